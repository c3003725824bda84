"""Lattices, generators, and catalogues of generators placed by translation.

Source: Abrams and Ghrist, definition of catalogue and action; the hexagonal and arm generators
follow their examples. A catalogue is data: it can be written to and read from a file.

Outside a process, a move is named by its generator and where that is placed, a
`GeneratorPlacement`: in messages, files and schedules.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from operator import add
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


@dataclass(frozen=True, slots=True)
class Lattice:
    """A lattice whose sites are integer tuples, of which the first `dimension` translate.

    The remaining entries name the orbit (for lattice edges, the axis). `drawing` says how sites
    look: "hexagons", "squares" or "edges".

    >>> HEXAGONS.shift((1, 2), (3, -1)), HEXAGONS.between((0, 0), (4, 1))
    ((4, 1), (4, 1))
    >>> EDGES.check((0, 0, 1))
    (0, 0, 1)
    """

    name: str
    dimension: int
    arity: int
    drawing: str

    def check(self, site: Site) -> Cell:
        """Return `site` as a cell of this lattice, or raise InputError."""
        if (
            isinstance(site, tuple)
            and len(site) == self.arity
            and all(type(item) is int for item in site)
        ):
            return site
        raise InputError(f"a site of lattice {self.name} is {self.arity} integers, found {site!r}")

    def shift(self, cell: Cell, by: Cell) -> Cell:
        """Return the cell translated by `by` (length `dimension`)."""
        return tuple(map(add, cell, by)) + cell[self.dimension :]

    def between(self, origin: Cell, cell: Cell) -> Cell | None:
        """Return the translation that takes `origin` to `cell`; None if there is none."""
        if origin[self.dimension :] != cell[self.dimension :]:
            return None
        return tuple(cell[axis] - origin[axis] for axis in range(self.dimension))


HEXAGONS = Lattice("hexagons", dimension=2, arity=2, drawing="hexagons")
"""The triangular lattice of hexagonal cells, in axial coordinates ``(q, r)``."""
SQUARES = Lattice("squares", dimension=2, arity=2, drawing="squares")
"""The square lattice, of cells ``(x, y)``."""
EDGES = Lattice("edges", dimension=2, arity=3, drawing="edges")
"""The edges ``(x, y, axis)`` of the square lattice: from ``(x, y)`` one step along the axis."""
LATTICES = {lattice.name: lattice for lattice in (HEXAGONS, SQUARES, EDGES)}
HEX_DIRECTIONS: tuple[tuple[int, int], ...] = ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))
"""The six directions of the hexagonal lattice in axial coordinates, counter-clockwise."""


@dataclass(frozen=True, slots=True)
class Generator:
    """A generator at the origin of a lattice.

    `motion` lists where each module of the trace goes, from `before` to `after`; the first is the
    mover, the module that proposes. Read backwards, it is the motion of the reverse.

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
    motion: tuple[tuple[Cell, Cell], ...]
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


@dataclass(frozen=True, slots=True)
class _Template:
    """A generator in one direction: what a module at `source` can propose."""

    generator: Generator
    reverse: bool

    @property
    def source(self) -> Cell:
        return self.generator.motion[0][1 if self.reverse else 0]

    def motion(self) -> tuple[tuple[Cell, Cell], ...]:
        if not self.reverse:
            return self.generator.motion
        return tuple((after, before) for before, after in self.generator.motion)


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
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError(f"generator {twice[0]!r} stands twice in the catalogue")
        for generator in self.generators:
            for cell in generator.support:
                self.lattice.check(cell)
        self._check_different()
        object.__setattr__(self, "by_name", dict(zip(names, self.generators, strict=True)))
        templates: dict[Cell, list[_Template]] = {}
        for generator in self.generators:
            for reverse in (False, True):
                template = _Template(generator, reverse)
                templates.setdefault(self.orbit(template.source), []).append(template)
        object.__setattr__(
            self, "templates", {orbit: tuple(found) for orbit, found in templates.items()}
        )

    def _check_different(self) -> None:
        """Raise InputError if two generators are equal: translated, or read backwards."""
        known: dict[Action, str] = {}
        for generator in self.generators:
            corner = [-min(along) for along in zip(*generator.support, strict=True)]
            action = generator.place(self.lattice, tuple(corner[: self.lattice.dimension]))
            first = known.setdefault(action, generator.name)
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
        for template in self.templates.get(self.orbit(cell), ()):
            by = lattice.between(template.source, cell)
            if by is None:  # the template is filed under this orbit
                raise AssertionError(f"{template.generator.name} does not reach {cell}")
            motion = tuple(
                (lattice.shift(source, by), lattice.shift(target, by))
                for source, target in template.motion()
            )
            name = template.generator.name
            found.append(Move(place(name, by), name, by, motion))
        return tuple(found)
