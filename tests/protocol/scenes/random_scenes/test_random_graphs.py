"""Random graphs: each model has exactly the probabilities that it names, and is connected."""

from collections import Counter
from fractions import Fraction
from itertools import combinations, product
from typing import cast

import pytest

from chances import as_chance_has_it
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.random_scenes import Stream, open_part, random_graph
from cubepath.protocol.systems.graphs import Edge, Graph, graph_from_name

Edges = tuple[Edge, ...]


def drawn(name: str, seed: int) -> Graph:
    draw = random_graph(name)
    assert draw is not None
    return draw(Stream(f"graph:{name}", seed))


def connected(count: int, edges: Edges) -> bool:
    """Tell whether the edges join all vertices, by merging parts."""
    part = list(range(count))
    for one, other in cast("tuple[tuple[int, int], ...]", edges):
        old, new = part[one], part[other]
        part = [new if each == old else each for each in part]
    return len(set(part)) == 1


def all_graphs(count: int) -> list[Edges]:
    """Return all connected graphs on numbered vertices."""
    pairs = list(combinations(range(count), 2))
    choices = product((False, True), repeat=len(pairs))
    found = [
        tuple(pair for pair, taken in zip(pairs, choice, strict=True) if taken)
        for choice in choices
    ]
    return [edges for edges in found if connected(count, edges)]


def degrees(count: int, edges: Edges) -> set[int]:
    return {sum(vertex in edge for edge in edges) for vertex in range(count)}


@pytest.mark.parametrize(
    ("name", "count", "number"), [("tree4", 4, 16), ("tree5", 5, 125), ("regular6x3", 6, 70)]
)
def test_each_tree_and_each_regular_graph_comes_about_as_often(
    name: str, count: int, number: int
) -> None:
    """All of them that there are, counted in the obvious way, and no other."""
    is_tree = name.startswith("tree")
    wanted = [
        edges
        for edges in all_graphs(count)
        if (len(edges) == count - 1 if is_tree else degrees(count, edges) == {3})
    ]
    assert len(wanted) == number
    found = Counter(drawn(name, seed).edges for seed in range(20 * number))
    assert found.keys() <= set(wanted)
    assert as_chance_has_it([found[edges] for edges in wanted], 20)


def test_connected_random_graphs_have_the_probabilities_that_they_name() -> None:
    """Of the 38 connected graphs on four vertices each has that of its number of edges."""
    share, runs = Fraction("0.4"), 4000
    weight = {
        edges: share ** len(edges) * (1 - share) ** (6 - len(edges)) for edges in all_graphs(4)
    }
    assert len(weight) == 38
    found = Counter(drawn("gnp4x0.4", seed).edges for seed in range(runs))
    assert found.keys() <= weight.keys()
    for size in range(3, 7):
        alike = [edges for edges in weight if len(edges) == size]
        expected = runs * sum(weight[edges] for edges in alike) / sum(weight.values())
        counted = sum(found[edges] for edges in alike)
        assert abs(counted - expected) < 4 * float(expected) ** 0.5
        if len(alike) > 1:
            assert as_chance_has_it([found[edges] for edges in alike], counted / len(alike))


@pytest.mark.parametrize(
    "name", ["tree2", "tree30", "gnp30x0.2", "gnp3x1", "regular20x3", "regular9x4"]
)
def test_random_graphs_are_connected_and_as_large_as_they_say(name: str) -> None:
    """For a few seeds, which give different graphs where there are several."""
    found = {drawn(name, seed).edges for seed in range(5)}
    count = int("".join(c for c in name.partition("x")[0] if c.isdigit()))
    assert len(found) == (1 if name in {"tree2", "gnp3x1"} else 5)
    for edges in found:
        assert connected(count, edges)
        if name.startswith("regular"):
            assert degrees(count, edges) == {int(name[-1])}
        if name.startswith("tree"):
            assert len(edges) == count - 1


def test_the_open_part_is_the_largest_of_a_random_choice() -> None:
    """So many vertices are drawn, rounded half up; the part is connected and nothing is lost."""
    whole = graph_from_name("grid5x5")
    sizes = set()
    for seed in range(30):
        some = Stream("open", seed).drawn(whole.vertices)
        chosen = {next(some) for _ in range(15)}  # 0.58 * 25 = 14.5
        part = open_part(whole, "0.58", Stream("open", seed))
        kept = set(part.vertices)
        assert kept <= chosen
        assert set(part.edges) == {edge for edge in whole.edges if kept.issuperset(edge)}
        assert not any(len(kept & {*edge}) == 1 for edge in whole.edges if chosen.issuperset(edge))
        number = {vertex: place for place, vertex in enumerate(part.vertices)}
        assert connected(len(kept), tuple((number[a], number[b]) for a, b in part.edges))
        assert len(kept) >= len(chosen - kept) / 5
        assert part.compass
        sizes.add(len(kept))
    assert len(sizes) > 3
    assert open_part(whole, "1", Stream("open", 1)) == whole


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("tree1", "graph=tree1: expected at least 2 and at most 100000 vertices"),
        ("gnp501x0.1", "expected at least 2 and at most 500 vertices"),
        ("gnp9x1.5", "graph=gnp9x1.5: expected a decimal number of at least 0, at most 1"),
        ("gnp9x..", "graph=gnp9x..: expected a decimal number"),
        ("gnp20x0.01", "graph=gnp20x0.01: none of 1000 drawn is connected, expected more edges"),
        ("regular9x3", "graph=regular9x3: expected a degree of 3 or 4"),
        ("regular8x5", "expected a degree of 3 or 4"),
        ("regular4x4", "less than the number of vertices"),
    ],
)
def test_a_model_that_cannot_be_drawn_is_refused(name: str, message: str) -> None:
    """In one line, with what was expected."""
    with pytest.raises(InputError, match=message) as error:
        drawn(name, 1)
    assert "\n" not in str(error.value)
