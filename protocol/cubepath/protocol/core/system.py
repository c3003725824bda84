"""Systems: the static world of a robot, and scenes: a system with a start and a goal.

A system answers, for one place, what a module there could do, what it must see for that, and
who could be in its way; the cost is that of the neighbourhood. It knows nothing of where modules
are, so that handing a system to a rule hands it no more than the static map.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order

EMPTY, MODULE, FILLED, CLOSED = 0, 1, 2, 3
"""What a sensed place shows: free, a module, an occupied obstacle, or no place for a module."""
KEPT = 1 << 16
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

    def legal(self, state: AbstractSet[Site]) -> bool:
        """Tell whether the rule for the whole aggregate, if there is one, allows the state."""
        del state
        return True

    def check_state(self, sites: Iterable[Site]) -> None:
        """Raise InputError where modules cannot be at these sites together; Scene checks places."""
        del sites

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
            if not self.system.has_place(place):
                raise InputError(f"{self.spec}: {what} at {site!r}: an obstacle or no place")
            if place in seen:
                raise InputError(f"{self.spec}: {what} twice at {place!r}")
            seen.add(place)

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
