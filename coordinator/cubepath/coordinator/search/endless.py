"""Whether modules can wander off for ever, so that a scene has states without end.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, product

from cubepath.coordinator.search.budget import Budget, SpentError
from cubepath.coordinator.search.exact import optimum
from cubepath.coordinator.search.transitions import Transitions
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene

_STEPS_MAX = 30_000
"""Steps of the search: it takes a second at most."""
_STATES_MAX = 500
"""So many states of a few modules are looked at for one path."""
_FIRST = (0, 2, 4)
"""After so many vectors they may be clear of the others."""


@dataclass(frozen=True, slots=True)
class Wandering:
    """Some modules, and how many moves take all of them on by a vector of the lattice."""

    modules: tuple[Site, ...]
    by: Cell
    moves: int


def wandering(scene: Scene) -> Wandering | None:
    """Return modules of the start that can wander off for ever, None where none were found.

    Why they can. The workspace is a whole lattice without obstacles, so what can be done in one
    place can be done in every other. Alone in the world, the modules have a path that takes each of
    their places on by one vector. From the start they come, with all others at rest, some multiples
    of it further; from there on none of the sites that the path reads, moved on by any more
    multiples, is the place of another module. So the path can be repeated without end, and no state
    comes twice. Costs a bounded number of steps; where nothing is found nothing is known.
    """
    catalogue = scene.system.catalogue
    if catalogue is None or not (scene.system.open and scene.system.local):
        return None
    steps = Transitions(scene.system, budget=Budget(steps=_STEPS_MAX))
    try:
        for modules in _some(scene):
            for by in _vectors(catalogue.lattice.dimension):
                found = _Walk(steps, catalogue.lattice, scene.start_state, modules, by).found()
                if found is not None:
                    return found
    except SpentError:
        pass
    return None


def _some(scene: Scene) -> Iterator[tuple[Site, ...]]:
    """Yield single modules, all, and pairs that see each other, of few neighbours first."""
    start = in_order(scene.start)
    near = {site: set(scene.system.sensed(site)) & set(start) for site in start}
    yield from ((site,) for site in start)
    pairs = [(one, other) for one, other in combinations(start, 2) if other in near[one]]
    yield start
    yield from sorted(pairs, key=lambda pair: len(near[pair[0]] | near[pair[1]]))


def _vectors(dimension: int) -> Iterator[Cell]:
    """Yield the shortest vectors of a lattice, those along one axis first."""
    found = [by for by in product((1, 0, -1), repeat=dimension) if any(by)]
    yield from sorted(found, key=lambda by: sum(map(abs, by)))


@dataclass(frozen=True, slots=True)
class _Walk:
    """The question whether some modules can walk off by multiples of a vector."""

    steps: Transitions
    lattice: Lattice
    start: State
    modules: tuple[Site, ...]
    by: Cell

    def _moved(self, sites: Iterable[Site], times: int) -> frozenset[Site]:
        lattice, vector = self.lattice, tuple(times * each for each in self.by)
        return frozenset(lattice.shift(lattice.check(site), vector) for site in sites)

    def _path(self, times: int, others: State) -> list[Action] | None:
        """Return moves that take the modules on; what is not to be moved, and others, rest."""
        steps, ends = self.steps, (frozenset(self.modules), self._moved(self.modules, times))
        still = steps.encode(others | (ends[0] & ends[1]))
        before, after = (steps.encode(end | others) for end in ends)
        found = optimum(steps, before, after, max_states=_STATES_MAX, still=still).cubes
        if found is None:
            return None
        return [steps.actions[number] for cube in found for number in cube]

    def found(self) -> Wandering | None:
        alone = self._path(1, frozenset())
        if alone is None:
            return None
        read = {site for action in alone for site in action.support}
        others = self.start - frozenset(self.modules)
        last = _width(read | others, self.by)
        for first in _FIRST:
            clear = all(
                others.isdisjoint(self._moved(read, times)) for times in range(first, first + last)
            )
            if clear and (first == 0 or self._path(first, others) is not None):
                return Wandering(self.modules, self.by, len(alone))
        return None


def _width(sites: Iterable[Site], by: Cell) -> int:
    """Return how often sites must be moved on to be clear of where they were."""
    axis = next(place for place, each in enumerate(by) if each)
    along = [int(site[axis]) for site in sites if isinstance(site, tuple)]
    return max(along) - min(along) + 1
