"""Sets of cells as a page says them: lists, drawings, maps, lines, boxes, and random shapes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import Any

import msgspec

from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import converted
from cubepath.protocol.scenes.drawings import Sketch, drawn
from cubepath.protocol.scenes.page_keys import number_of, with_numbers
from cubepath.protocol.scenes.registry import MODULES_MAX

_OTHER = "."
_MAP = {"start": "o@", "goal": "x@", "filled": "#", "empty": "!", "workspace": "ox@#!."}
"""The marks of a map whose cells belong to each key."""
_Number = int | str


class Shape(msgspec.Struct, forbid_unknown_fields=True):
    """A shape: one of `line`, `box`, `random` and `walk`, where it begins and which way it goes."""

    line: _Number | None = None
    box: list[_Number] | None = None
    random: _Number | None = None
    walk: _Number | None = None
    origin: list[_Number] | None = msgspec.field(name="from", default=None)
    along: list[_Number] | None = None
    seed: _Number = 0


def mapped(lattice: Lattice, sketch: Sketch) -> dict[str, Any]:
    """Return what a map says: the cells of each key that it has any of, in reading order.

    Without a mark for other cells it says nothing of the workspace.
    """
    drawing = drawn(lattice, [sketch], _MAP["workspace"])[0]
    marks = {cell: mark.text for cell, mark in drawing.marks.items()}
    found = {
        key: [list(cell) for cell, mark in marks.items() if mark in known]
        for key, known in _MAP.items()
        if key != "workspace" or _OTHER in marks.values()
    }
    return {key: cells for key, cells in found.items() if cells}


def cells_of(lattice: Lattice, value: object, sketch: Sketch, values: Mapping[str, int]) -> object:
    """Return the cells, as lists, of a drawing, of a shape other than a walk, or of a list."""
    if isinstance(value, str):
        drawing = drawn(lattice, [sketch], _MAP["workspace"])[0]
        return [list(cell) for cell, mark in drawing.marks.items() if mark.text != _OTHER]
    what = sketch.what
    if isinstance(value, list):
        return with_numbers(value, values, what)
    if not isinstance(value, dict):
        raise InputError(f"{what}: expected a list of sites, a drawing or a shape, found {value!r}")
    shape = converted(value, Shape, what)
    if shape.walk is not None or [shape.line, shape.box, shape.random].count(None) != 2:
        raise InputError(f"{what}: expected one of line, box, random")
    origin = tuple(_vector(shape.origin, lattice.arity, values, f"{what}: from"))
    if shape.line is not None:
        count = _count(shape.line, values, f"{what}: line")
        first_axis = [1] + [0] * (lattice.dimension - 1)
        along = _vector(shape.along or first_axis, lattice.dimension, values, f"{what}: along")
        steps: Iterable[Cell] = (tuple(step * by for by in along) for step in range(count))
    elif shape.box is not None:
        steps = _box(lattice, _sizes(lattice, shape.box, values, f"{what}: box"))
    else:
        count = _count(shape.random or 0, values, f"{what}: random")
        steps = _grown(lattice, count, what, number_of(shape.seed, values, f"{what}: seed"))
    return [list(lattice.shift(origin, by)) for by in steps]


def _grown(lattice: Lattice, count: int, what: str, seed: int) -> Iterable[Cell]:
    from cubepath.protocol.scenes.random_scenes import Stream, grown_shape  # noqa: PLC0415 - numpy

    stream = Stream(f"{what.rpartition(' ')[2]} shape", seed)
    return grown_shape(count, lattice, stream)


def _count(value: _Number, values: Mapping[str, int], what: str) -> int:
    count = number_of(value, values, what)
    if not 1 <= count <= MODULES_MAX:
        raise InputError(f"{what}: expected 1 to {MODULES_MAX} cells, found {count}")
    return count


def _vector(
    value: Sequence[_Number] | None, size: int, values: Mapping[str, int], what: str
) -> list[int]:
    found = [number_of(each, values, what) for each in value or [0] * size]
    if len(found) != size:
        raise InputError(f"{what}: expected {size} numbers, found {len(found)}")
    return found


def _sizes(
    lattice: Lattice, box: Sequence[_Number], values: Mapping[str, int], what: str
) -> list[int]:
    sizes = _vector(box, lattice.dimension, values, what)
    if min(sizes) < 1 or prod(sizes) > MODULES_MAX:
        raise InputError(f"{what}: expected 1 to {MODULES_MAX} cells, found sides {sizes}")
    return sizes


def _box(lattice: Lattice, sizes: Sequence[int]) -> Iterator[Cell]:
    for by in product(*map(range, sizes)):
        if not (lattice.even and sum(by) % 2):
            yield by
