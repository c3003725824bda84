"""The state complex: a cube for every set of commuting actions at a state.

Source: Abrams and Ghrist, definition of the state complex. Two cubes are equal iff their actions
are the same and their states agree off the traces. So every cube has exactly one name: the state at
which all of its actions are at end 0, and these actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.complexes.cliques import following
from cubepath.coordinator.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.complexes.exploration import Explored
from cubepath.coordinator.complexes.state_masks import Numbers, Words, commutes
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError

_CELLS_MAX = 2**31 - 1


@dataclass(frozen=True, slots=True)
class StateComplex:
    """A state complex with the names of its cubes.

    ``actions[k]`` has shape (k-cubes, k): the numbers of the actions of each k-cube in ascending
    order, which are its directions. ``bases[k]`` holds the state of each k-cube at which all of its
    actions are at end 0.
    """

    explored: Explored
    complex: CubicalComplex
    bases: tuple[Numbers, ...]
    actions: tuple[Numbers, ...]

    @property
    def memory(self) -> int:
        """Return the size of states, cubes and their faces in bytes."""
        arrays = (*self.complex.faces, *self.bases, *self.actions)
        return self.explored.memory + sum(array.nbytes for array in arrays)

    def cube(self, dimension: int, number: int) -> tuple[int, tuple[Action, ...]]:
        """Return the number of the base state of a cube, and its actions by direction."""
        known = self.explored.bits.actions
        found = tuple(known[action] for action in self.actions[dimension][number])
        return int(self.bases[dimension][number]), found


def f_vector(explored: Explored) -> tuple[int, ...]:
    """Return the number of cubes of each dimension, without keeping the cubes.

    CheckError if not all states were explored.
    """
    _all_explored(explored)
    counts = _counts(explored)
    return tuple(int(count) for count in counts.sum(axis=0, dtype=np.int64))


def _all_explored(explored: Explored) -> None:
    if not explored.complete:
        raise CheckError(
            f"{explored.scene.spec}: only a part was explored ({len(explored.states)} states), so"
            " its complex is not known"
        )


def bytes_for(counts: Sequence[int]) -> int:
    """Return the size in bytes of the cubes of this f-vector: faces, bases and actions."""
    return sum(4 * count * (3 * k + 1) for k, count in enumerate(counts))


def state_complex(explored: Explored) -> StateComplex:
    """Return the complex on the explored states; CheckError if not all states were explored."""
    _all_explored(explored)
    counts = _counts(explored)
    totals = counts.sum(axis=0, dtype=np.int64)
    if totals.max() > _CELLS_MAX:
        raise CheckError(
            f"{explored.scene.spec}: {totals.max()} cubes of one dimension, expected at most"
            f" {_CELLS_MAX}"
        )
    dimensions = len(totals)
    first = np.zeros((len(explored.states) + 1, dimensions), dtype=np.int64)
    np.cumsum(counts, axis=0, out=first[1:])
    offsets = np.zeros(dimensions + 1, dtype=np.int64)
    np.cumsum(totals * np.arange(dimensions), out=offsets[1:])
    layout, edges = _Layout(first, offsets), _edges(explored)
    flat = np.empty(int(offsets[-1]), dtype=np.int32)
    most = _most(explored)
    _fill.for_work(_EDGE_STEPS * (len(flat) + len(edges.targets)))(edges, most, layout, flat)
    faces = [np.empty((len(explored.states), 0, 2), dtype=np.int32)]
    actions = [np.empty((len(explored.states), 0), dtype=np.int32)]
    bases = [np.arange(len(explored.states), dtype=np.int32)]
    for k in range(1, dimensions):
        actions.append(flat[offsets[k] : offsets[k + 1]].reshape(-1, k))
        found = np.empty((int(totals[k]), k, 2), dtype=np.int32)
        faces_of = _faces.for_work(_EDGE_STEPS * found.size)
        faces_of(edges, layout, actions[k], actions[k - 1], found)
        faces.append(found)
        bases.append(np.repeat(bases[0], counts[:, k]))
    return StateComplex(explored, CubicalComplex(tuple(faces)), tuple(bases), tuple(actions))


class _Edges(NamedTuple):
    """The arrays of `Explored`, for compiled code."""

    starts: NDArray[np.int64]
    actions: Numbers
    targets: Numbers
    masks: Words


def _edges(explored: Explored) -> _Edges:
    return _Edges(explored.starts, explored.actions, explored.targets, explored.bits.masks())


_LOCAL = -1
_EDGE_STEPS = 8
"""Steps of work for an edge or a face, which is about its microseconds in plain Python."""


def _most(explored: Explored) -> int:
    """Return the largest size of a set of commuting actions, or `_LOCAL` for a local system.

    In a system with a global rule, commuting actions alone do not make a cube: all corners must be
    looked at.
    """
    if explored.scene.system.local:
        return _LOCAL
    most = int(np.diff(explored.starts).max(initial=0))
    counts = np.zeros((len(explored.states), most + 1), dtype=np.int32)
    return _count.for_work(_clique_steps(explored))(_edges(explored), _LOCAL, counts)


def _clique_steps(explored: Explored) -> int:
    """Return roughly how many steps it takes to look at all sets of commuting actions."""
    degrees = np.diff(explored.starts)
    return _EDGE_STEPS * int((degrees * degrees).sum() + len(degrees))


def _counts(explored: Explored) -> Numbers:
    """Return for each state the number of cubes of each dimension that have it as their base."""
    most = int(np.diff(explored.starts).max(initial=0))
    counts = np.zeros((len(explored.states), most + 1), dtype=np.int32)
    most = _most(explored)
    highest = _count.for_work(_clique_steps(explored))(_edges(explored), most, counts)
    return counts[:, : highest + 1]


@compiled
def _agree(edges: _Edges, state: int) -> NDArray[np.bool_]:
    """Return which of the actions at end 0 of the state commute."""
    first = edges.starts[state]
    size = edges.starts[state + 1] - first
    found = np.zeros((size, size), dtype=np.bool_)
    for one in range(size):
        for other in range(one):
            mine, theirs = edges.actions[first + one], edges.actions[first + other]
            if commutes(edges.masks, int(mine), int(theirs)):
                found[one, other] = True
                found[other, one] = True
    return found


@compiled
def _up(edges: _Edges, state: int, action: int) -> int:
    """Return the number of the edge of this action that leaves the state at end 0, or -1."""
    low, high = edges.starts[state], edges.starts[state + 1]
    while low < high:
        middle = (low + high) // 2
        if edges.actions[middle] < action:
            low = middle + 1
        else:
            high = middle
    if low < edges.starts[state + 1] and edges.actions[low] == action:
        return int(low)
    return -1


@compiled
def _raise(edges: _Edges, corners: Numbers, depth: int, action: int) -> bool:
    """Add the corners across `action` to the 2^depth corners of a cube; False if one is missing."""
    size = 1 << depth
    for place in range(size):
        edge = _up(edges, corners[place], action)
        if edge < 0:
            return False
        corners[size + place] = edges.targets[edge]
    return True


@compiled
def _count(edges: _Edges, most: int, counts: Numbers) -> int:
    """Count the cubes by base and dimension; return the greatest dimension."""
    highest = 0
    corners = np.zeros(1 << max(most, 0), dtype=np.int32)
    for state in range(len(edges.starts) - 1):
        counts[state, 0] = 1
        corners[0] = state
        agree = _agree(edges, state)
        chosen = np.zeros(len(agree), dtype=np.int32)
        depth = following(agree, chosen, 0, True)
        while depth:
            action = int(edges.actions[edges.starts[state] + chosen[depth - 1]])
            is_cube = most == _LOCAL or _raise(edges, corners, depth - 1, action)
            if is_cube:
                counts[state, depth] += 1
                highest = max(highest, depth)
            depth = following(agree, chosen, depth, is_cube)
    return highest


class _Layout(NamedTuple):
    """Where the cubes lie: those of dimension k over state s are first[s, k] to first[s + 1, k]."""

    first: NDArray[np.int64]
    offsets: NDArray[np.int64]
    """Where the actions of each dimension begin in one flat array."""


@compiled
def _fill(edges: _Edges, most: int, layout: _Layout, flat: Numbers) -> None:
    """Write the actions of every cube, by base and then by their numbers in order."""
    corners = np.zeros(1 << max(most, 0), dtype=np.int32)
    free = np.zeros(layout.first.shape[1], dtype=np.int64)
    for state in range(len(edges.starts) - 1):
        first = edges.starts[state]
        corners[0] = state
        free[:] = layout.first[state]
        agree = _agree(edges, state)
        chosen = np.zeros(len(agree), dtype=np.int32)
        depth = following(agree, chosen, 0, True)
        while depth:
            action = int(edges.actions[first + chosen[depth - 1]])
            is_cube = most == _LOCAL or _raise(edges, corners, depth - 1, action)
            if is_cube:
                at = layout.offsets[depth] + free[depth] * depth
                free[depth] += 1
                for other in range(depth):
                    flat[at + other] = edges.actions[first + chosen[other]]
            depth = following(agree, chosen, depth, is_cube)


@compiled
def _find(cubes: Numbers, low: int, high: int, cube: Numbers) -> int:
    """Return the row with this cube's actions, between `low` and `high`, in lexicographic order."""
    while high - low > 1:
        middle = (low + high) // 2
        later = False
        for direction in range(len(cube)):
            if cubes[middle, direction] != cube[direction]:
                later = cubes[middle, direction] > cube[direction]
                break
        if later:
            high = middle
        else:
            low = middle
    return low


@compiled
def _faces(edges: _Edges, layout: _Layout, cubes: Numbers, below: Numbers, faces: Numbers) -> None:
    """Find the faces of all cubes of one dimension among the cubes of the one below."""
    k = cubes.shape[1]
    first = layout.first
    rest = np.zeros(k - 1, dtype=np.int32)
    for state in range(len(edges.starts) - 1):
        for cube in range(first[state, k], first[state + 1, k]):
            for direction in range(k):
                rest[:direction] = cubes[cube, :direction]
                rest[direction:] = cubes[cube, direction + 1 :]
                across = edges.targets[_up(edges, state, cubes[cube, direction])]
                for end in range(2):
                    base = across if end else state
                    low, high = first[base, k - 1], first[base + 1, k - 1]
                    faces[cube, direction, end] = _find(below, low, high, rest)
