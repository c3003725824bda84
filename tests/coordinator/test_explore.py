"""Exploring states and building the state complex, against the obvious enumeration."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import complexes
from cubepath.coordinator.bits import Bits, commutes, row_of
from cubepath.coordinator.cubical import CubicalComplex
from cubepath.coordinator.explore import explore
from cubepath.coordinator.state_complex import bytes_for, f_vector, state_complex
from cubepath.protocol.actions import apply, commute
from cubepath.protocol.errors import CheckError
from cubepath.protocol.scenes import scene_from_spec

SMALL = [
    "hex:n=3,base=1",
    "hex-open:n=2",
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


@pytest.mark.slow
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


@pytest.mark.parametrize("spec", ["arm:n=5", "agv-labelled:graph=K4,n=2", "sliding:p=1,q=1"])
def test_a_cube_is_its_actions_at_its_base(spec: str) -> None:
    """Cubes commute pairwise, and their faces are what the definition of the boundary says."""
    built = state_complex(explore(scene_from_spec(spec)))
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


@settings(deadline=None, max_examples=30)
@given(st.sampled_from(["hex-open:n=3", "sliding:p=2,q=2", "polygon:n=7", "arms", "arm:n=7"]))
def test_masks_say_what_sets_say(spec: str) -> None:
    """Commuting by masks is `commute`, for all pairs of actions met at a start."""
    bits = Bits(scene_from_spec(spec))
    for bit in range(len(bits.sites)):
        bits.meet(bit)
    masks = bits.masks()
    for one, other in combinations(range(len(bits.actions)), 2):
        assert commutes(masks, one, other) == commute(bits.actions[one], bits.actions[other])


def test_states_go_to_masks_and_back() -> None:
    """What is on in a row of words is what was put there, occupied obstacles included."""
    scene = scene_from_spec("sliding:p=2,q=1")
    bits = Bits(scene)
    assert bits.decode(row_of(bits.start, bits.words)) == scene.start_state


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
    """An endless system stops soon after the limit; its complex is refused."""
    explored = explore(scene_from_spec("hex:n=6"), max_states=500)
    assert not explored.complete
    assert 500 <= len(explored.states) < 10_000
    with pytest.raises(CheckError, match="hex:n=6: only a part was explored"):
        state_complex(explored)


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
