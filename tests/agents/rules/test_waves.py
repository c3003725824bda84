"""What spreads by notes: gradients are distances, one module is elected, one token goes round."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.rollouts import play
from cubepath.agents.local.random_streams import RULE, stream
from cubepath.agents.rules.chain_task import beside_of
from cubepath.agents.rules.graph_distances import Roads
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.agents.rules.waves import Election, Gradient, Token
from cubepath.protocol.core.actions import State, apply
from cubepath.protocol.core.catalogue import HEXAGONS
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.command_line import ROOT

Graph = tuple[frozenset[int], ...]
"""The neighbours of each module."""
Turns = list[set[int]]
"""Who acts in each round; the others skip it."""
MOST = 9


def graph_of(count: int, edges: Collection[tuple[int, int]]) -> Graph:
    near = [set[int]() for _ in range(count)]
    for one, other in edges:
        if one != other:
            near[one].add(other)
            near[other].add(one)
    return tuple(map(frozenset, near))


@st.composite
def trees(draw: st.DrawFn, count: int) -> list[tuple[int, int]]:
    """Return the edges of any tree."""
    order = draw(st.permutations(range(count)))
    return [(order[at], order[draw(st.integers(0, at - 1))]) for at in range(1, count)]


@st.composite
def graphs(draw: st.DrawFn, count: int) -> Graph:
    """Return a connected graph: a tree, and some edges more."""
    ends = st.integers(0, count - 1)
    return graph_of(
        count, [*draw(trees(count)), *draw(st.lists(st.tuples(ends, ends), max_size=6))]
    )


COUNTS = st.integers(1, MOST)
TURNS = st.lists(st.sets(st.integers(0, MOST - 1)), max_size=20)


@st.composite
def anything(draw: st.DrawFn, count: int) -> list[Gradient]:
    """Return what modules may say after moves, changes of sources, or by mistake."""
    numbers = st.integers(0, count - 1)
    return [Gradient(module, draw(numbers), draw(numbers)) for module in range(count)]


def flowed(said: list[Gradient], graph: Graph, sources: Collection[int]) -> list[Gradient]:
    """Return what all say after a round."""
    return [
        Gradient.next(
            module,
            [said[near] for near in graph[module]],
            modules=len(graph),
            source=module in sources,
        )
        for module in range(len(graph))
    ]


@pytest.mark.slow
@settings(max_examples=100, derandomize=True)
@given(st.data())
def test_a_gradient_is_the_distance_whatever_was_said_before(data: st.DataObject) -> None:
    """By breadth-first search; after t rounds up to t hops; without a source nobody knows one."""
    count = data.draw(COUNTS)
    graph, said = data.draw(graphs(count)), data.draw(anything(count))
    sources = data.draw(st.sets(st.integers(0, count - 1)))
    roads = Roads(graph)
    far = [min((roads.distances(s)[m] for s in sources), default=count) for m in range(count)]
    for time in range(1, count + 1):
        said = flowed(said, graph, sources)
        for each, distance in zip(said, far, strict=True):
            assert each.hops == distance if distance < time else each.hops >= time
    assert [each.hops for each in said] == far


@pytest.mark.slow
@settings(max_examples=100, derandomize=True)
@given(st.data())
def test_parents_are_a_spanning_tree(data: st.DataObject) -> None:
    """Each module but the source is a child of one neighbour, one hop nearer."""
    count = data.draw(COUNTS)
    graph, said = data.draw(graphs(count)), data.draw(anything(count))
    source = data.draw(st.integers(0, count - 1))
    for _ in range(count):
        said = flowed(said, graph, {source})
    children = [mine.children(said[near] for near in graph[mine.module]) for mine in said]
    assert sorted(sum(children, [source])) == list(range(count))
    assert all(said[child].hops == said[m].hops + 1 for m in range(count) for child in children[m])


def ballots(count: int, seed: int) -> list[Election]:
    system = scene_from_spec("hex:n=3").system
    return [
        Election.begin(
            InitialKnowledge(system, module, count, (0, 0), (), stream(seed, module, RULE))
        )
        for module in range(count)
    ]


def gathered(said: list[Election], graph: Graph, acting: Collection[int]) -> list[Election]:
    """Return what all know after a round in which these modules listen."""
    after = list(said)
    for module in acting:
        for near in graph[module]:
            after[module] = after[module].merged(said[near])
    return after


@pytest.mark.slow
@settings(max_examples=25, derandomize=True)
@given(st.data(), TURNS, st.integers(0, 9))
def test_all_elect_one_leader_while_they_move(data: st.DataObject, turns: Turns, seed: int) -> None:
    """Who is settled is right, in any order of turns and while neighbours change; then all are."""
    count = data.draw(COUNTS)
    said = ballots(count, seed)
    leader = min(said).leader
    for acting in [*turns, *[set(range(count))] * count]:
        said = gathered(said, data.draw(graphs(count)), acting & set(range(count)))
        assert all(each.leader == leader for each in said if each.settled(count))
    assert all(each.settled(count) for each in said)


def test_any_module_may_lead() -> None:
    """The seed decides, and the same seed decides the same."""
    leaders = [min(ballots(4, seed)).leader for seed in range(20)]
    assert set(leaders) == {0, 1, 2, 3}
    assert leaders == [min(ballots(4, seed)).leader for seed in range(20)]


@settings(max_examples=40, derandomize=True)
@given(st.integers(1, 100), st.integers(0))
def test_an_election_is_read_back(count: int, heard: int) -> None:
    """Of any number of modules, in numbers that a note can hold."""
    known = Election((1 << 31) - 1, count - 1, heard & (1 << count) - 1)
    note = known.note(count)
    assert Election.of(note) == known
    assert len(note) == Election.note_length(count)
    assert max(note) < 1 << 31


def tokens(count: int, holder: int) -> list[Token]:
    return [Token(module, int(module == holder), module) for module in range(count)]


@pytest.mark.slow
@settings(max_examples=40, derandomize=True)
@given(st.data(), TURNS)
def test_there_is_one_token_at_any_time(data: st.DataObject, turns: Turns) -> None:
    """While modules move and skip rounds, and what they hear is late."""
    count = data.draw(COUNTS)
    said = tokens(count, data.draw(st.integers(0, count - 1)))
    before = [said]
    for acting in turns:
        graph, after = data.draw(graphs(count)), list(said)
        for module in acting & set(range(count)):
            old = before[-data.draw(st.integers(1, min(4, len(before)))) :][0]
            heard = [old[near] for near in graph[module]]
            mine = said[module]
            after[module] = mine.passed(heard) if mine.mine else mine.taken(heard)
        said = after
        before.append(said)
        greatest = max(each.passes for each in said)
        assert sum(each.passes == greatest for each in said) == 1
        (last,) = (each for each in said if each.passes == greatest)
        assert [each for each in said if each.mine] == [last] * (last.to == last.module)


def walk(graph: Graph, steps: int) -> list[int]:
    """Return who has the token in turn, if it goes to the neighbour who had it least lately."""
    said, found = tokens(len(graph), 0), [0]
    for _ in range(2 * steps):
        heard = [[said[near] for near in sorted(graph[m])] for m in range(len(graph))]
        said = [
            mine.passed(heard[m]) if mine.mine else mine.taken(heard[m])
            for m, mine in enumerate(said)
        ]
        found += [each.module for each in said if each.mine]
    return found


@pytest.mark.slow
@settings(max_examples=50, derandomize=True)
@given(st.data())
def test_a_token_goes_round_a_tree(data: st.DataObject) -> None:
    """In twice as many steps as there are edges, along each of them both ways."""
    count = data.draw(st.integers(2, MOST))
    graph = graph_of(count, data.draw(trees(count)))
    steps = 2 * (count - 1)
    found = walk(graph, 2 * steps)
    assert found[0] == found[steps] == 0
    assert found[steps:] == found[: steps + 1]
    assert len(set(pairwise(found))) == steps


@pytest.mark.slow
@settings(max_examples=50, derandomize=True)
@given(st.data())
def test_a_token_comes_to_everybody(data: st.DataObject) -> None:
    """Here within n^2 steps; between k + 1 visits to a module its k neighbours have all had it."""
    count = data.draw(st.integers(2, MOST))
    graph = data.draw(graphs(count))
    found = walk(graph, count * count)
    assert set(found) == set(range(count))
    for module in range(count):
        visits = [at for at, each in enumerate(found) if each == module]
        for first, last in zip(visits, visits[len(graph[module]) :], strict=False):
            assert graph[module] <= set(found[first:last])


def connected(cells: Collection[Site]) -> bool:
    """Return whether hexagons are in one piece."""
    rest = {HEXAGONS.check(cell) for cell in cells}
    rim = [rest.pop()]
    for here in rim:
        near = rest.intersection(beside_of(here))
        rest -= near
        rim += near
    return not rest


@pytest.mark.slow
@pytest.mark.parametrize(("spec", "rounds"), [("hex-open:n=4", 600), ("hex-open:n=7,bend=60", 400)])
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
def test_the_walkers_of_the_tutorial_stay_connected(
    spec: str, rounds: int, hesitate: float
) -> None:
    """In every round, since none is the way of another to the source; `metropolis` parts them."""
    file = ROOT / "docs" / "examples" / "walkers.py"
    for name, whole in ((f"{file}:WALKERS", True), ("metropolis", False)):
        rule = rule_named(name, scene_from_spec(spec).system)
        played = play(spec, rule, seed=1, hesitate=hesitate, max_rounds=rounds)
        states: list[State] = [frozenset(scene_from_spec(spec).start)]
        for action in played.path:
            states.append(apply(action, states[-1]))
        assert len(states) > 10
        assert all(map(connected, states)) == whole
