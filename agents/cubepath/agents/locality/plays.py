"""What is played to find out whether a rule is local, and what comes of it.

All of it is plain data, which is pickled between processes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from cubepath.agents.local.observation import Note, Observation
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


@dataclass(frozen=True, slots=True)
class Conditions:
    """What surrounds a play and must not matter; numbers that differ stand for other surroundings.

    `trapped` is False where Python's functions are left as they are: then the clock, the process
    and the random numbers are those of the machine.
    """

    trapped: bool = True
    clock: int = 0
    random: int = 0
    process: int = 0
    environment: int = 0


@dataclass(frozen=True, slots=True)
class RuleChoice:
    """What a rule chose in a round or turn, or the type of the error that ended it."""

    action: int = 0
    note: Note | None = None
    failed: str | None = None
    error: str | None = None
    guards: tuple[Site, ...] | None = None
    heeds: tuple[Site, ...] | None = None
    exchanges: tuple[tuple[Site, Note], ...] | None = None

    def beside(self, other: RuleChoice) -> tuple[str, str]:
        """Return in words what differs between this choice and another."""
        for mine, yours, word in (
            (self.error, other.error, "error"),
            (self.action, other.action, "action"),
            (self.note, other.note, "note"),
            (self.failed, other.failed, "failed"),
            (self.guards, other.guards, "guards"),
            (self.heeds, other.heeds, "heeds"),
            (self.exchanges, other.exchanges, "exchanges"),
        ):
            if mine != yours:
                return _said(word, mine), _said(word, yours)
        return ("the same", "the same")


def _said(word: str, what: object) -> str:
    return f"no {word}" if what is None else f"{word} {what}"


@dataclass(frozen=True, slots=True)
class ModuleLife:
    """All that a module knew and saw in a run, and what it chose; a list has an entry a round.

    Under the free clock it has one for each turn of the module. `before` says for each how many
    rounds, or turns of any module, came before it. `key` is that of its stream. A rule that could
    not be made has one choice, the error, and saw nothing.
    """

    module: int
    modules: int
    start: Site
    goals: tuple[Site, ...]
    key: int
    observations: list[Observation] = field(default_factory=list)
    choices: list[RuleChoice] = field(default_factory=list)
    before: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class WholeRun:
    """A whole run in one process; `backwards` asks the module with the highest number first."""

    scene: Scene
    seed: int
    hesitate: float
    rounds: int
    backwards: bool = False


Setting: TypeAlias = Mapping[int, Site]
"""A world in a round: the site of each module that is there, by number."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is around a module in all rounds of its life.

    Numbers are those of the modules of this world; `goals` has the goals of each. The first of
    `settings` is where they start, the others are those of the rounds, from the first.
    """

    seed: int
    goals: Mapping[int, tuple[Site, ...]]
    settings: Sequence[Setting]


@dataclass(frozen=True, slots=True)
class ModuleReplay:
    """One module is asked again with what it saw, alone or among others in `surroundings`.

    The others are asked too, with what they see there; what they choose does not count.
    """

    scene: Scene
    life: ModuleLife
    surroundings: Surroundings | None = None


@dataclass(frozen=True, slots=True)
class FitQuestion:
    """Nothing is played: the rule is asked which of the scenes it is for."""

    specs: tuple[str, ...]


Play: TypeAlias = WholeRun | ModuleReplay | FitQuestion


@dataclass(frozen=True, slots=True)
class PlayTask:
    """A play for a process of its own, which it begins in an empty `folder`."""

    rule: str
    play: Play
    conditions: Conditions
    folder: str
    clock: str = "lockstep"


@dataclass(frozen=True, order=True, slots=True)
class OutsideAccess:
    """Something outside the module that the rule's code has used: what, and in which line."""

    kind: str
    what: str
    where: str


@dataclass(frozen=True, slots=True)
class PlayResult:
    """What came of a task.

    `sites` are where modules were before each round of a whole run, or each turn. `changed` names
    what the rule's file holds that is not as it was before the rules were made. `specs` are the
    scenes that it is for. `unfit` says why it is not for the scene, `broken` how the play itself
    came to an end; it is `late` if the rule gave no answer.
    """

    lives: dict[int, ModuleLife] = field(default_factory=dict)
    sites: list[tuple[Site, ...]] = field(default_factory=list)
    accesses: frozenset[OutsideAccess] = frozenset()
    changed: tuple[str, ...] = ()
    specs: tuple[str, ...] = ()
    unfit: str | None = None
    broken: str | None = None
    late: bool = False
