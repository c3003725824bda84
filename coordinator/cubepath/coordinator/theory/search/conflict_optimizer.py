"""Rounds cut off a plan of vehicles, and the plan repaired: a conflict optimizer.

The last rounds of a plan are cut off. Vehicles that then do not arrive are planned anew, through
others if need be; those are thrown out and wait to be planned in turn. Passing through a vehicle
costs the more, the more often that vehicle was planned before, so that the ones that are hard to
place keep their routes in the end, and the others find ways round them. Once nobody waits, the plan
has fewer rounds, and it goes on from there.

Sources: Crombez, da Fonseca, Gerard, Gonzalez-Lorenzo, Lafourcade and Libralesso, *Shadoks approach
to low-makespan coordinated motion planning* (2021); Crombez, da Fonseca, Fontan, Gerard,
Gonzalez-Lorenzo, Lafourcade, Libralesso, Momège, Spalding-Jamieson, Zhang and Zheng, *Conflict
optimization for binary CSP applied to minimum partition into plane subgraphs and graph coloring*
(2023), for weights that grow with the square of the count, and for noise. Here vehicles wait in no
order, any of them is next, which was found by trial to be better than a queue; several rounds are
cut at a time as long as that succeeds; and vehicles without labels that wait may exchange goals.
"""

from __future__ import annotations

from random import Random
from typing import NamedTuple

import numpy as np

from cubepath.coordinator.theory.search import (
    conflict_kernel as kernel,
    space_time_routes as routes,
)
from cubepath.coordinator.theory.search.space_time_routes import FREE, Numbers

_TRIES = 100_000
"""A repair is given up after so many routes, and begun again from what the plan is by then."""
_QUICK = 20
"""Routes per vehicle within which a cut of several rounds must be repaired."""
_WORK = 1_000_000
"""About how many vertices and times one step looks at."""
_TRIES_A_STEP = 32
"""The most routes planned in a step."""


class VehicleEnds(NamedTuple):
    """Where vehicles go: each to the goal of its number."""

    places: Numbers
    """The vertex of each goal, shape (vehicles,)."""
    away: Numbers
    """How far each vertex is from each goal, shape (vehicles, vertices)."""


class RepairedPlan(NamedTuple):
    """A plan with fewer rounds: routes, shape (vehicles, rounds + 1), and each vehicle's goal."""

    plan: Numbers
    goals: Numbers


class ConflictOptimizer:
    """Cuts rounds off the plans that it is given, one after another, and repairs them.

    Vehicles start at `starts`, an array of vertices; with `exchanged` they may exchange goals.
    `near` has the neighbours of each vertex, shape (vertices, most neighbours), padded by `FREE`.
    """

    def __init__(self, near: Numbers, starts: Numbers, *, exchanged: bool) -> None:
        """Compute how far every vertex is from every start."""
        self._near = near
        self._starts = starts
        self._exchanged = exchanged
        self._since = np.empty((len(starts), len(near)), dtype=np.int32)
        for vehicle, start in enumerate(starts):
            routes.distances(near, int(start), self._since[vehicle])
        self._draft: kernel.Draft | None = None
        self._window: kernel.RouteWindow | None = None
        self._tries = 0
        self._cut = 1
        self._given_up = 0
        self.routes = 0
        """The most routes that the last step may have planned; 0 if there was nothing to cut."""

    def step(self, plan: Numbers, ends: VehicleEnds, random: Random) -> RepairedPlan | None:
        """Plan some routes; return a legal plan with fewer rounds than `plan` once there is one.

        What was begun with an earlier plan is continued while it aims at fewer rounds than `plan`
        has. Vehicles must keep their starts.
        """
        rounds = plan.shape[1] - 1
        self.routes = 0
        draft, window = self._draft, self._window
        if draft is None or window is None or draft.plan.shape[1] > rounds:
            begun = self._begun(plan, ends, random)
            if begun is None:
                return None
            self._draft, self._window = draft, window = begun
            self._tries = 0
        vertices, last = len(self._near), draft.plan.shape[1] - 1
        tries = max(1, min(_TRIES_A_STEP, _WORK // (vertices * last)))
        self._tries += tries
        self.routes = tries
        quick = _QUICK * len(self._starts)
        if kernel.repair(draft, window, tries, exchanged=self._exchanged):
            self._draft = None
            if self._tries <= quick:
                self._cut *= 2
            return RepairedPlan(draft.plan, draft.goals)
        if self._tries >= (_TRIES if self._cut == 1 else quick):
            self._draft = None
            self._given_up += 1
            self._cut = max(1, self._cut // 2)
        return None

    def _begun(
        self, plan: Numbers, ends: VehicleEnds, random: Random
    ) -> tuple[kernel.Draft, kernel.RouteWindow] | None:
        """Return a draft of fewer rounds, or None if some way is too long for that."""
        vehicles, width = plan.shape
        vertices, degree = self._near.shape
        longest = int(ends.away[np.arange(vehicles), self._starts].max(initial=0))
        self._cut = min(self._cut, width - 1 - longest)
        if self._cut < 1:
            self._cut = 1
            return None
        shorter = plan[:, : width - self._cut]
        if self._cut == 1 and self._given_up % 2:
            # Another beginning: any round is left out, and what does not fit any more is repaired.
            shorter = np.delete(plan, random.randrange(1, width - 1), axis=1)
        width = shorter.shape[1]
        goals = np.arange(vehicles, dtype=np.int32)
        draft = kernel.Draft(
            near=self._near,
            starts=self._starts,
            ends=ends.places,
            since=self._since,
            away=ends.away,
            goals=goals,
            plan=np.array(shorter, dtype=np.int32, order="C"),
            at=np.empty((width, vertices), dtype=np.int32),
            price=np.empty((width, vertices), dtype=np.int32),
            weights=np.empty(vehicles, dtype=np.int32),
            counts=np.zeros(vehicles, dtype=np.int32),
            waiting=np.empty(vehicles, dtype=np.int32),
            state=np.array([0, random.randrange(1, 1 << 31)], dtype=np.int32),
        )
        window = kernel.RouteWindow(
            costs=np.empty((width, vertices + 1), dtype=np.int32),
            listed=np.empty(vertices, dtype=np.uint32),
            number=np.empty(vertices, dtype=np.int32),
            near=np.empty((vertices, degree), dtype=np.uint32),
            first=np.empty(vertices, dtype=np.int32),
            final=np.empty(vertices, dtype=np.int32),
            starting=np.full(vertices, FREE, dtype=np.int32),
            ending=np.full(vertices, FREE, dtype=np.int32),
        )
        window.starting[self._starts] = goals
        window.ending[ends.places] = goals
        kernel.load(draft)
        return draft, window


def prepare() -> None:
    """Compile everything here, or load what was compiled, so that no timed search waits for it."""
    near = np.array([[1], [0]], dtype=np.int32)
    # One vehicle on two vertices, there after the second round instead of the first.
    away = np.array([[1, 0]], dtype=np.int32)
    ends = VehicleEnds(np.array([1], dtype=np.int32), away)
    optimizer = ConflictOptimizer(near, np.zeros(1, dtype=np.int32), exchanged=False)
    optimizer.step(np.array([[0, 0, 1]], dtype=np.int32), ends, Random(0))  # noqa: S311 - no secret
