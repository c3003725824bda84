"""Systems: the static world of a robot, and scenes: a system with a start and a goal.

For one place, a system says what a module there could do, what it must sense to do so, and which
modules could be in its way, at the cost of the neighbourhood. It does not know where modules are,
so a rule that is given a system gets only the static map.

The class of a system answers every question about it: how it is written and read, how its sites are
drawn, where modules can go, what is known of its paths. No other code asks for a class or a name,
which would work only with today's systems. A system on a graph also has its vertices, edges and
neighbours.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import (
    Callable,
    Collection,
    Hashable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
    Set as AbstractSet,
)
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Catalogue, GeneratorPlacement, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.displays import Displayed


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class VehicleGraph:
    """A graph on which each move takes one vehicle along one edge, between two vertices.

    A system with such a graph promises that its places are the vertices, that the support of a move
    is both ends of its edge (with every label), and that the move is named ``edge`` and placed at
    the two ends in canonical order, followed by the label if vehicles have labels.

    `vertices` are in canonical order, `index` has the number of each, `near` its neighbours in
    canonical order, and `edges` each edge once, in canonical order.

    >>> graph = scene_from_spec("agv:graph=grid3x2,n=2").system.graph
    >>> graph.near[0, 0], len(graph.edges)
    (((0, 1), (1, 0)), 7)
    """

    vertices: tuple[Site, ...]
    index: Mapping[Site, int]
    near: Mapping[Site, tuple[Site, ...]]
    edges: tuple[tuple[Site, Site], ...]


EMPTY, MODULE, FILLED, CLOSED = 0, 1, 2, 3
"""What a sensed place shows: free, a module, an occupied obstacle, or no place for a module."""
KEPT = 1 << 16
"""Number of places whose moves and neighbourhoods are cached."""
FIRST_LABEL = 4
"""A labelled module with label ``i`` shows as ``FIRST_LABEL + i``."""
FAR = 1 << 31
"""Coordinates of places are below this in absolute value, as the integers of observations are."""


class Ways(NamedTuple):
    """Where one move can take a module from a site, whatever other modules stand around.

    >>> ways = scene_from_spec("agv:graph=grid3x2,n=2").system.ways()
    >>> in_order(ways.near((0, 0)))
    ((0, 1), (1, 0))
    """

    near: Callable[[Site], Iterable[Site]]
    """The sites that are one move away from a site, each once."""
    one_to_one: bool
    """Whether every move takes distinct modules to distinct sites."""


def one_to_one(motions: Iterable[Sequence[tuple[Site, Site]]]) -> bool:
    """Return whether each motion takes distinct sites to distinct sites."""
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

    A class of another distribution defines the abstract members, and overrides any others that it
    can answer. The default of each says that nothing is known, and does no harm. A `Family` of
    scenes offers the class, under the entry point group ``cubepath.systems``.
    """

    table: ClassVar[str]
    """The name of the TOML table that systems of this class are written as and read from."""
    filled: frozenset[Site]
    """Obstacles that are on: they count in supports, never move and are never freed."""
    empty: frozenset[Site] = frozenset()
    """Obstacles that are off."""
    drawing: str
    """How places look, as a style of pictures: "hexagons", "squares", "map", "edges", "cubes",
    "dodecahedra", "cube-edges", "chords" or "letters"; with any other, as a graph."""
    places: tuple[Site, ...] = ()
    """The places that a picture shows wherever the modules are: all places of a finite system."""
    positions: Mapping[Site, tuple[float, float]] = MappingProxyType({})
    """Where places, or the points that a chord joins, lie in a picture, y upwards."""
    letters: tuple[str, ...] = ()
    """The letters of a system whose sites are ``(place, letter)``."""
    catalogue: Catalogue | None = None
    """The generators that are placed by translation, if all moves come from such generators: those
    are the moves whose support lies in the `workspace` and whose trace holds no obstacle."""
    workspace: frozenset[Site] | None = None
    """The cells that the supports of a catalogue's moves lie in; None for the whole lattice."""
    graph: VehicleGraph | None = None
    """The graph, if modules are vehicles."""
    bounded: bool = True
    """False if modules can move away without limit: the workspace is a whole lattice."""
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
    dimension: int = 0
    """Length of every answer of `coordinates`; 0 if it is not known where places lie."""
    local = True
    """False if a rule for the whole aggregate also decides (`legal`): such a system has a complex,
    but no environment, no runs and no shortening."""

    descends: bool = False
    """Whether some move lowers the sum of the `potential` from every state but the goal."""

    @abstractmethod
    def to_table(self) -> dict[str, Any]:
        """Return the content of this system's TOML table: plain lists, strings and numbers."""

    @classmethod
    @abstractmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a TOML table; for the table of `to_table`, an equal system.

        Raises InputError, or msgspec's ValidationError, if the table describes no system.
        """

    @abstractmethod
    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves whose mover is a module at `site`; None pads and marks excluded ones.

        Each move takes the modules of its trace one to one to sites of the trace, so none appears
        or disappears.
        """

    def moves_at(self, site: Site) -> Iterable[Move]:
        """Return the moves of `moves` in the same order, without empty slots.

        A system that lists its moves only for runs and environments finds them here without the
        list.
        """
        return (move for move in self.moves(site) if move is not None)

    def discovery(self) -> Callable[[Site], Iterable[Move]] | None:
        """Return a function that finds moves for a search that visits few of very many sites.

        The search calls it once for each site that is on in some state, in any order. Once it was
        called for all the sites that are on in a state, it has returned every move that is
        admissible there, with the mover that is on; it may have returned others. None if calling
        `moves_at` for each site does the same.
        """
        return None

    @abstractmethod
    def action(self, generator: str, at: Site) -> Action:
        """Return the action of the named generator at the given place; InputError if unknown.

        It is the same object each time, and the one in `moves`, while it is cached (`KEPT`).
        """

    def read_action(self, placed: GeneratorPlacement) -> Action:
        """Return the action of a generator and a place; InputError if unknown."""
        return self.action(placed.generator, placed.at)

    def move_named(self, site: Site, generator: str, at: Site) -> Move | None:
        """Return the move of this generator and place whose mover is a module at `site`.

        None if there is no such move, or none whose mover is at `site`.
        """
        for move in self.moves_at(site):
            if move.generator == generator and move.at == at:
                return move
        return None

    def moves_of(self, action: Action) -> tuple[Move, ...]:
        """Return the moves that make an action, in either direction, from each mover's site.

        They are ordered by the site of the mover in canonical order, then by slot. An equal action
        may be listed under several names. An action that is not the system's has no moves.
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
        """Return the places where moves may not commute with those of a module at `place`.

        The places of modules that its moves take along are among them. Claims and notes go there
        and no further.
        """

    def pattern(self, site: Site) -> Hashable | None:
        """Return what the moves of a module at `site` have in common with those elsewhere.

        Where two sites have equal patterns, the moves at them are the same slot by slot, up to the
        places in the corresponding slots of `sensed` and, in a labelled system, up to the label. So
        what was worked out for one of them holds for the others. None if nothing is known.
        """
        del site
        return None

    @abstractmethod
    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return a module's own site as `site_size` integers, for observations.

        In a labelled system the label is left out: it is the module's own.
        """

    @abstractmethod
    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the site that `encode_site` encodes as these integers."""

    @abstractmethod
    def has_place(self, place: Site) -> bool:
        """Return whether a module could ever stand at `place`."""

    def check_place(self, place: Site) -> None:
        """Raise InputError if no module could ever stand at `place`."""
        if not self.has_place(place):
            raise InputError("an obstacle or no place")

    def modules_among(self, sites: Iterable[Site]) -> tuple[Site, ...]:
        """Return the sites of the modules that these sites of a file stand for, in their order.

        They are the same, unless files of the system may list more than modules. Raises InputError
        for sites that stand for no modules.
        """
        return tuple(sites)

    def coordinates(self, place: Site) -> tuple[float, ...]:
        """Return where a place lies, as `dimension` numbers between ``-FAR`` and ``FAR``.

        The unit is about the length of a move, so that differences are of use to a network.
        """
        del place
        return ()

    def legal(self, state: AbstractSet[Site]) -> bool:
        """Return whether the rule for the whole aggregate, if there is one, allows the state."""
        del state
        return True

    def check_state(self, sites: Iterable[Site]) -> None:
        """Raise InputError if modules cannot be at these sites together; Scene checks places."""
        del sites

    @property
    def open(self) -> bool:
        """Return whether the system is a whole lattice without obstacles."""
        return not (self.bounded or self.filled or self.empty)

    def lines(self) -> Iterable[tuple[Site, Site]]:
        """Return the pairs of places that a picture joins by a line, each once."""
        return ()

    def label_of(self, site: Site) -> int | None:
        """Return the label of a site, or None if the system has no labels."""
        if self.labels is None or not isinstance(site, tuple):
            return None
        return int(site[1])

    def with_labels(self, count: int) -> System:
        """Return the same system with `count` labels; modules keep them, sites end with them.

        Raises InputError if labels cannot tell its modules apart.
        """
        raise InputError(f"labels for {count} modules: this system has none to give them")

    def with_moves(self, placed: Iterable[tuple[str, Site]]) -> System:
        """Return a system that has the moves of these generators at these places, if it can.

        As far as it is known, that is the system without obstacles and without an end of the
        workspace. Raises InputError if such moves contradict the system.
        """
        del placed
        return self

    def ways(self) -> Ways | None:
        """Return where modules can go by some move, or None if that is not known."""
        return None

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        """Return known lower bounds on the number of cubes of every path between two states.

        The two states differ. The proof stands beside the code. They are asked for one after
        another, until the time is up or a known path is met. So bounds that take long come last,
        and a generator may yield a bound again, to be stopped there.
        """
        del start, goal
        return ()

    def potential(self, goal: State) -> Callable[[Site], int] | None:
        """Return how far each site that is on is from the goal, to guide a search; None if unknown.

        It is 0 for sites of the goal; its sum over the sites of a state is 0 only at the goal.
        """
        del goal
        return None

    def paths(
        self, start: State, goal: State, *, seed: int, known: Iterable[Action] = ()
    ) -> Iterator[Sequence[Action] | None] | None:
        """Return a search of the system's own for short paths between two states, None if none.

        Each step of the iterator does a bounded piece of work. It yields the moves of a path from
        start to goal in some order in which they can be made, if it has found one that is better
        than all before, and else None. It ends when there is nothing left to try. `known` is a path
        between the two states. What is yielded depends on the arguments alone. It is checked
        before it is used, as every path is, so the search may be as bold as it likes.
        """
        del start, goal, seed, known
        return None

    def prepare_paths(self) -> bool:
        """Do what `paths` needs once for an installation or a process, such as compiling.

        Return whether there is anything of the kind.
        """
        return False

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
"""Side of a region in cells: a few reaches wide, so a module hears from few regions."""


def region_of(coordinates: Iterable[int]) -> str:
    """Return the name of the region of these coordinates, one chunk of a key expression."""
    return ",".join(str(number // _REGION_SIZE) for number in coordinates)


@dataclass(frozen=True, slots=True)
class Scene(Displayed):
    """A system with the start of its modules and, if they have one, their goal.

    `start` lists the site of module 0, 1, ...; `goal` holds the sites that are on at the end, or is
    None; `goals` lists what each module knows of it from the start (for vehicles one vertex, for a
    chain of hexagons all its cells in order). Where there is a `goal`, all of that is in it. `rule`
    is the rule that runs have by default, if it is not that of the family.

    >>> scene = scene_from_spec("hex:n=3")
    >>> scene.start, sorted(scene.goal), scene.modules
    (((0, 0), (1, 0), (2, 0)), [(2, 0), (2, 1), (2, 2)], ('module_0', 'module_1', 'module_2'))
    """

    spec: str
    family: str
    system: System
    start: tuple[Site, ...]
    goal: frozenset[Site] | None = None
    goals: tuple[tuple[Site, ...], ...] = field(default=())
    rule: str = ""

    def __post_init__(self) -> None:
        """Check that modules start on distinct free places and that the goal is possible."""
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
        self._check_together(f"{self.spec}: {name}", sites)
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
        # If every module knows one site, that is where it is to end; the same for each vehicle
        # with a label. Otherwise modules may share what they know, and places with letters stay.
        single = not self.system.letters and all(len(goals) == 1 for goals in self.goals)
        own = labelled or single
        # Where sites have letters, a place alone stands for its site of the goal.
        wanted = set(self.goal or ())
        if self.system.letters:
            wanted.update(map(self.system.place_of, self.goal or ()))
        owners: dict[Site, int] = {}
        checked: set[int] = set()
        for number, goals in enumerate(self.goals):
            where = f"{self.spec}: goals[{number}]"
            first = id(goals) not in checked  # modules of a chain share one tuple
            if first:
                checked.add(id(goals))
                self._check_goals_of(where, goals)
            if own and len(goals) == 1:
                place = goals[0] if labelled else self.system.place_of(goals[0])
                other = owners.setdefault(place, number)
                if other != number:
                    raise InputError(f"{where}: {goals[0]!r} is the goal of module {other} too")
            if self.goal is not None and (first or labelled):
                self._check_in_goal(where, number, wanted)
            elif self.goal is None and first and not own and len(goals) == len(self.start):
                self._check_together(where, goals)
        if self.goal is None and single and self.goals and not labelled:
            self._check_together(f"{self.spec}: goals", [goals[0] for goals in self.goals])

    def _check_in_goal(self, where: str, number: int, wanted: AbstractSet[Site]) -> None:
        label = self.system.label_of(self.start[number])
        for known in self.goals[number]:
            site = known if label is None else (known, label)
            if site not in wanted:
                raise InputError(f"{where}: {site!r} is no site of the goal")

    def _check_together(self, where: str, sites: Collection[Site]) -> None:
        try:
            self.system.check_state(in_order(sites))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

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

    def can_begin(self) -> bool:
        """Return whether any module can move at the start."""
        state = self.start_state
        moves = (move for site in self.start for move in self.system.moves_at(site))
        return any(move.possible(state) for move in moves)

    def reached(self, sites: Iterable[Site]) -> bool:
        """Return whether modules at these sites are at the goal; False if there is none."""
        return self.goal is not None and frozenset(sites) == self.goal


def local_only(scene: Scene, what: str) -> Scene:
    """Return the scene; InputError if its system is not local, and so has no `what`."""
    if not scene.system.local:
        raise InputError(
            f"{scene.spec}: not a local system (a rule for the whole aggregate decides too), so it"
            f" has no {what}"
        )
    return scene
