"""Two keepers and three modules that attempt and enter in any order, over a bad network."""

from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import LEASE_TICKS_MAX, Keeper
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Attempt, Decision, Entered, EnterRequest
from exploration.keeper_seats import check_keeper
from exploration.keeper_world import Dealt, Letter, letters_of

SCENE = replace(scene_from_spec("agv:graph=grid2x3,n=3"), goal=None, goals=())
SYSTEM, MODULES, KEEPERS = SCENE.system, range(len(SCENE.start)), range(2)
PLACES = [(x, y) for x in range(2) for y in range(3)]
TILES = Dealt(SYSTEM, {place: number % 2 for number, place in enumerate(PLACES)})
KINDS = (
    *("attempt", "attempt", "note", "enter"),
    *("deliver",) * 6,
    *("double", "lose", "tick", "crash"),
)


class Any3:
    """The keepers, what is under way, and what modules know."""

    def __init__(self) -> None:
        self.journals = [MemoryJournal() for _ in KEEPERS]
        self.keepers = [Keeper(me, SCENE, TILES, self.journals[me]) for me in KEEPERS]
        self.under_way: list[Letter] = []
        self.asked: dict[int, Attempt | None] = dict.fromkeys(MODULES)
        self.epoch = dict.fromkeys(MODULES, 0)
        self.number = dict.fromkeys(MODULES, 0)
        self.incarnation = dict.fromkeys(MODULES, 0)

    def step(self, kind: str, who: int, which: int) -> None:  # noqa: C901 - a case for each kind
        match kind:
            case "attempt" | "note":
                self.attempt(who, which, note=kind == "note")
            case "enter":
                self.incarnation[who] += which % 2
                for each in self.keepers:
                    each.ask(who, EnterRequest(who, self.incarnation[who]))
            case "deliver" | "double" | "lose" if self.under_way:
                number = which % len(self.under_way)
                letter = self.under_way[number]
                if kind != "double":
                    del self.under_way[number]
                if kind != "lose":
                    self.deliver(letter)
            case "tick":
                for _ in range(1 + which % 12):
                    self.keepers[who % 2].tick()
            case "crash":
                self.keepers[who % 2] = Keeper(who % 2, SCENE, TILES, self.journals[who % 2])
            case _:
                pass
        for each in self.keepers:
            self.under_way += letters_of(each)
            check_keeper(each)

    def attempt(self, module: int, which: int, *, note: bool) -> None:
        attempt = self.asked[module]
        if attempt is None:
            attempt = self.asked[module] = self.begun(module, which, note=note)
        if attempt is not None:
            units = [*(unit for unit, _ in attempt.sensed), *(at for at, *_ in attempt.notes)]
            first = min(TILES.keeper_of(unit) for unit in units)
            self.keepers[first].ask(module, attempt)

    def begun(self, module: int, which: int, *, note: bool) -> Attempt | None:
        on = {place: known for place in PLACES if (known := self.shown(place)) is not None}
        sites = [place for place, known in on.items() if known == module]
        if not sites:
            return None  # under way between keepers
        (site, *_) = sites
        name = module, self.epoch[module], self.number[module] + 1, 0, site
        if note:
            near = sorted({site, *SYSTEM.reach(site)}, key=str)
            other = near[which % len(near)]
            notes = {site: None, other: [which]} if other in on else {site: [which]}
            listed: list[tuple[Site, list[int], list[int] | None]] = [
                (at, self.note(at), new) for at, new in sorted(notes.items(), key=str)
            ]
            return Attempt(*name, notes=listed)
        moves = [
            each for each in SYSTEM.moves(site) if each is not None and each.possible(on.keys())
        ]
        if not moves:
            return None
        move = moves[which % len(moves)]
        near = sorted(each for each in SYSTEM.sensed(site) if each is not None)  # type: ignore[type-var]
        guards = [each for at, each in enumerate(near) if which >> at & 1]
        units = sorted({site, move.target, *guards}, key=str)
        sensed: list[tuple[Site, Site | None]] = [
            (unit, unit if unit in on else None) for unit in units
        ]
        return Attempt(*name, move.generator, move.at, sensed)

    def shown(self, place: Site) -> int | None:
        occupant = self.keepers[TILES.keeper_of(place)].units.occupant(place)
        return None if occupant is None else occupant.module

    def note(self, place: Site) -> list[int]:
        occupant = self.keepers[TILES.keeper_of(place)].units.occupant(place)
        return [] if occupant is None else list(occupant.note)

    def deliver(self, letter: Letter) -> None:
        part = letter.part
        if letter.to >= 0:
            self.keepers[letter.to].hear(letter.sender, part)  # type: ignore[arg-type]
        elif isinstance(part, Decision):
            asked = self.asked[part.module]
            if asked is not None and (asked.epoch, asked.number) == (part.epoch, part.number):
                self.asked[part.module], self.number[part.module] = None, part.number
        elif (
            isinstance(part, Entered) and part.incarnation == self.incarnation[part.occupant.module]
        ):
            module = part.occupant.module
            if part.occupant.epoch > self.epoch[module]:
                self.epoch[module], self.number[module] = part.occupant.epoch, 0
                self.asked[module] = None

    def come_to_rest(self) -> None:
        """Nothing is lost any more, and time goes by."""
        for _ in range(3 * LEASE_TICKS_MAX):
            while self.under_way:
                self.step("deliver", 0, 0)
            if not any(keeper.busy for keeper in self.keepers):
                return
            for who in KEEPERS:
                self.step("tick", who, 0)
        raise AssertionError("something stays under way")


def _come_through(seed: int, steps: int) -> None:
    random, world = Random(seed), Any3()  # noqa: S311 - to be repeated
    for _ in range(steps):
        world.step(random.choice(KINDS), random.choice(MODULES), random.randrange(1 << 16))
    world.come_to_rest()
    for keeper in world.keepers:
        assert not keeper._waiting
        assert not keeper._exclusive
        assert not keeper._shared
    here = [module for place in PLACES if (module := world.shown(place)) is not None]
    assert sorted(here) == [*MODULES]


SEEDS, STEPS = st.integers(0, (1 << 32) - 1), st.integers(1, 80)
"""Lists of steps as hypothesis makes them are mostly too short for three to meet."""


@pytest.mark.slow
@settings(max_examples=100)
@given(SEEDS, STEPS)
def test_locks_are_those_of_what_is_prepared_and_nobody_waits_for_nothing(
    seed: int, steps: int
) -> None:
    """After each step, whatever is doubled, lost, late or forgotten; and all comes to an end."""
    _come_through(seed, steps)


@pytest.mark.nightly
@settings(max_examples=1000)
@given(SEEDS, STEPS)
def test_that_holds_in_a_thousand_orders(seed: int, steps: int) -> None:
    """The same, more often."""
    _come_through(seed, steps)
