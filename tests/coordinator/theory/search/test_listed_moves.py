"""Moves that a list alone tells: met where they begin, and met the same way from arrays."""

from hypothesis import given, strategies as st

from cubepath.coordinator.normal_form.compiled_heap import cubes_of, normal_form_of
from cubepath.coordinator.theory.search.exact import optimum, too_wide
from cubepath.coordinator.theory.search.transitions import Transitions, listed_moves
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves
from samples.strategies import SCENES, Word, edge, scene, toggle, walks, words


def numbered(path: Word) -> NumberedPath:
    return number_moves(PathMove(action, move) for move, action in enumerate(path))


@given(st.one_of(words(), st.sampled_from(SCENES).flatmap(lambda spec: walks(spec, max_size=12))))
def test_arrays_list_what_actions_list(path: Word) -> None:
    """At each site the same moves in the same order, and the same ones anywhere."""
    one, other = listed_moves(path), listed_moves(numbered(path))
    sites: set[Site] = {site for action in path for site in action.support}
    assert one.anywhere == other.anywhere
    assert {site: one.at(site) for site in sites} == {site: other.at(site) for site in sites}
    assert other.at("nowhere") == one.at("nowhere") == []


def test_a_path_of_nothing_lists_nothing() -> None:
    """And a move is met in both of its directions, where it begins."""
    assert listed_moves(numbered([])).anywhere == []
    there = edge(1, 2)
    found = listed_moves(numbered([there, toggle(3), there]))
    assert (found.at(1), found.at(2)) == ([(there, 0)], [(there, 1)])
    assert found.anywhere == [(toggle(3), 0)]


@given(
    st.sampled_from(SCENES).flatmap(
        lambda spec: walks(spec, min_size=1, max_size=20).map(lambda path: (spec, path))
    ),
    st.integers(1, 40),
)
def test_a_search_that_is_said_to_be_too_wide_does_not_begin(
    given_path: tuple[str, Word], max_states: int
) -> None:
    """It gives up before its first round, with the bound that is known without it."""
    spec, path = given_path
    start, known = scene(spec).start_state, numbered(path)
    cubes = cubes_of(normal_form_of(known), known)
    if len(cubes.starts) == 1:
        return
    first = known.numbers[cubes.moves[: int(cubes.starts[1])]]
    if too_wide(first, known.supports, max_states):
        steps = Transitions(None, known)
        goal = steps.encode(start) ^ 1 << steps.bit("elsewhere")
        found = optimum(steps, steps.encode(start), goal, max_states=max_states)
        assert (found.at_least, found.cubes, found.states) == (1, None, 2)


def test_how_wide_is_too_wide() -> None:
    """Half of what an edge may meet at both ends; one that meets many takes the place of these."""
    apart = [edge((n, 0), (n, 1)) for n in range(8)]
    known = numbered(apart)
    assert too_wide(known.numbers, known.supports, 7)
    assert not too_wide(known.numbers, known.supports, 8)
    reading = [toggle(n, reads=["hub"]) for n in range(8)]
    known = numbered([*reading, toggle("hub")])
    assert not too_wide(known.numbers[:8], known.supports, 1)
    known = numbered([*reading, toggle(8, reads=range(4))])
    assert too_wide(known.numbers[:8], known.supports, 1)
    assert not too_wide(known.numbers[:8], known.supports, 2)
