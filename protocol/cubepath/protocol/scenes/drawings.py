"""Drawings: cells of a lattice as marks in a text, each at the place that the lattice gives it.

Rows go from the largest y down, layers from the lowest z up, with a line ``--`` between two layers.
Cells stand two columns apart. On hexagons each row is one column to the right of the row below it,
so cell ``(q, r)`` stands in column 2 q + r. Edges stand halfway between vertices, ``+``, which are
drawn in every second column of cells, row and layer.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

from cubepath.protocol.core.catalogue import HEXAGONS, Cell, Lattice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.symmetries import cell_at, point_of

LAYER = "--"
VERTEX = "+"
_MOST = 10_000


class DrawnMark(NamedTuple):
    """A character of a drawing: its layer, row there, column, and row in the text, from 0."""

    text: str
    layer: int
    row: int
    column: int
    line: int


class Sketch(NamedTuple):
    """A drawing's text, what it draws, and where it begins in its file.

    This is a line from 1, 0 if it is not known, and how many characters stand before it there.
    """

    text: str
    what: str
    place: tuple[int, int] = (0, 0)

    def rows(self) -> list[str]:
        """Return the rows without empty ones at the end."""
        return self.text.rstrip().split("\n")

    def mistake(self, text: str, mark: DrawnMark | None = None) -> "DrawingError":
        """Return the error that says what is wrong, and at which mark."""
        return DrawingError(self, text, mark)


class DrawingError(InputError):
    """A mistake in a drawing; `picture` is the drawing with a caret under the mark."""

    def __init__(self, sketch: Sketch, text: str, mark: DrawnMark | None) -> None:
        """Name the line and the column, from 1, as far as they are known."""
        line, before = sketch.place
        rows = sketch.rows()
        at = [f"line {line + (mark.line if mark else 0)}"] if line else []
        if mark is not None:
            at.append(f"column {mark.column + 1 + (0 if mark.line else before)}")
            rows.insert(mark.line + 1, " " * mark.column + "^")
        super().__init__(", ".join([*at, sketch.what]) + f": {text}")
        self.picture = "\n".join(rows)


class Drawing(NamedTuple):
    """The marks of a sketch by their cells, in reading order: layers, rows, columns."""

    sketch: Sketch
    marks: dict[Cell, DrawnMark]

    def text(self, cell: Cell) -> str:
        """Return the mark of a cell; a blank for none."""
        return self.marks[cell].text if cell in self.marks else " "

    def mistake(self, text: str, cell: Cell) -> DrawingError:
        """Return the error at a cell that is drawn."""
        return self.sketch.mistake(text, self.marks.get(cell))


def drawn(lattice: Lattice, sketches: Sequence[Sketch], known: str) -> list[Drawing]:
    """Return drawings in one frame, in which the first has the origin: its lowest row's first mark.

    For edges it is the lowest row's first vertex. DrawingError for a mark that is not `known`, or
    that stands between cells, and for frames that differ.
    """
    edges = lattice.arity > lattice.dimension
    every = [list(_marks(lattice, each, known + VERTEX * edges)) for each in sketches]
    first = _heights(sketches[0])
    for sketch in sketches:
        if _heights(sketch) != first:
            one, other = (" and ".join(map(str, each)) for each in (_heights(sketch), first))
            raise sketch.mistake(f"has {one} rows, but the drawing before {other} rows")
    among = [mark for mark in every[0] if not edges or mark.text == VERTEX]
    if not among:
        raise sketches[0].mistake(f"expected a vertex {VERTEX!r}" if edges else "nothing is drawn")
    origin = min(among, key=lambda mark: (mark.layer, -mark.row, mark.column))
    return [
        Drawing(sketch, dict(_placed(lattice, sketch, marks, origin)))
        for sketch, marks in zip(sketches, every, strict=True)
    ]


def _heights(sketch: Sketch) -> list[int]:
    """Return how many rows each layer has."""
    found = [0]
    for row in sketch.rows():
        if row.strip() == LAYER:
            found.append(0)
        else:
            found[-1] += 1
    return found


def _marks(lattice: Lattice, sketch: Sketch, known: str) -> Iterator[DrawnMark]:
    """Yield the characters of a sketch that are no blanks, in reading order."""
    layer = first = 0
    for number, line in enumerate(sketch.rows()):
        if line.strip() == LAYER:
            if lattice.dimension == 2:
                layers = DrawnMark(LAYER, 0, number, 0, number)
                raise sketch.mistake("a plane lattice has one layer", layers)
            layer, first = layer + 1, number + 1
            continue
        for column, text in enumerate(line):
            mark = DrawnMark(text, layer, number - first, column, number)
            if text not in known + " ":
                raise sketch.mistake(f"unknown mark {text!r}, expected {' '.join(known)}", mark)
            if text != " ":
                yield mark


def _placed(
    lattice: Lattice, sketch: Sketch, marks: Sequence[DrawnMark], origin: DrawnMark
) -> Iterator[tuple[Cell, DrawnMark]]:
    """Yield the marks with their cells; vertices of edges have none."""
    for mark in marks:
        up = origin.row - mark.row
        along = mark.column - origin.column - up * (lattice == HEXAGONS)
        point = (along // 2, up, mark.layer - origin.layer)[: lattice.dimension]
        odd = sum(number % 2 for number in point)
        if along % 2 or (lattice.even and sum(point) % 2):
            raise sketch.mistake("stands between two cells", mark)
        if lattice.arity == lattice.dimension:
            yield point, mark
        elif odd != (mark.text != VERTEX):
            raise sketch.mistake("expected a vertex, an edge or a blank as in the grid", mark)
        elif odd:
            yield cell_at(lattice, point), mark


def drawing_text(lattice: Lattice, marks: Mapping[Cell, str]) -> str:
    """Return the drawing of cells with these marks, at least one, without blanks at its ends.

    InputError if they are too far apart.

    >>> print(drawing_text(HEXAGONS, {(0, 0): "a", (1, 0): ".", (0, 1): "#"}))
     #
    a .
    """
    points = {point_of(lattice, cell): mark for cell, mark in marks.items()}
    if prod(max(each) - min(each) + 1 for each in zip(*points, strict=True)) > _MOST:
        raise InputError(f"cells too far apart to be drawn, expected at most {_MOST} in their box")
    if lattice.arity > lattice.dimension:
        ranges = [(min(each) // 2 * 2, max(each) + 2) for each in zip(*points, strict=True)]
        points |= dict.fromkeys(product(*(range(*each, 2) for each in ranges)), VERTEX)
    spots = {_spot(lattice, point): mark for point, mark in points.items()}
    layers, rows, columns = (range(min(each), max(each) + 1) for each in zip(*spots, strict=True))

    def line(layer: int, row: int) -> str:
        return "".join(spots.get((layer, row, column), " ") for column in columns).rstrip()

    texts = ("\n".join(line(layer, row) for row in rows) for layer in layers)
    return f"\n{LAYER}\n".join(texts)


def _spot(lattice: Lattice, point: Cell) -> tuple[int, int, int]:
    """Return the layer, row and column in which a point is drawn."""
    x, y, z = (*point, 0)[:3]
    return z, -y, 2 * x + y * (lattice == HEXAGONS)
