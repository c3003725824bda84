"""Random graphs for vehicles: trees, connected G(n, p), regular graphs, and random parts of graphs.

Each model is uniform or has exactly the probabilities that it names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.scenes.random_scenes.shares import happens, share_of
from cubepath.protocol.scenes.random_scenes.stream import Stream
from cubepath.protocol.systems.graphs import Graph

_TREE = re.compile(r"tree([0-9]{1,9})")
_GNP = re.compile(r"gnp([0-9]{1,9})x([0-9.]+)")
_REGULAR = re.compile(r"regular([0-9]{1,9})x([0-9]{1,9})")
_TREE_MAX, _GNP_MAX, _REGULAR_MAX = 100_000, 500, 10_000
_DEGREES = (3, 4)
"""With a degree of 5 one of some 400 pairings makes a graph without loops and double edges."""
_TRIES = 1000
_Pairs = list[tuple[int, int]]


def random_graph(name: str) -> Callable[[Stream], Graph] | None:
    """Return what draws the graph that a name stands for; None if it is no name of a model.

    ``tree20``: each of the 20^18 trees on 20 numbered vertices equally likely. ``gnp20x0.2``: each
    pair is an edge with probability 0.2, given that the graph is connected. ``regular20x3``: each
    connected graph on 20 numbered vertices of degree 3 equally likely; degrees are 3 or 4.
    InputError for sizes out of bounds.
    """
    if found := _TREE.fullmatch(name):
        count = _size(name, found[1], 2, _TREE_MAX)
        return lambda stream: _graph(count, _tree(count, stream))
    if found := _GNP.fullmatch(name):
        count = _size(name, found[1], 2, _GNP_MAX)
        share = share_of(found[2], f"graph={name}")
        return lambda stream: _connected(
            name,
            count,
            lambda: [
                (one, other)
                for one in range(count)
                for other in range(one + 1, count)
                if happens(share, stream)
            ],
        )
    if found := _REGULAR.fullmatch(name):
        count, degree = _size(name, found[1], 4, _REGULAR_MAX), int(found[2])
        if degree not in _DEGREES or degree >= count or count * degree % 2:
            raise InputError(
                f"graph={name}: expected a degree of 3 or 4, less than the number of vertices, and"
                " an even number of ends of edges"
            )
        return lambda stream: _connected(name, count, lambda: _paired(count, degree, stream))
    return None


def _size(name: str, text: str, least: int, most: int) -> int:
    count = int(text)
    if not least <= count <= most:
        raise InputError(f"graph={name}: expected at least {least} and at most {most} vertices")
    return count


def _graph(count: int, edges: Iterable[tuple[int, int]]) -> Graph:
    ordered = sorted((min(edge), max(edge)) for edge in edges)
    return Graph(tuple(range(count)), tuple(ordered))


def _tree(count: int, stream: Stream) -> _Pairs:
    """Return the edges of a tree on `count` vertices, from its code (Pruefer 1918).

    The codes are the sequences of count - 2 vertices; each belongs to one tree, and each tree to
    one. The code is read from the left: its next vertex is joined to the least leaf there is.
    """
    code = [stream.below(count) for _ in range(count - 2)]
    degree = [1] * count
    for vertex in code:
        degree[vertex] += 1
    edges: _Pairs = []
    first = degree.index(1)
    leaf = first
    for vertex in code:
        edges.append((leaf, vertex))
        degree[vertex] -= 1
        if degree[vertex] == 1 and vertex < first:
            leaf = vertex  # a leaf that is less than all others
        else:
            first = degree.index(1, first + 1)
            leaf = first
    edges.append((leaf, count - 1))
    return edges


def _paired(count: int, degree: int, stream: Stream) -> _Pairs | None:
    """Return the edges of a pairing of all ends of edges; None if it has a loop or a double edge.

    Every graph without these comes of (degree!)^count pairings (Bollobas 1980), so all are equally
    likely.
    """
    ends = stream.drawn([vertex for vertex in range(count) for _ in range(degree)])
    found: set[tuple[int, int]] = set()
    for one, other in zip(ends, ends, strict=True):
        edge = (min(one, other), max(one, other))
        if one == other or edge in found:
            return None
        found.add(edge)
    return sorted(found)


def _connected(name: str, count: int, draw: Callable[[], _Pairs | None]) -> Graph:
    """Return the first graph drawn that is connected: it has its probability given that it is."""
    for _ in range(_TRIES):
        edges = draw()
        if edges is not None and len(edges) >= count - 1:
            graph = _graph(count, edges)
            if len(_parts(graph)[0]) == count:
                return graph
    raise InputError(f"graph={name}: none of {_TRIES} drawn is connected, expected more edges")


def open_part(graph: Graph, share: str, stream: Stream) -> Graph:
    """Return the largest connected part of a random choice of vertices, with all edges between.

    Of the vertices this share is chosen, rounded to a whole number, half up; each choice of that
    size is equally likely. Of several parts of one size the first is taken, by the canonical order
    of their vertices. InputError if no edge is left.
    """
    vertices = in_order(graph.vertices)
    part = share_of(share, f"open={share}")
    some = stream.drawn(vertices)
    kept = {next(some) for _ in range(int(part * len(vertices) * 2 + 1) // 2)}
    left = Graph(
        tuple(vertex for vertex in vertices if vertex in kept),
        tuple(edge for edge in graph.edges if kept.issuperset(edge)),
        graph.compass,
    )
    largest = max(_parts(left), key=len, default=set[Site]())
    if len(largest) < 2:
        raise InputError(f"open={share}: no two vertices beside each other are open")
    return Graph(
        tuple(vertex for vertex in left.vertices if vertex in largest),
        tuple(edge for edge in left.edges if largest.issuperset(edge)),
        graph.compass,
    )


def _parts(graph: Graph) -> list[set[Site]]:
    """Return the connected parts, in the order of their first vertices."""
    near: dict[Site, list[Site]] = {vertex: [] for vertex in graph.vertices}
    for one, other in graph.edges:
        near[one].append(other)
        near[other].append(one)
    found: list[set[Site]] = []
    known: set[Site] = set()
    for vertex in graph.vertices:
        if vertex in known:
            continue
        part = [vertex]
        known.add(vertex)
        for here in part:  # it grows meanwhile
            for there in near[here]:
                if there not in known:
                    known.add(there)
                    part.append(there)
        found.append(set(part))
    return found
