"""Rounds cut off a plan of vehicles, and the plan repaired: a conflict optimizer.

The last rounds of a plan are cut off. Vehicles that then do not arrive are planned anew, through
others if need be; those are thrown out and wait to be planned in turn. Passing through a vehicle
costs the more, the more often that vehicle was planned before, so that the ones that are hard to
place keep their routes in the end, and the others find ways round them. Once nobody waits, the plan
has fewer rounds, and the search continues from there.

A *draft* is a plan of a fixed number of rounds in which some vehicles have no route yet; those that
have one are in nobody's way. Being at a vertex after round t holds it in the rounds t and
t + 1, so two vehicles are in conflict if they are at one vertex at times that differ by one at
most. Every vehicle waits at its start at time 0 and at its goal at the end, routed or not; so
nobody else may be at a start at time 1, or at a goal one round before the end.

Sources: Crombez, da Fonseca, Gerard, Gonzalez-Lorenzo, Lafourcade and Libralesso, *Shadoks approach
to low-makespan coordinated motion planning* (2021); Crombez, da Fonseca, Fontan, Gerard,
Gonzalez-Lorenzo, Lafourcade, Libralesso, Momège, Spalding-Jamieson, Zhang and Zheng, *Conflict
optimization for binary CSP applied to minimum partition into plane subgraphs and graph coloring*
(2023), for weights that grow with the square of the count, and for noise. Here vehicles wait in no
order, any of them is next, which was found by trial to be better than a queue; several rounds are
cut at a time as long as that succeeds; and vehicles without labels that wait may exchange goals.
"""

from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.search.space_time_routes import FREE, Numbers, distances
from cubepath.protocol.compiled import compiled, inner

Places = NDArray[np.uint32]
"""Numbers that only tell where in an array to look: unsigned, these are looked up faster."""
NEVER = 2**30
"""The cost of what is not possible; every other cost is less."""
MOVE = 4
"""The cost of a move: who moves holds two vertices in a round, and so is more in the way."""
CONFLICT = 16
"""The cost of a conflict with a vehicle that was never planned before."""
_NOISE = 30
"""By how much in a hundred weights vary at random, up and down."""
_OFTEN = 128
"""Once a vehicle was planned this often, the counts of all are halved: weights stay bounded."""
_FEW = 3
"""With fewer that wait than this when counts are halved, the repair seems to go in a circle."""
_LONGER = 8
"""One exchange of goals in this many is made although it makes ways longer."""


class Draft(NamedTuple):
    """A plan under repair, for n vehicles on v vertices in T rounds; the first five arrays stay."""

    near: Numbers
    """Neighbours of each vertex, shape (v, most neighbours), padded by `FREE`."""
    starts: Numbers
    """The vertex where each vehicle starts, shape (n,)."""
    ends: Numbers
    """The vertex of each goal, shape (n,)."""
    since: Numbers
    """How far each vertex is from each start, shape (n, v)."""
    away: Numbers
    """How far each vertex is from each goal, shape (n, v)."""
    goals: Numbers
    """The number of each vehicle's goal, shape (n,)."""
    plan: Numbers
    """The vertex of each vehicle after each round, shape (n, T + 1)."""
    at: Numbers
    """The routed vehicle at each vertex after each round, shape (T + 1, v), or `FREE`."""
    price: Numbers
    """The sum of the weights of those in conflict with being there then, shape (T + 1, v)."""
    weights: Numbers
    """The weight with which each vehicle is entered in `price`, 0 without a route, shape (n,)."""
    counts: Numbers
    """How often each vehicle was planned, shape (n,)."""
    waiting: Numbers
    """The vehicles without a route, in no order, shape (n,)."""
    state: Numbers
    """The number of vehicles without a route, and the random number: shape (2,)."""


@inner
def draw(state: Numbers) -> int:
    """Return the next random number, of 31 bits (xorshift: Marsaglia 2003)."""
    drawn = int(state[1]) & 0xFFFFFFFF
    drawn ^= (drawn << 13) & 0xFFFFFFFF
    drawn ^= drawn >> 17
    drawn ^= (drawn << 5) & 0xFFFFFFFF
    state[1] = drawn if drawn < 0x80000000 else drawn - 0x100000000
    return drawn >> 1


@inner
def enter(draft: Draft, vehicle: int, weight: int) -> None:
    """Enter the route of a vehicle with a weight; with a negative one, take it out again."""
    row, at, price = draft.plan[vehicle], draft.at, draft.price
    last = len(row) - 1
    mark = vehicle if weight > 0 else FREE
    time = 0
    while time <= last:
        place = row[time]
        first = time
        while time <= last and row[time] == place:
            at[time, place] = mark
            time += 1
        for when in range(max(0, first - 1), min(last, time) + 1):
            price[when, place] += weight
    draft.weights[vehicle] = max(weight, 0)


@inner
def throw_out(draft: Draft, vehicle: int) -> None:
    """Let a vehicle wait to be planned, without its route if it has one."""
    if draft.weights[vehicle] > 0:
        enter(draft, vehicle, -draft.weights[vehicle])
    draft.waiting[draft.state[0]] = vehicle
    draft.state[0] += 1


@inner
def weight_of(draft: Draft, vehicle: int) -> int:
    """Return the weight of a vehicle: one more than the square of its count, and some noise."""
    count = int(draft.counts[vehicle])
    weight = CONFLICT * (1 + count * count)
    return weight + weight * (draw(draft.state) % (2 * _NOISE + 1) - _NOISE) // 100


@inner
def _forget(draft: Draft) -> None:
    """Halve the counts of all vehicles.

    Where next to nobody waits, two vehicles may throw each other out for ever, as the others were
    entered with great weights long ago; then all weights are made anew.
    """
    for vehicle in range(len(draft.counts)):
        draft.counts[vehicle] //= 2
        weight = draft.weights[vehicle]
        if weight > 0 and draft.state[0] < _FEW:
            enter(draft, vehicle, -weight)
            enter(draft, vehicle, weight_of(draft, vehicle))


@inner
def conflicts(draft: Draft, vehicle: int, found: Numbers) -> int:
    """List the routed vehicles in conflict with a vehicle's row, once each; return their number."""
    row, at = draft.plan[vehicle], draft.at
    last = len(row) - 1
    count = 0
    for time in range(last + 1):
        place = row[time]
        if draft.price[time, place] == 0:
            continue
        for when in range(max(0, time - 1), min(last, time + 1) + 1):
            other = at[when, place]
            if other == FREE:
                continue
            known = other == vehicle
            for number in range(count):
                if found[number] == other:
                    known = True
                    break
            if not known:
                found[count] = other
                count += 1
    return count


@compiled
def load(draft: Draft) -> None:
    """Enter each row of the plan that is a route and in nobody's way; let the others wait.

    Vehicles are entered in random order.
    """
    plan, near = draft.plan, draft.near
    vehicles, width = plan.shape
    draft.at[:] = FREE
    draft.price[:] = 0
    draft.weights[:] = 0
    draft.state[0] = 0
    order = np.arange(vehicles)
    for number in range(vehicles - 1, 0, -1):
        other = draw(draft.state) % (number + 1)
        order[number], order[other] = order[other], order[number]
    found = np.empty(vehicles, dtype=np.int32)
    for number in range(vehicles):
        vehicle = int(order[number])
        row = plan[vehicle]
        good = (
            row[0] == draft.starts[vehicle] and row[width - 1] == draft.ends[draft.goals[vehicle]]
        )
        for time in range(1, width):
            if not good:
                break
            if row[time] != row[time - 1]:
                good = False
                for there in near[row[time - 1]]:
                    if there == row[time]:
                        good = True
        if good and conflicts(draft, vehicle, found) == 0:
            enter(draft, vehicle, weight_of(draft, vehicle))
        else:
            throw_out(draft, vehicle)


class RouteWindow(NamedTuple):
    """Room for the search of a route, and which vertices are held at either end of the plan."""

    costs: Numbers
    """The least cost to be at each listed vertex after each round, shape (T + 1, v + 1)."""
    listed: Places
    """The vertices that may be passed, shape (v,)."""
    number: Numbers
    """The place of each vertex in the list, or `FREE`, shape (v,)."""
    near: Places
    """Neighbours by places in the list, shape (v, most neighbours), padded by its length."""
    first: Numbers
    """The first time at which a vehicle can be at each listed vertex, shape (v,)."""
    final: Numbers
    """The last time from which it still gets from there to its goal, shape (v,)."""
    starting: Numbers
    """The vehicle that starts at each vertex, or `FREE`, shape (v,)."""
    ending: Numbers
    """The vehicle that ends at each vertex, or `FREE`, shape (v,)."""


@inner
def _open(draft: Draft, window: RouteWindow, vehicle: int) -> int:
    """List the vertices that a vehicle can pass on its way, and when; return their number."""
    since, away = draft.since[vehicle], draft.away[draft.goals[vehicle]]
    last = draft.plan.shape[1] - 1
    vertices, degree = draft.near.shape
    size = 0
    for vertex in range(vertices):
        window.number[vertex] = FREE
        if since[vertex] == FREE or away[vertex] == FREE or since[vertex] + away[vertex] > last:
            continue
        window.listed[size] = vertex
        window.number[vertex] = size
        # Where another starts, one can be from time 2 on, and where it ends, until T - 2.
        alone = window.starting[vertex] == FREE or window.starting[vertex] == vehicle
        window.first[size] = since[vertex] if alone else max(2, since[vertex])
        alone = window.ending[vertex] == FREE or window.ending[vertex] == vehicle
        window.final[size] = last - (away[vertex] if alone else max(2, away[vertex]))
        size += 1
    for place in range(size):
        for side in range(degree):
            there = draft.near[window.listed[place], side]
            if there != FREE:
                there = window.number[there]
            window.near[place, side] = size if there == FREE else there
    return size


@inner
def _spread(draft: Draft, window: RouteWindow, time: int, size: int) -> None:
    """Fill in the costs at a time from those one round before."""
    before, now, price = window.costs[time - 1], window.costs[time], draft.price[time]
    near, first, final, listed = window.near, window.first, window.final, window.listed
    degree = near.shape[1]
    now[size] = NEVER
    for place in range(size):
        if time < first[place] or time > final[place]:
            now[place] = NEVER
            continue
        best = before[place] - MOVE
        for side in range(degree):
            best = min(best, before[near[place, side]])
        now[place] = min(best + MOVE + price[listed[place]], NEVER)


@compiled
def route(draft: Draft, window: RouteWindow, vehicle: int) -> int:
    """Write a cheapest route into the row of a vehicle; return its cost, or `NEVER` if none is.

    A route costs `MOVE` for each move, and `price` for each vertex and time where it is after the
    start. Dynamic programming over rounds, and over the vertices that are near enough to both ends.
    """
    last = draft.plan.shape[1] - 1
    degree = draft.near.shape[1]
    start, goal = draft.starts[vehicle], draft.ends[draft.goals[vehicle]]
    size = _open(draft, window, vehicle)
    listed, near, costs = window.listed, window.near, window.costs
    if size == 0:
        return NEVER
    costs[0, : size + 1] = NEVER
    costs[0, window.number[start]] = 0
    for time in range(1, last + 1):
        _spread(draft, window, time, size)
    place = window.number[goal]
    total = costs[last, place]
    if total == NEVER:
        return NEVER
    row = draft.plan[vehicle]
    row[last] = goal
    for time in range(last, 0, -1):
        least = costs[time, place] - draft.price[time, listed[place]]
        turn = draw(draft.state)
        for choice in range(degree + 1):
            side = (choice + turn) % (degree + 1)
            before = place if side == degree else near[place, side]
            if costs[time - 1, before] + (0 if side == degree else MOVE) == least:
                place = before
                break
        row[time - 1] = listed[place]
    return int(total)


@inner
def exchange(draft: Draft, window: RouteWindow, one: int, other: int) -> None:
    """Let two vehicles without routes exchange goals, if both ways then fit into the rounds.

    Mostly only if the ways do not become longer together.
    """
    goals, away, last = draft.goals, draft.away, draft.plan.shape[1] - 1
    start, beginning = draft.starts[one], draft.starts[other]
    new, renewed = away[goals[other], start], away[goals[one], beginning]
    if min(new, renewed) == FREE or max(new, renewed) > last:
        return
    old = away[goals[one], start] + away[goals[other], beginning]
    if new + renewed > old and draw(draft.state) % _LONGER > 0:
        return
    goals[one], goals[other] = goals[other], goals[one]
    window.ending[draft.ends[goals[one]]] = one
    window.ending[draft.ends[goals[other]]] = other


@compiled
def repair(draft: Draft, window: RouteWindow, tries: int, *, exchanged: bool) -> bool:
    """Plan waiting vehicles through all others, which they throw out, at most `tries` times.

    With `exchanged`, vehicles that wait may exchange goals. Return whether all have a route.
    """
    state, waiting, counts = draft.state, draft.waiting, draft.counts
    vehicles = len(waiting)
    found = np.empty(vehicles, dtype=np.int32)
    for _ in range(tries):
        if state[0] == 0:
            break
        pick = draw(state) % state[0]
        vehicle = int(waiting[pick])
        state[0] -= 1
        waiting[pick] = waiting[state[0]]
        if exchanged and state[0] > 0:
            exchange(draft, window, vehicle, int(waiting[draw(state) % state[0]]))
        counts[vehicle] += 1
        if counts[vehicle] >= _OFTEN:
            _forget(draft)
        if route(draft, window, vehicle) == NEVER:
            throw_out(draft, vehicle)
            continue
        for number in range(conflicts(draft, vehicle, found)):
            throw_out(draft, found[number])
        enter(draft, vehicle, weight_of(draft, vehicle))
    return bool(state[0] == 0)


_TRIES = 100_000
"""A repair is given up after this many routes, and begun again from what the plan is by then."""
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
            distances(near, int(start), self._since[vehicle])
        self._draft: Draft | None = None
        self._window: RouteWindow | None = None
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
        if repair(draft, window, tries, exchanged=self._exchanged):
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
    ) -> tuple[Draft, RouteWindow] | None:
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
        draft = Draft(
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
        window = RouteWindow(
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
        load(draft)
        return draft, window


def prepare() -> None:
    """Compile everything here, or load what was compiled, so that no timed search waits for it."""
    near = np.array([[1], [0]], dtype=np.int32)
    # One vehicle on two vertices, there after the second round instead of the first.
    away = np.array([[1, 0]], dtype=np.int32)
    ends = VehicleEnds(np.array([1], dtype=np.int32), away)
    optimizer = ConflictOptimizer(near, np.zeros(1, dtype=np.int32), exchanged=False)
    optimizer.step(np.array([[0, 0, 1]], dtype=np.int32), ends, Random(0))  # noqa: S311 - no secret
