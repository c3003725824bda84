"""Whether modules can move away for ever, so that a scene has infinitely many states."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, product

from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene

_STEPS_MAX = 30_000
"""The bound on the steps of the search, which takes at most a second."""
_STATES_MAX = 500
"""The bound on the states that are searched for one path."""
_FIRST = (0, 2, 4)
"""The numbers of vectors after which the modules may be clear of the others."""


@dataclass(frozen=True, slots=True)
class EndlessMotion:
    """Some modules, and the number of moves that shift all of them by a vector of the lattice."""

    modules: tuple[Site, ...]
    by: Cell
    moves: int


def wandering(scene: Scene) -> EndlessMotion | None:
    """Return modules of the start that can move away for ever, None if none are found.

    Proof. The workspace is a whole lattice without obstacles, so a path that is possible in one
    place is possible in every other. Without other modules, these have a path that shifts their
    places by one vector. From the start, a second path shifts them by some multiple of the vector
    while all others stay where they are. From there on, no site that the first path reads, shifted
    by any further multiple, is the place of another module. So the first path can be repeated for
    ever, and no state occurs twice. Costs a bounded number of steps; None proves nothing.
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
    """Yield single modules, all, and pairs that sense each other, fewest neighbours first."""
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
    """A search for a walk of some modules by multiples of a vector."""

    steps: Transitions
    lattice: Lattice
    start: State
    modules: tuple[Site, ...]
    by: Cell

    def _moved(self, sites: Iterable[Site], times: int) -> frozenset[Site]:
        lattice, vector = self.lattice, tuple(times * each for each in self.by)
        return frozenset(lattice.shift(lattice.check(site), vector) for site in sites)

    def _path(self, times: int, others: State) -> list[Action] | None:
        """Return moves that shift the modules; modules already at their ends, and others, stay."""
        steps, ends = self.steps, (frozenset(self.modules), self._moved(self.modules, times))
        still = steps.encode(others | (ends[0] & ends[1]))
        before, after = (steps.encode(end | others) for end in ends)
        found = optimum(steps, before, after, max_states=_STATES_MAX, still=still).cubes
        if found is None:
            return None
        return [steps.actions[number] for cube in found for number in cube]

    def found(self) -> EndlessMotion | None:
        """Return the walk if it can be repeated for ever, else None."""
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
                return EndlessMotion(self.modules, self.by, len(alone))
        return None


def _width(sites: Iterable[Site], by: Cell) -> int:
    """Return how many shifts by a vector take all of these sites clear of where they were."""
    axis = next(place for place, each in enumerate(by) if each)
    along = [int(site[axis]) for site in sites if isinstance(site, tuple)]
    return max(along) - min(along) + 1
