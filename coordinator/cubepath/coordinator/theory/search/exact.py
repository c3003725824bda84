"""The least number of cubes between two states over all homotopy classes, by exhaustive search.

Breadth first from both ends, a round at a time, where a round is any non-empty set of commuting
moves. Maximal sets alone are not enough: a vehicle that is already at its goal, with a free place
beside it, would have to leave in the first round. Single moves alone would minimise something else.

By short such paths it is also found whether modules can move away for ever.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.supports import TRACE, Supports

MAX_STATES = 100_000
"""The default bound on the number of states."""
_BITS_MAX = 1 << 31
"""The bound on the size of all states together, in bits."""

_Parents = dict[int, tuple[int, tuple[int, ...]]]


@dataclass(frozen=True, slots=True)
class Optimum:
    """The result of an exhaustive search: no path has fewer cubes than `at_least`.

    `cubes` is a shortest cube path, each cube as the numbers of its moves in `Transitions`, or None
    if a bound stopped the search first. Then only `at_least` is known. `states` is the number of
    states that were found.
    """

    at_least: int
    cubes: tuple[tuple[int, ...], ...] | None
    states: int


def optimum(
    steps: Transitions,
    start: int,
    goal: int,
    *,
    max_states: int = MAX_STATES,
    most: int | None = None,
    still: int = 0,
) -> Optimum:
    """Return a cube path from `start` to `goal` with the fewest cubes, if the bounds allow it.

    Why no path has fewer. After `a` rounds from the start and `b` from the goal, all states within
    these distances are known, and none is known from both sides, so no path has a + b cubes or
    fewer. The first state that the next round finds on the other side gives a path of a + b + 1.

    The search ends as soon as all paths are known to have more than `most` cubes. It keeps at most
    about `max_states` states, and fewer if they are large; a round of the search is either
    completed or does not count. Looking at one set of moves is a step of the budget of `steps`;
    the search stops when the budget is spent.
    Sites of `still` are not written, so paths are those of the other modules alone.
    If the goal cannot be reached at all, one side runs out of states, and the answer is the same as
    if the search was stopped.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> moves = Transitions(scene.system)
    >>> found = optimum(moves, moves.encode(scene.start_state), moves.encode(scene.goal))
    >>> len(found.cubes), found.at_least
    (3, 3)
    """
    if start == goal:
        return Optimum(0, (), 1)
    sides: tuple[_Parents, _Parents] = ({start: (start, ())}, {goal: (goal, ())})
    fronts = [[start], [goal]]
    depth = 0
    while fronts[0] and fronts[1]:
        if most is not None and depth >= most:
            break
        side = 0 if len(fronts[0]) <= len(fronts[1]) else 1
        known = len(sides[0]) + len(sides[1])
        room = min(max_states, _BITS_MAX // max(1, len(steps.sites))) - known
        try:
            met = _round(steps, fronts, sides, side, (room, still))
        except SpentError:
            break
        if met is not None and met >= 0:
            path = _joined(sides, met)
            return Optimum(len(path), path, len(sides[0]) + len(sides[1]))
        if met is None:
            break
        depth += 1
    return Optimum(depth + 1, None, len(sides[0]) + len(sides[1]))


def too_wide(cube: NDArray[np.int32], supports: Supports, max_states: int) -> bool:
    """Return whether `optimum` is sure to give up before its first round, without asking it.

    `cube` holds actions, rows of `supports`, that commute and are admissible at the start; no other
    actions exist than these rows.

    Proof. `optimum` takes commuting moves at the start until no more commutes with them, so each of
    `cube` is taken, or does not commute with one that is: writes what that one needs, or needs what
    it writes. As moves of a cube write disjoint sites, at a site that an action reads it meets one
    of them at most, and at a site that it writes those that need the site. If no action meets more
    than `most` in all its sites, then at least ``len(cube) / most`` moves are taken. It gives up if
    these have more subsets than there is room for.
    """
    (starts, sites, says), places = supports.rows[:3], supports.entries(cube)
    writes = says[places] & TRACE != 0
    needed = np.bincount(sites[places], minlength=len(supports.sites))
    written = np.bincount(sites[places[writes]], minlength=len(supports.sites))
    meets = np.where(says & TRACE != 0, needed[sites], written[sites])
    most = int(np.add.reduceat(meets, starts[:-1]).max())
    return -(-len(cube) // most) > max_states.bit_length()


_NOT_MET = -1


def _round(
    steps: Transitions,
    fronts: list[list[int]],
    sides: tuple[_Parents, _Parents],
    side: int,
    limits: tuple[int, int],
) -> int | None:
    """Advance one side by a round.

    `limits` is the number of states that there is room for, and the sites that stay still. Return
    the state where it meets the other side, `_NOT_MET`, or None if the room is used up.
    """
    room, still = limits
    mine, other = sides[side], sides[1 - side]
    found: list[int] = []
    for state in fronts[side]:
        widest = len(steps.greedy(steps.possible(state, still)))
        # All subsets of a commuting set lead to different states: too many, so do not begin.
        if 1 << widest > room + len(mine):
            return None
        for there, cube in steps.cubes(state, still):
            steps.budget.spend()
            if there in mine:
                continue
            mine[there] = state, cube
            if there in other:
                return there
            found.append(there)
            if len(found) > room:
                return None
    fronts[side] = found
    return _NOT_MET


def _joined(sides: tuple[_Parents, _Parents], met: int) -> tuple[tuple[int, ...], ...]:
    ahead: list[tuple[int, ...]] = []
    state = met
    while sides[0][state][1]:
        state, cube = sides[0][state]
        ahead.append(cube)
    behind: list[tuple[int, ...]] = []
    state = met
    while sides[1][state][1]:
        state, cube = sides[1][state]
        behind.append(cube)
    return (*reversed(ahead), *behind)


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
