"""What random scenes are drawn from: a stream of numbers, shapes, graphs, triangulations, walks.

A seed must name the same scene forever: in any process, on any machine, with any version of Python
and numpy. So nothing of theirs is used but SHA-256 (FIPS 180-4). The stream for a purpose and a
seed is the bits of the digests of the texts ``cubepath:PURPOSE:SEED:0``,
``cubepath:PURPOSE:SEED:1`` and so on, in ASCII, each digest from its most significant bit on. Each
purpose has its own stream: the same seed gives the same map, however many vehicles start there.

A shape is a connected set of cells of a lattice; two that differ by a translation are the same one
in another place (a *fixed* polyhex or polyomino).

Each model is uniform or has exactly the probabilities that it names.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from fractions import Fraction
from hashlib import sha256
from itertools import combinations
from typing import TypeVar

import numpy as np

from cubepath.protocol.core.actions import apply, apply_in_place, end_at
from cubepath.protocol.core.catalogue import Cell, Lattice, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.registry import Values, whole
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graphs import Graph
from cubepath.protocol.systems.point_sets import Edge

T = TypeVar("T")
SEED_MAX = 10**18 - 1
"""The greatest seed that a spec may have."""


class Stream:
    """A stream of random numbers for one purpose, from a seed.

    >>> Stream("docs", 1).below(100), Stream("docs", 2).below(100)
    (83, 92)
    """

    def __init__(self, purpose: str, seed: int) -> None:
        """Begin the stream; nothing is drawn yet."""
        self._name = f"cubepath:{purpose}:{seed}"
        self._blocks = 0
        self._bits = 0
        self._left = 0

    def below(self, limit: int) -> int:
        """Return an integer of at least 0 and less than `limit`, each equally likely.

        As many bits as ``limit - 1`` has are read as a number, most significant first, again until
        it is less than `limit`. `limit` is at least 1; of 1 alone nothing is read.
        """
        size = (limit - 1).bit_length()
        while True:
            while self._left < size:
                text = f"{self._name}:{self._blocks}"
                block = int.from_bytes(sha256(text.encode("ascii")).digest(), "big")
                self._bits = self._bits << 256 | block
                self._left += 256
                self._blocks += 1
            self._left -= size
            found = self._bits >> self._left
            self._bits &= (1 << self._left) - 1
            if found < limit:
                return found

    def choice(self, among: Sequence[T]) -> T:
        """Return one of several, each equally likely."""
        return among[self.below(len(among))]

    def drawn(self, among: Sequence[T]) -> Iterator[T]:
        """Yield all of several in random order, each order equally likely.

        If you stop after N, you have a random choice of N; with more, it begins the same.
        """
        rest = list(among)
        for place in range(len(rest)):
            other = place + self.below(len(rest) - place)
            rest[place], rest[other] = rest[other], rest[place]
            yield rest[place]


_DECIMAL = re.compile(r"[0-9]?(\.[0-9]{1,9})?")


def share_of(text: str, what: str, *, most: str = "1") -> Fraction:
    """Return a decimal number within bounds, exactly; InputError begins with `what`."""
    found = Fraction(text) if text and _DECIMAL.fullmatch(text) else None
    if found is None or not 0 <= found <= Fraction(most):
        raise InputError(
            f"{what}: expected a decimal number of at least 0, at most {most}, of at most 9 places"
        )
    return found


def happens(share: Fraction, stream: Stream) -> bool:
    """Return True with this probability, exactly."""
    return stream.below(share.denominator) < share.numerator


def uniform_shape(count: int, lattice: Lattice, stream: Stream) -> tuple[Cell, ...]:
    """Return a shape of `count` cells that holds the origin, each equally likely, as are its cells.

    The lattice is one of cells, so that one orbit holds all. They are listed in ascending order.

    Method. A cluster grows from the origin: each cell beside it is looked at once, in an order that
    depends only on what was seen before, and joins with probability 1/3 (Leath 1976). If it
    stops growing with `count` cells and has t cells beside it, it is taken with probability
    (2/3)^(most - t), where `most` is at least the greatest t of that size; else all begins again.

    Proof. A shape that holds the origin is found with probability (1/3)^(count - 1) (2/3)^t,
    whatever the order, and so taken with (1/3)^(count - 1) (2/3)^most, the same for all. Every
    shape has as many translates that hold the origin as cells, one for each. As for `most`: the
    first cell has d cells beside it. A shape can be listed so that each cell is beside an earlier
    one. It was then itself beside the shape, and of its d neighbours one is in the shape, and as
    many as two touching cells share are beside that one and so known already: for 6 hexagons 2, for
    12 dodecahedra 4, else none. It adds at most the rest and takes itself away. A straight line has
    as many.

    Cost. In the plane 1/3 makes the loss of each further cell least, (1/3)(2/3)^2 = 4/27 against
    the growth of the number of shapes, some 5.18 of hexagons (4.06 of squares): to begin again is
    needed about 1.3^count (1.7^count) times, mostly after a few cells.
    """
    near = lattice.beside(origin_of(lattice))
    most = len(near) + (count - 1) * (len(near) - 2 - len({*near} & {*lattice.beside(near[0])}))
    while True:
        found = grown_once(count, lattice, most, stream)
        if found is not None:
            return found


def origin_of(lattice: Lattice) -> Cell:
    """Return the cell from which shapes grow."""
    return (0,) * lattice.arity


def grown_once(count: int, lattice: Lattice, most: int, stream: Stream) -> tuple[Cell, ...] | None:
    """Return the cluster of one try of `uniform_shape`; None if it has another size or is refused.

    With `most` as there, each shape that holds the origin has the probability
    (1/3)^(count - 1) (2/3)^most.
    """
    below = stream.below
    cells = [origin_of(lattice)]
    seen = {*cells}
    closed = 0
    for cell in cells:  # it grows meanwhile
        for near in lattice.beside(cell):
            if near not in seen:
                seen.add(near)
                if below(3):
                    closed += 1
                else:
                    cells.append(near)
        if len(cells) > count:
            return None
    if len(cells) == count and all(below(3) for _ in range(most - closed)):
        return tuple(sorted(cells))
    return None


def grown_shape(count: int, lattice: Lattice, stream: Stream) -> tuple[Cell, ...]:
    """Return a shape of `count` cells that holds the origin, grown from there.

    Cells are listed in ascending order. Each new cell is one of those beside the shape, each
    equally likely (Eden 1961). Compact shapes are more likely than others.
    """
    cells = {origin_of(lattice)}
    border = list(lattice.beside(origin_of(lattice)))
    known = {*cells, *border}
    while len(cells) < count:
        place = stream.below(len(border))
        border[place], border[-1] = border[-1], border[place]
        cell = border.pop()
        cells.add(cell)
        for near in lattice.beside(cell):
            if near not in known:
                known.add(near)
                border.append(near)
    return tuple(sorted(cells))


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

    Every graph without these results from (degree!)^count pairings (Bollobas 1980), so all are
    equally likely.
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
        raise InputError(f"open={share}: no two neighbouring vertices are open")
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


_POINTS_MAX = 200


def random_triangulation(system: FlipSystem, stream: Stream) -> frozenset[Edge]:
    """Return a triangulation: edges in random order, each taken if it crosses none taken before.

    Every triangulation can come out, with long edges more often than if all were equally likely.
    InputError for more than 200 points.
    """
    plane = system.plane
    count = len(plane.points)
    if count > _POINTS_MAX:
        raise InputError(f"{count} points: a random triangulation has at most {_POINTS_MAX}")
    edges = [edge for edge in combinations(range(count), 2) if not plane.on_the_way(*edge)]
    taken = np.empty((3 * count, 2), dtype=np.intp)
    size = 0
    for edge in stream.drawn(edges):
        if not plane.crossings(edge, taken[:size]).any():
            taken[size] = edge
            size += 1
    return frozenset((int(one), int(other)) for one, other in taken[:size])


_MOVES_MAX = 100_000
_WORK_MAX = 1_000_000
"""The most moves times modules: at every step all modules are asked what they can do."""
WALK_KEY = ("", "the goal is where this many random moves lead, so it can be reached")


def walk_length(values: Values, modules: int) -> int | None:
    """Return the value of the key `walk`; None where it is left out, InputError for a bad one."""
    if not values["walk"]:
        return None
    most = min(_MOVES_MAX, _WORK_MAX // modules)
    return whole(values, "walk", least=1, most=most)


def walked(system: System, start: Sequence[Site], moves: int, stream: Stream) -> tuple[Site, ...]:
    """Return where the modules are after a random walk, in the order in which they start.

    Every step is one of the admissible moves, each equally likely, but not the last move back
    unless there is no other. A walk that ends where it began is one step shorter. InputError if no
    module can move.
    """
    sites = before = list(start)
    state = {*start, *system.filled}
    ask = system.discovery() or system.moves_at
    asked: set[Site] = set()
    known: dict[Site, list[Move]] = {}
    waiting: list[Site] = [*start, *in_order(system.filled)]
    last = None
    for _ in range(moves):
        for site in waiting:
            if site not in asked:
                asked.add(site)
                for move in ask(site):
                    known.setdefault(move.source, []).append(move)
        # A system may offer one action by several moves.
        options = {
            move.action: move
            for site in sites
            for move in known.get(site, ())
            if _can_be_made(move, state)
            and (system.local or system.legal(apply(move.action, state)))
        }
        if len(options) > 1 and last is not None:
            options.pop(last, None)
        if not options:
            raise InputError(f"walk={moves}: no module can move")
        move = stream.choice(list(options.values()))
        place = {site: number for number, site in enumerate(sites)}
        before = list(sites)
        for source, target in move.motion:
            sites[place[source]] = target
        apply_in_place(move.action, state)
        waiting = [target for _, target in move.motion]
        last = move.action
    return tuple(before if set(sites) == set(start) else sites)


def _can_be_made(move: Move, state: AbstractSet[Site]) -> bool:
    """Return whether the action applies at the state, in the direction of this move."""
    end = end_at(move.action, state)
    return end is not None and all(source in move.action.ends[end] for source, _ in move.motion)
