"""What holds for all runs in a scene: a lower bound, the optimum, distances to the goal.

Effort is bounded by counts and never by time, so the results are the same everywhere. A process
computes each once.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.environments.rollouts import play_in_python
from cubepath.agents.rules.registry import own_rule, rule_named
from cubepath.coordinator.experiments.instances import Change
from cubepath.coordinator.experiments.setting import scene_hash
from cubepath.coordinator.theory.search import transitions
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import lower_bound
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.specs import scene_from_spec

_BOUND_STEPS = 300_000
"""What a lower bound may take: a step is a site met on the way of a module."""
_WAY_ROUNDS = 1000
"""In how many rounds a rule must reach the goal for a search to go out from its path."""
_DISTANCE_STEPS = 200_000
"""For how many sites it may be asked where a module can go from there, to measure distances."""


class _BoundedWays(transitions.ReachableSites):
    """The ways of modules, from a bounded number of sites."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self._budget = Budget(steps=_DISTANCE_STEPS)

    def near(self, site: Site) -> tuple[Site, ...]:
        self._budget.spend()
        return super().near(site)


@dataclass(slots=True)
class ComputedSceneFacts:
    """What is known of a scene.

    `optimum` is the least number of cubes from start to goal, None if it is not known, `at_least`
    what a search for it has proved, and `best_found` the cubes of the best path that was found.
    """

    scene: Scene
    at_least: int | None
    optimum: int | None
    best_found: int | None
    missing: int | None
    """How many sites of the goal are off at the start; None if there is no goal."""
    distance: int | None
    """How far the start is from the goal; None if that is not known.

    It is the sum over all modules of how many moves each is from the nearest site of the goal,
    whatever else stands there, or what the system itself says (for triangulations, how many edges
    cross). It is 0 at the goal alone, and so is `missing`."""
    hashed: str
    """A hash of what the scene holds."""
    _potential: transitions.Potential | None
    _steps: transitions.Transitions
    _bounds: dict[int, int] = field(default_factory=dict)
    _measured: dict[Change, tuple[int, int]] = field(default_factory=dict)

    def bound(self, cubes: int | None) -> int | None:
        """Return a lower bound on cubes from start to goal; None if there is none.

        `cubes` are those of a path to the goal, if one is known, whose length bounds the search for
        the ways of modules. It is rounded up, so that few bounds are asked for in a scene; if the
        search may take what it needs, the bound is the same for all of them.
        """
        if cubes is None or self.scene.goal is None:
            return self.at_least
        within = 1 << max(cubes - 1, 0).bit_length()
        if within not in self._bounds:
            system, start = self.scene.system, self.scene.start_state
            goal, budget = self.scene.goal | system.filled, Budget(steps=_BOUND_STEPS)
            found = lower_bound(system, start, goal, within=within, budget=budget)
            self._bounds[within] = max(found.cubes, self.at_least or 0)
        return self._bounds[within]

    def measures(self, changes: Iterable[Change]) -> NDArray[np.int64]:
        """Return how much each change of sites changes `missing` and `distance`, shape (2, n)."""
        found = [self._measured.get(each) or self._measure(each) for each in changes]
        return np.array(found, np.int64).reshape(len(found), 2).T

    def _measure(self, change: Change) -> tuple[int, int]:
        off, on = change
        goal, potential, steps = self.scene.goal or frozenset(), self._potential, self._steps
        nearer = 0
        if potential is not None:
            nearer = potential.of(steps.encode(on)) - potential.of(steps.encode(off))
        found = self._measured[change] = len(off & goal) - len(on & goal), nearer
        return found

    def blocked(self, sites: Sequence[Site]) -> bool:
        """Return whether no move at all is admissible with the modules at these sites."""
        state = frozenset(sites) | self.scene.system.filled
        system = self.scene.system
        return not any(move.possible(state) for site in sites for move in system.moves_at(site))


@lru_cache(maxsize=32)
def facts_of(system: str, max_states: int = 0, iterations: int = 0) -> ComputedSceneFacts:
    """Return what is known of a scene by name.

    `max_states` bounds a search for the optimum, `iterations` one for a path with few cubes; there
    is none if it is 0.
    """
    scene = scene_from_spec(system)
    steps, hashed = transitions.Transitions(scene.system), scene_hash(scene)
    if scene.goal is None:
        return ComputedSceneFacts(scene, None, None, None, None, None, hashed, None, steps)
    start, goal = scene.start_state, scene.goal | scene.system.filled
    potential, best, at_least = None, None, None
    with suppress(SpentError, CubepathError):
        ends = steps.encode(start), steps.encode(goal)
        potential = transitions.Potential(steps, *ends, _BoundedWays(scene.system))
    if max_states and transitions.maskable(scene.system):
        search = transitions.Transitions(scene.system)
        ends = search.encode(start), search.encode(goal)
        found = optimum(search, *ends, max_states=max_states)
        at_least = found.at_least
        best = None if found.cubes is None else len(found.cubes)
    found_best = best
    if iterations and best is None:
        found_best = _best_found(scene, iterations)
    missing = len(scene.goal - scene.start_state)
    distance = None if potential is None else potential.of(potential.start)
    return ComputedSceneFacts(
        scene, at_least, best, found_best, missing, distance, hashed, potential, steps
    )


def _best_found(scene: Scene, iterations: int) -> int | None:
    """Return the cubes of the best path of a search of this many steps; None without a path.

    It goes out from what the rule of the family does with seed 0, whatever rules are compared, and
    the search has seed 0 too: so the value is one of the scene.
    """
    rule = rule_named(own_rule(scene), scene.system)
    run = play_in_python(scene, rule, seed=0, hesitate=0.0, max_rounds=_WAY_ROUNDS)
    if not run.reached:
        return None
    return improve(run.path, scene.start_state, scene.system, iterations=iterations).cubes
