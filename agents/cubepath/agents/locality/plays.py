"""The plays that show whether a rule is local, and their results.

All of it is plain data, which is pickled between processes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass, field, fields, replace
from random import Random
from typing import TypeAlias

from cubepath.agents.local.observation import Observation
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System


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

    choice: Choice = field(default_factory=Choice)
    error: str | None = None

    @property
    def ends(self) -> bool:
        """Return whether the run ends with it."""
        return self.error is not None or self.choice.failed is not None

    def beside(self, other: RuleChoice) -> tuple[str, str]:
        """Return in words what differs between this choice and another."""
        mine, yours = self._parts(), other._parts()
        word = next(word for word in mine if mine[word] != yours[word])
        return _with_word(word, mine[word]), _with_word(word, yours[word])

    def _parts(self) -> dict[str, object]:
        own = {each.name: getattr(self.choice, each.name) for each in fields(self.choice)}
        return {"error": self.error, **own}


def _with_word(word: str, what: object) -> str:
    return f"no {word}" if what in (None, (), {}) else f"{word} {what}"


@dataclass(frozen=True, slots=True)
class ModuleLife:
    """All that a module saw in a run, and what it chose; a list has an entry a round.

    Under the free clock it has one for each turn of the module. `before` says for each how many
    rounds, or turns of any module, came before it. `seed` is that of the run. A rule that could not
    be made has one choice, the error, and saw nothing.
    """

    module: int
    seed: int
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
    """A play for a separate process, which it begins in an empty `folder`."""

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
    """The result of a task.

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


_WALK = 6
"""A module is put where this many moves could have taken it, whatever is in the way."""
_TRIES = 4
_VAIN_MAX = 50
"""How many are tried where modules cannot stand by themselves, as diagonals of a triangulation."""
_ADDED = 2
_SEEDS = 1 << 32


def surrounding_scene(
    scene: Scene, setting: Setting, goals: Mapping[int, tuple[Site, ...]]
) -> Scene:
    """Return the scene of a setting; InputError if modules cannot stand together like that."""
    numbers = sorted(setting)
    return replace(
        scene,
        start=tuple(setting[number] for number in numbers),
        goal=None,
        goals=tuple(goals[number] for number in numbers) if any(goals.values()) else (),
    )


def within_reach(system: System, place: Site) -> frozenset[Site]:
    """Return the places of which a module at `place` may know: sensed, or heard from."""
    sensed = (near for near in system.sensed(place) if near is not None)
    return frozenset([place, *sensed, *system.reach(place)])


class ChangedWorlds:
    """Makes surroundings for one module of a run, from a source of random choices.

    `sites` are those of all modules before each round or turn of the run.
    """

    def __init__(
        self, scene: Scene, life: ModuleLife, sites: Sequence[Sequence[Site]], random: Random
    ) -> None:
        """Change nothing yet; `count` says how many sites were changed, over all rounds."""
        self.count = 0
        self._scene, self._own, self._random = scene, life.module, random
        self._vain = 0
        self._place_of = scene.system.place_of
        self._rows = [sites[0], *(sites[number] for number in life.before)]
        self._others = [n for n in range(len(scene.start)) if n != self._own]
        self._goals: dict[int, tuple[Site, ...]] = {}

    def elsewhere(self) -> Surroundings:
        """Return surroundings with as many modules.

        Those beyond reach stand elsewhere, all others have other numbers and goals, and the seed
        is another.
        """
        was, wants = self._shuffled(), self._shuffled()
        goals = self._scene.goals
        self._goals = {number: goals[wants[number]] if goals else () for number in was}
        settings = [self._moved({number: row[was[number]] for number in was}) for row in self._rows]
        return self._made(settings)

    def fewer_and_more(self) -> Surroundings:
        """Return surroundings where some modules beyond reach are missing, and others are there."""
        gone = set(self._random.sample(self._others, (len(self._others) + 1) // 2))
        new = [len(self._scene.start) + number for number in range(_ADDED)]
        self._goals = dict(enumerate(self._scene.goals)) or dict.fromkeys(range(new[0]), ())
        self._goals |= dict.fromkeys(new, ())
        return self._made([self._replaced(row, gone, new) for row in self._rows])

    def _made(self, settings: list[Setting]) -> Surroundings:
        return Surroundings(self._random.randrange(_SEEDS), self._goals, settings)

    def _shuffled(self) -> dict[int, int]:
        """Return another number for each of the others."""
        numbers = self._random.sample(self._others, len(self._others))
        return {self._own: self._own} | dict(zip(self._others, numbers, strict=True))

    def _near(self, setting: Setting) -> frozenset[Site]:
        return within_reach(self._scene.system, self._place_of(setting[self._own]))

    def _moved(self, setting: Setting) -> Setting:
        near = self._near(setting)
        found = dict(setting)
        for number, site in setting.items():
            if self._place_of(site) not in near:
                found = self._put(found, number, site, near)
        return found

    def _replaced(self, row: Sequence[Site], gone: AbstractSet[int], new: Sequence[int]) -> Setting:
        whole = dict(enumerate(row))
        near = self._near(whole)
        found = {
            number: site
            for number, site in whole.items()
            if number not in gone or self._place_of(site) in near
        }
        if not self._is_scene(found):
            return whole
        self.count += len(whole) - len(found)
        far = [site for site in row if self._place_of(site) not in near]
        for number in new if far else ():
            found = self._put(found, number, self._random.choice(far), near)
        return found

    def _put(
        self, setting: dict[int, Site], number: int, site: Site, near: frozenset[Site]
    ) -> dict[int, Site]:
        """Return the setting with a module some moves from `site`, beyond reach, if that can be."""
        taken = {self._place_of(other) for each, other in setting.items() if each != number}
        for _ in range(_TRIES if self._vain < _VAIN_MAX else 0):
            there = site
            for _ in range(self._random.randint(1, _WALK)):
                ways = [move.target for move in self._scene.system.moves(there) if move is not None]
                there = self._random.choice(ways) if ways else there
            found = {**setting, number: there}
            place = self._place_of(there)
            if place not in near and place not in taken and self._is_scene(found):
                self.count += there != setting.get(number)
                return found
        return setting

    def _is_scene(self, setting: Setting) -> bool:
        try:
            surrounding_scene(self._scene, setting, self._goals)
        except InputError:
            self._vain += 1
            return False
        return True
