"""Systems: the static world of a robot, and scenes: a system with a start and a goal.

A system answers, for one place, what a module there could do, what it must see for that, and
who could be in its way; the cost is that of the neighbourhood. It knows nothing of where modules
are, so that handing a system to a rule hands it no more than the static map.

All that others may want to know of a system, its class says itself: how it is written and read,
how its sites are drawn, where modules can go, what is known of paths in it. Whoever asks for a
class or a name instead works with the systems of today only; so nobody does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Catalogue, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.vehicle_graph import VehicleGraph

EMPTY, MODULE, FILLED, CLOSED = 0, 1, 2, 3
"""What a sensed place shows: free, a module, an occupied obstacle, or no place for a module."""
KEPT = 1 << 16
"""Places whose moves and neighbourhoods are remembered."""
FIRST_LABEL = 4
"""A labelled module with label ``i`` shows as ``FIRST_LABEL + i``."""


class Ways(NamedTuple):
    """From which site a module can come to which by some move, whatever else stands there."""

    near: Callable[[Site], Iterable[Site]]
    """The sites that are one move away from a site, each once."""
    one_to_one: bool
    """Whether every move takes its modules to as many sites, no two to one."""


def one_to_one(motions: Iterable[Sequence[tuple[Site, Site]]]) -> bool:
    """Tell whether each of these motions takes its modules to as many sites, no two to one."""
    return all(
        len({source for source, _ in motion})
        == len({target for _, target in motion})
        == len(motion)
        for motion in motions
    )


class Bound(NamedTuple):
    """No path between two states has fewer than `cubes` cubes; `why` names the argument."""

    cubes: int
    why: str


class System(ABC):
    """The static world: places, obstacles, actions and neighbourhoods.

    A *site* is what can be on; a *place* is where a module stands. They differ only in labelled
    systems, whose sites are ``(place, label)``.

    A class of another distribution defines what is abstract here, and whatever else it can say;
    what it leaves out is not known of it, and does no harm. It is offered to others by a `Family`
    of scenes, under the entry point group ``cubepath.systems``.
    """

    table: ClassVar[str]
    """The name of the TOML table that systems of this class are written as and read from."""
    filled: frozenset[Site]
    """Obstacles that are on: they count for supports, never move, never become free."""
    empty: frozenset[Site] = frozenset()
    """Obstacles that are off."""
    drawing: str
    """How places look: a style that pictures know: "hexagons", "squares", "map", "edges", "graph",
    "chords" or "letters"."""
    places: tuple[Site, ...] = ()
    """The places that a picture shows whatever the modules do: of a finite system all."""
    positions: Mapping[Site, tuple[float, float]] = MappingProxyType({})
    """Where places, or the points that a chord joins, lie in a picture, y upwards."""
    letters: tuple[str, ...] = ()
    """The letters of a system whose sites are ``(place, letter)``."""
    catalogue: Catalogue | None = None
    """The generators that are placed by translation, where all moves come from such."""
    graph: VehicleGraph | None = None
    """The graph, where modules are vehicles."""
    bounded: bool = True
    """False where modules can wander off for ever: the workspace is a whole lattice."""
    site_size: int
    """How many integers `encode_site` returns."""
    move_slots: int
    """Length of every answer of `moves`."""
    sense_slots: int
    """Length of every answer of `sensed`."""
    reach_slots: int
    """The greatest length of an answer of `reach`."""
    labels: int | None = None
    """Number of labels in a labelled system."""
    codes: int = 4
    """Every code that a place shows is below this."""
    local = True
    """False where a rule for the whole aggregate decides too (`legal`): such a system has a
    complex, but no environment, no runs and no shortening."""

    @abstractmethod
    def to_table(self) -> dict[str, Any]:
        """Return what the TOML table of this system holds: plain lists, texts and numbers."""

    @classmethod
    @abstractmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system that a TOML table holds; of `to_table`, an equal one.

        InputError, or msgspec's ValidationError, for a table that holds none.
        """

    @abstractmethod
    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves whose mover is a module at `site`; None pads and marks excluded ones.

        Each takes every module of its trace to a site of it, one to one: none comes or goes.
        """

    def moves_at(self, site: Site) -> Iterable[Move]:
        """Return the moves of `moves` that there are, in their order, without slots.

        A system that lists its moves only for runs and environments finds them here.
        """
        return (move for move in self.moves(site) if move is not None)

    def discovery(self) -> Callable[[Site], Iterable[Move]] | None:
        """Return what finds moves for a search that visits few of very many sites.

        A function that is told once of each site that is on in some state, in any order. When it
        was told of all that are on in a state, it has returned every move that is admissible
        there, with the mover that is on; it may have returned others. None where `moves_at` of the
        sites does for that.
        """
        return None

    @abstractmethod
    def action(self, generator: str, at: Site) -> Action:
        """Return the action of the named generator at the given place; InputError if unknown.

        The same object each time, and that of `moves`, as long as so many are remembered (`KEPT`).
        """

    def move_named(self, site: Site, generator: str, at: Site) -> Move | None:
        """Return the move of this generator and place whose mover is a module at `site`.

        None where there is none: that it is no move at all, or nobody's at `site`.
        """
        for move in self.moves_at(site):
            if move.generator == generator and move.at == at:
                return move
        return None

    def moves_of(self, action: Action) -> tuple[Move, ...]:
        """Return the moves that make an action, in either direction, from each mover's site.

        By the site of the mover in canonical order, then by slot. An equal action may be listed
        under several names; where it is none of the system's there is no move.
        """
        return tuple(
            move
            for site in in_order(action.trace & (action.ends[0] | action.ends[1]))
            if self.has_place(self.place_of(site))
            for move in self.moves_at(site)
            if move.action == action
        )

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
    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return a module's own site as `site_size` integers, for observations.

        In a labelled system the label is left out: it is the module's own.
        """

    @abstractmethod
    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the site that `encode_site` made these integers of."""

    @abstractmethod
    def has_place(self, place: Site) -> bool:
        """Tell whether a module could ever stand at `place`."""

    def check_place(self, place: Site) -> None:
        """Raise InputError where no module could ever stand at `place`."""
        if not self.has_place(place):
            raise InputError("an obstacle or no place")

    def modules_among(self, sites: Iterable[Site]) -> tuple[Site, ...]:
        """Return the sites of modules that a file means by these, in their order.

        They are the same, unless a file may say more than where modules are. InputError where
        these cannot be meant.
        """
        return tuple(sites)

    def legal(self, state: AbstractSet[Site]) -> bool:
        """Tell whether the rule for the whole aggregate, if there is one, allows the state."""
        del state
        return True

    def check_state(self, sites: Iterable[Site]) -> None:
        """Raise InputError where modules cannot be at these sites together; Scene checks places."""
        del sites

    @property
    def open(self) -> bool:
        """Tell whether a whole lattice is free: no end of the workspace, and no obstacle."""
        return not (self.bounded or self.filled or self.empty)

    def lines(self) -> Iterable[tuple[Site, Site]]:
        """Return the pairs of places that a picture joins by a line, each once."""
        return ()

    def label_of(self, site: Site) -> int | None:
        """Return the label of a site of a labelled system, None of another."""
        if self.labels is None or not isinstance(site, tuple):
            return None
        return int(site[1])

    def with_labels(self, count: int) -> System:
        """Return the same system with `count` labels, which modules keep; sites get them behind.

        InputError where modules cannot be told apart by labels.
        """
        raise InputError(f"labels for {count} modules: this system has none to give them")

    def with_moves(self, placed: Iterable[tuple[str, Site]]) -> System:
        """Return a system that has the moves of these generators at these places, if it can.

        As far as is known what would be there if nothing were in the way: no obstacle, no end of
        the workspace. InputError where such moves contradict the system.
        """
        del placed
        return self

    def ways(self) -> Ways | None:
        """Return where modules can go by some move, None where that is not known."""
        return None

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        """Return what is known of how many cubes every path between two states has at least.

        The states differ. The proof stands beside the code.
        """
        del start, goal
        return ()

    def potential(self, goal: State) -> Callable[[Site], int] | None:
        """Return how far a site that is on is from the goal, to lead a search; None if not known.

        0 for sites of the goal; the sum over the sites of a state is 0 at the goal alone.
        """
        del goal
        return None

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


_REGION_SIZE = 8
"""Side of a region in cells: some reaches wide, so a module hears from few regions."""


def region_of(coordinates: Iterable[int]) -> str:
    """Return the name of the region of these coordinates, one chunk of a key expression."""
    return ",".join(str(number // _REGION_SIZE) for number in coordinates)


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
        self._check_sites("start", "module starts", self.start)
        self._check_sites("goal", "the goal lies", self.goal or ())
        if not self.system.legal(self.start_state):
            raise InputError(f"{self.spec}: the start breaks the rule for the whole aggregate")
        if self.goal is not None and len(self.goal) != len(self.start):
            raise InputError(
                f"{self.spec}: {len(self.start)} modules start, the goal has {len(self.goal)} sites"
            )
        if self.goals and len(self.goals) != len(self.start):
            raise InputError(
                f"{self.spec}: {len(self.start)} modules, goals for {len(self.goals)} of them"
            )
        self._check_goals()

    def _check_sites(self, name: str, what: str, sites: Collection[Site]) -> None:
        if not sites:
            return
        try:
            self.system.check_state(in_order(sites))
        except InputError as error:
            raise InputError(f"{self.spec}: {name}: {error}") from None
        seen: set[Site] = set()
        for site in sites:
            place = self.system.place_of(site)
            try:
                self.system.check_place(place)
            except InputError as error:
                raise InputError(f"{self.spec}: {what} at {site!r}: {error}") from None
            if place in seen:
                raise InputError(f"{self.spec}: {what} twice at {place!r}")
            seen.add(place)

    def _check_goals(self) -> None:
        labelled = self.system.labels is not None
        owners: dict[Site, int] = {}
        checked: set[int] = set()
        for number, goals in enumerate(self.goals):
            where = f"{self.spec}: goals[{number}]"
            if id(goals) not in checked:  # modules of a chain share one tuple
                checked.add(id(goals))
                self._check_goals_of(where, goals)
            if labelled and len(goals) == 1:
                other = owners.setdefault(goals[0], number)
                if other != number:
                    raise InputError(f"{where}: {goals[0]!r} is the goal of module {other} too")

    def _check_goals_of(self, where: str, goals: Sequence[Site]) -> None:
        labelled = self.system.labels is not None
        seen: set[Site] = set()
        for site in goals:
            try:
                self.system.check_place(site if labelled else self.system.place_of(site))
            except InputError as error:
                more = ", expected a place without a label" if labelled else ""
                raise InputError(f"{where}: {site!r}: {error}{more}") from None
            if site in seen:
                raise InputError(f"{where}: {site!r} stands twice")
            seen.add(site)

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


def local_only(scene: Scene, what: str) -> Scene:
    """Return the scene; InputError where its system is not local, and so has no `what`."""
    if not scene.system.local:
        raise InputError(
            f"{scene.spec}: not a local system (a rule for the whole aggregate decides too), so it"
            f" has no {what}"
        )
    return scene
