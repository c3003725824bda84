"""The components of the pivot graphs of connected shapes of hexagons, under both catalogues.

``python docs/studies/hexagon_shapes.py 1..11 -o docs/studies/hexagon-shapes.json`` counts them,
``--quick`` for up to 7 hexagons only.

A shape is a connected set of n hexagons up to translation. Two shapes are joined when a pivot leads
from one to the other. Catalogue 1 keeps the topology, so its pivots lead from connected shapes to
connected shapes. Under catalogue 2 only the pivots count after which the shape is connected, the
rule of `hex-connected`; others would let pieces leave, and no finite graph would hold them.

Shapes are listed once each (Redelmeier 1981), translated so that their first cell is (0, 0), and
packed into two numbers, 9 bits a cell; what a pivot leads to is found among them by bisection, and
is connected iff it is there.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS
from cubepath.protocol.core.errors import CheckError

Cells = NDArray[np.int16]
Codes = NDArray[np.uint64]
Numbers = NDArray[np.int32]

LOCKED_MOST = 8
"""Up to so many hexagons the shapes of small components are kept."""
WIDTH = 48
"""The side of a grid that holds any shape with its first cell in the middle, and its moves."""
DIRECTIONS = np.array(HEX_DIRECTIONS, dtype=np.int16)
CATALOGUES = (1, 2)


@compiled
def grow(size: int, directions: Cells, shapes: Cells) -> int:
    """List the connected shapes of `size` cells, each once; return how many there are.

    `shapes` has the shape (room, size, 2); what it has no room for is only counted. The first cell
    in order is (0, 0). A shape is a choice of cells from a list, in ascending order; the neighbours
    of a cell that is chosen join the end of the list unless they were there before.
    """
    seen = np.zeros((WIDTH, WIDTH), dtype=np.bool_)
    known = np.zeros((6 * size + 1, 2), dtype=np.int16)
    chosen = np.zeros((size, 2), dtype=np.int16)
    place = np.zeros(size + 1, dtype=np.int64)
    end = np.zeros(size + 1, dtype=np.int64)
    middle = WIDTH // 2
    seen[middle, middle] = True
    end[0] = 1
    depth = count = 0
    while depth >= 0:
        if place[depth] == end[depth]:
            depth -= 1
            if depth >= 0:
                for number in range(end[depth], end[depth + 1]):
                    seen[known[number, 0] + middle, known[number, 1] + middle] = False
            continue
        number = place[depth]
        place[depth] += 1
        chosen[depth] = known[number]
        if depth + 1 == size:
            if count < len(shapes):
                shapes[count] = chosen
            count += 1
            continue
        last = end[depth]
        for step in directions:
            q, r = known[number, 0] + step[0], known[number, 1] + step[1]
            if (q > 0 or (q == 0 and r > 0)) and not seen[q + middle, r + middle]:
                seen[q + middle, r + middle] = True
                known[last, 0], known[last, 1] = q, r
                last += 1
        depth += 1
        place[depth], end[depth] = number + 1, last
    return count


@compiled
def pack(cells: Cells, row: Cells, code: Codes) -> None:
    """Write to `code` (2,) the shape of these cells up to translation; `row` (size,) is for work.

    The cells other than the first, translated so that it is (0, 0), in ascending order.
    """
    size = len(cells)
    for number in range(size):
        here = np.int16(cells[number, 0] * 32 + cells[number, 1])
        place = number
        while place > 0 and row[place - 1] > here:
            row[place] = row[place - 1]
            place -= 1
        row[place] = here
    code[0] = code[1] = 0
    for number in range(1, size):
        half = 0 if number <= 7 else 1
        code[half] = (code[half] << np.uint64(9)) | np.uint64(row[number] - row[0])


@compiled
def find(highs: Codes, lows: Codes, code: Codes) -> int:
    """Return the number of a shape among those in ascending order, -1 if it is not there."""
    low, high = 0, len(highs)
    while low < high:
        middle = (low + high) // 2
        if highs[middle] < code[0] or (highs[middle] == code[0] and lows[middle] < code[1]):
            low = middle + 1
        else:
            high = middle
    if low < len(highs) and highs[low] == code[0] and lows[low] == code[1]:
        return low
    return -1


@compiled
def pack_all(shapes: Cells, highs: Codes, lows: Codes) -> None:
    """Pack all shapes."""
    row, code = np.empty(shapes.shape[1], dtype=np.int16), np.zeros(2, dtype=np.uint64)
    for number in range(len(shapes)):
        pack(shapes[number], row, code)
        highs[number], lows[number] = code[0], code[1]


@compiled
def root_of(above: Numbers, number: int) -> int:
    """Return the first of a set, and halve the way to it."""
    while above[number] != number:
        above[number] = above[above[number]]
        number = above[number]
    return number


@compiled
def join(above: Numbers, one: int, other: int) -> None:
    """Unite two sets under the lesser of their firsts."""
    one, other = root_of(above, one), root_of(above, other)
    if one < other:
        above[other] = one
    else:
        above[one] = other


@compiled
def pivots(
    shapes: Cells,
    highs: Codes,
    lows: Codes,
    directions: Cells,
    catalogue: int,
    above: Numbers,
    moves: Numbers,
) -> int:
    """Unite the shapes that a pivot joins; return how many pivots lead to no connected shape.

    `moves` (shapes,) counts each shape's pivots that lead to connected shapes.
    """
    size = shapes.shape[1]
    on = np.zeros((2 * WIDTH, 2 * WIDTH), dtype=np.bool_)
    row, code = np.empty(size, dtype=np.int16), np.zeros(2, dtype=np.uint64)
    cells = np.empty((size, 2), dtype=np.int16)
    broken = 0
    for number in range(len(shapes)):
        for cell in shapes[number]:
            on[cell[0] + WIDTH, cell[1] + WIDTH] = True
        for mover in range(size):
            q, r = shapes[number, mover, 0] + WIDTH, shapes[number, mover, 1] + WIDTH
            for k in range(6):
                ahead_q, ahead_r = q + directions[k, 0], r + directions[k, 1]
                if on[ahead_q, ahead_r]:
                    continue
                if catalogue == 1 and (
                    on[q - directions[k, 0], r - directions[k, 1]]
                    or on[ahead_q + directions[k, 0], ahead_r + directions[k, 1]]
                ):
                    continue
                for sense in (1, -1):
                    pivot = directions[(k + sense) % 6]
                    away = directions[(k - sense) % 6]
                    beside = directions[(k - 2 * sense) % 6]
                    if (
                        not on[q + pivot[0], r + pivot[1]]
                        or on[q + away[0], r + away[1]]
                        or on[q + beside[0], r + beside[1]]
                        or on[ahead_q + away[0], ahead_r + away[1]]
                    ):
                        continue
                    cells[:] = shapes[number]
                    cells[mover, 0] += directions[k, 0]
                    cells[mover, 1] += directions[k, 1]
                    pack(cells, row, code)
                    there = find(highs, lows, code)
                    if there < 0:
                        broken += 1
                    else:
                        moves[number] += 1
                        join(above, number, there)
        for cell in shapes[number]:
            on[cell[0] + WIDTH, cell[1] + WIDTH] = False
    return broken


@compiled
def unite_images(shapes: Cells, highs: Codes, lows: Codes, labels: Numbers, above: Numbers) -> None:
    """Unite the labels of shapes that differ by a rotation or a reflection of the lattice."""
    row, code = np.empty(shapes.shape[1], dtype=np.int16), np.zeros(2, dtype=np.uint64)
    cells = np.empty((shapes.shape[1], 2), dtype=np.int16)
    for number in range(len(shapes)):
        shape = shapes[number]
        for turned in (True, False):
            for cell in range(len(shape)):
                q, r = shape[cell, 0], shape[cell, 1]
                if turned:  # by 60 degrees: (1, 0) to (0, 1), (0, 1) to (-1, 1)
                    cells[cell, 0], cells[cell, 1] = -r, q + r
                else:
                    cells[cell, 0], cells[cell, 1] = r, q
            pack(cells, row, code)
            there = find(highs, lows, code)
            join(above, labels[number], labels[there])


@compiled
def holes_of(shapes: Cells, directions: Cells, holes: Numbers) -> None:
    """Fill in the holes of each shape: 1 less its Euler characteristic, as it is connected.

    The hexagons cover the shape, two meet in a side and three in a corner, if at all, so the
    characteristic is that of the nerve: cells less adjacent pairs plus triples.
    """
    on = np.zeros((2 * WIDTH, 2 * WIDTH), dtype=np.bool_)
    for number in range(len(shapes)):
        for cell in shapes[number]:
            on[cell[0] + WIDTH, cell[1] + WIDTH] = True
        euler = shapes.shape[1]
        for cell in shapes[number]:
            q, r = cell[0] + WIDTH, cell[1] + WIDTH
            first = on[q + directions[0, 0], r + directions[0, 1]]
            second = on[q + directions[1, 0], r + directions[1, 1]]
            third = on[q + directions[2, 0], r + directions[2, 1]]
            euler -= np.int64(first) + np.int64(second) + np.int64(third)
            euler += np.int64(first and second) + np.int64(second and third)
        holes[number] = 1 - euler
        for cell in shapes[number]:
            on[cell[0] + WIDTH, cell[1] + WIDTH] = False


@dataclass(frozen=True)
class Shapes:
    """All connected shapes of one size, in the order of their codes."""

    cells: Cells
    highs: Codes
    lows: Codes


def all_shapes(size: int) -> Shapes:
    """Return the connected shapes of so many hexagons up to translation."""
    count = grow(size, DIRECTIONS, np.empty((0, size, 2), dtype=np.int16))
    cells = np.empty((count, size, 2), dtype=np.int16)
    grow(size, DIRECTIONS, cells)
    highs, lows = np.empty(count, dtype=np.uint64), np.empty(count, dtype=np.uint64)
    pack_all(cells, highs, lows)
    order = np.lexsort((lows, highs))
    return Shapes(cells[order], highs[order], lows[order])


@dataclass(frozen=True)
class Row:
    """The components of the graph of one size and catalogue.

    `free` counts are up to rotation and reflection as well. `by_size` has the number of components
    by size, `holes` for each number of holes the shapes and the components (of catalogue 1; under
    catalogue 2 holes come and go). A `stuck` shape has no pivot that
    keeps it connected; `stuck_shapes` has one of each up to symmetry. `locked` has for up to
    `LOCKED_MOST` hexagons the other components without holes but the largest, one of each up to
    symmetry: its size, and its first shape.
    """

    n: int
    catalogue: int
    shapes: int
    free_shapes: int
    components: int
    free_components: int
    largest: int
    by_size: dict[str, int]
    holes: dict[str, tuple[int, int]]
    stuck: int
    free_stuck: int
    stuck_shapes: list[list[tuple[int, int]]]
    locked: list[tuple[int, list[tuple[int, int]]]]


def roots(above: Numbers) -> Numbers:
    """Return for each element the first of its set."""
    while True:
        next_ = above[above]
        if np.array_equal(next_, above):
            return next_
        above = next_


def _plain(cells: Cells) -> list[tuple[int, int]]:
    return sorted((int(q), int(r)) for q, r in cells)


def measure(shapes: Shapes, catalogue: int) -> Row:
    """Return the components of the shapes under one of the catalogues."""
    count, size = shapes.cells.shape[:2]
    packed = shapes.highs, shapes.lows
    above = np.arange(count, dtype=np.int32)
    moves = np.zeros(count, dtype=np.int32)
    broken = pivots(shapes.cells, *packed, DIRECTIONS, catalogue, above, moves)
    if catalogue == 1 and broken:
        raise CheckError(f"{broken} pivots of catalogue 1 take a shape of {size} hexagons apart")
    component = roots(above)
    free = np.arange(count, dtype=np.int32)
    unite_images(shapes.cells, *packed, np.arange(count, dtype=np.int32), free)
    free_component = np.arange(count, dtype=np.int32)
    unite_images(shapes.cells, *packed, component, free_component)
    free, free_component = roots(free), roots(free_component)
    labels, sizes = np.unique(component, return_counts=True)
    by_size = Counter(map(int, sizes))
    holes = np.empty(count, dtype=np.int32)
    holes_of(shapes.cells, DIRECTIONS, holes)
    by_holes: dict[str, tuple[int, int]] = {}
    if catalogue == 1:
        for each in np.unique(holes):
            here = holes == each
            by_holes[str(each)] = int(here.sum()), len(np.unique(component[here]))
    stuck = np.flatnonzero(moves == 0)
    firsts = np.unique(free[stuck])
    locked = [
        (int(many), _plain(shapes.cells[label]))
        for label, many in zip(labels, sizes, strict=True)
        if size <= LOCKED_MOST and 1 < many < sizes.max() and not holes[label]
        if free_component[label] == label
    ]
    return Row(
        n=size,
        catalogue=catalogue,
        shapes=count,
        free_shapes=len(np.unique(free)),
        components=len(sizes),
        free_components=len(np.unique(free_component[component])),
        largest=int(sizes.max()),
        by_size={str(each): by_size[each] for each in sorted(by_size)},
        holes=by_holes,
        stuck=len(stuck),
        free_stuck=len(firsts),
        stuck_shapes=[_plain(shapes.cells[number]) for number in firsts],
        locked=locked,
    )


def write(path: Path, rows: list[Row]) -> None:
    """Write the rows, one a line."""
    lines = [json.dumps(asdict(row), separators=(",", ":")) for row in rows]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


def main() -> None:
    """Print the rows that are asked for, and add them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sizes", nargs="?", default="1..9", help="hexagons, 1..9 if not given")
    parser.add_argument("--quick", action="store_true", help="up to 7 hexagons only")
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file for the rows")
    asked = parser.parse_args()
    low, _, high = ("1..7" if asked.quick else asked.sizes).partition("..")
    rows = []
    for size in range(int(low), int(high or low) + 1):
        began = process_time()
        shapes = all_shapes(size)
        for catalogue in CATALOGUES:
            row = measure(shapes, catalogue)
            rows.append(row)
            print(
                f"{size} hexagons, catalogue {catalogue}: {row.shapes} shapes, {row.components}"
                f" components, {row.stuck} stuck; up to symmetry {row.free_shapes},"
                f" {row.free_components} and {row.free_stuck}; {process_time() - began:.1f} s",
                flush=True,
            )
        if asked.o is not None:
            write(asked.o, rows)


if __name__ == "__main__":
    main()
