"""What a test does to a run: processes killed, paused and cut off, messages lost, when it says."""

from __future__ import annotations

import os
import re
import signal
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.testing.commands import Command, Guard
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import SECONDS_MAX, Action, Pattern, Rule
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name, seconds as seconds_of, whole_number
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, is_private

_MODULE = re.compile(r"module_(\d+)")

When: TypeAlias = "Pattern | str | int | None"
"""Now (None), in a round or at a level, or at the first message of a kind or a pattern."""
Who: TypeAlias = "str | int"
"""A process by its name, or by the number of one of its modules."""


_OF_RULES = ("times", "after", "probability", "seed")
_OF_ACTIONS: dict[Action, tuple[str, ...]] = {
    "delay": ("seconds", "overtaken"),
    "double": ("seconds",),
    "hold": ("seconds",),
}
"""What else each kind of rule is told."""
_PROCESS_LIKE = ("process_", "keeper_", "module_", COORDINATOR, "router")
_REGION = re.compile(r"-?\d+(,-?\d+)*")


@dataclass(slots=True, eq=False, repr=False)
class PlannedFault:
    """Something that happens now, or when a message comes; `at` is that message, once it has."""

    pattern: Callable[[WireMessage], bool]
    act: Callable[[], None]
    at: WireMessage | None = None
    done: bool = False

    def do(self, at: WireMessage | None = None) -> None:
        """Have it happen."""
        self.at, self.done = at, True
        self.act()

    def __repr__(self) -> str:
        """Return whether it has happened, and at which message."""
        at = "" if self.at is None else f" at {self.at.kind} of {self.at.sender}"
        return f"<planned: done{at}>" if self.done else "<planned: to come>"


class ProcessFaults:
    """The processes of a run under test, ours and those of others, with their links, by name."""

    run: Run
    commands: dict[str, Command]

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Put links before all processes, none, or those of these names; InputError for others."""
        ill = not isinstance(links, bool | Collection)  # pyright: ignore[reportUnnecessaryIsInstance]
        if ill or isinstance(links, str):
            raise InputError(f"links={links!r}: expected True, False, or a list of processes")
        self._wanted = links
        self.links: dict[str, LinkProxy] = {}
        self._guard: Guard | None = None
        self._planned: list[PlannedFault] = []
        self._wounded: set[str] = set()
        self._paused: dict[str, int] = {}
        self._timers: dict[tuple[str, str], threading.Timer] = {}
        self._known: dict[str, int] = {}
        self._modules: dict[str, tuple[int, ...]] = {}

    # Who there is.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name, those of commands included; none of a run that ended.

        One of the run's own that has died is there until the run has noticed.
        """
        found: dict[str, int] = {}
        with suppress(CubepathError):
            found = self.run.pids
        return found | {
            name: command.pid
            for name, command in self.commands.items()
            if command.returncode is None
        }

    def name_of(self, who: Who) -> str:
        """Return the name of a process that is given by its name, or by one of its modules.

        InputError for a name or a module that is not there.
        """
        found = _MODULE.fullmatch(who) if isinstance(who, str) else None
        if isinstance(who, str) and found is None:
            return known_name("", who, (*self._known, *self._speakers - self._known.keys()))
        module = int(found[1]) if found is not None else who
        self._check_module(module)
        for name, modules in self._modules.items():
            if module in modules:
                return name
        raise InputError(f"module_{module}: has no process of its own name, expected a name")

    @property
    def _speakers(self) -> set[str]:
        return {link.speaks_as for link in self.links.values()}

    def _check_module(self, module: object) -> None:
        most = len(self.run.scene.start) - 1
        if module is not None and whole_number("module", module, 0) > most:
            raise InputError(f"module_{module}: expected module_0 to module_{most}")

    def _check_speaker(self, sender: str) -> None:
        known = {*self._known, *self._speakers, COORDINATOR} - {"router"}
        known_name("sender=", sender, sorted(known))

    def _is_region(self, name: str) -> bool:
        scene = self.run.scene
        regions = map(scene.system.region, (*scene.start, *(scene.goal or ())))
        return _REGION.fullmatch(name) is not None or name in regions

    def _named(self, who: str | int | None) -> str | None:
        if who is None or (isinstance(who, str) and _MODULE.fullmatch(who) is None):
            return who
        return self.name_of(who)

    # What happens to messages.

    @property
    def guard(self) -> Guard:
        """Return what ends everything if this process is killed."""
        if self._guard is None:
            self._guard = Guard()
        return self._guard

    def way(self, name: str, endpoint: str, credentials: Credentials) -> tuple[str, Credentials]:
        """Return where a process finds the router: at its link, if it is to have one."""
        wanted = self._wanted
        if name not in self.links and not (wanted if isinstance(wanted, bool) else name in wanted):
            return endpoint, credentials
        if name not in self.links:  # one that is started again has its link already
            link = self.links[name] = LinkProxy(name, endpoint, credentials)
            if is_private(link.endpoint):
                self.guard.watch_folder(Path(link.endpoint.partition("/")[2]).parent)
        return self.links[name].endpoint, credentials

    def check_links(self, known: Collection[str]) -> None:
        """Check that there is a process for each link that was asked for; InputError if not."""
        for name in () if isinstance(self._wanted, bool) else self._wanted:
            known_name("links: ", name, known)

    def link_of(self, name: str) -> LinkProxy:
        """Return the link of a process; InputError if it has none."""
        for link in self.links.values():
            if name in (link.name, link.speaks_as):
                return link
        told = ", ".join(self.links) or "none"
        near = did_you_mean(name, self.links)
        raise InputError(f"{name}: has no link, the processes that have one: {told}{near}")

    def drop(self, what: What = "", **options: Any) -> Rule:
        """Lose messages.

        Which, say the keys of `Pattern`: `kind` (or `what`), `round`, `phase`, `module`, `sender`,
        `to`, `where`. How many, say those of `Rule`: `times`, `after`, `probability` with a `seed`.
        With `to` a message is lost on its way to that process, and others hear it; without, nobody
        does. Of what the coordinator says each process has a copy of its own.

        InputError for unknown kinds and keys, and processes without a link.
        """
        return self._rule("drop", what, options)

    def delay(self, seconds: float, what: What = "", **options: Any) -> Rule:
        """Have messages come later; those behind them wait, unless `overtaken`. Keys as `drop`."""
        return self._rule("delay", what, options | {"seconds": seconds})

    def double(self, what: What = "", *, seconds: float = 0.0, **options: Any) -> Rule:
        """Have messages come twice, the second time so many seconds later. Keys as `drop`."""
        return self._rule("double", what, options | {"seconds": seconds})

    def hold(self, what: What = "", *, seconds: float | None = None, **options: Any) -> Rule:
        """Hold messages back until the rule is released; others pass them. Keys as `drop`.

        With `seconds` it is released by itself, so long after the first message that it holds.
        """
        if seconds is not None:
            if seconds_of("seconds", seconds, SECONDS_MAX) == 0:
                raise InputError("seconds=0: expected more than 0, or rule.release()")
            options["seconds"] = seconds
        return self._rule("hold", what, options)

    def _rule(self, action: Action, what: What, options: dict[str, Any]) -> Rule:
        own = (*_OF_RULES, *_OF_ACTIONS.get(action, ()))
        ours = {key: options.pop(key) for key in own if key in options}
        strange = options.keys() - set(Pattern.__slots__)
        if strange:
            known_name("", min(strange), (*Pattern.__slots__, *own))
        for key in options.keys() & {"sender", "to"}:
            options[key] = self._named(options[key])
        pattern = pattern_of(what, **options)
        self._check_module(pattern.module)
        if not self.links:
            raise InputError(f"{action}: no process has a link, expected links=True")
        to, sender = self._named(pattern.to), self._speaks_as(self._named(pattern.sender))
        if to is not None and (to in self.links or to.startswith(_PROCESS_LIKE)):
            pattern = replace(pattern, to=None, sender=sender)
            if sender is not None:
                self._check_speaker(sender)
            return self.link_of(to).add(Rule(action=action, pattern=pattern, **ours), ("down",))
        if to is not None and not self._is_region(to):
            raise InputError(
                f"to={to}: expected a process, a region or a tile{did_you_mean(to, self.links)}"
            )
        if sender not in (None, COORDINATOR):
            self.link_of(str(sender))  # what it says is met there alone
        told = frozenset(link.speaks_as for link in self.links.values())
        rule = Rule(action=action, pattern=replace(pattern, sender=sender), told=told, **ours)
        for link in self.links.values():
            link.add(rule)
        return rule

    def _speaks_as(self, name: str | None) -> str | None:
        """Return the name in keys of a process that is given by that of its link."""
        return self.links[name].speaks_as if name in self.links else name

    def clear(self) -> None:
        """Take all rules away, and heal all links."""
        for link in self.links.values():
            link.clear()

    def close_links(self, around: Callable[[Callable[[], None]], object]) -> None:
        """Have all links taken away, and the guard told that all is well."""
        if self._guard is not None:
            around(self._guard.close)
        for link in self.links.values():
            around(link.close)

    # What is done to processes.

    def kill(self, who: Who, at: When = None) -> PlannedFault:
        """Kill a process, now, in a round or at a level, or at a message.

        A run with rounds ends by that: they tolerate pauses and loss, not death. Without rounds the
        others go on.
        """
        name = self.name_of(who)
        return self._do(at, lambda: self._signal(name, signal.SIGKILL))

    def pause(self, who: Who, at: When = None, *, seconds: float | None = None) -> PlannedFault:
        """Have a process stand still, for some seconds, or until it is resumed.

        With rounds nobody goes on meanwhile: without `seconds` the next round waits in vain.
        """
        name = self.name_of(who)
        if seconds is not None:
            seconds_of("seconds", seconds, SECONDS_MAX)

        def act() -> None:
            pid = self._pid(name)
            self._cancel("resume", name)
            self.guard.watch(pid)  # who stands still does not notice that all others have ended
            self._paused[name] = pid
            self._signal(name, signal.SIGSTOP)
            self._after(seconds, lambda: self._resume(name), "resume", name)

        return self._do(at, act)

    def _after(
        self, seconds: float | None, act: Callable[[], object], what: str, name: str
    ) -> None:
        """Have something happen to the one of a name, unless that is called off before."""
        if seconds is not None:
            timer = self._timers[what, name] = threading.Timer(seconds, act)
            timer.daemon = True
            timer.start()

    def _cancel(self, what: str, name: str) -> None:
        timer = self._timers.pop((what, name), None)
        if timer is not None:
            timer.cancel()

    def resume(self, who: Who, at: When = None) -> PlannedFault:
        """Have a process that was paused go on; no other is changed."""
        name = self.name_of(who)

        def act() -> None:
            self._cancel("resume", name)
            self._resume(name)

        return self._do(at, act)

    def _resume(self, name: str) -> None:
        pid = self._paused.pop(name, None)
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def cut_off(
        self, who: Who, at: When = None, *, seconds: float | None = None, keep: bool = False
    ) -> PlannedFault:
        """Cut the link of a process, for some seconds or until it is healed.

        Nothing gets through, and nobody is told. What is said meanwhile is lost; with `keep` it
        comes when the link is healed, as over a connection that outlives the cut.
        """
        link = self.link_of(self.name_of(who))
        if seconds is not None:
            seconds_of("seconds", seconds, SECONDS_MAX)

        def act() -> None:
            self._cancel("heal", link.name)
            link.cut(keep=keep)
            self._after(seconds, link.heal, "heal", link.name)

        return self._do(at, act)

    def heal(self, who: Who | None = None, at: When = None) -> PlannedFault:
        """Heal the link of a process, or all links."""
        links = [self.link_of(self.name_of(who))] if who is not None else [*self.links.values()]

        def act() -> None:
            for link in links:
                self._cancel("heal", link.name)
                link.heal()

        return self._do(at, act)

    def when(self, at: When, act: Callable[[], None]) -> PlannedFault:
        """Have a function called in a round or at a level, or at a message; it may not go on."""
        return self._do(at, act)

    def _do(self, at: When, act: Callable[[], None]) -> PlannedFault:
        if not callable(act):
            raise InputError(f"{act!r}: expected a function")
        if at is None:
            now = PlannedFault(lambda _: False, act)
            now.do()
            return now
        if isinstance(at, int):
            whole_number("at", at, 0)
            return self._plan(lambda seen: (seen.round or 0) >= at, act)
        return self._plan(pattern_of(at).holds, act)

    def _plan(
        self, pattern: Callable[[WireMessage], bool], act: Callable[[], None]
    ) -> PlannedFault:
        planned = PlannedFault(pattern, act)
        self._planned.append(planned)
        return planned

    def _pid(self, name: str) -> int:
        pids = self.pids
        if name not in pids:
            left = f"expected one of {', '.join(pids)}" if pids else "the run has ended"
            raise InputError(f"{name}: has no process any more, {left}")
        return pids[name]

    def _signal(self, name: str, number: int) -> None:
        if number == signal.SIGKILL:
            self._wounded.add(name)
        if name in self.commands:
            self.commands[name].signal(number)
        else:
            os.kill(self._pid(name), number)
