"""Reads, writes and versions: rounds and cubes compared by the sites that their moves touch."""

from collections.abc import Sequence
from itertools import accumulate, chain

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.verification.dependencies import check_dependencies, numbered, remaining
from cubepath.protocol.core.actions import Action, commute
from oracles.obvious import obvious_normal_form
from samples.random_runs import SPECS, random_run
from samples.strategies import class_key, crowded_words, linear_extensions, toggle, words

Cubes = Sequence[Sequence[Action]]


def said(rounds: Cubes, cubes: Cubes | None, *, whole: bool = True) -> list[str]:
    """Return what the check says of rounds and cubes."""
    found: list[str] = []
    path = list(chain.from_iterable(rounds))
    ends = list(accumulate(map(len, rounds)))
    check_dependencies(path, ends, cubes, lambda _, line: found.append(line), whole=whole)
    return found


def one_by_one(path: Sequence[Action]) -> Cubes:
    """Return rounds of one move each."""
    return [[action] for action in path]


def obviously_left(path: Sequence[Action]) -> list[int]:
    """Return the places that are left when pairs that can be brought together are taken out."""
    places = list(range(len(path)))
    pair = True
    while pair:
        pair = False
        for at, two in enumerate(places):
            for back in range(at - 1, -1, -1):
                one = places[back]
                if path[one] == path[two]:
                    del places[at], places[back]
                    pair = True
                    break
                if not commute(path[one], path[two]):
                    break
            if pair:
                break
    return places


def obviously_the_same(path: Sequence[Action], cubes: Cubes) -> bool:
    """Compare the order of every two moves that conflict, each by action and how often before."""

    def times(moves: Sequence[Action]) -> list[tuple[Action, int]]:
        return [(each, list(moves[:place]).count(each)) for place, each in enumerate(moves)]

    flat = list(chain.from_iterable(cubes))
    run = times([path[place] for place in obviously_left(path)])
    order = {each: place for place, each in enumerate(times(flat))}
    return (
        all(map(is_cube, cubes))
        and run.__len__() == len(order)
        and set(run) == set(order)
        and all(
            order[one] < order[two]
            for at, two in enumerate(run)
            for one in run[:at]
            if not commute(one[0], two[0])
        )
    )


@pytest.mark.slow
@given(path=words() | crowded_words())
def test_what_is_undone_is_what_can_be_brought_together(path: Sequence[Action]) -> None:
    """The moves that are left, by taking out pairs in the obvious way until there are none."""
    table, (numbers,) = numbered(path)
    left = remaining(numbers, table)
    assert class_key([path[n] for n in left]) == class_key([path[n] for n in obviously_left(path)])
    assert len(left) == len(obviously_left(path))


@pytest.mark.slow
@given(data=st.data(), path=words() | crowded_words())
def test_cubes_agree_iff_all_that_conflicts_has_one_order(
    data: st.DataObject, path: Sequence[Action]
) -> None:
    """The normal form, the rest in another order, or anything else: as by comparing all pairs."""
    rest = [path[place] for place in obviously_left(path)]
    letters = list(dict.fromkeys(path))
    cubes: Cubes = data.draw(
        st.one_of(
            st.just([list(cube) for cube in obvious_normal_form(path)]),
            linear_extensions(rest).map(one_by_one),
            st.permutations(rest).map(one_by_one),
            st.lists(st.sampled_from(letters), max_size=8).map(one_by_one)
            if letters
            else st.just([]),
            st.permutations(rest).map(lambda some: [some[:2], *one_by_one(some[2:])]),
        )
    )
    cubes = [cube for cube in cubes if cube]
    assert (said(one_by_one(path), cubes) == []) == obviously_the_same(path, cubes)


@pytest.mark.parametrize("spec", SPECS)
def test_a_run_and_its_normal_form_agree(spec: str) -> None:
    """Rounds of many modules; the first cubes too, when the others are lost, and then alone."""
    _, rounds, _ = random_run(spec, 25)
    cubes = [list(cube) for cube in obvious_normal_form(chain.from_iterable(rounds))]
    assert said(rounds, cubes) == []
    assert said(rounds, None) == []
    for count in range(len(cubes)):
        assert said(rounds, cubes[:count], whole=False) == []
        assert said(rounds, cubes[:count]) != []
    if len(cubes) > 2:
        assert said(rounds, cubes[1:], whole=False) != []


def test_what_is_wrong_is_named_by_its_site() -> None:
    """Two moves of a round that share one, cubes with others, and cubes in another order."""
    a, b = toggle(1, reads=[2], label="a"), toggle(2, label="b")
    c = toggle(3, reads=[2], label="c")
    assert said([[a, c]], [[a, c]]) == []
    assert said([[a, c], [b, c]], None) == [
        "round 2: c and another move of it share 2, which one of them writes"
    ]
    assert said([[a], [a]], [[a]]) == [
        "a is 1 time in the cubes, and in the run 0 times but for what it undoes"
    ]
    assert said([[a], [b]], [[b], [a]]) == [
        "a finds 2 written 1 time in the cubes, and in the run 0 times but for what it undoes"
    ]
    assert said([[a], [b]], [[a, b]]) == [
        "cube 1: b and another move of it share 2, which one of them writes"
    ]


def test_words_that_cancel_at_every_site_need_not_cancel() -> None:
    """What each site sees is not enough: (b a c a)(b a c a), where b and c share nothing."""
    a, b, c = toggle(1, 2, label="a"), toggle(1, label="b"), toggle(2, label="c")
    word = [b, a, c, a] * 2
    table, (numbers,) = numbered(word)
    assert remaining(numbers, table) == list(range(len(word)))
    assert said(one_by_one(word), []) != []
