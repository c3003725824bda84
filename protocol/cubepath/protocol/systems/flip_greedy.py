"""Greedy rounds of flips from one triangulation to another, in compiled code.

Each round is a set of flips of which no two have a triangle in common. Those that reduce the
crossings with the goal most are chosen first. Any random choice breaks ties or blurs the order, so
that several tries differ. After a try the edges of the goal that came last get a greater weight,
and their crossings count more in the next one.

Sources: Hanke, Ottmann and Schuierer, *The edge-flipping distance of triangulations* (1996); the
path heuristic of da Fonseca, Feschet and Gerard, *Shadoks approach to parallel reconfiguration of
triangulations* (CG:SHOP 2026); squeaky wheels, Joslin and Clements (1999).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cubepath.protocol.compiled import inner
from cubepath.protocol.systems.flip_mesh import Floats, Mesh, Numbers, convex, crossed, flip

STUCK = -1
"""No way was found within the limit."""
_LATE = 1.2
"""What the weight of an edge that came last is multiplied by."""
_BEYOND = 2
"""A try that takes so many rounds too many is given up."""
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
