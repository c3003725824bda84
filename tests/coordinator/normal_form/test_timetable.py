"""Unequal times: earliest starts are a timetable, no timetable is shorter, and 1 is one cube."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from counted_lines import lines_of
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.normal_form.timetable import Timetable, durations_of, earliest
from cubepath.protocol.core.actions import Action, apply, commute
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.durations import Durations, TimedLine, write_timetable
from cubepath.protocol.path_files.moves import MoveName, PathMove
from samples.strategies import (
    SCENES,
    Word,
    edge,
    linear_extensions,
    reduced,
    scene,
    toggle,
    walks,
    words,
)

ONE = Fraction(1)
times_taken = st.fractions(Fraction(1, 4), 5, max_denominator=6)


def times(word: Word) -> st.SearchStrategy[list[Fraction]]:
    return st.lists(times_taken, min_size=len(word), max_size=len(word))


def is_timetable(
    path: Sequence[Action], durations: Sequence[Fraction], starts: Sequence[Fraction]
) -> bool:
    """By the definition: what does not commute keeps its order and does not overlap."""
    return all(start >= 0 for start in starts) and all(
        commute(path[one], path[other]) or starts[one] + durations[one] <= starts[other]
        for other in range(len(path))
        for one in range(other)
    )


def chains(path: Sequence[Action], durations: Sequence[Fraction]) -> list[Fraction]:
    """Return for each move the longest time of a chain that ends with it, by the definition."""
    found: list[Fraction] = []
    for place, action in enumerate(path):
        before = [found[one] for one in range(place) if not commute(path[one], action)]
        found.append(max(before, default=Fraction(0)) + durations[place])
    return found


# Earliest starts


@pytest.mark.slow
@given(data=st.data())
def test_earliest_starts_are_a_timetable_and_none_is_shorter(data: st.DataObject) -> None:
    """Nothing overlaps that does not commute, and a chain without a pause takes all the time."""
    path = data.draw(words(max_size=20))
    durations = data.draw(times(path))
    found = earliest(path, durations)
    assert is_timetable(path, durations, found.starts)
    ends = [start + durations[place] for place, start in enumerate(found.starts)]
    assert ends == chains(path, durations)
    assert found.makespan == max(ends, default=0)
    links = found.critical
    assert sum(durations[place] for place in links) == found.makespan
    for one, other in pairwise(links):
        assert one < other
        assert not commute(path[one], path[other])
        assert ends[one] == found.starts[other]


@settings(max_examples=40)
@given(data=st.data())
def test_no_order_of_the_moves_is_faster(data: st.DataObject) -> None:
    """Of all orders that keep dependent moves in order, begun greedily, none ends before."""
    path = data.draw(words(max_letters=4, max_size=5))
    durations = data.draw(times(path))
    least = earliest(path, durations).makespan
    for order in permutations(range(len(path))):
        if any(
            order.index(one) > order.index(other) and not commute(path[one], path[other])
            for other in range(len(path))
            for one in range(other)
        ):
            continue
        again = earliest([path[n] for n in order], [durations[n] for n in order])
        assert again.makespan == least


@pytest.mark.slow
@given(data=st.data())
def test_unit_durations_give_the_normal_cube_path(data: st.DataObject) -> None:
    """Where each move takes 1, it begins one before the number of its cube; in any order."""
    path = data.draw(st.one_of(words(max_size=24), walks(data.draw(st.sampled_from(SCENES)))))
    left = data.draw(linear_extensions(reduced(path)))
    found = earliest(left, [ONE] * len(left))
    heap = Heap()
    heap.extend(left)
    assert found.makespan == heap.cubes == len(found.critical)
    levels: dict[Fraction, set[Action]] = {}
    for action, start in zip(left, found.starts, strict=True):
        levels.setdefault(start, set()).add(action)
    assert [levels[start] for start in sorted(levels)] == list(map(set, heap.cube_path()))


@pytest.mark.slow
@given(data=st.data())
def test_carried_out_in_order_of_start_a_walk_ends_where_it_ends(data: st.DataObject) -> None:
    """Of every system: moves in order of their starts, ties in any order, are admissible."""
    spec = data.draw(st.sampled_from(SCENES))
    path = data.draw(walks(spec, max_size=12))
    durations = data.draw(times(path))
    starts = earliest(path, durations).starts
    mixed = data.draw(st.permutations(range(len(path))))
    state, expected = scene(spec).start_state, scene(spec).start_state
    for place in sorted(mixed, key=lambda place: starts[place]):
        state = apply(path[place], state)
    for action in path:
        expected = apply(action, expected)
    assert state == expected


def test_a_slow_move_does_not_hold_up_others() -> None:
    """Cube by cube the slow one would be waited for; by start times only what depends waits."""
    path = [edge(1, 2), edge(2, 3), edge(8, 9), edge(9, 10)]
    durations = [Fraction(n) for n in (5, 1, 1, 5)]
    found = earliest(path, durations)
    assert found == Timetable(tuple(map(Fraction, (0, 5, 0, 1))), Fraction(6), (0, 1))


def test_durations_must_be_as_many_as_moves() -> None:
    """One too many is an error."""
    with pytest.raises(ValueError, match="2 durations, expected one for each of 1 moves"):
        earliest([toggle(1)], [ONE, ONE])
    with pytest.raises(ValueError, match="0 durations"):
        earliest([toggle(1)], [])


@pytest.mark.slow
def test_timing_grows_with_the_path_alone() -> None:
    """Sixteen times as many moves over one site: far from 256 times as much work."""

    def steps(size: int) -> int:
        path = [toggle(n, reads=["hub"]) for n in range(size)]
        durations = [Fraction(1, 1 + n % 3) for n in range(size)]
        return lines_of(lambda: earliest(path, durations))

    assert 0 < steps(8_000) < 24 * steps(500)


# Durations


def move(name: Any, action: Action | None = None) -> PathMove:
    return PathMove(action or toggle(str(name)), name)


def test_the_most_particular_duration_counts() -> None:
    """That of generator and place, then that of the generator or id, then the default."""
    known = Durations(
        Fraction(2), {"slide": Fraction(3), "7": Fraction(5)}, {("slide", (0, 1)): Fraction(7)}
    )
    names: list[MoveName] = [
        GeneratorPlacement("slide", (0, 1)),
        GeneratorPlacement("slide", (0, 2)),
        GeneratorPlacement("turn", (0, 1)),
        7,
        "7",
        "a",
    ]
    assert [known.of(name) for name in names] == [7, 3, 2, 5, 5, 2]


@pytest.mark.parametrize(
    ("durations", "reason"),
    [
        (Durations(named={"slid": ONE}), "'slid' (did you mean 'slide'?) is no generator"),
        (Durations(placed={("slide", (9, 9)): ONE}), "generator 'slide' at (9, 9) is no move"),
    ],
)
def test_a_duration_of_no_move_is_refused(durations: Durations, reason: str) -> None:
    """A slip in a name is not passed over; of a path of no moves nothing is asked."""
    with pytest.raises(InputError) as refusal:
        durations_of([move(GeneratorPlacement("slide", (0, 1))), move(3)], durations)
    assert reason in str(refusal.value)
    assert durations_of([], durations) == []


def test_a_place_counts_for_its_other_name() -> None:
    """An edge is one move, from whichever end it is written."""
    action = edge(1, 2)
    path = [
        move(GeneratorPlacement("edge", (1, 2)), action),
        move(GeneratorPlacement("edge", (2, 1)), action),
    ]
    assert durations_of(path, Durations(placed={("edge", (2, 1)): Fraction(3)})) == [3, 3]
    both = Durations(placed={("edge", (2, 1)): Fraction(3), ("edge", (1, 2)): Fraction(4)})
    with pytest.raises(InputError, match="moves 1 and 2 are equal, but take 4 and 3"):
        durations_of(path, both)


def test_equal_moves_must_take_equal_time() -> None:
    """A move is what it does, so two ids of one move have one duration."""
    same = toggle(1)
    path = [move("a", same), move("b", toggle(2)), move("c", same)]
    with pytest.raises(InputError, match="moves 1 and 3 are equal, but take 1/2 and 1"):
        durations_of(path, Durations(named={"a": Fraction(1, 2)}))
    told = Durations(named={"a": Fraction(2), "c": Fraction(2)})
    assert durations_of(path, told) == [2, 1, 2]


# Timetables


def test_a_timetable_has_a_line_for_each_move(tmp_path: Path) -> None:
    """When it begins, how long it takes, and how it is written."""
    path = tmp_path / "t.jsonl"
    lines = [TimedLine(0, "3/2", GeneratorPlacement("edge", (0, 1))), TimedLine("3/2", 2, "a")]
    write_timetable(path, lines)
    assert path.read_text().splitlines() == [
        '{"start":0,"duration":"3/2","move":{"generator":"edge","at":[0,1]}}',
        '{"start":"3/2","duration":2,"move":"a"}',
    ]


def test_of_the_moves_that_are_left_the_times_are_those_of_the_reduced_path() -> None:
    """What cancels takes no time."""
    path = [toggle(1), toggle(2), toggle(1), toggle(2, reads=[1])]
    left = [path[move - 1] for cube in certificate_of(path).cubes for move in cube]
    assert earliest(left, [ONE] * 2).makespan == 2
