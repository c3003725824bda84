"""What a test does to processes: it kills, pauses and cuts them off, now or at a message."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Collection
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.testing.commands import Command, Guard, stderr_of
from cubepath.coordinator.testing.link import LinkProxy, Tap
from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import SECONDS_MAX, Action, Direction, Pattern, Rule
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name, seconds as checked_seconds, whole_number
from cubepath.protocol.wire.credentials import Credentials, is_private

When: TypeAlias = "Pattern | str | int | None"
"""Now (None), in a round or at a level, or at the first message of a kind, key or pattern."""
_OF_RULES = ("times", "after", "probability", "seed")
_OF_ACTIONS: dict[Action, tuple[str, ...]] = {
    "delay": ("seconds", "overtaken"),
    "double": ("seconds",),
    "hold": ("seconds",),
    "reorder": ("by",),
}
"""The other fields of each kind of rule."""
Target: TypeAlias = str | int
"""A process by its name, or in runs by the number of one of its modules."""


@dataclass(slots=True, eq=False, repr=False)
class PlannedFault:
    """Something that happens now, or when a message comes; `at` is that message, once it has."""

    pattern: Callable[[WireMessage], bool]
    act: Callable[[], object]
    at: WireMessage | None = None
    done: bool = False

    def do(self, at: WireMessage | None = None) -> None:
        """Have it happen."""
        self.at, self.done = at, True
        self.act()

    def __repr__(self) -> str:
        """Return whether it has happened, and at which message."""
        what = self.at and (self.at.kind if self.at.link is None else self.at.key)
        at = "" if self.at is None else f" at {what} of {self.at.sender}"
        return f"<planned: done{at}>" if self.done else "<planned: to come>"


class ProcessFaults:
    """Processes and their links by name, and what a test can do to them."""

    commands: dict[str, Command]
    _tap: Tap | None = None
    _of_patterns: tuple[str, ...] = tuple(Pattern.__slots__)

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Put links before all processes, none, or those of these names; InputError for others."""
        ill = not isinstance(links, bool | Collection)  # pyright: ignore[reportUnnecessaryIsInstance]
        if ill or isinstance(links, str):
            raise InputError(f"links={links!r}: expected True, False, or a list of processes")
        self._wanted = links
        self.links: dict[str, LinkProxy] = {}
        self._guard: Guard | None = None
        self._known: dict[str, int] = {}
        self._modules: dict[str, tuple[int, ...]] = {}
        self._planned: list[PlannedFault] = []
        self._faults: list[tuple[str, Rule | PlannedFault]] = []
        self._wounded: set[str] = set()
        self._paused: dict[str, int] = {}
        self._timers: dict[tuple[str, str], threading.Timer] = {}
        self._raised: Exception | None = None
        self._noticing = threading.RLock()
        self._notices_in = 0
        """The thread in which something happens at a message, which others wait for."""

    # The processes.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids of the commands that run, by name."""
        return {
            name: command.pid
            for name, command in self.commands.items()
            if command.returncode is None
        }

    def name_of(self, target: Target) -> str:
        """Return the name of a process that is there; InputError for another."""
        return known_name("", target, sorted({*self.pids, *self.links}))

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
            link = self.links[name] = LinkProxy(name, endpoint, credentials, tap=self._tap)
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
        names = ", ".join(self.links) or "none"
        near = did_you_mean(name, self.links)
        raise InputError(f"{name}: has no link, the processes that have one: {names}{near}")

    def drop(self, what: What = "", **options: Any) -> Rule:
        """Lose messages.

        Which, say the keys of `Pattern`: `kind` (or `what`), `round`, `phase`, `module`, `sender`,
        `to`, `where`. How many, say those of `Rule`: `times`, `after`, `probability` with a `seed`.
        With `to` a message is lost on its way to that process, and others hear it; without, nobody
        does. Of what the coordinator says each process has its own copy.

        InputError for unknown kinds and keys, and processes without a link.
        """
        return self._rule("drop", what, options)

    def delay(self, seconds: float, what: What = "", **options: Any) -> Rule:
        """Have messages come later; those behind them wait, unless `overtaken`. Keys as `drop`."""
        return self._rule("delay", what, options | {"seconds": seconds})

    def double(self, what: What = "", *, seconds: float = 0.0, **options: Any) -> Rule:
        """Have messages come twice, the second time this many seconds later. Keys as `drop`."""
        return self._rule("double", what, options | {"seconds": seconds})

    def hold(self, what: What = "", *, seconds: float | None = None, **options: Any) -> Rule:
        """Hold messages back until the rule is released; others pass them. Keys as `drop`.

        With `seconds` it is released by itself, this long after the first message that it holds.
        """
        if seconds is not None:
            if checked_seconds("seconds", seconds, SECONDS_MAX) == 0:
                raise InputError("seconds=0: expected more than 0, or rule.release()")
            options["seconds"] = seconds
        return self._rule("hold", what, options)

    def reorder(self, what: What = "", *, by: int = 1, **options: Any) -> Rule:
        """Have messages overtaken by this many that come after them. Keys as `drop`."""
        return self._rule("reorder", what, options | {"by": by})

    def _rule(self, action: Action, what: What, options: dict[str, Any]) -> Rule:
        own = (*_OF_RULES, *_OF_ACTIONS.get(action, ()))
        ours = {key: options.pop(key) for key in own if key in options}
        strange = options.keys() - set(self._of_patterns)
        if strange:
            known_name("", min(strange), (*self._of_patterns, *own))
        pattern = self._pattern(what, **options)
        return self._place(pattern, action=action, **ours)

    def _pattern(self, what: What = "", **options: Any) -> Pattern:
        return pattern_of(what, **options)

    def _place(self, pattern: Pattern, **rule: Any) -> Rule:
        """Add a rule at the link of its receiver, else of its sender, else at all."""
        made = Rule(pattern=pattern, **rule)
        way: Direction = "up" if pattern.to is None else "down"
        end = pattern.sender if pattern.to is None else pattern.to
        for link in self.links.values() if end is None else [self.link_of(end)]:
            link.add(made, (way,))
        self._faults.append((str(made), made))
        return made

    def clear(self) -> None:
        """Take all rules away, and heal all links."""
        for link in self.links.values():
            link.clear()

    def close_links(self, around: Callable[[Callable[[], None]], object]) -> None:
        """Remove all links, and tell the guard that all is well."""
        if self._guard is not None:
            around(self._guard.close)
        for link in self.links.values():
            around(link.close)

    # What is done to them.

    def kill(self, target: Target, at: When = None) -> PlannedFault:
        """Kill a process, now, in a round or at a level, or at a message.

        A run with rounds ends by that: they tolerate pauses and loss, not death. Without rounds the
        others continue.
        """
        name = self.name_of(target)

        def act() -> None:
            self._signal(name, signal.SIGKILL)
            self._note(f"{name} killed")

        return self._do(at, act, f"kill {name}")

    def pause(
        self, target: Target, at: When = None, *, seconds: float | None = None
    ) -> PlannedFault:
        """Have a process stand still, for some seconds, or until it is resumed.

        With rounds no other process continues meanwhile: without `seconds` the next round waits in
        vain.
        """
        name = self.name_of(target)
        if seconds is not None:
            checked_seconds("seconds", seconds, SECONDS_MAX)

        def act() -> None:
            pid = self._pid(name)
            self._cancel("resume", name)
            self.guard.watch(pid)  # who stands still does not notice that all others have ended
            self._paused[name] = pid
            self._signal(name, signal.SIGSTOP)
            self._note(f"{name} paused")
            self._after(seconds, lambda: self._resume(name), "resume", name)

        return self._do(at, act, f"pause {name}")

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

    def resume(self, target: Target, at: When = None) -> PlannedFault:
        """Have a process that was paused continue; no other is changed."""
        name = self.name_of(target)

        def act() -> None:
            self._cancel("resume", name)
            self._resume(name)

        return self._do(at, act, f"resume {name}")

    def _resume(self, name: str) -> None:
        pid = self._paused.pop(name, None)
        if pid is not None:
            self._note(f"{name} resumed")
        if pid is not None and name in self.commands:
            self.commands[name].signal(signal.SIGCONT)
        elif pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def cut_off(
        self, target: Target, at: When = None, *, seconds: float | None = None, keep: bool = False
    ) -> PlannedFault:
        """Cut the link of a process, for some seconds or until it is healed.

        Nothing gets through, and neither side is notified. Messages sent meanwhile are lost; with
        `keep` it comes when the link is healed, as over a connection that outlives the cut.
        """
        link = self.link_of(self.name_of(target))
        if seconds is not None:
            checked_seconds("seconds", seconds, SECONDS_MAX)

        def act() -> None:
            self._cancel("heal", link.name)
            link.cut(keep=keep)
            self._note(f"{link.name} cut off")
            self._after(seconds, lambda: self._heal(link), "heal", link.name)

        return self._do(at, act, f"cut off {link.name}")

    def _heal(self, link: LinkProxy) -> None:
        self._note(f"{link.name} healed")
        link.heal()

    def heal(self, target: Target | None = None, at: When = None) -> PlannedFault:
        """Heal the link of a process, or all links."""
        links = (
            [self.link_of(self.name_of(target))] if target is not None else [*self.links.values()]
        )

        def act() -> None:
            for link in links:
                self._cancel("heal", link.name)
                self._heal(link)

        return self._do(at, act, f"heal {', '.join(link.name for link in links)}")

    def when(self, at: When, act: Callable[[], object]) -> PlannedFault:
        """Have a function called in a round or at a level, or at a message; it may not continue."""
        return self._do(at, act, "call a function")

    def _note(self, done: str) -> None:
        """Note what was done to a process; a network has it in its log."""

    def _do(self, at: When, act: Callable[[], object], what: str) -> PlannedFault:
        if not callable(act):
            raise InputError(f"{act!r}: expected a function")
        if at is None:
            now = PlannedFault(lambda _: False, act)
            now.do()
            return now
        if isinstance(at, int):
            whole_number("at", at, 0)
            return self._plan(lambda seen: (seen.round or 0) >= at, act)
        pattern = self._pattern(at)
        planned = self._plan(pattern.holds, act)
        self._faults.append((f"{what} at {pattern}", planned))
        return planned

    def _plan(
        self, pattern: Callable[[WireMessage], bool], act: Callable[[], object]
    ) -> PlannedFault:
        planned = PlannedFault(pattern, act)
        self._planned.append(planned)
        return planned

    def _notice(self, seen: WireMessage) -> None:
        """Have that happen which was planned for a message."""
        with self._noticing:
            self._notices_in = threading.get_ident()
            for planned in tuple(self._planned):
                try:
                    if not planned.done and planned.pattern(seen):
                        self._planned.remove(planned)
                        planned.do(seen)
                except Exception as error:  # noqa: BLE001 - the test's, and no end of what runs
                    self._raised = self._raised or error
            self._notices_in = 0

    def _raise_again(self) -> None:
        """Raise what something that was planned has raised."""
        error, self._raised = self._raised, None
        if error is not None:
            raise error

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

    def close(self, *, check: bool = False) -> None:
        """End everything: rules, pauses, the run, the commands, the links.

        With `check`, CheckError if a rule raised or a link had too much to carry, and what was
        raised by something that the test has planned.
        """
        with ExitStack() as stack:
            if check:
                stack.callback(self._raise_again)
                for link in self.links.values():
                    stack.callback(link.check)
            self.close_links(stack.callback)
            for command in self.commands.values():
                stack.callback(command.close)
            stack.callback(self._end)
            for name in list(self._paused):
                stack.callback(self.resume, name)
            for timer in list(self._timers):
                stack.callback(self._cancel, *timer)

    def _end(self) -> None:
        """End what is neither a command nor a link."""

    def about(self, name: str, pid: int) -> str:
        """Return how a process is, in a line."""
        paused = " paused," if name in self._paused else ""
        is_there = self.pids.get(name) == pid
        command = self.commands.get(name)
        code = f" ({command.returncode})" if command is not None else ""
        how = f"process id {pid}" if is_there else f"process id {pid}, has ended{code}"
        modules = self._modules.get(name, ())
        whose = f", modules {', '.join(map(str, modules))}" if modules else ""
        cut = name in self.links and self.links[name].up.cut
        link = f", its link is cut ({cut})" if cut else ""
        output = command.last_lines if command is not None else stderr_of(pid) if is_there else ""
        about = f"{name}:{paused} {how}{whose}{link}"
        return about + (f"; {output}" if output else "")
