"""Torsion in the second homology of vehicles on grids: two exchanges that can change places.

``python docs/studies/torsion.py -o docs/studies/torsion.json`` makes the rows, ``--quick`` two
small ones. A cell is a set of edges along which vehicles move, no two with a common end, and a set
of vertices where the others stand: the state complex by names, without the project's arrays.
"""

from __future__ import annotations

import argparse
import json
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from itertools import combinations, pairwise
from math import atan2
from pathlib import Path

from cubepath.coordinator import explore, homology, state_complex
from cubepath.protocol import scene_from_spec

Vertex = tuple[int, int]
Edge = tuple[Vertex, Vertex]
Cell = tuple[tuple[Edge, ...], frozenset[Vertex]]
Chain = dict[Cell, int]
Column = dict[int, int]
Junction = tuple[Vertex, Vertex, Vertex, Vertex]
"""A vertex and three of its neighbours, clockwise."""
Pair = tuple[Junction, Junction]
SETTINGS = ((4, 4, 4), (5, 4, 4), (6, 4, 4), (5, 5, 4), (6, 5, 4), (5, 5, 5))
"""Columns and rows of a grid, and how many vehicles are on it."""
QUICK = ((3, 3, 4), (4, 3, 4))
PAIR: Pair = (((0, 1), (0, 0), (1, 1), (0, 2)), ((2, 3), (3, 3), (2, 4), (1, 3)))
"""Two junctions on the 5x5 grid; their exchanges change places by way of a third."""
_PRIME = 10007


def grid(columns: int, rows: int) -> list[Vertex]:
    """Return the vertices of a grid."""
    return [(x, y) for x in range(columns) for y in range(rows)]


def edges_of(vertices: Iterable[Vertex]) -> list[Edge]:
    """Return the edges between neighbours, each from its lesser end to its greater."""
    known = set(vertices)
    ends = [((x, y), to) for x, y in sorted(known) for to in ((x, y + 1), (x + 1, y))]
    return [edge for edge in ends if edge[1] in known]


def cells(vertices: Iterable[Vertex], vehicles: int, dimension: int) -> Iterator[Cell]:
    """Yield the cells of a dimension: so many vehicles move, the others stand."""
    known = sorted(vertices)
    edges = edges_of(known)

    def extend(chosen: tuple[Edge, ...], first: int) -> Iterator[Cell]:
        used = {end for edge in chosen for end in edge}
        if len(chosen) == dimension:
            free = [vertex for vertex in known if vertex not in used]
            for standing in combinations(free, vehicles - dimension):
                yield chosen, frozenset(standing)
            return
        for place in range(first, len(edges)):
            if used.isdisjoint(edges[place]):
                yield from extend((*chosen, edges[place]), place + 1)

    return extend((), 0)


def faces(cell: Cell) -> Iterator[tuple[Cell, int]]:
    """Yield the faces of a cell, each with its sign: a move that is over, less one not begun."""
    moving, standing = cell
    for place, edge in enumerate(moving):
        rest = moving[:place] + moving[place + 1 :]
        for end, sign in ((1, 1), (0, -1)):
            yield (rest, standing | {edge[end]}), sign * (-1) ** place


def boundary(chain: Chain) -> Chain:
    """Return the boundary of a chain."""
    found: Chain = {}
    for cell, count in chain.items():
        for face, sign in faces(cell):
            found[face] = found.get(face, 0) + sign * count
    return {cell: count for cell, count in found.items() if count}


def product(one: Chain, other: Chain) -> Chain:
    """Return the product of chains of vehicles that have no vertex in common."""
    found: Chain = {}
    for (moving, standing), count in one.items():
        for (also, there), times in other.items():
            swaps = sum(late < early for early in moving for late in also)
            cell = tuple(sorted(moving + also)), standing | there
            found[cell] = found.get(cell, 0) + (-1) ** swaps * count * times
    return found


def junctions(vertices: Iterable[Vertex]) -> list[Junction]:
    """Return all vertices with three of their neighbours each."""
    near: dict[Vertex, list[Vertex]] = {}
    for one, other in edges_of(vertices):
        near.setdefault(one, []).append(other)
        near.setdefault(other, []).append(one)
    found = []
    for at, others in sorted(near.items()):
        for three in combinations(others, 3):
            x, y = at
            first, second, third = sorted(three, key=lambda v: atan2(v[1] - y, v[0] - x))
            found.append((at, first, second, third))
    return found


def exchange(junction: Junction) -> Chain:
    """Return the loop of six moves in which two vehicles change places at a junction."""
    middle, first, second, third = junction
    moves = [
        (second, middle, first),
        (middle, third, first),
        (first, middle, third),
        (middle, second, third),
        (third, middle, second),
        (middle, first, second),
    ]
    found: Chain = {}
    for start, end, stands in moves:
        edge = (min(start, end), max(start, end))
        found[(edge,), frozenset([stands])] = 1 if start < end else -1
    return found


# Linear algebra modulo a prime, one column after another. Rows below 0 are never eliminated.


def reduced(column: Column, pivots: dict[int, Column], prime: int) -> Column:
    """Return a column less multiples of the pivots, until its greatest row is none of theirs."""
    left = {row: value % prime for row, value in column.items() if value % prime}
    while left and (row := max(left)) in pivots:
        times = left[row]
        for place, value in pivots[row].items():
            new = (left.get(place, 0) - times * value) % prime
            if new:
                left[place] = new
            else:
                del left[place]
    return left


def pivots_of(columns: Iterable[Column], prime: int) -> dict[int, Column]:
    """Return a basis of what the columns span, by greatest row, where each has a 1."""
    pivots: dict[int, Column] = {}
    for column in columns:
        left = reduced(column, pivots, prime)
        row = max(left, default=-1)
        if row >= 0:
            inverse = pow(left[row], -1, prime)
            pivots[row] = {place: value * inverse % prime for place, value in left.items()}
    return pivots


class Boundaries:
    """The boundaries of vehicles on a graph from one dimension to the next, modulo a prime."""

    def __init__(self, vertices: Iterable[Vertex], vehicles: int, dimension: int) -> None:
        """List the cells."""
        known = list(vertices)
        self.cells = list(cells(known, vehicles, dimension))
        self.row = {cell: row for row, cell in enumerate(cells(known, vehicles, dimension - 1))}

    def column(self, chain: Chain) -> Column:
        """Return a chain of the lower dimension as a column."""
        return {self.row[cell]: count for cell, count in chain.items()}

    def columns(self, skip: Iterable[int] = ()) -> Iterator[Column]:
        """Yield the boundaries of all cells but those with these numbers."""
        left_out = set(skip)
        for number, cell in enumerate(self.cells):
            if number not in left_out:
                yield {self.row[face]: sign for face, sign in faces(cell)}


# Two exchanges that change places.


class Exchanges:
    """The exchanges at junctions on a grid, by which others are homologous beside a given one."""

    def __init__(self, vertices: Iterable[Vertex]) -> None:
        """List the junctions."""
        self.vertices = sorted(vertices)
        self.junctions = junctions(self.vertices)
        self._beside: dict[Junction, tuple[Boundaries, dict[int, Column]]] = {}

    def pairs(self) -> list[Pair]:
        """Return all pairs of junctions without a common vertex, in both orders."""
        every = self.junctions
        return [(one, other) for one in every for other in every if not set(one) & set(other)]

    def _free(self, taken: Junction) -> tuple[Boundaries, dict[int, Column]]:
        """Return the squares of two vehicles that keep away from a junction, eliminated.

        A column has, in the row -1 - number, how often each square is in it.
        """
        if taken not in self._beside:
            vertices = [vertex for vertex in self.vertices if vertex not in taken]
            squares = Boundaries(vertices, 2, 2)
            columns = (column | {-1 - number: 1} for number, column in enumerate(squares.columns()))
            self._beside[taken] = squares, pivots_of(columns, _PRIME)
        return self._beside[taken]

    @cache  # noqa: B019 - one object for each grid
    def kind(self, junction: Junction, taken: Junction) -> tuple[tuple[int, int], ...]:
        """Return the class of an exchange beside a junction: it is equal for homologous ones."""
        squares, pivots = self._free(taken)
        left = squares.column(exchange(junction))
        found: Column = {}
        while left:  # down to the rows of no pivot
            left = reduced(left, pivots, _PRIME)
            row = max(left, default=-1)
            if row < 0:
                break
            found[row] = left.pop(row)
        return tuple(sorted(found.items()))

    def between(self, one: Junction, other: Junction, taken: Junction) -> Chain:
        """Return squares beside a junction whose boundary is one exchange less another."""
        squares, pivots = self._free(taken)
        first, second = (squares.column(exchange(each)) for each in (one, other))
        rows = first.keys() | second.keys()
        left = reduced(
            {row: first.get(row, 0) - second.get(row, 0) for row in rows}, pivots, _PRIME
        )
        lifted = {row: (_PRIME // 2 - value) % _PRIME - _PRIME // 2 for row, value in left.items()}
        return {squares.cells[-1 - row]: value for row, value in lifted.items()}

    def neighbours(self, pair: Pair) -> Iterator[Pair]:
        """Yield the pairs with one exchange elsewhere, homologous beside the other."""
        one, other = pair
        for there in self.junctions:
            if self._homologous(one, there, other):
                yield there, other
            if self._homologous(other, there, one):
                yield one, there

    def _homologous(self, one: Junction, other: Junction, taken: Junction) -> bool:
        """Return whether one exchange can become another one that is also beside a junction."""
        apart = one != other and not set(other) & set(taken)
        return apart and self.kind(one, taken) == self.kind(other, taken)

    def swapping(self) -> list[Pair]:
        """Return the pairs whose exchanges can change places, each in one order."""
        group: dict[Pair, int] = {}
        for number, pair in enumerate(self.pairs()):
            if pair in group:
                continue
            group[pair] = number
            waiting = [pair]
            while waiting:
                for there in self.neighbours(waiting.pop()):
                    if there not in group:
                        group[there] = number
                        waiting.append(there)
        return [
            pair for pair in group if pair < pair[::-1] and group[pair] == group[pair[1], pair[0]]
        ]

    def way(self, pair: Pair) -> list[Pair] | None:
        """Return a shortest way by which the two exchanges change places; None without one."""
        before: dict[Pair, Pair] = {pair: pair}
        queue = deque([pair])
        while queue:
            here = queue.popleft()
            if here == pair[::-1]:
                way = [here]
                while way[-1] != pair:
                    way.append(before[way[-1]])
                return way[::-1]
            for there in self.neighbours(here):
                if there not in before:
                    before[there] = here
                    queue.append(there)
        return None

    def filling(self, way: list[Pair]) -> Chain:
        """Return the cubes that the torus of a pair sweeps on the way: their boundary is twice it.

        The first torus less the last is the boundary, and the last is the first with its two
        directions changed, that is, less itself.
        """
        found: Chain = {}
        for (one, other), (next_one, next_other) in pairwise(way):
            if other == next_other:
                part = product(self.between(one, next_one, other), exchange(other))
            else:
                part = product(exchange(one), self.between(other, next_other, one))
                part = {cell: -count for cell, count in part.items()}
            for cell, count in part.items():
                found[cell] = found.get(cell, 0) + count
        return {cell: count for cell, count in found.items() if count}


def torus(pair: Pair) -> Chain:
    """Return the 36 squares in which two vehicles are exchanged at each of two junctions."""
    return product(exchange(pair[0]), exchange(pair[1]))


# A count modulo 2 that is even on every boundary.


def passed(standing: frozenset[Vertex], start: Vertex, end: Vertex) -> list[int]:
    """Return the places in the order of the vehicles that are swapped by a move, one by one."""
    place = sum(vertex < start for vertex in standing)
    after = sum(vertex < end for vertex in standing)
    return list(range(place, after)) if place < after else list(range(place - 1, after - 1, -1))


@cache
def lifted_sign(word: tuple[int, ...]) -> int:
    """Return 1 if a word of swaps that changes nothing is below 0 in the Clifford algebra, else 0.

    The swap of places k and k + 1 is e_k - e_(k+1), up to length, with e_k e_k = 1 and
    e_j e_k = -e_k e_j. So two swaps without a common place anticommute, and all other relations of
    the symmetric group hold.
    """
    value = {0: 1}  # by the set of factors, as bits
    for place in word:
        new: dict[int, int] = {}
        for factor, sign in ((place, 1), (place + 1, -1)):
            for bits, count in value.items():
                swaps = (bits >> (factor + 1)).bit_count()
                key = bits ^ (1 << factor)
                new[key] = new.get(key, 0) + (-1) ** swaps * sign * count
        value = {bits: count for bits, count in new.items() if count}
    ((bits, count),) = value.items()
    if bits:
        raise ValueError(f"{word}: vehicles are not as they were")
    return int(count < 0)


def twisted(square: Cell) -> int:
    """Return 1 if the vehicles, going around a square, are turned by a full turn, else 0.

    This is a cocycle of the second Stiefel-Whitney class (of the bundle of the vehicles' covering):
    the sum of it over the faces of each cube is even.
    """
    (one, other), standing = square
    word = [
        *passed(standing | {other[0]}, one[0], one[1]),
        *passed(standing | {one[1]}, other[0], other[1]),
        *passed(standing | {other[1]}, one[1], one[0]),
        *passed(standing | {one[0]}, other[1], other[0]),
    ]
    return lifted_sign(tuple(word))


@dataclass(frozen=True)
class Row:
    """What is found of so many vehicles on a grid of columns and rows.

    `ranks` holds for 2 and 3 the ranks of the boundaries from dimension 1 on, modulo these;
    `torsion` the torsion of each homology group over the integers, by the project's own code.
    `pairs` is how many pairs of junctions there are without a common vertex, `swapping` for how
    many of them the exchanges can change places, and `bounding` how many of their tori bound modulo
    3, and modulo 2. These are None where vehicles are left that are at neither junction. `way` is
    how the exchanges of `PAIR` change places, if they can, by sweeping `swept` cubes.
    """

    columns: int
    rows: int
    vehicles: int
    cells: list[int]
    ranks: dict[int, list[int]]
    torsion: list[list[int]]
    pairs: int | None
    swapping: int | None
    bounding: tuple[int, int] | None
    way: list[Pair] | None
    swept: int | None


def measure(columns: int, rows: int, vehicles: int) -> Row:
    """Compute one row."""
    vertices = grid(columns, rows)
    chains = [Boundaries(vertices, vehicles, k) for k in range(1, vehicles + 1)]
    exchanges = Exchanges(vertices)
    own = vehicles == 4
    pairs = [pair for pair in exchanges.pairs() if pair < pair[::-1]] if own else []
    way = exchanges.way(PAIR) if PAIR in pairs else None
    ranks: dict[int, list[int]] = {}
    bounding = {}
    for prime in (2, 3):
        found: list[int] = []
        pivots: dict[int, Column] = {}
        for dimension in range(vehicles, 0, -1):
            each = chains[dimension - 1]
            # What is the greatest row of a boundary has a boundary that others have, too.
            pivots = pivots_of(each.columns(skip=pivots), prime)
            found.insert(0, len(pivots))
            if dimension == 3:
                left = [reduced(each.column(torus(pair)), pivots, prime) for pair in pairs]
                bounding[prime] = sum(not column for column in left)
        ranks[prime] = found
    built = state_complex(explore(scene_from_spec(f"agv:graph=grid{columns}x{rows},n={vehicles}")))
    return Row(
        columns,
        rows,
        vehicles,
        [len(chains[0].row), *(len(each.cells) for each in chains)],
        ranks,
        [list(factors) for factors in homology(built.complex).torsion],
        len(pairs) if own else None,
        len(exchanges.swapping()) if own else None,
        (bounding[3], bounding[2]) if own else None,
        way,
        None if way is None else len(exchanges.filling(way)),
    )


def main() -> None:
    """Print the rows, and write them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two small grids only")
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file that gets the rows")
    asked = parser.parse_args()
    rows = []
    for setting in QUICK if asked.quick else SETTINGS:
        rows.append(measure(*setting))
        print(rows[-1], flush=True)
    if asked.o is not None:
        lines = [json.dumps(asdict(row), separators=(",", ":")) for row in rows]
        asked.o.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


if __name__ == "__main__":
    main()
