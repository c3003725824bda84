"""Systems on a graph: vehicles that move along edges, labelled or not."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import chain
from typing import Annotated, Any, ClassVar, Self

import msgspec

from cubepath.protocol.core.actions import Action, action_of_parts
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site, in_order, site_hook, site_text, to_json
from cubepath.protocol.core.system import (
    FAR,
    FIRST_LABEL,
    KEPT,
    MODULE,
    System,
    VehicleGraph,
    Ways,
    region_of,
)

COMPASS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def along_edge(one: Site, other: Site) -> Action:
    """Return the action of a vehicle without a label along an edge, in either direction.

    The two ends are distinct and in canonical order. They are support and trace, and one is on.

    >>> along_edge(1, 2) == Action([1, 2], [1, 2], [1], [2])
    True
    """
    first, second = frozenset((one,)), frozenset((other,))
    both = first | second
    return action_of_parts(both, both, (first, second), label=f"edge at {site_text((one, other))}")


class GraphSystem(System):
    """Vehicles on a graph: support and trace are the two ends of an edge.

    Source: the paper's example of automated guided vehicles. Parallel edges are one, and loops are
    refused. `labels` makes it the labelled system: a site is (vertex, label), the support holds
    every label at both ends, the trace only the mover's. `compass` gives each vertex (x, y) four
    slots, in the order of `COMPASS`, instead of one slot for each neighbour.

    >>> system = GraphSystem(["gate", "dock", "yard"], [("gate", "yard"), ("yard", "dock")])
    >>> scene = Scene("trucks", "", system, start=("gate", "dock"))
    >>> [move.target for move in system.moves("yard") if move is not None]
    ['dock', 'gate']
    >>> play(scene, "random", seed=3, max_rounds=20).sites
    ('gate', 'dock')
    """

    table: ClassVar[str] = "graph"
    graph: VehicleGraph

    def __init__(
        self,
        vertices: Iterable[Site],
        edges: Iterable[tuple[Site, Site]],
        *,
        labels: int | None = None,
        compass: bool = False,
    ) -> None:
        """Check the graph and lay out its slots."""
        listed = list(vertices)
        self.vertices = in_order(set(listed))
        if len(self.vertices) < len(listed):
            twice = next(vertex for vertex in listed if listed.count(vertex) > 1)
            raise InputError(f"vertex {twice!r} stands twice (1, 1.0 and true are the same)")
        if labels is not None and labels > len(self.vertices):
            most = len(self.vertices)
            raise InputError(f"labels={labels}: expected at most {most}, one a vertex")
        self.index = {vertex: number for number, vertex in enumerate(self.vertices)}
        self.labels = labels
        self.compass = compass
        self.filled = frozenset()
        self.places = self.vertices
        self.drawing = "map" if compass else "graph"
        self.site_size = 1
        self.codes = FIRST_LABEL + (labels or 0)
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
        near_by = compass and all(
            -FAR < number < FAR
            for vertex in self.vertices
            if isinstance(vertex, tuple)
            for number in vertex
        )
        self.dimension = 2 if near_by else 0
        self._near = {vertex: in_order(found) for vertex, found in near.items()}
        # Narrower than in the base class, and set only here.
        self.graph = VehicleGraph(  # pyright: ignore[reportIncompatibleVariableOverride]
            self.vertices, self.index, self._near, self.edges
        )
        # On a grid twelve cells lie at distance one or two; on other graphs they are counted.
        self.reach_slots = (
            12 if compass else max(1, *(len(self._within_two(vertex)) for vertex in self.vertices))
        )
        self._reach = lru_cache(maxsize=KEPT)(lambda place: in_order(self._within_two(place)))
        self._support = lru_cache(maxsize=1 << 14)(self._both_ends)
        self._kept_moves = lru_cache(maxsize=KEPT)(self._moves)
        self._placed = lru_cache(maxsize=KEPT * self.move_slots)(self._along)

    def __reduce__(self) -> tuple[object, ...]:
        # The caches cannot be pickled, and need not be.
        build = partial(
            type(self), self.vertices, self.edges, labels=self.labels, compass=self.compass
        )
        return build, ()

    def to_table(self) -> dict[str, Any]:
        """Return vertices, edges, compass and labels."""
        table: dict[str, Any] = {
            "compass": self.compass,
            "vertices": to_json(self.vertices),
            "edges": to_json(self.edges),
        }
        if self.labels is not None:
            table["labels"] = self.labels
        return table

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a table ``[graph]``; docs/files.md has its keys."""
        found = msgspec.convert(table, _GraphTable, dec_hook=site_hook)
        return cls(found.vertices, found.edges, labels=found.labels, compass=found.compass)

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
        ends = self.index[one], self.index[other]
        return self._placed(min(ends), max(ends), label)

    def _along(self, lesser: int, greater: int, label: int | None) -> Action:
        one, other = self.vertices[lesser], self.vertices[greater]
        if label is None:
            return along_edge(one, other)
        first, second = (one, label), (other, label)
        name = f"edge at {site_text((one, other, label))}"
        support = self._support(one, other)
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
            and type(site[1]) is int
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
            raise ExcludedError(f"generator edge: {[one, other]!r} is no edge of the graph")
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
        return self._reach(place)

    def _within_two(self, place: Site) -> set[Site]:
        near = self._near[place]
        return {*near, *(far for other in near for far in self._near[other])} - {place}

    def region(self, place: Site) -> str:
        """Return the block of the grid that a vertex lies in; other graphs are one region."""
        return region_of(place) if self.compass and isinstance(place, tuple) else "0"

    def pattern(self, site: Site) -> Hashable:
        """Return which slots of the vertex lead anywhere."""
        return tuple([other is not None for other in self._slots[self.place_of(site)]])

    def coordinates(self, place: Site) -> tuple[float, ...]:
        """Return (x, y) with `compass`, and nothing for other graphs."""
        return place if self.dimension and isinstance(place, tuple) else ()

    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return the number of the vertex in canonical order."""
        return (self.index[self.place_of(site)],)

    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the site at the vertex with this number."""
        vertex = self.vertices[int(numbers[0])]
        return vertex if self.labels is None else (vertex, label)

    def has_place(self, place: Site) -> bool:
        """Return whether `place` is a vertex."""
        return place in self.index

    def check_place(self, place: Site) -> None:
        """Raise InputError if `place` is no vertex in the graph's own spelling: true is not 1."""
        super().check_place(place)
        vertex = self.vertices[self.index[place]]
        if site_text(place) != site_text(vertex):
            raise InputError(f"the vertex is {site_text(vertex)}")

    def place_of(self, site: Site) -> Site:
        """Return the vertex of a site."""
        return site if self.labels is None else self._split(site)[0]

    def site_at(self, place: Site, code: int) -> Site | None:
        """Return the site that is on at a vertex that shows `code`."""
        if self.labels is None:
            return super().site_at(place, code)
        return (place, code - FIRST_LABEL) if code >= FIRST_LABEL else None

    def code_of(self, site: Site) -> int:
        """Return MODULE, or the code of the label."""
        label = self._split(site)[1]
        return MODULE if label is None else FIRST_LABEL + label

    def lines(self) -> Iterable[tuple[Site, Site]]:
        """Return the edges."""
        return self.edges

    def with_labels(self, count: int) -> System:
        """Return the same graph with labelled vehicles."""
        return type(self)(self.vertices, self.edges, labels=count, compass=self.compass)

    def with_moves(self, placed: Iterable[tuple[str, Site]]) -> System:
        """Return the graph with these edges and their ends added."""
        more = [(at[0], at[1]) for _, at in placed if isinstance(at, tuple) and len(at) >= 2]
        edges = dict.fromkeys((*self.edges, *more))
        vertices = dict.fromkeys((*self.vertices, *chain.from_iterable(edges)))
        return type(self)(vertices, edges, labels=self.labels, compass=self.compass)

    def ways(self) -> Ways:
        """Return the sites along the edges."""

        def near(site: Site) -> Iterable[Site]:
            place, label = self._split(site)
            if label is None:
                return self._near[place]
            return [(other, label) for other in self._near[place]]

        return Ways(near, one_to_one=True)

    def check_state(self, sites: Iterable[Site]) -> None:
        """Check that no label is on at two vertices."""
        seen: dict[int, Site] = {}
        for site in sites:
            place, label = self._split(site)
            if label is None:
                continue
            if label in seen:
                raise InputError(f"label {label} is on twice, at {seen[label]!r} and {place!r}")
            seen[label] = place


class _GraphTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    vertices: list[Site]
    edges: list[tuple[Site, Site]]
    compass: bool = False
    labels: Annotated[int, msgspec.Meta(ge=1)] | None = None
