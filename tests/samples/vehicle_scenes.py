"""Vehicles on small graphs, for the tests of rules: with goals of their own, or shared ones."""

import random
from collections.abc import Sequence
from itertools import pairwise

from hypothesis import strategies as st

from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import graph_from_name

Edges = Sequence[tuple[Site, Site]]


def scene_on(edges: Edges, starts: Sequence[Site], goals: Sequence[Site]) -> Scene:
    """Return vehicles that share their goals."""
    vertices = {end for edge in edges for end in edge}
    return Scene(
        spec="test",
        family="agv",
        system=GraphSystem(vertices, edges),
        start=tuple(starts),
        goal=frozenset(goals),
        goals=tuple((goal,) for goal in goals),
    )


def labelled_scene_on(edges: Edges, starts: Sequence[Site], goals: Sequence[Site]) -> Scene:
    """Return vehicles with goals of their own."""
    vertices = {end for edge in edges for end in edge}
    return Scene(
        spec="test",
        family="agv-labelled",
        system=GraphSystem(vertices, edges, labels=len(starts)),
        start=tuple((vertex, label) for label, vertex in enumerate(starts)),
        goal=frozenset((vertex, label) for label, vertex in enumerate(goals)),
        goals=tuple((goal,) for goal in goals),
    )


def random_labelled_scene(graph: str, vehicles: int, seed: int) -> Scene:
    """Return vehicles with goals of their own at random on a named graph."""
    found = graph_from_name(graph)
    chosen = random.Random(seed)  # noqa: S311 - a test's instance is no secret
    starts, goals = (chosen.sample(found.vertices, vehicles) for _ in range(2))
    return labelled_scene_on(found.edges, starts, goals)


def cycle(size: int) -> list[tuple[int, int]]:
    """Return the edges of a cycle."""
    return [(vertex, (vertex + 1) % size) for vertex in range(size)]


@st.composite
def without_cut_vertices(draw: st.DrawFn) -> Scene:
    """Return vehicles on a cycle with chords and a further ear, with one or two empty vertices."""
    size = draw(st.integers(3, 7))
    edges = cycle(size)
    ends = st.lists(st.integers(0, size - 1), min_size=2, max_size=2, unique=True)
    edges += [(one, other) for one, other in draw(st.lists(ends, max_size=2))]
    one, other = draw(ends)
    ear = [one, *range(size, size + draw(st.integers(0, 2))), other]
    edges += pairwise(ear)
    size += len(ear) - 2
    vehicles = size - draw(st.integers(1, 2))
    starts = draw(st.permutations(range(size)))[:vehicles]
    goals = draw(st.permutations(range(size)))[:vehicles]
    return labelled_scene_on(edges, starts, goals)
