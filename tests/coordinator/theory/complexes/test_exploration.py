"""Exploring states and building the state complex, against the obvious enumeration."""

from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes import exploration, state_masks
from cubepath.coordinator.theory.complexes.collapses import collapse
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import Exploration, explore
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.coordinator.theory.complexes.links import check_links
from cubepath.coordinator.theory.complexes.state_complexes import (
    StateComplex,
    bytes_for,
    f_vector,
    state_complex,
)
from cubepath.coordinator.theory.complexes.state_masks import Bits, commutes
from cubepath.protocol.core.actions import apply, commute, end_at
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from marked import all_but
from oracles import complexes
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.listed_scenes import listed, listed_scenes, move

SMALL = [
    "hex:n=3,base=1",
    "hex-open:n=2",
    "hex-tunnel:n=4",
    "hex-connected:n=3",
    "sliding:p=2,q=1",
    "sliding:p=1,q=1,n=3",
    "arm:n=6",
    "arm-free:n=3",
    "arms",
    "agv:graph=K5,n=2",
    "agv-labelled:graph=C5,n=3",
    "polygon:n=7",
    "triangulation:n=7",
    "words",
    "assembly:n=2",
]


@pytest.mark.few(9)
@pytest.mark.parametrize("spec", SMALL)
def test_states_and_cubes_are_those_of_the_obvious_enumeration(spec: str) -> None:
    """The same f-vector as by going through all commuting sets of all states, for every system."""
    scene = scene_from_spec(spec)
    explored = explore(scene)
    assert explored.complete
    assert list(f_vector(explored)) == complexes.f_vector(scene)
    assert {explored.state(number) for number in range(len(explored.states))} == set(
        complexes.states_of(scene)
    )


@pytest.mark.parametrize(
    "spec", ["arm:n=5", "agv-labelled:graph=K4,n=2", "sliding:p=1,q=1", "hex-connected:n=3"]
)
def test_a_cube_is_its_actions_at_its_base(spec: str) -> None:
    """Cubes commute pairwise, and their faces are what the definition of the boundary says."""
    check_names(state_complex(explore(scene_from_spec(spec))))


def check_names(built: StateComplex) -> None:
    """Compare every cube and its faces with the definition of the boundary."""
    explored = built.explored
    number = {explored.state(place): place for place in range(len(explored.states))}
    built.complex.check()
    for k in range(1, built.complex.dimension + 1):
        for place in range(built.complex.f_vector[k]):
            base, actions = built.cube(k, place)
            assert all(commute(one, other) for one, other in combinations(actions, 2))
            for direction, action in enumerate(actions):
                rest = actions[:direction] + actions[direction + 1 :]
                across = number[apply(action, explored.state(base))]
                low, high = built.complex.faces[k][place, direction].tolist()
                assert built.cube(k - 1, low) == (base, rest)
                assert built.cube(k - 1, high) == (across, rest)


@settings(max_examples=10)
@given(st.sampled_from(["hex-open:n=3", "sliding:p=2,q=2", "polygon:n=7", "arms", "arm:n=7"]))
def test_masks_say_what_sets_say(spec: str) -> None:
    """Commuting by masks is `commute`, for all pairs of actions met at a start."""
    bits = Bits(scene_from_spec(spec))
    for bit in range(len(bits.sites)):
        bits.meet(bit)
    masks = bits.masks()
    for one, other in combinations(range(len(bits.actions)), 2):
        assert commutes(masks, one, other) == commute(bits.actions[one], bits.actions[other])


def test_the_same_scene_gives_the_same_numbers() -> None:
    """States, actions and cubes come in the same order every time."""
    one, other = (state_complex(explore(scene_from_spec("hex:n=3,base=1"))) for _ in range(2))
    assert np.array_equal(one.explored.states, other.explored.states)
    assert [action.label for action in one.explored.bits.actions] == [
        action.label for action in other.explored.bits.actions
    ]
    for mine, theirs in zip(one.complex.faces, other.complex.faces, strict=True):
        assert np.array_equal(mine, theirs)


def test_the_limit_stops_it_and_is_told() -> None:
    """An endless system stops soon after the limit; its complex and counts are refused."""
    explored = explore(scene_from_spec("hex:n=6"), max_states=5000)
    assert not explored.complete
    assert 5000 < len(explored.states) < 6000
    for refused in (state_complex, f_vector):
        with pytest.raises(CheckError, match="hex:n=6: only a part was explored"):
            refused(explored)


@pytest.mark.parametrize("spec", ["arm:n=7", "hex-connected:n=3"])
def test_exactly_as_many_states_as_allowed_are_no_reason_to_stop(spec: str) -> None:
    """Also where many of the states that were looked at are forbidden by a global rule."""
    scene = scene_from_spec(spec)
    count = len(explore(scene).states)
    assert explore(scene, max_states=count).complete
    assert not explore(scene, max_states=count // 2).complete


def test_a_guard_on_an_obstacle_is_a_need() -> None:
    """An obstacle that is on and guarded by a site that must be off: the action never applies."""
    scene = listed(
        move("never", ["f", "g"], "a", "b", free=["f"], guards=[("f", "g")]),
        move("x", [], "g", "h"),
        start=["a", "g"],
        fixed=["f"],
    )
    assert f_vector(explore(scene)) == (2, 1)
    assert list(f_vector(explore(scene))) == complexes.f_vector(scene)
    needing = listed(
        move("if", ["f", "g"], "a", "b", free=["f", "g"], guards=[("f", "g")]),
        move("x", [], "g", "h"),
        start=["a", "g"],
        fixed=["f"],
    )
    assert list(f_vector(explore(needing))) == complexes.f_vector(needing) == [4, 3]


@settings(max_examples=25)
@given(listed_scenes())
def test_any_listed_system_is_explored_as_it_is_defined(scene: Scene) -> None:
    """Free sites, guards, obstacles, doubled actions: as enumerated the obvious way, and NPC."""
    explored = explore(scene)
    check_order(explored)
    built = state_complex(explored)
    assert list(built.complex.f_vector) == complexes.f_vector(scene)
    check_names(built)
    assert check_links(built.complex).npc


def check_order(explored: Exploration) -> None:
    """Compare numbers and edges with a plain breadth-first search by the numbers of the actions."""
    known, legal = explored.bits.actions, explored.scene.system.legal
    states = [explored.state(number) for number in range(len(explored.states))]
    number = {states[0]: 0}
    edges = []
    for state in states:
        found: list[tuple[int, int]] = []
        for action, each in enumerate(known):
            end = end_at(each, state)
            after = state if end is None else apply(each, state)
            if end is not None and legal(after):
                number.setdefault(after, len(number))
                found += [(action, number[after])] * (end == 0)
        edges.append(found)
    assert list(number) == states
    pairs = list(zip(explored.actions.tolist(), explored.targets.tolist(), strict=True))
    starts = explored.starts.tolist()
    assert [pairs[a:b] for a, b in pairwise(starts)] == edges


@pytest.mark.parametrize("spec", ["hex-connected:n=3", "sliding:p=2,q=1,n=3", "assembly:n=2"])
def test_states_are_numbered_as_a_plain_search_meets_them(spec: str) -> None:
    """By distance, and then by the number of the action, also where some are forbidden."""
    check_order(explore(scene_from_spec(spec)))


def test_equal_hashes_decide_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """If all states have one hash, or few, they are told apart all the same."""
    expected = explore(scene_from_spec("hex:n=3,base=1"))
    for few in (1, 3):
        # Of exclusive ors of few keys there are few.
        keys = np.arange(5000, dtype=np.uint64) % np.uint64(few)
        monkeypatch.setattr(
            state_masks, "keys_of_bits", lambda count, keys=keys: keys[:count].copy()
        )
        found = explore(scene_from_spec("hex:n=3,base=1"))
        for name in ("states", "starts", "actions", "targets"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))


def test_edges_and_states_do_not_depend_on_how_much_room_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where room runs out in the midst of a chunk it goes on with the same state."""
    expected = explore(scene_from_spec("hex:n=4,base=1"))
    monkeypatch.setattr(exploration, "_BLOCK", 1)
    found = explore(scene_from_spec("hex:n=4,base=1"))
    for name in ("states", "starts", "actions", "targets"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))


def test_progress_is_told() -> None:
    """How far it is, chunk by chunk, up to the end."""
    told: list[tuple[int, int]] = []
    explored = explore(scene_from_spec("arm:n=6"), progress=lambda *seen: told.append(seen))
    assert told[-1] == (len(explored.states), len(explored.states))


def test_the_bytes_that_are_announced_are_those_that_are_taken() -> None:
    """What is said before cubes are made is what they take."""
    built = state_complex(explore(scene_from_spec("arm:n=8")))
    arrays = (*built.complex.faces, *built.bases, *built.actions)
    assert bytes_for(built.complex.f_vector) == sum(array.nbytes for array in arrays)


def test_a_state_from_which_nothing_moves_is_a_point() -> None:
    """A deadlocked arm has a complex of one vertex."""
    built = state_complex(explore(scene_from_spec("arm-free:start=deadlock")))
    assert built.complex.f_vector == (1,)
    assert isinstance(built.complex, CubicalComplex)


def all_of(spec: str, left: int) -> list[object]:
    """Return all that is found out of a complex, with so many steps in plain Python."""
    with plain_steps(left):
        explored = explore(scene_from_spec(spec))
        built = state_complex(explored).complex
        arrays: list[NDArray[Any]] = [explored.states, explored.starts, *built.faces]
        arrays += [explored.actions, explored.targets]
        collapsed = collapse(built)
        return [
            *((array.dtype, array.tolist()) for array in arrays),
            homology(built),
            check_links(built),
            (collapsed.left, collapsed.steps.tolist()),
        ]


@pytest.mark.parametrize("spec", all_but(SMALL, {"arm-free:n=3"}))
@pytest.mark.thorough
def test_plain_python_and_compiled_code_find_the_same(spec: str) -> None:
    """States, edges, cubes, homology, links and collapses; and with a change from one to other."""
    plain = all_of(spec, PLAIN)
    assert all_of(spec, COMPILED) == plain
    assert all_of(spec, 2000) == plain
