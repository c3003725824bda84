"""Moves and configurations as Pathfinder has them, a search for shortest reconfigurations.

Source: J. Eisenbies, S. Samanta, G. Shahrouzi and F. Stock, Finding Shortest Reconfiguration
Sequences for Modular Robots (SoCG 2025, media exposition), whose program reads JSON files of moves
and of configurations of squares, cubes and rhombic dodecahedra.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from cubepath.protocol.core.catalogue import (
    CUBES,
    DODECAHEDRA,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
    Lattice,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import file_within, opened
from cubepath.protocol.core.parsing import converted
from cubepath.protocol.core.symmetries import orientations
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.lattice import LatticeSystem

_MOVER, _TARGET, _ON, _OFF, _ANY = "?!#x "
_Marks: TypeAlias = frozenset[tuple[Cell, str]]
"""Marks by cell, seen from the mover."""


class _Move(msgspec.Struct):
    name: str
    order: int
    drawing: list[list[str]] = msgspec.field(name="def")
    turned: bool = msgspec.field(name="permGen", default=True)
    checks: list[Any] = msgspec.field(name="propertyChecks", default=[])
    updates: list[Any] = msgspec.field(name="propertyUpdates", default=[])


class _MoveFile(msgspec.Struct):
    moves: list[_Move]


class _Module(msgspec.Struct):
    position: list[int]
    static: bool = False


class _Configuration(msgspec.Struct):
    order: int
    modules: list[_Module]
    boundaries: list[list[int]] = []

    def cells(self, *, static: bool) -> list[Cell]:
        """Return where the modules stand that never move, or the others."""
        return [tuple(each.position) for each in self.modules if each.static == static]


def _read(path: Path, kind: type[Any]) -> Any:
    with opened(path) as file:
        text = file.text()
    try:
        return msgspec.json.decode(text, type=kind)
    except RecursionError:
        raise InputError(f"{path}: lists in lists, nested too deeply") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: {error}") from None


def _configuration(path: Path) -> _Configuration:
    found: _Configuration = _read(path, _Configuration)
    if found.order not in (2, 3):
        raise InputError(f"{path}: order {found.order}, expected 2 or 3")
    for cell in [*(each.position for each in found.modules), *found.boundaries]:
        if len(cell) != found.order:
            raise InputError(f"{path}: position {cell}, expected {found.order} numbers")
    return found


def _drawn(where: str, move: _Move, order: int) -> _Marks:
    """Return the marks of a drawing: x to the right, y downwards, z from layer to layer."""
    marks = {
        (x, y, z)[:order]: mark
        for z, layer in enumerate(move.drawing)
        for y, line in enumerate(layer)
        for x, mark in enumerate(line)
        if mark != _ANY
    }
    odd = next((mark for mark in marks.values() if mark not in (_MOVER, _TARGET, _ON, _OFF)), None)
    if odd is not None:
        raise InputError(f"{where}: mark {odd!r}, expected ?, !, #, x or a blank")
    ends = [[cell for cell in marks if marks[cell] == end] for end in (_MOVER, _TARGET)]
    if [len(cells) for cells in ends] != [1, 1]:
        raise InputError(
            f"{where}: expected one '?', where the mover is, and one '!', where it goes"
        )
    return frozenset((_minus(cell, ends[0][0]), mark) for cell, mark in marks.items())


def _minus(one: Cell, other: Cell) -> Cell:
    return tuple(here - there for here, there in zip(one, other, strict=True))


def _orientations(marks: _Marks, order: int) -> Iterator[_Marks]:
    """Yield a drawing in all its rotations and reflections, first as it is."""
    lattice = SQUARES if order == 2 else CUBES
    for way in orientations(lattice, mirrored=True):
        yield frozenset((way.moved(lattice, cell), mark) for cell, mark in marks)


def _undone(marks: _Marks) -> _Marks:
    """Return the drawing of the move back."""
    target = next(cell for cell, mark in marks if mark == _TARGET)
    back = {_MOVER: _TARGET, _TARGET: _MOVER}
    return frozenset((_minus(cell, target), back.get(mark, mark)) for cell, mark in marks)


def _generators(moves: Iterable[tuple[str, _Move]], order: int) -> list[Generator]:
    """Return the moves in all their orientations, each once with the move back.

    Pathfinder's moves have a direction, an action has none: InputError names a move that no other
    undoes.
    """
    named: dict[_Marks, str] = {}
    origin: dict[_Marks, str] = {}
    for where, move in moves:
        if move.checks or move.updates:
            raise InputError(f"{where}: it checks or changes properties, expected positions alone")
        if not 2 <= move.order <= order or (move.order == 2 and len(move.drawing) != 1):
            raise InputError(
                f"{where}: order {move.order} and {len(move.drawing)} layers, in {order} dimensions"
            )
        base, number = move.name.lower().replace(" ", "-"), 0
        drawn = _orientations(_drawn(where, move, order), order)
        for marks in islice(drawn, None if move.turned else 1):
            origin.setdefault(marks, where)
            if marks not in named and _undone(marks) not in named:
                named[marks] = f"{base}-{number}"
                number += 1
    for marks, where in origin.items():
        if _undone(marks) not in origin:
            raise InputError(f"{where}: no move of the catalogue undoes it, expected one")
    return [_generator(name, marks) for marks, name in named.items()]


def _generator(name: str, marks: _Marks) -> Generator:
    cells = {mark: tuple(sorted(cell for cell, each in marks if each == mark)) for mark in "?!#x"}
    here, there, on = cells[_MOVER], cells[_TARGET], cells[_ON]
    trace = here + there
    return Generator(
        name, trace + on + cells[_OFF], trace, here + on, there + on, ((here[0], there[0]),)
    )


def _moves_in(folder: Path, name: str) -> list[tuple[str, _Move]]:
    """Return the moves of a file, or of all JSON files of a folder, with where they stand."""
    path = file_within(folder, name)
    names = sorted(each.name for each in path.glob("*.json")) if path.is_dir() else None
    files = [path] if names is None else [file_within(folder, Path(name, each)) for each in names]
    found: list[tuple[str, _Move]] = []
    for file in files:
        moves: _MoveFile = _read(file, _MoveFile)
        found += [(f"{file}: move {each.name!r}", each) for each in moves.moves]
    if not found:
        raise InputError(f"{path}: no moves")
    return found


def _lattice(order: int, generators: Iterable[Generator], cells: Sequence[Cell]) -> Lattice:
    """Return the lattice: that of dodecahedra where all moves and positions keep to its points."""
    if order == 2:
        return SQUARES
    offsets = {sum(cell) % 2 for each in generators for cell in each.support}
    return DODECAHEDRA if offsets == {0} and len({sum(cell) % 2 for cell in cells}) == 1 else CUBES


class _Files(msgspec.Struct, forbid_unknown_fields=True):
    moves: str
    initial: str
    final: str = ""
    connected: bool = False


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True):
    format: str
    pathfinder: _Files
    name: str = ""


def pathfinder_scene(table: dict[str, Any], where: str, folder: Path) -> Scene:
    """Read the scene of a file with a table ``[pathfinder]``, whose files lie in `folder`.

    `moves` is a file or a folder of such files, `initial` and `final` are configurations. With
    `connected` the whole aggregate must stay connected, so the system is not local. Static modules
    are obstacles; where both configurations have some, the corners of their boxes coincide.
    InputError names the file and what is wrong in it, or a path that leaves the folder.
    """
    read = converted(table, _SceneFile, "")
    files = read.pathfinder
    path = file_within(folder, files.initial)
    initial = _configuration(path)
    start, fixed = initial.cells(static=False), initial.cells(static=True)
    if not start:
        raise InputError(f"{path}: no module can move")
    generators = _generators(_moves_in(folder, files.moves), initial.order)
    lattice = _lattice(initial.order, generators, [*start, *fixed])
    by = (0,) * initial.order
    if lattice.even and sum(start[0]) % 2:
        by = (-1, *by[1:])
    goal = _goal(path, initial, file_within(folder, files.final)) if files.final else []

    def moved(cells: Iterable[Cell]) -> tuple[Cell, ...]:
        return tuple(lattice.shift(cell, by) for cell in cells)

    goals = moved(goal)
    empty = moved(map(tuple, initial.boundaries))
    system = LatticeSystem(
        Catalogue(lattice, tuple(generators)),
        filled=moved(fixed),
        empty=[cell for cell in empty if not (lattice.even and sum(cell) % 2)],
        connected=files.connected,
    )
    return Scene(
        spec=read.name or where,
        family="",
        system=system,
        start=moved(start),
        goal=frozenset(goals) if goals else None,
        goals=(goals,) * len(start) if goals else (),
    )


def _goal(path: Path, initial: _Configuration, other: Path) -> list[Cell]:
    final = _configuration(other)
    cells, fixed = final.cells(static=False), final.cells(static=True)
    if (final.order, len(cells)) != (initial.order, len(initial.cells(static=False))):
        raise InputError(
            f"{other}: {len(cells)} modules in {final.order} dimensions, expected as in {path}:"
            f" {len(initial.cells(static=False))} in {initial.order}"
        )
    corners = [
        tuple(map(min, zip(*each, strict=True)))
        for each in (fixed, initial.cells(static=True))
        if each
    ]
    if len(corners) < 2:
        return cells
    return [_minus(cell, _minus(*corners)) for cell in cells]
