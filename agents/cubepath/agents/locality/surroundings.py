"""Other worlds that look the same to one module: what is beyond its reach is changed.

A module senses some places and hears notes from some; whatever stands elsewhere, what numbers and
goals the others have, and which seed the run has, is not for it to know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set as AbstractSet
from dataclasses import replace
from random import Random

from cubepath.agents.locality.plays import ModuleLife, Setting, Surroundings
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

_WALK = 6
"""A module is put where so many moves could have taken it, whoever is in the way."""
_TRIES = 4
_VAIN_MAX = 50
"""Where modules cannot stand by themselves, as diagonals of a triangulation, so many are tried."""
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
        self._scene, self._life, self._random = scene, life, random
        self._vain = 0
        self._place_of = scene.system.place_of
        self._rows = [sites[0], *(sites[number] for number in life.before)]
        self._others = [n for n in range(len(scene.start)) if n != life.module]
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
        own = self._life.module
        return {own: own} | dict(zip(self._others, numbers, strict=True))

    def _near(self, setting: Setting) -> frozenset[Site]:
        return within_reach(self._scene.system, self._place_of(setting[self._life.module]))

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
