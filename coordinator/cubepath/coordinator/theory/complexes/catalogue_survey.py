"""What a catalogue is like: what commutes, what moves do to small aggregates, what modules sense.

All aggregates up to a size are listed, up to translation, and every move of each is tried, so what
is reported is exact. Nothing depends on the scene: obstacles and workspace are ignored.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import HEXAGONS, Catalogue, Cell, Generator, Lattice, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System

_WORK = 30_000
"""How many moves are tried in aggregates of one size, at most."""
_LARGEST = 8
FAR = 20
"""How many steps away cells are looked for that moves depend on; no more are counted."""
_Shape = tuple[Cell, ...]
_CORNERS = tuple(((0, 0), by) for by in product((1, 0, -1), repeat=2) if any(by))
_AROUND = {"hexagons": HEXAGONS, "squares": Lattice("corners", 2, 2, "squares", contacts=_CORNERS)}
"""By the name of a plane lattice, which of its cells that are off belong together."""


@dataclass(frozen=True, slots=True)
class Witness:
    """A move of a connected aggregate: the cells before and after."""

    move: Move
    before: frozenset[Cell]
    after: frozenset[Cell]


@dataclass(frozen=True, slots=True)
class CatalogueSurvey:
    """What is true of all connected aggregates of up to `size` modules, with smallest witnesses.

    `splits` is a move that takes one apart, `holes` one that changes the number of its holes.
    `unseen` are two moves that look alike to their movers: the first keeps its aggregate connected,
    the second does not. Of the `meeting` pairs of moves whose supports meet `commuting` commute;
    pairs count up to translation.
    """

    size: int
    aggregates: int
    meeting: int
    commuting: int
    sensed: int
    farthest: int
    splits: Witness | None
    holes: Witness | None
    unseen: tuple[Witness, Witness] | None


def catalogue_survey(system: System, size: int | None = None) -> CatalogueSurvey:
    """Return the survey of a system with a catalogue, of aggregates of up to `size` modules.

    By default the size is what a moment is enough for. InputError if the system has no catalogue.
    """
    catalogue = system.catalogue
    if catalogue is None:
        raise InputError("expected generators, which the system does not have")
    meeting, commuting = _pairs(catalogue)
    lattice = catalogue.lattice
    # A witness of what is not seen is larger than others.
    every, largest = _aggregates(catalogue, size, _WORK if system.local else 3 * _WORK)
    splits = holes = None
    unseen: tuple[Witness, Witness] | None = None
    seen: dict[object, dict[bool, Witness]] = {}
    everywhere = system.with_moves(())
    for shape in every:
        known = _holes(lattice, frozenset(shape))
        for move, after in _moves(everywhere, lattice, shape):
            found = Witness(move, frozenset(shape), after)
            whole = lattice.pieces(after) == 1
            splits = splits or (None if whole else found)
            if whole and holes is None and _holes(lattice, after) != known:
                holes = found
            if unseen is None and not system.local:
                both = seen.setdefault(_view(system, found), {})
                both.setdefault(whole, found)
                unseen = (both[True], both[False]) if len(both) > 1 else None
    places = {place: system.sensed(place) for place in catalogue.templates}
    return CatalogueSurvey(
        largest,
        len(every),
        meeting,
        commuting,
        max(sum(cell is not None for cell in cells) for cells in places.values()),
        max(
            _steps(lattice, place, {lattice.check(cell) for cell in cells if cell is not None})
            for place, cells in places.items()
        ),
        splits,
        holes,
        unseen,
    )


def _pairs(catalogue: Catalogue) -> tuple[int, int]:
    """Return how many pairs of placed generators meet, up to translation, and how many commute.

    This depends only on supports and traces, so generators that share them are counted together.
    """
    lattice = catalogue.lattice
    kinds = Counter(
        (frozenset(each.support), frozenset(each.trace)) for each in catalogue.generators
    )

    def offsets(one: frozenset[Cell], other: frozenset[Cell]) -> set[Cell]:
        found = (lattice.between(b, a) for a, b in product(one, other))
        return {by for by in found if by is not None}

    meeting = commuting = 0
    for (one, count), (other, others) in product(kinds.items(), repeat=2):
        meet = offsets(one[0], other[0])
        clash = offsets(one[1], other[0]) | offsets(one[0], other[1])
        # Each generator meets itself in its own place, which is no pair.
        meeting += count * others * len(meet) - count * (one == other)
        commuting += count * others * len(meet - clash)
    return meeting // 2, commuting // 2


def _aggregates(catalogue: Catalogue, size: int | None, work: int) -> tuple[list[_Shape], int]:
    """Return the connected aggregates by size, and the largest size."""
    lattice = catalogue.lattice
    slots = max(map(len, catalogue.templates.values()))
    orbits = sorted({one[lattice.dimension :] for one, _ in lattice.contacts})
    level: list[_Shape] = [((0,) * lattice.dimension + orbit,) for orbit in orbits]
    found, largest = list(level), 1
    while largest < (size or _LARGEST):
        grown = {_moved_home(lattice, {*s, n}) for s in level for c in s for n in lattice.beside(c)}
        level = sorted(shape for shape in grown if len(shape) > largest)
        if size is None and len(level) * (largest + 1) * slots > work:
            break
        largest += 1
        found += level
    return found, largest


def _moved_home(lattice: Lattice, cells: set[Cell]) -> _Shape:
    """Return the cells in order, translated so that the first is at the origin."""
    first = min(cells)
    by = tuple(-number for number in first[: lattice.dimension])
    return tuple(sorted(lattice.shift(cell, by) for cell in cells))


def _moves(
    system: System, lattice: Lattice, shape: _Shape
) -> Iterator[tuple[Move, frozenset[Cell]]]:
    state = frozenset(shape)
    for cell in shape:
        for move in system.moves(cell):
            if move is not None and move.possible(state):
                yield move, frozenset(map(lattice.check, apply(move.action, state)))


def _view(system: System, found: Witness) -> object:
    """Return what the mover sees, without where it is."""
    sensed = system.sensed(found.move.source)
    seen = tuple(cell in found.before for cell in sensed)
    source, target = found.move.motion[0]
    return found.move.generator, system.encode_site(source) < system.encode_site(target), seen


def _holes(lattice: Lattice, cells: frozenset[Cell]) -> int:
    """Return how many holes an aggregate in the plane has; 0 elsewhere.

    A hole is a piece of the cells that are off which does not reach the outside. Squares that are
    off belong together at corners, too, since those that are on do not.
    """
    around = _AROUND.get(lattice.name)
    if around is None:
        return 0
    ranges = (range(min(each) - 1, max(each) + 2) for each in zip(*cells, strict=True))
    return around.pieces(set(product(*ranges)) - cells) - 1


def _steps(lattice: Lattice, place: Cell, cells: set[Cell]) -> int:
    """Return how many steps between cells that touch lead to the farthest cell, `FAR` at most."""
    reached, steps = {place}, 0
    while not cells <= reached and steps < FAR:
        reached |= {other for cell in reached for other in lattice.beside(cell)}
        steps += 1
    return steps


def never_admissible(generator: Generator) -> bool:
    """Return whether a guard contradicts the cells that are always on and off."""
    fixed = set(generator.support) - set(generator.free)
    return any(
        one in generator.before and other in fixed and other not in generator.before
        for one, other in generator.guards
    )
