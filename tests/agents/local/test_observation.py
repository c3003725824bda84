"""Observations: what is seen is local, and reading it back loses nothing."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import (
    SILENT,
    checked_note,
    chosen_move,
    goal_sets,
    is_legal,
    observation_length,
    observe,
    view_of,
)
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from samples.space import SPACE

SPECS = [
    "hex:n=6",
    "hex-open:n=5",
    "arm:n=5",
    "agv:graph=grid4x4,n=6",
    "agv:graph=K5,n=3",
    "agv-labelled:graph=C6,n=4",
    "sliding:p=2,q=2,n=4",
    "arm-free:n=5",
    "arms:n=1",
    *SPACE,
]


class Nearby(Mapping[Site, Site]):
    """Occupants that may be asked for within a neighbourhood only."""

    def __init__(self, occupants: dict[Site, Site], near: set[Site]) -> None:
        self.occupants = occupants
        self.near = near

    def __getitem__(self, place: Site) -> Site:
        if place not in self.near:
            raise AssertionError(f"looked at {place!r}, which is beyond the sensing radius")
        return self.occupants[place]

    def __iter__(self) -> Iterator[Site]:
        raise AssertionError("looked at all occupants")

    def __len__(self) -> int:
        raise AssertionError("counted all occupants")


def worlds(spec: str) -> Iterator[World]:
    """Yield the world of a random run after each of its rounds."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=4)
    actors = actors_for(scene, RANDOM, seed=4, hesitate=0.0)
    for _ in range(15):
        yield world
        world.step({m: actor.act(world.observe(m)).action for m, actor in actors.items()})


@pytest.mark.parametrize("spec", SPECS)
def test_an_observation_looks_at_sensed_places_only(spec: str) -> None:
    """Asking for any place beyond the sensing radius would fail, and the result is the same."""
    for world in worlds(spec):
        system = world.scene.system
        occupants = {system.place_of(site): site for site in world.sites}
        for module, site in enumerate(world.sites):
            near = {place for place in system.sensed(system.place_of(site)) if place is not None}
            goals = frozenset(world.scene.goals[module])
            seen = observe(system, site, Nearby(occupants, near), goals=goals)
            whole = world.observe(module)
            assert all((seen[key] == whole[key]).all() for key in whole)


@pytest.mark.parametrize("spec", SPECS)
def test_what_is_far_changes_nothing(spec: str) -> None:
    """Taking away every module beyond the sensing radius leaves the observation as it was."""
    for world in worlds(spec):
        system = world.scene.system
        for module, site in enumerate(world.sites):
            near = set(system.sensed(system.place_of(site)))
            left = {system.place_of(s): s for s in world.sites if system.place_of(s) in near}
            goals = frozenset(world.scene.goals[module])
            seen = observe(system, site, left, goals=goals)
            whole = world.observe(module)
            assert all((seen[key] == whole[key]).all() for key in whole)


@pytest.mark.parametrize("spec", SPECS)
def test_the_mask_is_admissibility_in_the_whole_state(spec: str) -> None:
    """What the module can tell from its neighbourhood is what holds in the state as a whole."""
    for world in worlds(spec):
        system = world.scene.system
        state = set(world.sites) | system.filled
        for module, site in enumerate(world.sites):
            mask = world.observe(module)["action_mask"]
            assert mask[0] == 1
            for slot, move in enumerate(system.moves(site), 1):
                assert mask[slot] == (move is not None and move.possible(state))


@pytest.mark.parametrize("spec", SPECS)
def test_a_view_reads_the_observation_back(spec: str) -> None:
    """Site, occupied places and legal moves come out of the observation as they went in."""
    for world in worlds(spec):
        system = world.scene.system
        there = {system.place_of(site): site for site in (*world.sites, *system.filled)}
        for module, site in enumerate(world.sites):
            label = None if system.labels is None else module
            view = view_of(system, world.observe(module), label)
            assert view.site == site
            near = [place for place in system.sensed(view.place) if place in there]
            assert {p: system.site_at(p, code) for p, code in view.occupied.items()} == {
                place: there[place] for place in near
            }
            assert [action for action, _ in view.legal()] == [
                int(action) for action in view.mask.nonzero()[0] if action
            ]


@pytest.mark.parametrize("spec", SPECS)
def test_an_observation_has_the_shape_that_the_system_tells(spec: str) -> None:
    """The own site and its flag, two entries a slot, an action for each move; notes if there are.

    A slot where the system has no place shows that it is closed, and is no goal.
    """
    scene = scene_from_spec(spec)
    system, site = scene.system, scene.start[0]
    seen = observe(system, site, {}, goals=frozenset())
    numbers = seen["observation"]
    assert list(seen) == ["observation", "action_mask"]
    assert numbers.shape == (observation_length(system),)
    assert numbers.dtype == np.int32
    assert seen["action_mask"].shape == (system.move_slots + 1,)
    assert seen["action_mask"].dtype == np.int8
    size = system.site_size
    assert tuple(numbers[:size]) == system.encode_site(site)
    slots = numbers[size + 1 :].reshape(-1, 2).tolist()
    for near, shown in zip(system.sensed(system.place_of(site)), slots, strict=True):
        assert shown == [CLOSED if near is None else system.background(near), 0]
    notes = observe(system, site, {}, goals=frozenset(), note_length=3)["notes"]
    assert notes.shape == (system.reach_slots, 3)
    assert notes.dtype == np.int32
    assert (notes == SILENT).all()


def test_a_note_stands_in_the_slot_of_its_place() -> None:
    """And is read back from there; what nobody said is silent, whatever its length."""
    system = scene_from_spec("agv:graph=P4,n=1").system
    assert system.reach(1) == (0, 2, 3)
    said: dict[Site, tuple[int, ...]] = {0: (SILENT + 1, 5), 3: (-7, SILENT)}
    seen = observe(system, 1, {}, goals=frozenset(), notes=said, note_length=2)
    assert seen["notes"].tolist() == [[SILENT + 1, 5], [SILENT, SILENT], [-7, SILENT]]
    assert view_of(system, seen).notes == said


def test_a_view_tells_labels_and_moves() -> None:
    """The label of who stands at a sensed place, None of others; the moves, by slot."""
    system = scene_from_spec("agv-labelled:graph=P5,n=3").system
    seen = observe(system, (2, 1), {1: (1, 0), 2: (2, 1)}, goals=frozenset())
    view = view_of(system, seen, 1)
    assert (view.site, view.place, view.system) == ((2, 1), 2, system)
    assert [view.label_at(place) for place in range(5)] == [None, 0, None, None, None]
    assert view.moves == system.moves((2, 1))
    assert [(action, move.target) for action, move in view.legal()] == [(2, (3, 1))]
    assert view.mask.tolist() == [1, 0, 1]
    plain = scene_from_spec("agv:graph=P5,n=3").system
    seen = observe(plain, 2, {1: 1, 2: 2}, goals=frozenset())
    assert view_of(plain, seen).occupied == {1: 1}
    assert view_of(plain, seen).label_at(1) is None


def test_notes_are_heard_within_reach_and_by_place() -> None:
    """A note said in one round is heard in the next within reach, and not beyond."""
    scene = scene_from_spec("agv:graph=P6,n=3")
    world = World(scene, seed=0, note_length=2)
    assert view_of(scene.system, world.observe(0)).notes == {}
    world.step({2: 2}, {1: (7, 8), 2: (9, 10)})
    assert world.sites == [0, 1, 3]
    assert view_of(scene.system, world.observe(0)).notes == {1: (7, 8)}
    assert view_of(scene.system, world.observe(1)).notes == {0: (0, 0), 3: (9, 10)}


def test_modules_that_are_told_the_same_goals_share_one_set() -> None:
    """In a chain every module knows the whole goal: one set, also after a file; else one each."""
    chain = scene_from_spec("hex:n=40")
    for scene in (chain, scene_from_toml(scene_to_toml(chain), "text")):
        sets = goal_sets(scene)
        assert sets == tuple(map(frozenset, scene.goals))
        assert len({id(goals) for goals in sets}) == 1
    vehicles = scene_from_spec("agv:graph=grid4x4,n=5")
    assert goal_sets(vehicles) == tuple(map(frozenset, vehicles.goals))
    assert len(set(goal_sets(vehicles))) == 5
    nothing = replace(vehicles, goals=())
    assert goal_sets(nothing) == (frozenset(),) * 5


def test_goals_that_modules_share_are_gone_through_once() -> None:
    """Not once for each module, which would take quadratic time."""

    class Counted(tuple[Site, ...]):
        __slots__ = ()
        taken: ClassVar[list[int]] = []

        def __iter__(self) -> Iterator[Site]:
            self.taken.append(1)
            return super().__iter__()

    scene = scene_from_spec("hex:n=5")
    scene = replace(scene, goals=(Counted(scene.goals[0]),) * 5)
    Counted.taken.clear()
    assert len(set(goal_sets(scene))) == 1
    assert len(Counted.taken) == 1


def test_goals_are_places_or_sites() -> None:
    """A goal that is a site is met by its own label alone, one that is a place by any module.

    So it is for the module itself and for what it senses; an empty place meets no goal site.
    """
    system = scene_from_spec("agv-labelled:graph=P4,n=3").system
    here, near, empty = (1, 0), (2, 1), 0
    assert system.sensed(1)[:2] == (empty, 2)

    def flags(*goals: Site) -> list[int]:
        seen = observe(system, here, {1: here, 2: near}, goals=frozenset(goals))["observation"]
        return [int(seen[place]) for place in (1, 3, 5)]

    assert flags() == [0, 0, 0]
    assert flags((1, 0)) == [1, 0, 0]
    assert flags((1, 1)) == [0, 0, 0]
    assert flags(1) == [1, 0, 0]
    assert flags((2, 1)) == [0, 0, 1]
    assert flags((2, 0)) == [0, 0, 0]
    assert flags(2) == [0, 0, 1]
    assert flags((0, 0), (0, 1)) == [0, 0, 0]
    assert flags(0) == [0, 1, 0]


def test_legal_is_what_the_mask_says() -> None:
    """Any integer may be asked about; to stay claims nothing, nor does what is not legal."""
    scene = scene_from_spec("hex:n=4")
    system, site = scene.system, scene.start[0]
    mask = np.array([1, 1] + [0] * (system.move_slots - 1), np.int8)
    kept = mask.tobytes()
    for action in range(-2, len(mask) + 2):
        assert is_legal(mask, action) == is_legal(kept, action) == (action in (0, 1))
        move = system.moves(site)[0] if action == 1 else None
        assert chosen_move(system, site, kept, action) == move


def test_a_note_is_int32_above_the_least() -> None:
    """Both ends of what a note may hold are taken, and one beyond each is refused."""
    least, most = -(2**31), 2**31 - 1
    assert checked_note((most, least + 1), 2) == (most, least + 1)
    for number in (most + 1, least):
        with pytest.raises(InputError, match=f"a note with {number}, expected more than {least}"):
            checked_note((0, number), 2)
