"""How far a module is from its goal, for rules that let it come nearer.

That is the potential of the system, if it has one. Otherwise it is the number of moves from a site
to the nearest site of the goal along the ways of the system, whatever stands on the way.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cache, lru_cache, partial
from typing import TypeAlias

from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

SEARCHED_MAX = 1 << 16
"""A site counts as without a way to a goal if it is not among this many sites around the goal."""

Distance: TypeAlias = Callable[[Site], int | None]
"""How far a site is; None or less than 0 if there is no way."""


class SiteDistances:
    """Distances from one site along the ways of a system, searched only as far as they are asked.

    >>> distances = SiteDistances(scene_from_spec("hex:n=3").system, (0, 0))
    >>> distances.of((3, -1))
    3
    """

    def __init__(self, system: System, origin: Site) -> None:
        """Begin the search at `origin`."""
        ways = system.ways()
        self._near: Callable[[Site], Iterable[Site]] = (lambda _: ()) if ways is None else ways.near
        self._found = {origin: 0}
        self._rim = [origin]
        self._radius = 0

    def of(self, site: Site) -> int | None:
        """Return the distance of a site; None if no way is found."""
        while site not in self._found and self._rim and len(self._found) < SEARCHED_MAX:
            self._radius += 1
            near = dict.fromkeys(there for here in self._rim for there in self._near(here))
            self._rim = [there for there in near if there not in self._found]
            self._found.update(dict.fromkeys(self._rim, self._radius))
        return self._found.get(site)


class _Measures:
    """The distances that the modules of a process share."""

    def __init__(self, system: System) -> None:
        self._system = system
        self.whole = cache(self._whole)
        self.to = cache(self._to)
        blocked = system.filled or system.empty
        self._around = cache(partial(SiteDistances, system if blocked else system.with_moves(())))

    def _whole(self, goals: tuple[Site, ...]) -> Distance | None:
        potential = self._system.potential(frozenset(goals))
        return None if potential is None else cache(potential)

    def _to(self, goal: Site) -> Distance:
        system = self._system
        if system.graph is not None:
            index = system.graph.index
            steps = roads_of(system.graph).distances(index[system.place_of(goal)])
            return lambda site: steps[index[system.place_of(site)]]
        if system.catalogue is None or system.filled or system.empty:
            return self._around(goal).of
        # Without obstacles one search serves all goals of an orbit, also in a box: the box may
        # have a million cells, and a thousand goals.
        lattice, cell = system.catalogue.lattice, system.catalogue.lattice.check(goal)
        search = self._around(system.catalogue.orbit(cell))
        back = tuple(-along for along in cell[: lattice.dimension])
        return lambda site: search.of(lattice.shift(lattice.check(site), back))


_measures = lru_cache(maxsize=8)(_Measures)


class OwnPotential:
    """How far a module's sites are from the goals that it knows, of which it needs one.

    >>> from cubepath.agents.local.random_streams import RandomStream
    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> known = InitialKnowledge(scene.system, 0, 2, (0, 0), ((2, 1),), RandomStream(1))
    >>> OwnPotential(known).of((0, 0))
    3
    """

    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Take what a module knows from the start."""
        system, label = knowledge.system, knowledge.label
        goals = [goal if label is None else (goal, label) for goal in knowledge.goals]
        measures = _measures(system)
        whole = measures.whole(tuple(goals))
        self.goals: Sequence[tuple[Site | None, Distance]] = (
            [(system.place_of(goal), measures.to(goal)) for goal in goals]
            if whole is None
            else [(None, whole)]
        )
        """The place of each goal, and how far sites are from it; None for all of them together."""

    def of(self, site: Site, taken: Collection[Site] = ()) -> int:
        """Return how far a site is from the nearest goal; 0 if there is no way to any.

        Goals at the places that are `taken` do not count, unless all are.
        """
        free = [far for place, far in self.goals if place not in taken]
        found = [far(site) for far in free or [far for _, far in self.goals]]
        return min((each for each in found if each is not None and each >= 0), default=0)
