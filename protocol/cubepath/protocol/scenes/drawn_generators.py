"""Generators drawn as two texts, placed in all orientations of their lattice.

::

    before = '''   after = '''
     # .            # .           a, b, ...  modules that move; `a` is the mover
    . a .          . . a          #          on, and stays
      . .            . .          .          off         ~  off, and drawn as swept
                                  ?          on or off
                                  < > ^ v    on only if the neighbour that way is on, or off;
                                  ' ,        likewise the one in the layer above, or below

A cell without a mark does not matter: it is outside the support.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from typing import Any

import msgspec
from msgspec.structs import replace

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEXAGONS, Cell, Generator, Lattice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import converted
from cubepath.protocol.core.symmetries import Orientation, cell_at, orientations, point_of
from cubepath.protocol.scenes.drawings import Drawing, Sketch, drawn

MOVER = "a"
LETTERS = "abcdefghijklmnopqrstu"
_OFF = ".~"
_ARROWS = {"<": (0, -1), ">": (0, 1), "^": (1, 1), "v": (1, -1), "'": (2, 1), ",": (2, -1)}
"""The axis and the sign of the neighbour that a mark depends on."""
_FREE = "?" + "".join(_ARROWS)
_KNOWN = LETTERS + "#" + _OFF + _FREE
_OPEN_MAX = 12
_MOST = 10_000
"""How many generators one drawing stands for, at most: they take some ten seconds to read."""


class DrawnGenerator(msgspec.Struct, forbid_unknown_fields=True):
    """The keys of a drawn generator."""

    name: str
    before: str
    after: str
    symmetry: str | None = None
    turns: list[int] | None = None
    connected: str | None = None


def generators_of(
    lattice: Lattice, table: Mapping[str, Any], lines: Mapping[str, tuple[int, int]]
) -> list[Generator]:
    """Return the generators of a drawn one, all different, in the order of the orientations.

    `lines` are where `before` and `after` begin in the file. InputError, often a
    DrawingError, for a drawing that is none of a move.
    """
    found = converted(table, DrawnGenerator, f"generator {table.get('name')!r}")
    for key, value, known in (
        ("symmetry", found.symmetry, (None, "rotations", "all")),
        ("connected", found.connected, (None, "near")),
    ):
        if value not in known:
            names = " or ".join(map(repr, known[1:]))
            raise InputError(f"generator {found.name!r}: {key}: expected {names}, found {value!r}")
    sketches = [
        Sketch(text, f"generator {found.name!r}: {end}", lines.get(end, (0, 0)))
        for end, text in (("before", found.before), ("after", found.after))
    ]
    before, after = drawn(lattice, sketches, _KNOWN)
    plain = _plain(lattice, found.name, before, after)
    every = [plain] if found.connected is None else list(_near(lattice, plain))
    if not every:
        raise InputError(f"generator {found.name!r}: connected: no local state keeps connected")
    return list(_named(found, _oriented(lattice, found, every)))


def _plain(lattice: Lattice, name: str, before: Drawing, after: Drawing) -> Generator:
    """Return the generator as drawn, its support from the move outwards."""
    sources, targets = _letters(before), _letters(after)
    _check_motion(before, after, sources, targets)
    for cell in {**before.marks, **after.marks}:
        _check_cell(before, after, cell)
    trace = tuple(dict.fromkeys([*sources.values(), *targets.values()]))
    others = [cell for cell in before.marks if cell not in trace]
    rest = _outwards(lattice, sources[MOVER], targets[MOVER], others)
    on = tuple(cell for cell in rest if before.text(cell) == "#")
    return Generator(
        name=name,
        support=(*trace, *rest),
        trace=trace,
        before=(*(sources[letter] for letter in sorted(sources)), *on),
        after=(*(targets[letter] for letter in sorted(sources)), *on),
        motion=tuple((sources[letter], targets[letter]) for letter in sorted(sources)),
        free=tuple(cell for cell in rest if before.text(cell) in _FREE),
        guards=tuple(_guards(lattice, before, rest)),
    )


def _letters(drawing: Drawing) -> dict[str, Cell]:
    """Return the cells of the modules that move."""
    found: dict[str, Cell] = {}
    for cell, mark in drawing.marks.items():
        if mark.text in LETTERS:
            if mark.text in found:
                raise drawing.mistake(f"module {mark.text!r} stands twice", cell)
            found[mark.text] = cell
    return dict(sorted(found.items()))


def _check_motion(
    before: Drawing, after: Drawing, sources: Mapping[str, Cell], targets: Mapping[str, Cell]
) -> None:
    """Raise DrawingError unless the same modules, the mover among them, move to other cells."""
    for one, other, found, known in (
        (before, "afterwards", sources, targets),
        (after, "before", targets, sources),
    ):
        for letter, cell in found.items():
            if letter not in known:
                raise one.mistake(f"module {letter!r} is missing {other}", cell)
    for letter, cell in targets.items():
        if sources[letter] == cell:
            raise after.mistake(f"module {letter!r} does not move, expected '#' if it stays", cell)
    if MOVER not in sources:
        raise before.sketch.mistake(f"expected the mover, {MOVER!r}, which proposes the move")


def _check_cell(before: Drawing, after: Drawing, cell: Cell) -> None:
    """Raise DrawingError unless a cell has the same mark twice, or a module comes or goes."""
    marks = before.text(cell), after.text(cell)
    moves = any(mark in LETTERS for mark in marks)
    if marks[0] != marks[1] and not all(mark in _OFF + LETTERS * moves for mark in marks):
        expected = "a module or '.' in both" if moves else "the same mark in both"
        where = after if cell in after.marks else before
        raise where.mistake(f"{marks[0]!r} before, {marks[1]!r} after, expected {expected}", cell)


def _outwards(lattice: Lattice, source: Cell, target: Cell, cells: Iterable[Cell]) -> list[Cell]:
    """Return cells by their distance from the middle of the move, then from its source.

    Cells that are as far from both keep their order.
    """
    here, there = point_of(lattice, source), point_of(lattice, target)

    def square(by: Iterable[int]) -> int:
        x, y, *z = by
        return sum(each * each for each in (x, y, *z)) + x * y * (lattice == HEXAGONS)

    def far(cell: Cell) -> tuple[int, int]:
        at = list(zip(point_of(lattice, cell), here, there, strict=True))
        return square(2 * a - b - c for a, b, c in at), square(a - b for a, b, _ in at)

    return sorted(cells, key=far)


def _guards(
    lattice: Lattice, drawing: Drawing, cells: Iterable[Cell]
) -> Iterator[tuple[Cell, Cell]]:
    """Yield the cells marked with arrows, each with the neighbour that it depends on."""
    for cell in cells:
        arrow = drawing.text(cell)
        if arrow not in _ARROWS:
            continue
        axis, sign = _ARROWS[arrow]
        if axis >= (1 if lattice == HEXAGONS else lattice.dimension) or lattice.even:
            raise drawing.mistake("no neighbour lies that way", cell)
        point = list(point_of(lattice, cell))
        point[axis] += sign * (1 + (lattice.arity > lattice.dimension))
        neighbour = cell_at(lattice, tuple(point))
        if drawing.text(neighbour) not in "#" + _FREE:
            raise drawing.mistake("its neighbour that way is neither '#' nor free", cell)
        yield cell, neighbour


def _near(lattice: Lattice, plain: Generator) -> Iterator[Generator]:
    """Yield the generators of all local states in which a connected aggregate stays connected.

    The neighbourhood is all cells that touch a module that moves, before or after, and all free
    cells. In a state that is allowed, afterwards all modules there that touched the same group of
    connected sources and stay are connected to one another within the neighbourhood, and each
    module that moved to one that stays; and so backwards.

    Proof that a connected aggregate stays so. Take two modules that stay, and a path between them.
    Where it passes through modules that move, it enters and leaves by modules that touch one group.
    These are connected afterwards, so the two are; and those that moved, to one that stays.
    """
    sources, targets = map(set, zip(*plain.motion, strict=True))
    near = dict.fromkeys(
        cell for pair in plain.motion for end in pair for cell in lattice.beside(end)
    )
    open_cells = [cell for cell in near if cell not in plain.support] + list(plain.free)
    if len(open_cells) > _OPEN_MAX:
        raise InputError(
            f"generator {plain.name!r}: connected: {len(open_cells)} cells around the move may be"
            f" on or off, 2^{len(open_cells)} = {2 ** len(open_cells)} local states, expected at"
            f" most 2^{_OPEN_MAX}: draw more of them as '#' or '.'"
        )
    support = tuple(dict.fromkeys([*plain.support, *open_cells]))
    for size in range(len(open_cells) + 1):
        for some in combinations(open_cells, size):
            on = {*plain.before, *some} - set(plain.trace)
            if any(cell in on and other not in on for cell, other in plain.guards):
                continue
            if _keeps(lattice, on, sources, targets) and _keeps(lattice, on, targets, sources):
                number = sum(1 << open_cells.index(cell) for cell in some)
                yield replace(
                    plain,
                    name=f"{plain.name}-{number}",
                    support=support,
                    before=(*plain.before, *some),
                    after=(*plain.after, *some),
                    free=(),
                    guards=(),
                )


def _keeps(lattice: Lattice, on: set[Cell], left: set[Cell], taken: set[Cell]) -> bool:
    """Return whether what touched a group that left stays connected, and all that moved to it."""
    among = on | taken
    for cell in left:
        group = lattice.reached(cell, left)
        touched = {other for each in group for other in lattice.beside(each)} & on
        if touched and not touched <= lattice.reached(min(touched), among):
            return False
    return all(lattice.reached(cell, among) & on for cell in taken)


def _oriented(
    lattice: Lattice, table: DrawnGenerator, every: Sequence[Generator]
) -> Iterator[tuple[Orientation, Generator]]:
    """Yield the generators in the orientations that are asked for, each different one once."""
    ways = list(orientations(lattice, mirrored=table.symmetry == "all"))
    turns = table.turns
    if turns is None:
        turns = [way.turn for way in ways] if table.symmetry else [0]
    for stray in sorted(set(turns) - {way.turn for way in ways}):
        raise InputError(
            f"generator {table.name!r}: turns: expected numbers of rotations, 0 to"
            f" {ways[-1].turn}, found {stray}"
        )
    known: set[Action] = set()
    for way, generator in product((way for way in ways if way.turn in turns), every):
        turned = _turned(lattice, generator, way)
        action = turned.canonical(lattice)
        if action not in known:
            known.add(action)
            yield way, turned
        if len(known) > _MOST:
            raise InputError(
                f"generator {table.name!r}: connected: {len(every)} local states in several"
                f" orientations are more than {_MOST}: draw more cells as '#' or '.'"
            )


def _turned(lattice: Lattice, generator: Generator, way: Orientation) -> Generator:
    """Return the generator turned, with the mover's source at the origin."""
    first = way.moved(lattice, generator.motion[0][0])
    back = tuple(-number for number in first[: lattice.dimension])

    def put(cells: Iterable[Cell]) -> tuple[Cell, ...]:
        return tuple(lattice.shift(way.moved(lattice, cell), back) for cell in cells)

    def pairs(cells: Iterable[tuple[Cell, Cell]]) -> tuple[tuple[Cell, Cell], ...]:
        return tuple((one, other) for one, other in map(put, cells))

    cells = ("support", "trace", "before", "after", "free")
    moved = {key: put(getattr(generator, key)) for key in cells}
    return replace(
        generator, **moved, motion=pairs(generator.motion), guards=pairs(generator.guards)
    )


def _named(
    table: DrawnGenerator, every: Iterable[tuple[Orientation, Generator]]
) -> Iterator[Generator]:
    """Yield generators with their names: by orientation, or else numbered if there are several."""
    found = list(every)
    for number, (way, generator) in enumerate(found):
        if "{" in table.name:
            name = generator.name.replace("{turn}", str(way.turn))
            name = name.replace("{side}", "right" if way.mirrored else "left")
        else:
            name = table.name + f"-{number}" * (len(found) > 1)
        yield replace(generator, name=name)


def generator_marks(lattice: Lattice, generator: Generator) -> tuple[dict[Cell, str], ...]:
    """Return the marks of a generator before and after, whether it was drawn or not.

    Swept cells are marked as any that are off, guards whose arrow there is none of as free ones.
    """
    marks = dict.fromkeys(generator.support, _OFF[0]) | dict.fromkeys(generator.free, _FREE[0])
    marks |= {cell: "#" for cell in generator.before if cell not in generator.trace}
    step = 1 + (lattice.arity > lattice.dimension)
    for cell, neighbour in generator.guards:
        points = point_of(lattice, neighbour), point_of(lattice, cell)
        by = [one - other for one, other in zip(*points, strict=True)]
        for arrow, (axis, sign) in _ARROWS.items():
            if by[axis : axis + 1] == [sign * step] and not any(by[:axis] + by[axis + 1 :]):
                marks[cell] = arrow
    before, after = dict(marks), dict(marks)
    for letter, (source, target) in zip(LETTERS, generator.motion, strict=False):
        before[source] = after[target] = letter
    return before, after
