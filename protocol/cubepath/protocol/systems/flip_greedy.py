"""Greedy rounds of flips from one triangulation to another, on triangulations in arrays.

Edges have numbers that they keep when they flip. All arithmetic is on 64-bit integers, which the
span of the coordinates keeps exact (`PointSet.exact`).

Each round is a set of flips of which no two have a triangle in common. Those that reduce the
crossings with the goal most are chosen first. Any random choice breaks ties or blurs the order, so
that several tries differ. After a try the edges of the goal that came last get a greater weight,
and their crossings count more in the next one.

Sources: Hanke, Ottmann and Schuierer, *The edge-flipping distance of triangulations* (1996); the
path heuristic of da Fonseca, Feschet and Gerard, *Shadoks approach to parallel reconfiguration of
triangulations* (CG:SHOP 2026); squeaky wheels, Joslin and Clements (1999).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner

Numbers = NDArray[np.int64]
Floats = NDArray[np.float64]

NONE = -1
"""There is no triangle on this side of an edge, so no apex and no sides."""


class Mesh(NamedTuple):
    """A triangulation: for each edge its ends, the apexes of its triangles and their sides.

    Edge e goes from ``ends[e, 0]`` = a to ``ends[e, 1]`` = b; ``apex[e, 0]`` = c lies left of it
    and ``apex[e, 1]`` = d right. The row ``side[e]`` holds the numbers of the edges bc, ca, ad, db.
    """

    xy: Numbers
    """Coordinates, shape (points, 2)."""
    ends: Numbers
    """Shape (edges, 2)."""
    apex: Numbers
    """Shape (edges, 2), `NONE` outside the hull."""
    side: Numbers
    """Shape (edges, 4), `NONE` outside the hull."""
    spoke: Numbers
    """An edge that ends at each point, shape (points,); kept up to date where nothing flips."""


@inner
def turn(xy: Numbers, one: int, other: int, third: int) -> int:
    """Return twice the signed area of a triangle of points, positive where it turns left."""
    ax, ay = xy[one, 0], xy[one, 1]
    return int(
        (xy[other, 0] - ax) * (xy[third, 1] - ay) - (xy[other, 1] - ay) * (xy[third, 0] - ax)
    )


@inner
def _before(xy: Numbers, centre: int, one: int, other: int) -> bool:
    """Return whether the ray to `one` comes before that to `other`, counter-clockwise from east."""
    x, y = xy[one, 0] - xy[centre, 0], xy[one, 1] - xy[centre, 1]
    u, v = xy[other, 0] - xy[centre, 0], xy[other, 1] - xy[centre, 1]
    above, over = y > 0 or (y == 0 and x > 0), v > 0 or (v == 0 and u > 0)
    if above != over:
        return bool(above)
    return bool(x * v - y * u > 0)


class _Rays(NamedTuple):
    """The edges around each point, counter-clockwise: where they begin, other ends, numbers."""

    begins: Numbers
    ends: Numbers
    edges: Numbers


@inner
def _rays(mesh: Mesh) -> _Rays:
    points, edges = len(mesh.xy), len(mesh.ends)
    begins = np.zeros(points + 1, dtype=np.int64)
    for point in mesh.ends.ravel():
        begins[point + 1] += 1
    begins = np.cumsum(begins)
    filled = begins[:-1].copy()
    around = np.empty(2 * edges, dtype=np.int64)
    by = np.empty(2 * edges, dtype=np.int64)
    for edge in range(edges):
        for place in range(2):
            one, other = int(mesh.ends[edge, place]), int(mesh.ends[edge, 1 - place])
            at = filled[one]
            while at > begins[one] and _before(mesh.xy, one, int(other), int(around[at - 1])):
                around[at], by[at] = around[at - 1], by[at - 1]
                at -= 1
            around[at], by[at] = other, edge
            filled[one] += 1
    return _Rays(begins, around, by)


@inner
def _between(rays: _Rays, one: int, other: int) -> int:
    """Return the edge between two points, `NONE` if there is none."""
    begins = rays.begins
    if begins[one + 1] - begins[one] > begins[other + 1] - begins[other]:
        one, other = other, one
    for place in range(begins[one], begins[one + 1]):
        if rays.ends[place] == other:
            return int(rays.edges[place])
    return NONE


@compiled
def connect(mesh: Mesh) -> bool:
    """Fill in apexes, sides and spokes from the ends; return whether all is a triangulation.

    Every edge must have a triangle on one side at least, and every triangle three edges. That no
    two edges cross is for the caller to know.
    """
    rays = _rays(mesh)
    mesh.apex[:] = NONE
    mesh.side[:] = NONE
    for one in range(len(mesh.xy)):
        first, last = rays.begins[one], rays.begins[one + 1]
        if first == last:
            return False
        mesh.spoke[one] = rays.edges[first]
        for at in range(first, last):
            following = first if at + 1 == last else at + 1
            other, third = rays.ends[at], rays.ends[following]
            if turn(mesh.xy, one, other, third) <= 0:
                continue
            across = _between(rays, other, third)
            if across == NONE:
                return False
            _join(mesh, _from(mesh, rays.edges[at], one), third, across, rays.edges[following])
    for edge in range(len(mesh.ends)):
        if max(mesh.apex[edge, 0], mesh.apex[edge, 1]) == NONE:
            return False
    return True


@inner
def _join(mesh: Mesh, at: tuple[int, int], apex: int, ahead: int, back: int) -> None:
    """Put a triangle on one side of an edge: 0 on the left, 1 on the right.

    Seen from that side, `ahead` is the edge from the far end to the apex, and `back` the one from
    the apex to the near end.
    """
    edge, slot = at
    mesh.apex[edge, slot] = apex
    mesh.side[edge, 2 * slot] = ahead
    mesh.side[edge, 2 * slot + 1] = back


@inner
def _from(mesh: Mesh, edge: int, one: int) -> tuple[int, int]:
    """Return an edge and the side that lies left of it as seen from one of its ends."""
    return edge, 0 if mesh.ends[edge, 0] == one else 1


@inner
def convex(mesh: Mesh, edge: int) -> bool:
    """Return whether an edge can flip: its two triangles form a strictly convex quadrilateral."""
    c, d = mesh.apex[edge, 0], mesh.apex[edge, 1]
    if min(c, d) == NONE:
        return False
    a, b = mesh.ends[edge, 0], mesh.ends[edge, 1]
    return turn(mesh.xy, d, c, a) > 0 and turn(mesh.xy, c, d, b) > 0


@inner
def flip(mesh: Mesh, edge: int) -> None:
    """Flip an edge that can flip; spokes are left as they are. Twice gives the same edge again."""
    a, b = mesh.ends[edge, 0], mesh.ends[edge, 1]
    c, d = mesh.apex[edge, 0], mesh.apex[edge, 1]
    bc, ca, ad, db = mesh.side[edge, 0], mesh.side[edge, 1], mesh.side[edge, 2], mesh.side[edge, 3]
    mesh.ends[edge, 0], mesh.ends[edge, 1] = d, c
    mesh.apex[edge, 0], mesh.apex[edge, 1] = a, b
    mesh.side[edge, 0], mesh.side[edge, 1], mesh.side[edge, 2], mesh.side[edge, 3] = ca, ad, db, bc
    _join(mesh, _from(mesh, ca, c), d, ad, edge)
    _join(mesh, _from(mesh, ad, a), c, edge, ca)
    _join(mesh, _from(mesh, db, d), c, bc, edge)
    _join(mesh, _from(mesh, bc, b), d, edge, db)


@inner
def crossed(mesh: Mesh, weights: Floats, start: int, end: int, found: Numbers) -> tuple[float, int]:
    """Return the weight and the number of the edges that the segment between two points crosses.

    No point may lie on the segment. The edges are noted in `found`, as far as it reaches.
    """
    xy = mesh.xy
    edge, back = mesh.spoke[start], False
    # Turn left around the start until the segment lies in the triangle; at the hull, turn back.
    while True:
        place = 0 if mesh.ends[edge, 0] == start else 1
        other = mesh.ends[edge, 1 - place]
        slot = 1 - place if back else place
        apex = mesh.apex[edge, slot]
        if end in (other, apex):
            return 0.0, 0
        if apex == NONE:
            if back:
                return -1.0, NONE
            edge, back = mesh.spoke[start], True
            continue
        right, left = (apex, other) if back else (other, apex)
        ahead, behind = mesh.side[edge, 2 * slot], mesh.side[edge, 2 * slot + 1]
        if turn(xy, start, right, end) > 0 and turn(xy, start, left, end) < 0:
            gate = behind if back else ahead
            break
        edge = ahead if back else behind
    total, count = 0.0, 0
    while True:
        total += float(weights[gate])
        if count < len(found):
            found[count] = gate
        count += 1
        # Left of the edge as seen from its left end lies the triangle that follows.
        slot = 0 if mesh.ends[gate, 0] == left else 1
        apex = mesh.apex[gate, slot]
        if apex in (end, NONE):
            return (total, count) if apex == end else (-1.0, NONE)
        if turn(xy, start, end, apex) > 0:
            gate, left = mesh.side[gate, 2 * slot], apex
        else:
            gate, right = mesh.side[gate, 2 * slot + 1], apex


@compiled
def crossings(mesh: Mesh, edges: Numbers) -> Numbers:
    """Return how many edges of a mesh each of some edges crosses; `edges` has a row for each."""
    weights, nothing = np.ones(len(mesh.ends)), np.empty(0, dtype=np.int64)
    found = np.zeros(len(edges), dtype=np.int64)
    for place in range(len(edges)):
        _, found[place] = crossed(mesh, weights, edges[place, 0], edges[place, 1], nothing)
    return found


STUCK = -1
"""No way was found within the limit."""
_LATE = 1.2
"""What the weight of an edge that came last is multiplied by."""
_BEYOND = 2
"""A try that takes this many rounds too many is given up."""
_NOTHING = 1e-9
"""Costs below this are rounding errors of 0."""


class FlipWorkspace(NamedTuple):
    """Room to work in, an entry for each edge; nothing but `random` lasts between two calls."""

    cost: Floats
    """The weight of the goal's edges that an edge crosses."""
    gain: Floats
    """How much a flip lowers it."""
    stale: Numbers
    """1 where the gain is to be computed anew."""
    taken: Numbers
    """1 where an edge flips in this round, and 0 before and after the round."""
    found: Numbers
    """The edges that a segment crosses, or the edges that can flip with a gain."""
    wishes: Floats
    """The order in which these are to flip."""
    random: Numbers
    """The state of the random numbers, shape (1,)."""


class Flips(NamedTuple):
    """Flips one after another: the edge of each, and its round from 1 up."""

    edge: Numbers
    round: Numbers


class FlipTask(NamedTuple):
    """Some edges of a mesh that are to flip until they are in the goal, whose edges have weights.

    All other edges of the mesh are in the goal, or in the way of none.
    """

    mesh: Mesh
    goal: Mesh
    weights: Floats
    edges: Numbers


class GreedyStyle(NamedTuple):
    """What makes one try differ from another."""

    power: float
    """Costs are raised to this power before they are compared."""
    noise: float
    """Gains are blurred by up to this share."""
    tries: int
    """How often the weights are changed and all begins again."""


@inner
def room_for(edges: int, random: Numbers) -> FlipWorkspace:
    """Return room to work in."""
    return FlipWorkspace(
        np.empty(edges),
        np.empty(edges),
        np.zeros(edges, dtype=np.int64),
        np.zeros(edges, dtype=np.int64),
        np.empty(edges, dtype=np.int64),
        np.empty(edges),
        random,
    )


@inner
def draw(state: Numbers) -> float:
    """Return the next random number from 0 to 1; `state` has one entry (Lehmer 1951)."""
    state[0] = state[0] * 48271 % 2147483647
    return float(state[0] / 2147483647.0)


@inner
def _cost_of(task: FlipTask, one: int, other: int, power: float, nothing: Numbers) -> float:
    """Return the weight of the goal's edges that the edge between two points crosses."""
    total, _ = crossed(task.goal, task.weights, one, other, nothing)
    return float(total if power == 1.0 else total**power)


@inner
def _begin(task: FlipTask, power: float, room: FlipWorkspace, left: Numbers) -> int:
    """Write the edges that are not in the goal into `left`, and their costs; return how many."""
    size = 0
    for edge in task.edges:
        ends = task.mesh.ends[edge]
        room.cost[edge] = _cost_of(task, ends[0], ends[1], power, room.found[:0])
        room.stale[edge] = 1
        if room.cost[edge] > 0.0:
            left[size] = edge
            size += 1
    return size


@inner
def _options(task: FlipTask, left: Numbers, style: GreedyStyle, room: FlipWorkspace) -> int:
    """Note the edges whose flips lower the cost, and in which order; return how many."""
    mesh, gain, able = task.mesh, room.gain, 0
    for edge in left:
        if room.stale[edge]:
            room.stale[edge] = 0
            gain[edge] = -1.0
            if convex(mesh, edge):
                one, other = mesh.apex[edge, 0], mesh.apex[edge, 1]
                new = _cost_of(task, one, other, style.power, room.found[:0])
                gain[edge] = room.cost[edge] - new
        if gain[edge] > 0.0:
            room.wishes[able] = -gain[edge] * (1.0 + style.noise * draw(room.random))
            room.found[able] = edge
            able += 1
    return able


@inner
def _choose(mesh: Mesh, able: int, room: FlipWorkspace, chosen: Numbers) -> int:
    """Choose flips that share no triangle, in their order; return how many."""
    taken, size = room.taken, 0
    for place in np.argsort(room.wishes[:able]):
        edge = room.found[place]
        side = mesh.side[edge]
        if taken[side[0]] or taken[side[1]] or taken[side[2]] or taken[side[3]]:
            continue
        if size == len(chosen):
            break
        taken[edge] = 1
        chosen[size] = edge
        size += 1
    return size


@inner
def run(
    task: FlipTask, limit: int, style: GreedyStyle, room: FlipWorkspace, flips: Flips
) -> tuple[int, int]:
    """Flip the edges of a task until they are in the goal; return the rounds and the flips.

    The flips are noted. The rounds are `STUCK` if there are more than `limit`, if no flip helps, or
    if there is no room for more flips.
    """
    mesh = task.mesh
    left = np.empty(len(task.edges), dtype=np.int64)
    size = _begin(task, style.power, room, left)
    rounds, count = 0, 0
    while size:
        able = 0 if rounds == limit else _options(task, left[:size], style, room)
        if not able:
            return STUCK, count
        rounds += 1
        first = count
        count += _choose(mesh, able, room, flips.edge[first:])
        for edge in flips.edge[first:count]:
            flip(mesh, edge)
            room.taken[edge] = 0
            room.cost[edge] -= room.gain[edge]
            room.stale[edge] = 1
            for place in range(4):
                room.stale[mesh.side[edge, place]] = 1
        flips.round[first:count] = rounds
        if count == len(flips.edge):
            return STUCK, count
        kept = 0
        for edge in left[:size]:
            if room.cost[edge] > _NOTHING:
                left[kept] = edge
                kept += 1
        size = kept
    return rounds, count


@inner
def undo(mesh: Mesh, flips: Flips, count: int) -> None:
    """Take back the first `count` flips, the last of them first."""
    for place in range(count - 1, -1, -1):
        flip(mesh, flips.edge[place])


@inner
def _weigh(task: FlipTask, flips: Flips, count: int, room: FlipWorkspace) -> None:
    """Increase the weights of the goal's edges that were crossed until the last round.

    The mesh is at the end of the flips, and is again when this returns.
    """
    mesh = task.mesh
    last = flips.round[count - 1] if count else 0
    for place in range(count - 1, -1, -1):
        if flips.round[place] < last:
            break
        edge = flips.edge[place]
        flip(mesh, edge)
        one, other = mesh.ends[edge, 0], mesh.ends[edge, 1]
        flip(mesh, edge)
        _, many = crossed(task.goal, task.weights, one, other, room.found)
        for each in room.found[: max(many, 0)]:
            task.weights[each] *= _LATE


@inner
def run_often(
    task: FlipTask, limit: int, style: GreedyStyle, room: FlipWorkspace, flips: Flips
) -> tuple[int, int]:
    """Try several times; return the rounds and flips of the first try that keeps to the limit.

    The mesh is as before, and the flips are noted; the rounds are `STUCK` if no try does.
    """
    for _ in range(style.tries):
        rounds, count = run(task, limit + _BEYOND, style, room, flips)
        kept = rounds != STUCK and rounds <= limit
        if not kept:
            _weigh(task, flips, count, room)
        undo(task.mesh, flips, count)
        if kept:
            return rounds, count
    return STUCK, 0
