"""Routes of vehicles through space and time, in compiled code: the core of `vehicle_lns`.

A plan gives the vertex of every vehicle after each round. In round t a vehicle holds the vertices
where it is before and after the round, and no other vehicle holds either. For moves along edges
this is the same as commuting, so a plan is a cube path, and any cube path of vehicles is a plan.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled

Numbers = NDArray[np.int32]

FREE = -1
"""No vehicle holds the vertex, there is no further neighbour, or there is no way."""


@compiled
def distances(near: Numbers, goal: int, found: Numbers) -> None:
    """Fill in how far each vertex is from `goal`, `FREE` if there is no way.

    `near` has shape (vertices, most neighbours), padded by `FREE`; `found` shape (vertices,).
    """
    found[:] = FREE
    queue = np.empty(len(near), dtype=np.int32)
    queue[0] = goal
    found[goal] = 0
    head, tail = 0, 1
    while head < tail:
        here = queue[head]
        head += 1
        for there in near[here]:
            if there == FREE:
                break
            if found[there] == FREE:
                found[there] = found[here] + 1
                queue[tail] = there
                tail += 1


@compiled
def settle(plan: Numbers, vertices: int) -> int:
    """Make every move of a plan as early as possible; return the round of the last move.

    `plan` has shape (vehicles, rounds + 1) and is changed in place. Each move falls onto the last
    move that holds one of its two vertices, as in a heap of pieces; nothing is cancelled.
    """
    count, width = plan.shape
    last = np.zeros(vertices, dtype=np.int32)
    place = plan[:, 0].copy()
    filled = np.zeros(count, dtype=np.int32)
    most = 0
    for after in range(1, width):
        for vehicle in range(count):
            here, there = place[vehicle], plan[vehicle, after]
            if here == there:
                continue
            level = max(last[here], last[there]) + 1
            last[here] = last[there] = level
            most = max(most, level)
            # Up to its last move the row is final, since the levels of a vehicle rise.
            for between in range(filled[vehicle] + 1, level):
                plan[vehicle, between] = here
            plan[vehicle, level] = there
            filled[vehicle] = level
            place[vehicle] = there
    for vehicle in range(count):
        for between in range(filled[vehicle] + 1, width):
            plan[vehicle, between] = place[vehicle]
    return int(most)


@compiled
def hold(plan: Numbers, vehicle: int, held: Numbers, mark: int) -> None:
    """Write `mark` wherever a vehicle holds a vertex; `held` has shape (rounds + 1, vertices)."""
    for after in range(1, plan.shape[1]):
        held[after, plan[vehicle, after - 1]] = mark
        held[after, plan[vehicle, after]] = mark


@compiled
def arrival(row: Numbers) -> int:
    """Return the round of the last move of a vehicle."""
    at = len(row) - 1
    while at > 0 and row[at] == row[at - 1]:
        at -= 1
    return int(at)


class RoutingWorld(NamedTuple):
    """The world that routes are planned in; vertices and goals are numbers."""

    near: Numbers
    """Neighbours of each vertex, shape (vertices, most neighbours), padded by `FREE`."""
    held: Numbers
    """Which vehicle holds a vertex in a round, shape (rounds + 1, vertices), or `FREE`."""
    ends: Numbers
    """The vertex of each goal."""
    away: Numbers
    """How far each vertex is from each goal, shape (goals, vertices)."""


class _Ways(NamedTuple):
    """The fewest moves to be at each vertex after each round, and the vertex before it."""

    moves: Numbers
    came: Numbers


_NEVER = 2**30


@compiled
def _spread(
    world: RoutingWorld, ways: _Ways, away: Numbers, at: tuple[int, int, int, int], reached: Numbers
) -> int:
    """Extend routes from a vertex by a round; return the number of newly reached vertices.

    `at` holds the vertex, the round, how far the goal may be after it, and a random number.
    """
    here, after, within, turn = at
    moves, came = ways.moves[after], ways.came[after]
    cost = ways.moves[after - 1, here]
    width = world.near.shape[1]
    new = 0
    for choice in range(width + 1):
        there = here if choice == width else world.near[here, (choice + turn) % width]
        if there == FREE or away[there] > within or world.held[after, there] != FREE:
            continue
        price = cost if choice == width else cost + 1
        if moves[there] == _NEVER:
            reached[new] = there
            new += 1
        if price < moves[there] or (price == moves[there] and (turn >> 4) & 1):
            moves[there] = price
            came[there] = here
    return new


@compiled
def route(world: RoutingWorld, goal: int, latest: int, turn: int, row: Numbers) -> int:
    """Fill in a route that arrives first, with the fewest moves among those; return its arrival.

    `row[0]` is where the vehicle is, `goal` the number of its goal. The vehicle must be there after
    round `latest` at the latest, and stay. Dynamic programming over rounds and vertices; `turn` is
    a random number that breaks ties. Return `FREE` if there is no such route, and leave the row
    unchanged.
    """
    vertices = len(world.near)
    start, end, away = row[0], world.ends[goal], world.away[goal]
    if away[start] == FREE or away[start] > latest:
        return FREE
    # From this round on no other vehicle holds the goal.
    free_from = len(world.held) - 1
    while free_from > 0 and world.held[free_from, end] == FREE:
        free_from -= 1
    ways = _Ways(
        np.full((latest + 1, vertices), _NEVER, dtype=np.int32),
        np.full((latest + 1, vertices), FREE, dtype=np.int32),
    )
    ways.moves[0, start] = 0
    layer = np.empty(vertices, dtype=np.int32)
    following = np.empty(vertices, dtype=np.int32)
    layer[0] = start
    size, after = 1, 0
    while size and after < latest and (after < free_from or ways.moves[after, end] == _NEVER):
        after += 1
        reached = 0
        for here in layer[:size]:
            turn = (turn * 1103515245 + 12345) & 0x7FFFFFFF
            if world.held[after, here] == FREE:
                at = (here, after, latest - after, turn >> 8)
                reached += _spread(world, ways, away, at, following[reached:])
        layer, following = following, layer
        size = reached
    if after < free_from or ways.moves[after, end] == _NEVER:
        return FREE
    row[after:] = end
    for back in range(after, 0, -1):
        row[back - 1] = ways.came[back, row[back]]
    return int(after)


@compiled
def reroute(world: RoutingWorld, plan: Numbers, jobs: Numbers, turn: int) -> bool:
    """Plan some vehicles anew, one after another, with all others unchanged.

    `jobs` has a row for each vehicle: its number, the number of its goal, and its latest arrival.
    Return whether all got a route; if not, nothing changes. Prioritised planning: Erdmann and
    Lozano-Perez (1987), Silver (2005).
    """
    held = world.held
    kept = plan[jobs[:, 0]].copy()
    for vehicle in jobs[:, 0]:
        hold(plan, vehicle, held, FREE)
    # In the first round each vehicle still holds the vertex where it starts.
    for vehicle in jobs[:, 0]:
        held[1, plan[vehicle, 0]] = vehicle
    done = 0
    for number in range(len(jobs)):
        vehicle, goal, latest = jobs[number]
        held[1, plan[vehicle, 0]] = FREE
        if route(world, goal, latest, turn + number, plan[vehicle]) == FREE:
            break
        hold(plan, vehicle, held, vehicle)
        done += 1
    if done == len(jobs):
        return True
    for number in range(done):
        hold(plan, jobs[number, 0], held, FREE)
    for number in range(len(jobs)):
        held[1, kept[number, 0]] = FREE
    for number in range(len(jobs)):
        plan[jobs[number, 0]] = kept[number]
        hold(plan, jobs[number, 0], held, jobs[number, 0])
    return False


def prepare() -> None:
    """Compile everything here, or load what was compiled, so that no timed search waits for it."""
    near = np.array([[1], [0]], dtype=np.int32)
    plan, away = np.zeros((1, 2), dtype=np.int32), np.zeros((1, 2), dtype=np.int32)
    held, ends = np.full((2, 2), FREE, dtype=np.int32), np.zeros(1, dtype=np.int32)
    distances(near, 0, away[0])
    settle(plan, 2)
    hold(plan, 0, held, 0)
    arrival(plan[0])
    reroute(RoutingWorld(near, held, ends, away), plan, np.array([[0, 0, 1]], dtype=np.int32), 0)
