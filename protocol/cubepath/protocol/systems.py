"""Systems: the static world of a robot, and scenes: a system with a start and a goal.

A system answers, for one place, what a module there could do, what it must see for that, and
who could be in its way; the cost is that of the neighbourhood. It knows nothing of where modules
are, so that handing a system to a rule hands it no more than the static map.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from cubepath.protocol.actions import Action, commute
from cubepath.protocol.catalogue import Catalogue, Cell, Move
from cubepath.protocol.errors import InputError
from cubepath.protocol.sites import Site, in_order

EMPTY, MODULE, FILLED, CLOSED = 0, 1, 2, 3
"""What a sensed place shows: free, a module, an occupied obstacle, or no place for a module."""
_KEPT = 1 << 16
"""Places whose moves and neighbourhoods are remembered."""
FIRST_LABEL = 4
"""A labelled module with label ``i`` shows as ``FIRST_LABEL + i``."""


class System(ABC):
    """The static world: places, obstacles, actions and neighbourhoods.

    A *site* is what can be on; a *place* is where a module stands. They differ only in labelled
    systems, whose sites are ``(place, label)``.
    """

    filled: frozenset[Site]
    """Obstacles that are on: they count for supports, never move, never become free."""
    drawing: str
    """How places look: "hexagons", "squares", "edges" or "graph"."""
    place_size: int
    """How many integers `encode_place` returns."""
    move_slots: int
    """Length of every answer of `moves`."""
    sense_slots: int
    """Length of every answer of `sensed`."""
    reach_slots: int
    """The greatest length of an answer of `reach`."""
    labels: int | None = None
    """Number of labels in a labelled system."""

    @abstractmethod
    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves whose mover is a module at `site`; None pads and marks excluded ones."""

    @abstractmethod
    def action(self, generator: str, at: Site) -> Action:
        """Return the action of the named generator at the given place; InputError if unknown."""

    @abstractmethod
    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the places that a module at `place` senses: the supports of its own moves."""

    @abstractmethod
    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the places from which a module senses `place`."""

    @abstractmethod
    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the places where a module could stand whose moves do not commute with one's own.

        Modules that one's own moves take along are among them.
        Claims and notes go there and no further.
        """

    @abstractmethod
    def encode_place(self, place: Site) -> tuple[int, ...]:
        """Return the place as `place_size` integers, for observations."""

    @abstractmethod
    def decode_place(self, numbers: Sequence[int]) -> Site:
        """Return the place that `encode_place` made these integers of."""

    @abstractmethod
    def has_place(self, place: Site) -> bool:
        """Tell whether a module could ever stand at `place`."""

    def region(self, place: Site) -> str:
        """Return the name of the region that a place lies in, one chunk of a key expression.

        Regions only sort messages; a system without coordinates is one region.
        """
        del place
        return "0"

    def place_of(self, site: Site) -> Site:
        """Return the place of a site."""
        return site

    def site_at(self, place: Site, code: int) -> Site | None:
        """Return the site that is on at `place` when a module there sees `code`, None if none."""
        return place if code in (MODULE, FILLED) else None

    def code_of(self, site: Site) -> int:
        """Return how a module at `site` shows to others."""
        return FILLED if site in self.filled else MODULE

    def background(self, place: Site) -> int:
        """Return what a place shows when no module stands there; static, so known to all."""
        if place in self.filled:
            return FILLED
        return EMPTY if self.has_place(place) else CLOSED


class LatticeSystem(System):
    """A catalogue placed by translation into a workspace with obstacles.

    `workspace` None is the whole lattice. `filled` and `empty` are the obstacles that are on and
    off; both may lie in a support, neither in a trace (paper, metamorphic system with obstacles).
    """

    def __init__(
        self,
        catalogue: Catalogue,
        *,
        workspace: Iterable[Site] | None = None,
        filled: Iterable[Site] = (),
        empty: Iterable[Site] = (),
    ) -> None:
        """Check the obstacles and derive all neighbourhoods from the catalogue."""
        lattice = catalogue.lattice
        self.catalogue = catalogue
        self.workspace = (
            None if workspace is None else frozenset(lattice.check(site) for site in workspace)
        )
        self.filled = frozenset(lattice.check(site) for site in filled)
        self.empty = frozenset(lattice.check(site) for site in empty)
        both = self.filled & self.empty
        if both:
            raise InputError(f"obstacle {in_order(both)[0]!r} is both filled and empty")
        self.obstacles: frozenset[Site] = self.filled | self.empty
        self.drawing = lattice.drawing
        self.place_size = lattice.arity
        self._near = _Neighbourhoods(catalogue)
        self.move_slots = max(len(found) for found in catalogue.templates.values())
        self.sense_slots = max(len(found) for found in self._near.sensed.values())
        self.reach_slots = max(len(found) for found in self._near.reach.values())
        self._sensed = self._near.keeper(self._near.sensed, pad=self.sense_slots)
        self._listeners = self._near.keeper(self._near.listeners)
        self._reach = self._near.keeper(self._near.reach)
        self._kept_moves = lru_cache(maxsize=_KEPT)(self._moves)

    def _moves(self, site: Site) -> tuple[Move | None, ...]:
        found: list[Move | None] = [
            move if self._fits(move.action) else None
            for move in self.catalogue.proposals(self.catalogue.lattice.check(site))
        ]
        return tuple(found + [None] * (self.move_slots - len(found)))

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves of a module at `site`, one slot for each generator and direction."""
        return self._kept_moves(site)

    def _fits(self, action: Action) -> bool:
        return action.trace.isdisjoint(self.obstacles) and (
            self.workspace is None or action.support <= self.workspace
        )

    def action(self, generator: str, at: Site) -> Action:
        """Return the generator translated by `at`; InputError if it is not an action here."""
        found = self.catalogue.by_name.get(generator)
        if found is None:
            names = ", ".join(self.catalogue.by_name)
            raise InputError(f"unknown generator {generator!r}, expected one of {names}")
        dimension = self.catalogue.lattice.dimension
        if not (
            isinstance(at, tuple) and len(at) == dimension and all(type(item) is int for item in at)
        ):
            raise InputError(f"generator {generator!r}: 'at' is {dimension} integers, found {at!r}")
        action = found.place(self.catalogue.lattice, at)
        if not self._fits(action):
            raise InputError(f"{action.label}: it would move an obstacle or leave the workspace")
        return action

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the support cells of all moves of a module at `place`, in canonical order."""
        return self._sensed(place)

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the places from which a module senses `place`."""
        return self._listeners(place)

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the places of possible competitors of a module at `place`."""
        return self._reach(place)

    def region(self, place: Site) -> str:
        """Return the block of the lattice that a place lies in."""
        lattice = self.catalogue.lattice
        return _region(lattice.check(place)[: lattice.dimension])

    def encode_place(self, place: Site) -> tuple[int, ...]:
        """Return the cell itself."""
        return self.catalogue.lattice.check(place)

    def decode_place(self, numbers: Sequence[int]) -> Site:
        """Return the cell."""
        return tuple(int(number) for number in numbers)

    def has_place(self, place: Site) -> bool:
        """Tell whether `place` is in the workspace and no obstacle."""
        return place not in self.obstacles and (self.workspace is None or place in self.workspace)


class _Neighbourhoods:
    """Who senses whom and who can be in whose way, as offsets from each orbit's representative."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        lattice = catalogue.lattice
        proposals = {orbit: catalogue.proposals(orbit) for orbit in sorted(catalogue.templates)}
        supports = {
            orbit: {site for move in moves for site in move.action.support}
            for orbit, moves in proposals.items()
        }
        self.sensed: dict[Cell, tuple[Cell, ...]] = {
            orbit: _cells(sites - {orbit}) for orbit, sites in supports.items()
        }
        self.listeners: dict[Cell, tuple[Cell, ...]] = {}
        self.reach: dict[Cell, tuple[Cell, ...]] = {}
        for orbit in proposals:
            heard: set[Site] = set()
            for other, cells in self.sensed.items():
                for cell in cells:
                    by = lattice.between(cell, orbit)
                    if by is not None:
                        heard.add(lattice.shift(other, by))
            self.listeners[orbit] = _cells(heard)
            self.reach[orbit] = self._competitors(orbit, proposals, supports)

    def _competitors(
        self,
        orbit: Cell,
        proposals: Mapping[Cell, tuple[Move, ...]],
        supports: Mapping[Cell, set[Site]],
    ) -> tuple[Cell, ...]:
        lattice = self._catalogue.lattice
        found: set[Site] = set()
        for other, sites in supports.items():
            shifts = {
                lattice.between(lattice.check(theirs), lattice.check(mine))
                for mine in supports[orbit]
                for theirs in sites
            } - {None}
            for by in shifts:
                cell = lattice.shift(other, by or ())
                if cell != orbit and any(
                    not commute(mine.action, theirs.action)
                    for theirs in self._catalogue.proposals(cell)
                    for mine in proposals[orbit]
                ):
                    found.add(cell)
        # Whom a move takes along has to hear of it, even one that has no move of its own; and
        # reach is mutual.
        found |= {source for move in proposals[orbit] for source, _ in move.goes[1:]}
        for other, moves in proposals.items():
            for move in moves:
                for source, _ in move.goes[1:]:
                    by = lattice.between(lattice.check(source), orbit)
                    if by is not None:
                        found.add(lattice.shift(other, by))
        return _cells(found)

    def keeper(
        self, table: Mapping[Cell, tuple[Cell, ...]], *, pad: int = 0
    ) -> Callable[[Site], tuple[Site, ...]]:
        """Return a function from a place to its neighbourhood in `table`, which it remembers."""
        lattice = self._catalogue.lattice

        @lru_cache(maxsize=_KEPT)
        def at(place: Site) -> tuple[Site, ...]:
            cell = lattice.check(place)
            by = cell[: lattice.dimension]
            offsets = table.get(self._catalogue.orbit(cell), ())
            found = [lattice.shift(offset, by) for offset in offsets]
            return (*found, *[None] * (pad - len(found)))

        return at


def _cells(sites: Iterable[Site]) -> tuple[Cell, ...]:
    return tuple(cell for cell in in_order(sites) if isinstance(cell, tuple))


_REGION_SIZE = 8
"""Side of a region in cells: some reaches wide, so a module hears from few regions."""


def _region(coordinates: Iterable[int]) -> str:
    return ",".join(str(number // _REGION_SIZE) for number in coordinates)


COMPASS = ((1, 0), (0, 1), (-1, 0), (0, -1))


class GraphSystem(System):
    """Vehicles on a graph: support and trace are the two ends of an edge.

    Source: the paper's example of automated guided vehicles. Parallel edges are one, and loops are
    refused. `labels` makes it the labelled system: a site is (vertex, label), the support holds
    every label at both ends, the trace is the mover's alone. `compass` gives each vertex (x, y)
    four slots, in the order of `COMPASS`, in place of one slot a neighbour.
    """

    def __init__(
        self,
        vertices: Iterable[Site],
        edges: Iterable[tuple[Site, Site]],
        *,
        labels: int | None = None,
        compass: bool = False,
    ) -> None:
        """Check the graph and lay out its slots."""
        self.vertices = in_order(set(vertices))
        self.index = {vertex: number for number, vertex in enumerate(self.vertices)}
        self.labels = labels
        self.compass = compass
        self.filled = frozenset()
        self.drawing = "squares" if compass else "graph"
        self.place_size = 1
        near: dict[Site, set[Site]] = {vertex: set() for vertex in self.vertices}
        for one, other in edges:
            for end in (one, other):
                if end not in near:
                    raise InputError(f"edge {[one, other]!r} ends at {end!r}, which is no vertex")
            if one == other:
                raise InputError(f"edge {[one, other]!r} is a loop, a vehicle moves between two")
            near[one].add(other)
            near[other].add(one)
        self.edges = tuple(
            (one, other)
            for one in self.vertices
            for other in in_order(near[one])
            if self.index[one] < self.index[other]
        )
        if not self.edges:
            raise InputError("a graph for vehicles has at least one edge, found none")
        self._slots: dict[Site, tuple[Site | None, ...]] = {}
        self.move_slots = 4 if compass else max(len(found) for found in near.values())
        self.sense_slots = self.move_slots
        for vertex in self.vertices:
            found = self._compass(vertex, near[vertex]) if compass else in_order(near[vertex])
            self._slots[vertex] = found + (None,) * (self.move_slots - len(found))
        self._reach = {
            vertex: in_order(
                near[vertex].union(*(near[other] for other in near[vertex])) - {vertex}
            )
            for vertex in self.vertices
        }
        self.reach_slots = max(1, *(len(found) for found in self._reach.values()))
        self._near = {vertex: in_order(found) for vertex, found in near.items()}
        self._support = lru_cache(maxsize=1 << 14)(self._both_ends)
        self._kept_moves = lru_cache(maxsize=_KEPT)(self._moves)

    @staticmethod
    def _compass(vertex: Site, near: set[Site]) -> tuple[Site | None, ...]:
        if not (isinstance(vertex, tuple) and len(vertex) == 2):
            raise InputError(f"a compass vertex is [x, y], found {vertex!r}")
        around = [(vertex[0] + dx, vertex[1] + dy) for dx, dy in COMPASS]
        stray = near - set(around)
        if stray:
            raise InputError(f"edge {[vertex, in_order(stray)[0]]!r} follows no compass direction")
        return tuple(other if other in near else None for other in around)

    def _both_ends(self, one: Site, other: Site) -> frozenset[Site]:
        if self.labels is None:
            return frozenset((one, other))
        return frozenset((end, label) for end in (one, other) for label in range(self.labels))

    def _edge(self, one: Site, other: Site, label: int | None) -> Action:
        if self.index[one] > self.index[other]:
            one, other = other, one
        support = self._support(one, other)
        first: Site = one if label is None else (one, label)
        second: Site = other if label is None else (other, label)
        name = f"edge at {[one, other] if label is None else [one, other, label]}"
        return Action(support, (first, second), (first,), (second,), label=name)

    def _moves(self, site: Site) -> tuple[Move | None, ...]:
        place, label = self._split(site)
        found: list[Move | None] = []
        for other in self._slots[place]:
            if other is None:
                found.append(None)
                continue
            ends = (place, other) if self.index[place] < self.index[other] else (other, place)
            target: Site = other if label is None else (other, label)
            at: Site = ends if label is None else (*ends, label)
            action = self._edge(place, other, label)
            found.append(Move(action, "edge", at, ((site, target),)))
        return tuple(found)

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves along the edges at `site`, a slot for each neighbour or direction."""
        return self._kept_moves(site)

    def _split(self, site: Site) -> tuple[Site, int | None]:
        if self.labels is None:
            if site not in self.index:
                raise InputError(f"{site!r} is no vertex of the graph")
            return site, None
        if (
            isinstance(site, tuple)
            and len(site) == 2
            and site[0] in self.index
            and isinstance(site[1], int)
            and 0 <= site[1] < self.labels
        ):
            return site[0], site[1]
        raise InputError(
            f"a site is [vertex, label] with label below {self.labels}, found {site!r}"
        )

    def action(self, generator: str, at: Site) -> Action:
        """Return the action along the edge `at`: [vertex, vertex] or [vertex, vertex, label]."""
        size = 2 if self.labels is None else 3
        if generator != "edge":
            raise InputError(f"unknown generator {generator!r}, expected edge")
        if not (isinstance(at, tuple) and len(at) == size):
            raise InputError(f"generator edge: 'at' has {size} entries, found {at!r}")
        one, other = at[0], at[1]
        if one not in self._near or other not in self._near[one]:
            raise InputError(f"generator edge: {[one, other]!r} is no edge of the graph")
        label = None if self.labels is None else at[2]
        if label is not None and not (type(label) is int and 0 <= label < (self.labels or 0)):
            raise InputError(f"generator edge: label {label!r} is not below {self.labels}")
        return self._edge(one, other, label)

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the neighbours of a vertex, by slot."""
        return self._slots[place]

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the neighbours of a vertex."""
        return self._near[place]

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the vertices at distance one and two."""
        return self._reach[place]

    def region(self, place: Site) -> str:
        """Return the block of the grid that a vertex lies in; other graphs are one region."""
        return _region(place) if self.compass and isinstance(place, tuple) else "0"

    def encode_place(self, place: Site) -> tuple[int, ...]:
        """Return the number of the vertex in canonical order."""
        return (self.index[place],)

    def decode_place(self, numbers: Sequence[int]) -> Site:
        """Return the vertex with this number."""
        return self.vertices[int(numbers[0])]

    def has_place(self, place: Site) -> bool:
        """Tell whether `place` is a vertex."""
        return place in self.index

    def place_of(self, site: Site) -> Site:
        """Return the vertex of a site."""
        return site if self.labels is None else self._split(site)[0]

    def site_at(self, place: Site, code: int) -> Site | None:
        """Return the site that is on at a vertex which shows `code`."""
        if self.labels is None:
            return super().site_at(place, code)
        return (place, code - FIRST_LABEL) if code >= FIRST_LABEL else None

    def code_of(self, site: Site) -> int:
        """Return MODULE, or the code of the label."""
        label = self._split(site)[1]
        return MODULE if label is None else FIRST_LABEL + label


@dataclass(frozen=True, slots=True)
class Scene:
    """A system with where its modules start, and where they are to go.

    `start` lists the site of module 0, 1, ...; `goal` the sites that are on at the end, or None;
    `goals` what each module knows of it from birth (for vehicles one vertex, for a chain of
    hexagons all its cells in order).
    """

    spec: str
    family: str
    system: System
    start: tuple[Site, ...]
    goal: frozenset[Site] | None = None
    goals: tuple[tuple[Site, ...], ...] = field(default=())

    def __post_init__(self) -> None:
        """Check that modules start on free places of their own and the goal is possible."""
        if not self.start:
            raise InputError(f"{self.spec}: no module to start with")
        seen: set[Site] = set()
        for what, sites in (("module starts", self.start), ("the goal lies", self.goal or ())):
            seen.clear()
            for site in sites:
                place = self.system.place_of(site)
                if not self.system.has_place(place):
                    raise InputError(f"{self.spec}: {what} at {site!r}: an obstacle or no place")
                if place in seen:
                    raise InputError(f"{self.spec}: {what} twice at {place!r}")
                seen.add(place)
        if self.goal is not None and len(self.goal) != len(self.start):
            raise InputError(
                f"{self.spec}: {len(self.start)} modules start, the goal has {len(self.goal)} sites"
            )
        if self.goals and len(self.goals) != len(self.start):
            raise InputError(
                f"{self.spec}: {len(self.start)} modules, goals for {len(self.goals)} of them"
            )

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle as the text of a scene file: a system keeps caches that cannot be pickled."""
        from cubepath.protocol.files import scene_from_toml, scene_to_toml  # noqa: PLC0415

        return scene_from_toml, (scene_to_toml(self), self.spec)

    @property
    def modules(self) -> tuple[str, ...]:
        """Return the names of the modules: module_0, module_1, ..."""
        return tuple(f"module_{number}" for number in range(len(self.start)))

    @property
    def start_state(self) -> frozenset[Site]:
        """Return the sites that are on at the start, occupied obstacles included."""
        return frozenset(self.start) | self.system.filled

    def reached(self, sites: Iterable[Site]) -> bool:
        """Tell whether modules at these sites are at the goal; False when there is none."""
        return self.goal is not None and frozenset(sites) == self.goal
