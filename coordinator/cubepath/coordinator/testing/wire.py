"""The processes under test, a link for each, and the rules that hold on all of them."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.testing.commands import Command, Guard
from cubepath.coordinator.testing.link import LinkProxy, Tap
from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import SECONDS_MAX, Action, Direction, Pattern, Rule
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name, seconds as checked_seconds
from cubepath.protocol.wire.credentials import Credentials, is_private

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
    """Processes and their links, by name."""

    commands: dict[str, Command]
    keys: tuple[str, ...] = tuple(Pattern.__slots__)
    """What of a `Pattern` may be given."""
    _tap: Tap | None = None

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Put links before all processes, none, or those of these names; InputError for others."""
        ill = not isinstance(links, bool | Collection)  # pyright: ignore[reportUnnecessaryIsInstance]
        if ill or isinstance(links, str):
            raise InputError(f"links={links!r}: expected True, False, or a list of processes")
        self._wanted = links
        self.links: dict[str, LinkProxy] = {}
        self._guard: Guard | None = None
        self._known: dict[str, int] = {}

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
        strange = options.keys() - set(self.keys)
        if strange:
            known_name("", min(strange), (*self.keys, *own))
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
