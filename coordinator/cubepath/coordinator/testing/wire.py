"""The processes of a run under test, a link for each, and the rules that hold on all of them."""

import re
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
from cubepath.protocol.core.options import known_name, seconds as checked_seconds, whole_number
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, is_private

_OF_RULES = ("times", "after", "probability", "seed")
_OF_ACTIONS: dict[Action, tuple[str, ...]] = {
    "delay": ("seconds", "overtaken"),
    "double": ("seconds",),
    "hold": ("seconds",),
    "reorder": ("by",),
}
"""The other fields of each kind of rule."""
_PROCESS_LIKE = ("process_", "keeper_", "module_", COORDINATOR, "router")
Target: TypeAlias = str | int
"""A process by its name, or by the number of one of its modules."""
_MODULE = re.compile(r"module_(\d+)")
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


class Wire:
    """The processes of a run under test, ours and those of others, and their links, by name."""

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
        self._known: dict[str, int] = {}
        self._modules: dict[str, tuple[int, ...]] = {}

    # The processes.

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

    def name_of(self, target: Target) -> str:
        """Return the name of a process that is given by its name, or by one of its modules.

        InputError for a name or a module that is not there.
        """
        found = _MODULE.fullmatch(target) if isinstance(target, str) else None
        if isinstance(target, str) and found is None:
            known = *self._known, *sorted(self._speakers - self._known.keys())
            if not known:
                raise InputError(f"{target}: there is none, the run has not begun or has ended")
            return known_name("", target, known)
        module = int(found[1]) if found is not None else target
        self._check_module(module)
        for name, modules in self._modules.items():
            if module in modules:
                return name
        raise InputError(f"module_{module}: has no process of its own name, expected a name")

    @property
    def _speakers(self) -> set[str]:
        return {link.speaks_as for link in self.links.values()}

    def _check_module(self, module: object) -> None:
        if module is not None:
            whole_number("module", module, 0, len(self.run.scene.start) - 1)

    def _check_speaker(self, sender: str) -> None:
        known = {*self._known, *self._speakers, COORDINATOR} - {"router"}
        known_name("sender=", sender, sorted(known))

    def _is_region(self, name: str) -> bool:
        """Return whether a name may be that of a region or a tile."""
        scene = self.run.scene
        regions = map(scene.system.region, (*scene.start, *(scene.goal or ())))
        return _REGION.fullmatch(name) is not None or name in regions

    def _named(self, target: str | int | None) -> str | None:
        """Return the name of a process that is given by its name or one of its modules."""
        if target is None or (isinstance(target, str) and _MODULE.fullmatch(target) is None):
            return target
        return self.name_of(target)

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
        receivers = frozenset(link.speaks_as for link in self.links.values())
        rule = Rule(
            action=action, pattern=replace(pattern, sender=sender), upstream=receivers, **ours
        )
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
        """Remove all links, and tell the guard that all is well."""
        if self._guard is not None:
            around(self._guard.close)
        for link in self.links.values():
            around(link.close)
