"""The paper's algorithms: what they do as printed, where that falls short, and the mended one."""

from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.definitions import end_state, is_cube, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.paper import algorithms as printed
from cubepath.coordinator.theory.paper.algorithms import (
    READINGS,
    CommonEdge,
    Commute,
    CubePath,
    ExciseTrivial,
    Reading,
    ShrinkCubePath,
    TimeGeodesic,
    genuine_cube_path,
    mended_time_geodesic,
    weight,
)
from cubepath.protocol.core.actions import Action
from samples.strategies import (
    SCENES,
    Word,
    alphabets,
    class_key,
    edge,
    lists_of,
    toggle,
    walks,
    words,
)

A, B = edge(1, 2), edge(5, 6)
all_readings = pytest.mark.parametrize("reading", READINGS)


def singles(word: Sequence[Action]) -> CubePath:
    return [[action] for action in word]


def flat(path: CubePath) -> Word:
    return [action for cube in path for action in cube]


def as_sets(cubes: Sequence[Sequence[Action]]) -> list[frozenset[Action]]:
    return [frozenset(cube) for cube in cubes]


def dimensions(path: CubePath) -> int:
    return sum(len(cube) for cube in path)


def out_back_and_away() -> CubePath:
    """Three steps out, the same back, one the other way; beside it six steps of another vehicle."""
    out = [edge(f"p{n}", f"p{n + 1}") for n in range(3)]
    first = [*out, *reversed(out), edge("r", "p0")]
    second = [edge(f"q{n}", f"q{n + 1}") for n in range(6)]
    return [[*pair] for pair in zip(first[:6], second, strict=True)] + [[first[6]]]


@st.composite
def cube_paths(draw: st.DrawFn) -> CubePath:
    """Draw cubes of any dimension one after another; neighbours may share edges."""
    letters = draw(alphabets())
    path: CubePath = []
    for chosen in draw(lists_of(st.lists(st.sampled_from(letters), max_size=4), max_size=9)):
        cube: Word = []
        for action in chosen:
            if is_cube([*cube, action]):
                cube.append(action)
        if cube:
            path.append(cube)
    return path


@pytest.mark.slow
@given(cube_paths())
def test_the_mended_algorithm_gives_the_normal_cube_path(path: CubePath) -> None:
    """Made genuine and repeated until nothing changes, the paper's way agrees with the heap."""
    assert as_sets(mended_time_geodesic(path)) == as_sets(normal_cube_path(flat(path)))


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize("spec", SCENES)
@given(data=st.data())
@settings(max_examples=15)
def test_the_mended_algorithm_agrees_on_walks_of_systems(spec: str, data: st.DataObject) -> None:
    """On every system the fixed point of ShrinkCubePath is the heap's normal cube path."""
    word = data.draw(walks(spec))
    assert as_sets(mended_time_geodesic(singles(word))) == as_sets(normal_cube_path(word))


@pytest.mark.few(2)
@pytest.mark.slow
@all_readings
@given(cube_paths())
def test_the_printed_algorithm_stays_in_the_class_and_is_never_too_short(
    reading: Reading, path: CubePath
) -> None:
    """In each reading a path of cubes in the same class, no shorter than the normal one."""
    before = [list(cube) for cube in path]
    result = TimeGeodesic(path, reading)
    assert path == before
    assert all(result)
    assert all(is_cube(cube) for cube in result)
    assert class_key(flat(result)) == class_key(flat(path))
    assert len(normal_cube_path(flat(path))) <= len(result) <= len(path)


@pytest.mark.few(2)
@pytest.mark.slow
@all_readings
@given(cube_paths())
def test_a_call_that_keeps_the_length_of_a_genuine_path_shows_it_shortest(
    reading: Reading, path: CubePath
) -> None:
    """Where no two neighbours share an edge at the start of the call, the stop rule is right."""
    genuine = genuine_cube_path(path)
    if len(ShrinkCubePath(genuine, reading)) == len(genuine):
        assert len(genuine) == len(normal_cube_path(flat(path)))


@given(cube_paths())
def test_genuine_means_no_empty_cube_and_no_common_edge(path: CubePath) -> None:
    """Cancelling common edges leaves a homotopic path of cubes that share none."""
    result = genuine_cube_path(path)
    assert all(result)
    assert all(set(one).isdisjoint(other) for one, other in pairwise(result))
    assert class_key(flat(result)) == class_key(flat(path))


@pytest.mark.few(2)
@pytest.mark.slow
@all_readings
@given(cube_paths())
def test_on_genuine_paths_shrinking_fixes_exactly_the_normal_ones(
    reading: Reading, path: CubePath
) -> None:
    """ShrinkCubePath leaves a genuine cube path as it is if and only if it is normal."""
    genuine = genuine_cube_path(path)
    assert (ShrinkCubePath(genuine, reading) == genuine) == is_normal(genuine)


@pytest.mark.few(2)
@pytest.mark.slow
@all_readings
@given(cube_paths())
def test_the_weighted_sum_falls_whenever_something_changes(
    reading: Reading, path: CubePath
) -> None:
    """The sum of i times dim falls in each call that changes the path."""
    after = ShrinkCubePath(path, reading)
    assert after == path or weight(after) < weight(path)


@given(words(max_size=12))
def test_commute_is_the_papers_disjointness(word: Word) -> None:
    """Commuting with each action is being disjoint from all supports and traces together."""
    cube, following = word[:3], word[3:]
    supports = frozenset[object]().union(*(action.support for action in cube))
    traces = frozenset[object]().union(*(action.trace for action in cube))
    assert Commute(cube, following) == [
        action
        for action in following
        if supports.isdisjoint(action.trace) and traces.isdisjoint(action.support)
    ]


def test_subroutines_work_in_place() -> None:
    """CommonEdge deletes from both cubes, ExciseTrivial drops and moves up only what is empty."""
    path = [[A, B], [edge(2, 3), B], [], [A]]
    CommonEdge(path, 0, 1)
    assert path == [[A], [edge(2, 3)], [], [A]]
    ExciseTrivial(path, 0, 2)
    assert path == [[A], [edge(2, 3)], [A]]


def test_there_and_back_in_front_cancels() -> None:
    """The first pair does come to CommonEdge, as soon as there is a third cube."""
    assert TimeGeodesic(singles([A, A, edge(2, 3)])) == [[edge(2, 3)]]


def test_gap_there_and_back_is_left_as_it_is() -> None:
    """The last pair never comes to CommonEdge: [a], [a] stays, though it is the empty path."""
    assert TimeGeodesic([[A], [A]]) == [[A], [A]]
    assert mended_time_geodesic([[A], [A]]) == []
    assert normal_cube_path([A, A]) == ()


@all_readings
def test_gap_even_a_genuine_cube_path_may_end_in_a_common_edge(reading: Reading) -> None:
    """From [a], [b], [a], which is genuine, each reading makes [a, b], [a] and stops."""
    path = singles([A, B, A])
    assert genuine_cube_path(path) == path
    assert TimeGeodesic(path, reading) == [[A, B], [A]]
    assert mended_time_geodesic(path) == [[B]]
    assert normal_cube_path([A, B, A]) == ((B,),)


@all_readings
def test_gap_the_stop_rule_keeps_seven_cubes_where_six_do(reading: Reading) -> None:
    """With a common edge inside, the length is unchanged in the first call but not in the next."""
    path = out_back_and_away()
    assert [len(cube) for cube in path] == [2, 2, 2, 2, 2, 2, 1]
    start = frozenset({"p0", "q0"})
    assert end_state(path, start) == {"r", "q6"}
    result = TimeGeodesic(path, reading)
    assert len(result) == 7
    assert dimensions(result) == dimensions(path) - 2
    assert len(ShrinkCubePath(result, reading)) == 6
    normal = normal_cube_path(flat(path))
    assert len(normal) == 6
    assert end_state(normal, start) == {"r", "q6"}
    assert as_sets(mended_time_geodesic(path)) == as_sets(normal)


@pytest.mark.parametrize(
    ("reading", "length"), [("keeps", 7), ("follows", 7), ("steps back", 6), ("restarts", 6)]
)
def test_gap_a_genuine_path_may_come_out_genuine_and_too_long(
    reading: Reading, length: int
) -> None:
    """Cubes that vanish in the first call leave a common edge inside, and the second call stops.

    Where i steps back or is 1 again, the first call sees that edge already.
    """
    path = out_back_and_away()
    between = toggle("a", reads=["p3", "q3"])
    passing = toggle("d", reads=["q1"])
    path[2].append(passing)
    path[3:3] = singles([between, passing, between])
    assert genuine_cube_path(path) == path
    result = TimeGeodesic(path, reading)
    assert len(result) == length
    assert genuine_cube_path(result) == result
    assert len(mended_time_geodesic(path)) == len(normal_cube_path(flat(path))) == 6
    assert (ShrinkCubePath(path, reading) == out_back_and_away()) == (length == 7)


def test_gap_shortest_is_not_yet_normal() -> None:
    """TimeGeodesic may stop at a cube path as short as the normal one that is not normal."""
    word = [edge(0, 1), edge(1, 2), edge(2, 3), B]
    result = TimeGeodesic(singles(word))
    assert len(result) == len(normal_cube_path(word)) == 3
    assert not is_normal(result)
    assert is_normal(mended_time_geodesic(singles(word)))


def test_gap_the_sum_of_dimensions_does_not_fall() -> None:
    """Commute keeps the sum of dimensions in a loop that changes the path; i times dim falls."""
    path = [[A], [B]]
    after = ShrinkCubePath(path)
    assert after == [[A, B]]
    assert dimensions(after) == dimensions(path) == 2
    assert (weight(path), weight(after)) == (3, 2)


def test_gap_the_star_condition_is_one_at_the_vertex() -> None:
    """Two squares on the 4-cycle meet in two vertices, and yet are a normal cube path."""
    first, second = [edge(0, 1), edge(2, 3)], [edge(1, 2), edge(3, 0)]
    start = frozenset({0, 2})
    middle = end_state(first, start)

    def vertices(cube: Word, state: frozenset[object]) -> set[frozenset[object]]:
        one, other = cube
        return {end_state(moves, state) for moves in ([], [one], [other], [one, other])}

    assert vertices(first, start) & vertices(second, middle) == {start, middle}
    assert end_state([first, second], start) == start
    assert is_normal([first, second])
    assert as_sets(normal_cube_path([*first, *second])) == as_sets([first, second])


@pytest.mark.parametrize("length", [1, 2, 8])
def test_two_perpendicular_segments_take_a_call_for_every_cube_saved(
    length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the paper's worst case each call shortens by one, so there are N / 2 of them and one."""
    calls = 0
    shrink = ShrinkCubePath

    def counted(cubes: CubePath, reading: Reading) -> CubePath:
        nonlocal calls
        calls += 1
        return shrink(cubes, reading)

    monkeypatch.setattr(printed, "ShrinkCubePath", counted)
    first = [edge(f"a{n}", f"a{n + 1}") for n in range(length)]
    second = [edge(f"b{n}", f"b{n + 1}") for n in range(length)]
    path = TimeGeodesic(singles([*first, *second]))
    assert as_sets(path) == [frozenset(pair) for pair in zip(first, second, strict=True)]
    assert calls == length + 1
