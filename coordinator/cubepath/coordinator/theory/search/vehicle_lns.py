"""Vehicles planned anew, a few at a time: large neighbourhood search for plans of vehicles.

Sources: Li, Chen, Harabor, Stuckey and Koenig, *Anytime multi-agent path finding via large
neighborhood search* (2021), for the scheme, the choice of neighbourhoods and their adaptive
weights; Ropke and Pisinger (2006) for adaptive weights; Silver, *Cooperative pathfinding* (2005),
for planning one vehicle after another in space and time; Ma and Koenig (2016) for the exchange of
targets among vehicles without labels. Two things differ from these sources: a vehicle may not enter
a vertex that another leaves in the same round, and there are neighbourhoods along a chain of moves
that wait for each other, since such a chain determines the last round. Half of the steps, which
take most of the time, are those of a `conflict_optimizer`, which gets rid of rounds; neighbourhoods
smooth what it leaves, and give it other plans to begin with.
"""

from collections.abc import Iterable, Sequence
from random import Random

import numpy as np

from cubepath.coordinator.theory.search import conflict_optimizer, space_time_routes as routes
from cubepath.coordinator.theory.search.conflict_optimizer import ConflictOptimizer, VehicleEnds
from cubepath.coordinator.theory.search.space_time_routes import FREE, Numbers
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System, VehicleGraph

CELLS_MAX = 10_000_000
"""The bound on vertices times rounds, and on vertices times vehicles, kept in memory."""
_FORGET = 0.9
"""The share of a neighbourhood's weight that comes from its earlier worth."""
_BY_WAY, _BY_ARRIVAL = 0.4, 0.3
"""How often the vehicles with the longest way, or those that arrive last, are planned first."""
REPAIRS = 0.5
"""The share of steps that repair a plan cut short, which take most of the time."""
_LEAST = 0.1
"""The worth of a neighbourhood that found nothing; it is positive, so that each is tried again."""

Cost = tuple[int, int, int]
"""Rounds, the sum of the fourth powers of the arrivals, and moves: less is better.

The powers penalise late arrivals. The exponent was found by trial: 1 and 2 are slower.
"""


class Replanner:
    """A plan of vehicles on a graph that gets better step by step.

    Vehicles start and end where they do in the given cube path. With `labelled_goals`, or labels,
    each keeps its own end; otherwise vehicles may exchange ends. The cost never rises.
    """

    def __init__(
        self,
        system: System,
        graph: VehicleGraph,
        start: State,
        cubes: Sequence[Sequence[Action]],
        *,
        labelled_goals: bool,
    ) -> None:
        """Follow the vehicles through the cube path, which must be legal (not checked)."""
        self._system = system
        self._graph = graph
        self._labelled_goals = labelled_goals or system.labels is not None
        self._labels: list[int | None] = []
        degree = max(len(graph.near[vertex]) for vertex in graph.vertices)
        self._near = np.full((len(graph.vertices), degree), FREE, dtype=np.int32)
        for number, vertex in enumerate(graph.vertices):
            around = [graph.index[other] for other in graph.near[vertex]]
            self._near[number, : len(around)] = around
        self._plan = self._followed(start, cubes)
        self._ends = self._plan[:, -1].copy()
        self._away = np.empty((len(self._plan), len(self._near)), dtype=np.int32)
        for number, end in enumerate(self._ends):
            routes.distances(self._near, int(end), self._away[number])
        self._conflicts = ConflictOptimizer(
            self._near, self._plan[:, 0].copy(), exchanged=not self._labelled_goals
        )
        self._weights = [1.0] * 4
        self._choices = (self._chain, self._held_up, self._around, self._any)
        self._settled()
        self.cost = self._cost()

    @staticmethod
    def fits(graph: VehicleGraph, vehicles: int, cubes: int) -> bool:
        """Return whether a plan on this graph can be kept in memory."""
        return len(graph.vertices) * max(vehicles, cubes + 1) <= CELLS_MAX

    def _followed(self, start: State, cubes: Sequence[Sequence[Action]]) -> Numbers:
        system, index = self._system, self._graph.index
        modules = in_order(start)
        at: dict[Site, int] = {site: number for number, site in enumerate(modules)}
        if system.labels is not None:
            self._labels = [system.label_of(site) for site in modules]
        plan = np.empty((len(modules), len(cubes) + 1), dtype=np.int32)
        plan[:, 0] = [index[system.place_of(site)] for site in modules]
        for after, cube in enumerate(cubes, 1):
            plan[:, after] = plan[:, after - 1]
            for action in cube:
                one, other = in_order(action.trace)
                here, there = (one, other) if one in at else (other, one)
                number = at[there] = at.pop(here)
                plan[number, after] = index[system.place_of(there)]
        return plan

    def _settled(self) -> None:
        """Let all moves fall, and derive everything else from the plan again."""
        rounds = routes.settle(self._plan, len(self._near))
        self._plan = np.ascontiguousarray(self._plan[:, : rounds + 1])
        self._held = np.full((rounds + 1, len(self._near)), FREE, dtype=np.int32)
        for vehicle in range(len(self._plan)):
            routes.hold(self._plan, vehicle, self._held, vehicle)
        self._arrivals = [routes.arrival(row) for row in self._plan]

    @property
    def rounds(self) -> int:
        """Return the number of rounds of the plan, which is its number of cubes."""
        return int(self._plan.shape[1]) - 1

    def _cost(self) -> Cost:
        moves = int(np.count_nonzero(self._plan[:, 1:] != self._plan[:, :-1]))
        return self.rounds, sum(when**4 for when in self._arrivals), moves

    def actions(self) -> list[Action]:
        """Return the moves of the plan, round by round."""
        found: list[Action] = []
        known: dict[tuple[int, int, int | None], Action] = {}
        vertices, edge = self._graph.vertices, self._system.action
        rows = self._plan.tolist()
        for after in range(1, self.rounds + 1):
            for vehicle, row in enumerate(rows):
                here, there = sorted(row[after - 1 : after + 1])
                if here == there:
                    continue
                label = self._labels[vehicle] if self._labels else None
                key = here, there, label
                if key not in known:
                    ends = (vertices[here], vertices[there])
                    known[key] = edge("edge", ends if label is None else (*ends, label))
                found.append(known[key])
        return found

    def step(self, random: Random) -> bool:
        """Plan one neighbourhood anew, or repair; return whether the plan now costs less."""
        if self.rounds == 0:
            return False
        if random.random() < REPAIRS:
            return self.repair(random)
        which = random.choices(range(len(self._choices)), self._weights)[0]
        size = min(len(self._plan), random.choice((1, 2, 3, 4, 6, 8, 12, 16)))
        vehicles = list(dict.fromkeys(self._choices[which](random, size)))[:size]
        better = bool(vehicles) and self._replanned(random, vehicles)
        worth = 1.0 if better else _LEAST
        self._weights[which] = _FORGET * self._weights[which] + (1 - _FORGET) * worth
        return better

    @property
    def routes(self) -> int:
        """Return the number of routes that the last repair planned."""
        return self._conflicts.routes

    def repair(self, random: Random) -> bool:
        """Go on repairing a plan cut short; return whether it is whole, with fewer rounds."""
        found = self._conflicts.step(self._plan, VehicleEnds(self._ends, self._away), random)
        if found is None:
            return False
        self._plan = found.plan
        self._ends, self._away = self._ends[found.goals], self._away[found.goals]
        self._settled()
        self.cost = self._cost()
        return True

    def _replanned(self, random: Random, vehicles: list[int]) -> bool:
        random.shuffle(vehicles)
        order = random.random()
        if order < _BY_WAY:
            vehicles.sort(key=lambda vehicle: -int(self._away[vehicle, self._plan[vehicle, 0]]))
        elif order < _BY_WAY + _BY_ARRIVAL:
            vehicles.sort(key=lambda vehicle: -self._arrivals[vehicle])
        goals = list(vehicles) if self._labelled_goals else self._exchanged(random, vehicles)
        # Vehicles that arrive in the last round must now arrive earlier.
        latest = [
            self.rounds - (1 if self._arrivals[vehicle] == self.rounds else 0)
            for vehicle in vehicles
        ]
        kept, arrivals, held = self._plan.copy(), self._arrivals, self._held
        ends, away = self._ends, self._away
        world = routes.RoutingWorld(self._near, held, ends, away)
        jobs = np.array(list(zip(vehicles, goals, latest, strict=True)), dtype=np.int32)
        if not routes.reroute(world, self._plan, jobs, random.randrange(1 << 30)):
            return False
        if goals != vehicles:
            self._ends, self._away = self._ends.copy(), self._away.copy()
            self._ends[vehicles], self._away[vehicles] = ends[goals], away[goals]
        self._settled()
        cost = self._cost()
        if cost <= self.cost:
            better = cost < self.cost
            self.cost = cost
            return better
        self._plan, self._arrivals, self._held = kept, arrivals, held
        self._ends, self._away = ends, away
        # The restored plan is settled, but `held` was changed in place.
        self._held[:] = FREE
        for vehicle in range(len(self._plan)):
            routes.hold(self._plan, vehicle, self._held, vehicle)
        return False

    def _exchanged(self, random: Random, vehicles: list[int]) -> list[int]:
        """Return for each of the vehicles the vehicle whose end it takes over."""
        left = list(vehicles)
        if random.random() < 0.3:
            random.shuffle(left)
            return left
        found: list[int] = []
        for vehicle in vehicles:
            place = self._plan[vehicle, 0]
            goal = min(left, key=lambda end: (self._away[end, place], random.random()))
            left.remove(goal)
            found.append(goal)
        return found

    def _last(self, random: Random) -> int:
        return random.choice(
            [vehicle for vehicle, when in enumerate(self._arrivals) if when == self.rounds]
        )

    def _chain(self, random: Random, size: int) -> Iterable[int]:
        """Return the vehicles on a chain of moves, each of which waits for the one before it."""
        vehicle = self._last(random)
        after = self.rounds
        found = [vehicle]
        while after > 1:
            here, there = self._plan[vehicle, after - 1], self._plan[vehicle, after]
            after -= 1
            vehicles = [
                int(other)
                for other in (self._held[after, here], self._held[after, there])
                if other != FREE and self._plan[other, after] != self._plan[other, after - 1]
            ]
            if not vehicles:
                break
            vehicle = random.choice(vehicles)
            found.append(vehicle)
        found = list(dict.fromkeys(found))
        if len(found) > size:
            first = random.randrange(len(found) - size + 1)
            return found[first : first + size]
        return found

    def _held_up(self, random: Random, size: int) -> Iterable[int]:
        """Return a vehicle that arrives late, and those that stand on one of its shortest ways."""
        late = [
            when - int(self._away[vehicle, self._plan[vehicle, 0]]) + 1
            for vehicle, when in enumerate(self._arrivals)
        ]
        first = random.choices(range(len(late)), late)[0]
        found: set[int] = set()
        after = random.randrange(self.rounds)
        place = int(self._plan[first, after])
        while self._away[first, place] > 0 and after < self.rounds:
            after += 1
            nearer = [
                int(there)
                for there in self._near[place]
                if there != FREE and self._away[first, there] < self._away[first, place]
            ]
            place = random.choice(nearer)
            for holder in (self._held[after, place], self._held[max(1, after - 1), place]):
                if holder not in (FREE, first):
                    found.add(int(holder))
        return [first, *random.sample(sorted(found), k=min(size - 1, len(found)))]

    def _around(self, random: Random, size: int) -> Iterable[int]:
        """Return vehicles that pass near one place at about the same time."""
        after = random.randrange(1, self.rounds + 1)
        place = int(self._plan[random.randrange(len(self._plan)), after])
        seen, queue = {place}, [place]
        found: dict[int, None] = {}
        for here in queue:
            for when in range(max(1, after - 3), min(self.rounds, after + 3) + 1):
                if self._held[when, here] != FREE:
                    found[int(self._held[when, here])] = None
            if len(found) >= size or len(seen) > 200:
                break
            for there in self._near[here]:
                if there != FREE and int(there) not in seen:
                    seen.add(int(there))
                    queue.append(int(there))
        return found

    def _any(self, random: Random, size: int) -> Iterable[int]:
        """Return a vehicle that arrives last, and random others."""
        return [self._last(random), *random.sample(range(len(self._plan)), k=size)]


def prepare() -> None:
    """Compile what the search for vehicles uses, or load it, so that no timed search waits."""
    routes.prepare()
    conflict_optimizer.prepare()
