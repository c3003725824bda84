"""Paths in small complexes by their definitions: normal cube paths, and Euclidean geodesics.

This shows the effect of curvature on paths. Nothing here is fast, and nothing knows about actions.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from math import isclose, sqrt

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex

Cell = tuple[int, int]
"""A cube: its dimension and its number."""
CellPath = tuple[Cell, ...]


def closure(complex_: CubicalComplex, cell: Cell) -> frozenset[Cell]:
    """Return a cube with all of its faces."""
    found = {cell}
    layer = {cell}
    while layer:
        layer = {
            (k - 1, int(face))
            for k, number in layer
            if k
            for face in complex_.faces[k][number].ravel()
        }
        found |= layer
    return frozenset(found)


def diagonals(complex_: CubicalComplex) -> dict[int, list[tuple[int, Cell]]]:
    """Return for each vertex the cubes of which it is a corner, each with the opposite corner."""
    found: dict[int, list[tuple[int, Cell]]] = defaultdict(list)
    for k in range(1, complex_.dimension + 1):
        for number in range(complex_.f_vector[k]):
            for corner in range(1 << k):
                ends = [corner >> j & 1 for j in range(k)]
                here = _corner(complex_, (k, number), ends)
                there = _corner(complex_, (k, number), [1 - end for end in ends])
                found[here].append((there, (k, number)))
    return found


def _corner(complex_: CubicalComplex, cell: Cell, ends: list[int]) -> int:
    k, number = cell
    for j in reversed(range(k)):
        number = int(complex_.faces[j + 1][number, j, ends[j]])
    return number


def normal_cube_paths(
    complex_: CubicalComplex, start: int, end: int, *, most: int
) -> list[CellPath]:
    """Return all normal cube paths of at most `most` cubes from one vertex to another.

    By the paper's definition, read on the complex itself: consecutive cubes meet in one vertex, and
    the star of a cube, which is the union of the closed cubes of which it is a face, meets the next
    cube only there. So this is only for complexes in which two cubes meet in at most one cube.
    """
    across = diagonals(complex_)
    closed = {
        (k, number): closure(complex_, (k, number))
        for k in range(complex_.dimension + 1)
        for number in range(complex_.f_vector[k])
    }
    star: dict[Cell, set[Cell]] = defaultdict(set)
    for faces in closed.values():
        for face in faces:
            star[face] |= faces

    def onward(at: int, path: CellPath) -> Iterator[CellPath]:
        if at == end:
            yield path
        if len(path) == most:
            return
        for there, cell in across[at]:
            if not path or star[path[-1]] & closed[cell] == {(0, at)}:
                yield from onward(there, (*path, cell))

    return list(onward(start, ()))


def chains(
    complex_: CubicalComplex, start: int, end: int, *, most: int, through: int | None = None
) -> list[CellPath]:
    """Return all chains of at most `most` cubes from corner to corner, from `start` to `end`.

    With `through`, only cubes in the star of that vertex count: the faces of the cubes at it.
    """
    across = diagonals(complex_)
    near: set[Cell] | None = None
    if through is not None:
        near = set()
        for _, cell in across[through]:
            near |= closure(complex_, cell)

    def onward(at: int, path: CellPath) -> Iterator[CellPath]:
        if at == end:
            yield path
        if len(path) < most:
            for there, cell in across[at]:
                if near is None or cell in near:
                    yield from onward(there, (*path, cell))

    return list(onward(start, ()))


def geodesics(complex_: CubicalComplex, start: int, end: int) -> tuple[float, int]:
    """Return the length of the shortest paths between two vertices, and their number.

    Every square is Euclidean, with sides of length 1. Paths consist of edges, diagonals of squares,
    and diagonals of two squares that share an edge. So this is only for complexes of dimension 2 in
    which no shortest path runs through three squares between two vertices.
    """
    steps: dict[int, list[tuple[int, float]]] = defaultdict(list)
    for there, (k, _), here in (
        (there, cell, here) for here, found in diagonals(complex_).items() for there, cell in found
    ):
        steps[here].append((there, sqrt(k)))
    for here, there in _dominoes(complex_):
        steps[here].append((there, sqrt(5)))
    best: dict[int, float] = {start: 0.0}
    number: dict[int, int] = {start: 1}
    done: set[int] = set()
    while end not in done:
        here = min((vertex for vertex in best if vertex not in done), key=lambda v: best[v])
        done.add(here)
        for there, length in steps[here]:
            total = best[here] + length
            if there in best and isclose(total, best[there]):
                number[there] += number[here]
            elif there not in best or total < best[there]:
                best[there], number[there] = total, number[here]
    return best[end], number[end]


def _dominoes(complex_: CubicalComplex) -> Iterator[tuple[int, int]]:
    """Yield opposite corners of the rectangles that consist of two squares with a common edge."""
    beside: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for square in range(complex_.f_vector[2]):
        for j in (0, 1):
            for e in (0, 1):
                edge = int(complex_.faces[2][square, j, e])
                beside[edge].append((square, int(complex_.faces[2][square, j, 1 - e])))
    for found in beside.values():
        for place, (one, far) in zip(count(1), found, strict=False):
            for other, beyond in found[place:]:
                if one == other:
                    continue
                for end in (0, 1):
                    # Opposite sides of a square have the same orientation, also in both squares.
                    here = int(complex_.faces[1][far, 0, end])
                    there = int(complex_.faces[1][beyond, 0, 1 - end])
                    yield here, there
                    yield there, here
