"""The arm with all rotations of its generators: it stays one arm at its base, and can be stuck."""

from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.catalogue import EDGES, Catalogue, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.arms import (
    BASE,
    DEADLOCK,
    arm_of,
    edges_at,
    end_rotations,
    flips,
    free_arm_catalogue,
)
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.complexes import actions_at, f_vector, states_of

ARMS = (3, 9, 25, 71, 195, 543, 1479)
"""How many self-avoiding walks of 1, 2, ... steps there are from the origin, but for (0, -1)."""


def words(length: int) -> Iterator[str]:
    """Yield the words of all arms of this length."""
    found = [""]
    for _ in range(length):
        found = [word + letter for word in found for letter in "ruld" if is_arm(word + letter)]
    yield from found


def is_arm(word: str) -> bool:
    try:
        arm_of(word)
    except InputError:
        return False
    return True


def scene_of(start: tuple[Site, ...], generators: tuple[Generator, ...], *base: Site) -> Scene:
    return Scene("own", "", LatticeSystem(Catalogue(EDGES, generators), filled=base), start)


def in_one_piece(state: State) -> bool:
    """Tell whether all edges that are on can be reached from the base."""
    todo, seen = [(0, 0)], set[tuple[int, int]]()
    while todo:
        vertex = todo.pop()
        if vertex not in seen:
            seen.add(vertex)
            for edge in edges_at(vertex):
                if edge in state:
                    x, y, axis = edge
                    todo += [(x, y), (x + (axis == 0), y + (axis == 1))]
    return all(edge[:2] in seen for edge in state)  # type: ignore[index]  # edges are tuples


@pytest.mark.parametrize("count", range(1, 7))
def test_every_arm_is_reached_and_nothing_else(count: int) -> None:
    """From the straight arm: all self-avoiding walks from the base, each an arm in one piece."""
    states = set(states_of(scene_from_spec(f"arm-free:n={count}")))
    assert states == {frozenset((*arm_of(word), BASE)) for word in words(count)}
    assert len(states) == ARMS[count - 1]


@pytest.mark.slow
def test_no_arm_shorter_than_seven_is_deadlocked_and_two_of_seven_are() -> None:
    """Over all self-avoiding walks: the deadlocked arm and its mirror image are the first."""
    stuck = []
    for count in range(1, 8):
        scene = scene_from_spec(f"arm-free:n={count}")
        found = list(words(count))
        assert len(found) == ARMS[count - 1]
        stuck += [word for word in found if not actions_at(scene, {*arm_of(word), BASE})]
    assert sorted(stuck) == sorted([DEADLOCK, DEADLOCK.translate(str.maketrans("rl", "lr"))])


def test_all_arms_of_seven_but_the_deadlocked_are_reached_from_the_straight_one() -> None:
    """What cannot move cannot be reached: 1,477 of 1,479 arms are one component."""
    assert len(states_of(scene_from_spec("arm-free:n=7"))) == ARMS[6] - 2


def test_the_deadlocked_scene() -> None:
    """It starts with an arm of the system, at the base, whose state complex is a point."""
    scene = scene_from_spec("arm-free:start=deadlock")
    assert len(scene.start) == 7
    assert in_one_piece(scene.start_state)
    assert f_vector(scene) == [1]


def test_generators_are_two_flips_and_four_quarter_turns() -> None:
    """All rotations of the positive arm's two, with what their supports hold off."""
    assert [each.name for each in flips()] == ["flip-rising", "flip-falling"]
    assert [each.name for each in end_rotations()] == [
        f"rotate-{w}" for w in ("ru", "ul", "ld", "dr")
    ]
    for flip in flips():
        assert len(flip.trace) == 4
        assert len(flip.support) == 8
        assert set(flip.before) | set(flip.after) == set(flip.trace)
    for turn in end_rotations():
        assert set(turn.trace) < set(edges_at((0, 0)))
        assert len(turn.support) == 2 + 3 + 3
        assert set(turn.before) | set(turn.after) == set(turn.trace)


@pytest.mark.parametrize(("count", "states", "torn"), [(3, 25, 0), (4, 75, 0), (6, 627, 18)])
def test_with_less_support_an_arm_touches_itself_and_tears(
    count: int, states: int, torn: int
) -> None:
    """If flips do not look where the corner goes, arms of four close up and arms of six tear."""
    loose = tuple(replace(flip, support=flip.trace) for flip in flips())
    found = states_of(scene_of(arm_of("u" * count), loose + end_rotations(), BASE))
    assert len(found) == states
    assert sum(not in_one_piece(state) for state in found) == torn


def test_an_end_rotation_without_the_continuations_tears() -> None:
    """The middle of an arm is no end: its support says so."""
    loose = tuple(replace(turn, support=turn.trace) for turn in end_rotations())
    found = states_of(scene_of(arm_of("uuu"), flips() + loose, BASE), most=200)
    assert not all(in_one_piece(state) for state in found)


def test_without_a_base_an_arm_walks_away() -> None:
    """An arm with two free ends is at home nowhere; with the base its first segment stays there."""
    walking = states_of(scene_of(arm_of("uu"), free_arm_catalogue().generators), most=300)
    assert len(walking) == 300
    fixed = states_of(scene_of(arm_of("uu"), free_arm_catalogue().generators, BASE))
    assert len(fixed) == ARMS[1]
    assert all(any(edge in state for edge in edges_at((0, 0)) if edge != BASE) for state in fixed)


def test_the_segments_keep_their_order_along_the_arm() -> None:
    """In a flip each of the two keeps the end that is not at the corner."""
    (rising, falling) = flips()
    assert dict(rising.motion) == {(0, 0, 0): (0, 0, 1), (1, 0, 1): (0, 1, 0)}
    assert dict(falling.motion) == {(0, 0, 0): (1, 0, 1), (0, 0, 1): (0, 1, 0)}


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("arm-free:start=uxu", "arm 'uxu': expected letters r, u, l and d, found 'x'"),
        ("arm-free:start=urdl", r"arm 'urdl': it meets the vertex \[0, 0\] twice"),
        ("arm-free:start=d", r"arm 'd': it meets the vertex \[0, -1\] twice"),
        ("arm-free:start=uu,n=3", "start=uu: expected n=3 letters"),
        ("arm-free:start=uu,goal=r", "goal=r: expected 2 letters"),
        ("arm-free:n=0", "n=0: expected a whole number of at least 1"),
    ],
)
def test_a_word_that_is_no_arm_is_refused(spec: str, message: str) -> None:
    """The letter or the vertex that is met twice is named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)


def test_a_segment_on_the_base_is_refused() -> None:
    """The base is an obstacle, so no module starts there."""
    with pytest.raises(InputError, match=r"module starts at \(0, -1, 1\): an obstacle or no place"):
        scene_of((BASE,), free_arm_catalogue().generators, BASE)


@pytest.mark.parametrize("generator", [*flips(), *end_rotations()], ids=lambda each: each.name)
def test_a_generator_that_contradicts_itself_is_named(generator: Generator) -> None:
    """With the support cut down, or local states that differ off the trace."""
    with pytest.raises(
        InputError, match=f"{generator.name}.*the trace holds .* not in the support"
    ):
        replace(generator, support=generator.trace[1:])
    with pytest.raises(InputError, match=f"{generator.name}.*differ at .* which is off the trace"):
        replace(generator, after=(*generator.after, generator.support[-1]))
