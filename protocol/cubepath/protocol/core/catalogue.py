"""Lattices, generators, and catalogues of generators placed by translation.

Source: Abrams and Ghrist, definition of catalogue and action; the hexagonal and arm generators
follow their examples. A catalogue is data: it can be written to and read from a file.

Outside a process, a move is named by its generator and where that is placed, a
`GeneratorPlacement`: in messages, files and schedules.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from operator import add, sub
from typing import Any, TypeAlias

import msgspec

from cubepath.protocol.core.actions import Action, State, end_at
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site


class GeneratorPlacement(msgspec.Struct, frozen=True):
    """An action by the name of its generator and where it is placed."""

    generator: str
    at: Site


_SITE = {"$comment": "site"}
"""Stands for a site until `_any_site` takes it away: msgspec has no schema that allows anything."""


def _any_site(schema: Any) -> Any:
    """Return a schema in which a site may be anything; its lists in lists have no schema."""
    if isinstance(schema, list):
        return [_any_site(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: _any_site(value)
        for key, value in schema.items()
        if key != "$comment" and not (key == "anyOf" and _SITE in value)
    }


def schema_with_definitions(kind: type[msgspec.Struct]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the JSON Schema (2020-12) of an object, and by name the schemas that it refers to."""
    schema = _any_site(msgspec.json.schema(kind, schema_hook=lambda _: _SITE))
    definitions: dict[str, Any] = schema.pop("$defs", {})
    name = str(schema.pop("$ref", "")).rpartition("/")[2]
    return definitions.pop(name, schema), definitions


Cell: TypeAlias = tuple[int, ...]
Place: TypeAlias = Callable[[str, Cell], Action]
"""Returns the action of a generator, given its name and a translation."""


_INTEGERS = frozenset((int,))


@dataclass(frozen=True, slots=True)
class Lattice:
    """A lattice whose sites are integer tuples, of which the first `dimension` translate.

    The remaining entries name the orbit (for lattice edges, the axis). `drawing` is the style of
    its pictures. Where `even` is set, coordinates and translations have an even sum. `contacts` are
    the pairs of touching cells up to translation, each pair both ways.

    >>> HEXAGONS.shift((1, 2), (3, -1)), HEXAGONS.between((0, 0), (4, 1))
    ((4, 1), (4, 1))
    >>> EDGES.check((0, 0, 1)), SQUARES.beside((5, 5))
    ((0, 0, 1), ((6, 5), (5, 6), (4, 5), (5, 4)))
    """

    name: str
    dimension: int
    arity: int
    drawing: str
    even: bool = False
    contacts: tuple[tuple[Cell, Cell], ...] = field(default=(), repr=False)

    def check(self, site: Site) -> Cell:
        """Return `site` as a cell of this lattice, or raise InputError."""
        if (
            isinstance(site, tuple)
            and len(site) == self.arity
            and {*map(type, site)} <= _INTEGERS
            and not (self.even and sum(site) % 2)
        ):
            return site
        what = f"{self.arity} integers" + self.even * " with an even sum"
        raise InputError(f"a site of lattice {self.name} is {what}, found {site!r}")

    def shift(self, cell: Cell, by: Cell) -> Cell:
        """Return the cell translated by `by` (length `dimension`)."""
        return tuple(map(add, cell, by)) + cell[self.dimension :]

    def between(self, origin: Cell, cell: Cell) -> Cell | None:
        """Return the translation that takes `origin` to `cell`; None if there is none."""
        if origin[self.dimension :] != cell[self.dimension :]:
            return None
        return tuple(map(sub, cell[: self.dimension], origin))

    def beside(self, cell: Cell) -> tuple[Cell, ...]:
        """Return the cells that touch a cell, in the order of `contacts`."""
        by, tail = cell[: self.dimension], cell[self.dimension :]
        return tuple(
            self.shift(other, by) for one, other in self.contacts if one[self.dimension :] == tail
        )

    def pieces(self, sites: Iterable[Site]) -> int:
        """Return into how many pieces a set of cells falls, by cells that touch."""
        rest, count = {self.check(site) for site in sites}, 0
        while rest:
            count += 1
            rest -= self.reached(next(iter(rest)), rest)
        return count

    def reached(self, cell: Cell, among: Iterable[Cell]) -> set[Cell]:
        """Return the cells connected to a cell by cells among which they are, and itself."""
        rest, found, border = {*among} - {cell}, {cell}, [cell]
        while border:
            near = rest.intersection(self.beside(border.pop()))
            rest -= near
            found |= near
            border += near
        return found


def _faces(*directions: Cell) -> tuple[tuple[Cell, Cell], ...]:
    """Return the contacts of cells that touch in these directions."""
    return tuple(((0,) * len(by), by) for by in directions)


def _vertices(dimension: int) -> tuple[tuple[Cell, Cell], ...]:
    """Return the contacts of the edges of a lattice that share a vertex."""

    def ends(edge: Cell) -> set[Cell]:
        *first, along = edge
        last = (number + (axis == along) for axis, number in enumerate(first))
        return {tuple(first), tuple(last)}

    axes = [(0,) * dimension + (axis,) for axis in range(dimension)]
    near = [(*by, *axis[-1:]) for axis in axes for by in product((-1, 0, 1), repeat=dimension)]
    return tuple(
        (one, other) for one in axes for other in near if len(ends(one) & ends(other)) == 1
    )


HEX_DIRECTIONS: tuple[tuple[int, int], ...] = ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))
"""The six directions of the hexagonal lattice in axial coordinates, counter-clockwise."""
HEXAGONS = Lattice("hexagons", 2, 2, "hexagons", contacts=_faces(*HEX_DIRECTIONS))
"""The triangular lattice of hexagonal cells, in axial coordinates ``(q, r)``."""
SQUARES = Lattice("squares", 2, 2, "squares", contacts=_faces((1, 0), (0, 1), (-1, 0), (0, -1)))
"""The square lattice, of cells ``(x, y)``."""
EDGES = Lattice("edges", 2, 3, "edges", contacts=_vertices(2))
"""The edges ``(x, y, axis)`` of the square lattice: from ``(x, y)`` one step along the axis. Two
touch at a vertex, as they do in three dimensions."""
_STEPS = tuple(product((1, 0, -1), repeat=3))
CUBES = Lattice(
    "cubes", 3, 3, "cubes", contacts=_faces(*(by for by in _STEPS if sum(map(abs, by)) == 1))
)
"""The cubic lattice, of cells ``(x, y, z)``; a cell touches six others, at its faces."""
DODECAHEDRA = Lattice(
    "dodecahedra",
    3,
    3,
    "dodecahedra",
    even=True,
    contacts=_faces(*(by for by in _STEPS if sum(map(abs, by)) == 2)),
)
"""The face-centred cubic lattice, of rhombic dodecahedra around the points ``(x, y, z)`` with an
even sum; a cell touches twelve others, at ``(1, 1, 0)`` and the like."""
CUBE_EDGES = Lattice("cube-edges", 3, 4, "cube-edges", contacts=_vertices(3))
"""The edges ``(x, y, z, axis)`` of the cubic lattice, each one step along its axis."""
LATTICES = {
    lattice.name: lattice for lattice in (HEXAGONS, SQUARES, EDGES, CUBES, DODECAHEDRA, CUBE_EDGES)
}


def lattice_named(name: str, among: Mapping[str, Lattice] = LATTICES) -> Lattice:
    """Return the lattice of this name; InputError if there is none."""
    if name not in among:
        raise InputError(f"unknown lattice {name!r}, expected one of {', '.join(among)}")
    return among[name]


class Generator(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A generator at the origin of a lattice, as in the tables ``[[lattice.generators]]``.

    `motion` lists where each module of the trace goes, from `before` to `after`; the first is the
    mover, the module that proposes. Read backwards, it is the motion of the reverse. In tables it
    is ``goes``.

    >>> cells = (0, 0), (1, 0)
    >>> slide = Generator("slide", cells, cells, cells[:1], cells[1:], (cells,))
    >>> slide.place(SQUARES, (3, 4)).label
    'slide at [3, 4]'
    """

    name: str
    support: tuple[Cell, ...]
    trace: tuple[Cell, ...]
    before: tuple[Cell, ...]
    after: tuple[Cell, ...]
    motion: tuple[tuple[Cell, Cell], ...] = msgspec.field(name="goes")
    free: tuple[Cell, ...] = ()
    guards: tuple[tuple[Cell, Cell], ...] = ()

    def __post_init__(self) -> None:
        if not self.motion:
            raise InputError(f"generator {self.name!r}: no module goes anywhere")
        self.place(Lattice("origin", 0, len(self.support[0]) if self.support else 0, ""), ())
        sources, targets = zip(*self.motion, strict=True)
        trace = set(self.trace)
        if set(sources) != trace & set(self.before) or set(targets) != trace & set(self.after):
            raise InputError(
                f"generator {self.name!r}: 'goes' must take every site of the trace that is on"
                " before to one that is on after"
            )

    def place(self, lattice: Lattice, by: Cell) -> Action:
        """Return the action of this generator translated by `by`."""

        def put(cells: Iterable[Cell]) -> list[Cell]:
            return [lattice.shift(cell, by) for cell in cells]

        return Action(
            put(self.support),
            put(self.trace),
            put(self.before),
            put(self.after),
            free=put(self.free),
            guards=[(lattice.shift(a, by), lattice.shift(b, by)) for a, b in self.guards],
            label=f"{self.name} at {list(by)}" if by else f"generator {self.name!r}",
        )

    def canonical(self, lattice: Lattice) -> Action:
        """Return the action that is the same for all translates of a generator, and its reverse."""
        corner = [-min(along) for along in zip(*self.support, strict=True)]
        return self.place(lattice, tuple(corner[: lattice.dimension]))


@dataclass(frozen=True, slots=True)
class Move:
    """What a module can propose: an action, its generator and place, and where modules go.

    >>> system = scene_from_spec("hex:n=3").system
    >>> move = next(each for each in system.moves((0, 0)) if each is not None)
    >>> move.generator, move.source, move.target
    ('pivot-0-left', (0, 0), (1, 0))
    """

    action: Action
    generator: str
    at: Site
    motion: tuple[tuple[Site, Site], ...]

    @property
    def source(self) -> Site:
        """Return the site of the mover before the move."""
        return self.motion[0][0]

    @property
    def target(self) -> Site:
        """Return the site of the mover after the move."""
        return self.motion[0][1]

    def possible(self, state: State) -> bool:
        """Return whether the action is admissible and its modules stand where the move begins.

        The mover alone does not decide this: when a run of squares slides by one, most places are
        taken before and after.
        """
        end = end_at(self.action, state)
        if end is None:
            return False
        on = self.action.ends[end]
        if len(self.motion) == 1:  # nearly always: a comprehension would cost as much as the rest
            return self.motion[0][0] in on
        return all(source in on for source, _ in self.motion)


_Template: TypeAlias = tuple[str, tuple[tuple[Cell, Cell], ...]]
"""A generator in one direction: its name, and where it takes modules, first the one that proposes.
"""


@dataclass(frozen=True)
class Catalogue:
    """A finite set of generators on a lattice, indexed by name and by the orbit of the mover.

    All neighbourhoods are derived from the generators; no radius is entered by hand.

    >>> cells = (0, 0), (1, 0)
    >>> slide = Generator("slide", cells, cells, cells[:1], cells[1:], (cells,))
    >>> system = LatticeSystem(Catalogue(SQUARES, (slide,)))
    >>> [(move.generator, move.target) for move in system.moves((0, 0)) if move is not None]
    [('slide', (1, 0)), ('slide', (-1, 0))]
    """

    lattice: Lattice
    generators: tuple[Generator, ...]
    by_name: dict[str, Generator] = field(init=False, repr=False, compare=False)
    templates: dict[Cell, tuple[_Template, ...]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = [generator.name for generator in self.generators]
        if not names:
            raise InputError("a catalogue has at least one generator, found none")
        twice = next((name for name, count in Counter(names).items() if count > 1), None)
        if twice is not None:
            raise InputError(f"generator {twice!r} stands twice in the catalogue")
        for generator in self.generators:
            for cell in generator.support:
                self.lattice.check(cell)
        self._check_different()
        object.__setattr__(self, "by_name", dict(zip(names, self.generators, strict=True)))
        templates: dict[Cell, list[_Template]] = {}
        for generator in self.generators:
            back = tuple((after, before) for before, after in generator.motion)
            for motion in (generator.motion, back):
                own = templates.setdefault(self.orbit(motion[0][0]), [])
                own.append((generator.name, motion))
        object.__setattr__(
            self, "templates", {orbit: tuple(found) for orbit, found in templates.items()}
        )

    def _check_different(self) -> None:
        """Raise InputError if two generators are equal: translated, or read backwards."""
        known: dict[Action, str] = {}
        for generator in self.generators:
            first = known.setdefault(generator.canonical(self.lattice), generator.name)
            if first != generator.name:
                raise InputError(
                    f"generator {generator.name!r} equals {first!r}, up to a translation: expected"
                    " each once"
                )

    def orbit(self, cell: Cell) -> Cell:
        """Return the representative of the cell's orbit under translation."""
        return (0,) * self.lattice.dimension + cell[self.lattice.dimension :]

    def place(self, name: str, by: Cell) -> Action:
        """Return the action of the generator of this name translated by `by`."""
        return self.by_name[name].place(self.lattice, by)

    def proposals(self, cell: Cell, place: Place | None = None) -> tuple[Move, ...]:
        """Return all moves whose mover stands at `cell`, in the order of the catalogue.

        `place` returns their actions, so a caller can cache them; the default is `Catalogue.place`.
        """
        lattice, found = self.lattice, []
        place = place or self.place
        for name, ends in self.templates.get(self.orbit(cell), ()):
            by = lattice.between(ends[0][0], cell)
            if by is None:  # the template is filed under this orbit
                raise AssertionError(f"{name} does not reach {cell}")
            motion = tuple((lattice.shift(a, by), lattice.shift(b, by)) for a, b in ends)
            found.append(Move(place(name, by), name, by, motion))
        return tuple(found)
