"""How far one state seems to be from another: a number per site, summed over the sites that are on.

Such a sum guides a search, and affects only how soon the search finds something. The sum is 0 at
the goal alone, and the trace of a move determines how the move changes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cubepath.coordinator.theory.search.lower_bounds import potential_of, ways_of
from cubepath.coordinator.theory.search.transitions import Transitions, bits_of
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

_MARGIN = 2
"""Sites farther than all modules of the start by more than this need no exact distance."""


class ReachableSites:
    """The sites that a module can move to from each site; the system is asked once for each."""

    def __init__(self, system: System | None) -> None:
        """Ask the system."""
        found = None if system is None else ways_of(system)
        self._near = None if found is None else found.near
        self._known: dict[Site, tuple[Site, ...]] = {}

    @property
    def known(self) -> bool:
        """Return whether the system says where modules can go."""
        return self._near is not None

    def near(self, site: Site) -> tuple[Site, ...]:
        """Return the sites that are one step away."""
        found = self._known.get(site)
        if found is None and self._near is not None:
            found = self._known[site] = tuple(self._near(site))
        return found or ()


class Potential:
    """The potential of the sites towards a goal, and what each move changes.

    It is the potential of the system itself. If the system has none, it is the distance to the
    nearest site of the goal along the ways of modules; if these are not known, 1 off the goal.
    """

    def __init__(
        self, steps: Transitions, start: int, goal: int, ways: ReachableSites | None = None
    ) -> None:
        """Measure the sites as far as the modules of `start`, and a little beyond."""
        self.start, self.goal = start, goal
        self._steps = steps
        self._of_bit: dict[int, int] = {}
        self._changes: dict[int, tuple[int, int]] = {}
        self._at = _measure(
            steps, start, goal, ReachableSites(steps.system) if ways is None else ways
        )

    def of(self, state: int) -> int:
        """Return the sum over the sites that are on."""
        return sum(map(self._bit, bits_of(state)))

    def _bit(self, bit: int) -> int:
        found = self._of_bit.get(bit)
        if found is None:
            found = self._of_bit[bit] = self._at(self._steps.sites[bit])
        return found

    def change(self, number: int, state: int) -> int:
        """Return how much a move that is admissible at the state changes the sum."""
        known = self._changes.get(number)
        toggle = self._steps.toggle[number]
        before = toggle & state
        if known is None:
            change = self.of(toggle ^ before) - self.of(before)
            self._changes[number] = before, change
            return change
        return known[1] if known[0] == before else -known[1]


def _measure(
    steps: Transitions, start: int, goal: int, ways: ReachableSites
) -> Callable[[Site], int]:
    goals = steps.decode(goal)
    system = steps.system
    said = None if system is None else potential_of(system, goals)
    if said is not None:
        return said
    if not ways.known:
        return lambda site: int(site not in goals)
    known = dict.fromkeys(goals, 0)
    waiting = set(steps.decode(start)) - goals
    layer: Iterable[Site] = list(known)
    distance = beyond = 0
    while layer and beyond <= _MARGIN:
        distance += 1
        following: dict[Site, None] = {}
        for here in layer:
            for there in ways.near(here):
                if there not in known:
                    known[there] = distance
                    following[there] = None
        waiting -= following.keys()
        beyond += not waiting
        layer = following
    return lambda site: known.get(site, distance + 1)
