"""The state complex: a cube for every set of commuting actions at a state.

Source: Abrams and Ghrist, definition of the state complex. Two cubes are equal iff their actions
are the same and their states agree off the traces. So every cube has exactly one name: the state at
which all of its actions are at end 0, and these actions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import Exploration
from cubepath.coordinator.theory.complexes.links import following
from cubepath.coordinator.theory.complexes.state_masks import Numbers, Words, commutes
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.displays import Displayed

_CELLS_MAX = 2**31 - 1


@dataclass(frozen=True, slots=True)
class StateComplex(Displayed):
    """A state complex with the names of its cubes.

    ``actions[k]`` has shape (k-cubes, k): the numbers of the actions of each k-cube in ascending
    order, which are its directions. ``bases[k]`` holds the state of each k-cube at which all of its
    actions are at end 0.
    """

    explored: Exploration
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


def f_vector(explored: Exploration) -> tuple[int, ...]:
    """Return the number of cubes of each dimension, without keeping the cubes.

    CheckError if not all states were explored.
    """
    _all_explored(explored)
    counts = _counts(explored)
    return tuple(int(count) for count in counts.sum(axis=0, dtype=np.int64))


def _all_explored(explored: Exploration) -> None:
    if not explored.complete:
        raise CheckError(
            f"{explored.scene.spec}: only a part was explored ({len(explored.states)} states), so"
            " its complex is not known"
        )


def bytes_for(counts: Sequence[int]) -> int:
    """Return the size in bytes of the cubes of this f-vector: faces, bases and actions."""
    return sum(4 * count * (3 * k + 1) for k, count in enumerate(counts))


def state_complex(explored: Exploration) -> StateComplex:
    """Return the complex on the explored states; CheckError if not all states were explored."""
    _all_explored(explored)
    counts = _counts(explored)
    totals = counts.sum(axis=0, dtype=np.int64)
    if totals.max() > _CELLS_MAX:
        raise CheckError(
            f"{explored.scene.spec}: {totals.max()} cubes of one dimension, expected at most"
            f" {_CELLS_MAX}"
        )
    sizes = totals.tolist()
    cubes = _cubes(explored, sizes)
    faces = [np.empty((len(explored.states), 0, 2), dtype=np.int32)]
    bases = [np.arange(len(explored.states), dtype=np.int32)]
    for k in range(1, len(sizes)):
        bases.append(np.repeat(bases[0], counts[:, k]))
        if k == 1:  # the edges themselves
            found = np.stack([bases[1], explored.targets], axis=1).reshape(-1, 1, 2)
        else:
            found = np.empty((sizes[k], k, 2), dtype=np.int32)
            faces_of = _faces.for_work(_EDGE_STEPS * found.size)
            faces_of(cubes[k], cubes[k - 1], cubes[k - 2], faces[k - 1], found)
        faces.append(found)
    actions = tuple(each.actions for each in cubes)
    return StateComplex(explored, CubicalComplex(tuple(faces)), tuple(bases), actions)


class _Cubes(NamedTuple):
    """The cubes of one dimension k, by base and then by their actions in order.

    A cube's children are the cubes at the same base that have one more action, which is the last.
    They stand together, since they all begin with the actions of that cube.
    """

    actions: Numbers
    """Shape (cubes, k), ascending in each row."""
    children: Numbers
    """Where the children of each cube begin, shape (cubes + 1,)."""


def _cubes(explored: Exploration, sizes: list[int]) -> list[_Cubes]:
    """Return the cubes of each dimension, given how many there are."""
    offsets = np.cumsum([0, *(k * size for k, size in enumerate(sizes))], dtype=np.int64)
    flat = np.empty(int(offsets[-1]), dtype=np.int32)
    starts = np.cumsum([0, *(size + 1 for size in sizes)], dtype=np.int64)
    children = np.zeros(int(starts[-1]), dtype=np.int32)
    edges = _edges(explored)
    fill = _fill.for_work(_EDGE_STEPS * (len(flat) + len(edges.targets)))
    fill(edges, _most(explored), _Filled(flat, offsets, children, starts))
    return [
        _Cubes(
            flat[offsets[k] : offsets[k + 1]].reshape(size, k), children[starts[k] : starts[k + 1]]
        )
        for k, size in enumerate(sizes)
    ]


class _Edges(NamedTuple):
    """The arrays of `Exploration`, for compiled code."""

    starts: NDArray[np.int64]
    actions: Numbers
    targets: Numbers
    masks: Words


def _edges(explored: Exploration) -> _Edges:
    return _Edges(explored.starts, explored.actions, explored.targets, explored.bits.masks())


_LOCAL = -1
_EDGE_STEPS = 8
"""Steps of work for an edge or a face, which is about its microseconds in plain Python."""


def _most(explored: Exploration) -> int:
    """Return the largest size of a set of commuting actions, or `_LOCAL` for a local system.

    In a system with a global rule, commuting actions alone do not make a cube: all corners must be
    looked at.
    """
    if explored.scene.system.local:
        return _LOCAL
    most = int(np.diff(explored.starts).max(initial=0))
    counts = np.zeros((len(explored.states), most + 1), dtype=np.int32)
    return _count.for_work(_clique_steps(explored))(_edges(explored), _LOCAL, counts)


def _clique_steps(explored: Exploration) -> int:
    """Return roughly how many steps it takes to look at all sets of commuting actions."""
    degrees = np.diff(explored.starts)
    return _EDGE_STEPS * int((degrees * degrees).sum() + len(degrees))


def _counts(explored: Exploration) -> Numbers:
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


class _Filled(NamedTuple):
    """All actions and children: those of dimension k begin at offsets[k] and starts[k]."""

    actions: Numbers
    offsets: NDArray[np.int64]
    children: Numbers
    starts: NDArray[np.int64]


@compiled
def _fill(edges: _Edges, most: int, filled: _Filled) -> None:
    """Write the actions and children of every cube, by base and then by the actions in order."""
    flat, offsets, children, starts = filled
    corners = np.zeros(1 << max(most, 0), dtype=np.int32)
    # How many cubes there are so far; none have more actions than those of the highest dimension.
    known = np.zeros(len(starts), dtype=np.int64)
    for state in range(len(edges.starts) - 1):
        first = edges.starts[state]
        corners[0] = state
        agree = _agree(edges, state)
        chosen = np.zeros(len(agree), dtype=np.int32)
        children[state] = known[1]
        known[0] += 1
        depth = following(agree, chosen, 0, True)
        while depth:
            action = int(edges.actions[first + chosen[depth - 1]])
            is_cube = most == _LOCAL or _raise(edges, corners, depth - 1, action)
            if is_cube:
                at = offsets[depth] + known[depth] * depth
                for other in range(depth):
                    flat[at + other] = edges.actions[first + chosen[other]]
                children[starts[depth] + known[depth]] = known[depth + 1]
                known[depth] += 1
            depth = following(agree, chosen, depth, is_cube)
    for depth in range(len(starts) - 1):
        children[starts[depth] + known[depth]] = known[depth + 1]


@compiled
def _child(cubes: Numbers, low: int, high: int, action: int) -> int:
    """Return which of the cubes from `low` to `high`, the children of one, has this last action."""
    last = cubes.shape[1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if cubes[middle, last] > action:
            high = middle
        else:
            low = middle
    return low


@compiled
def _faces(
    cubes: _Cubes, below: _Cubes, lowest: _Cubes, known: NDArray[np.int32], faces: Numbers
) -> None:
    """Fill in the faces of the cubes of dimension k, from those of dimension k - 1, `known`.

    Every face is found as the child of a cube of dimension k - 2. Let a cube have the last action
    a, and let its parent be the cube without a. A face of the cube in any direction but a is the
    child, by a, of the parent's face in that direction. The face across a is the child, by the last
    action b of the parent, of the following: leave out b, and then go across a.
    """
    k = cubes.actions.shape[1]
    for parent in range(len(below.actions)):
        for cube in range(below.children[parent], below.children[parent + 1]):
            action = int(cubes.actions[cube, k - 1])
            for direction in range(k - 1):
                for end in range(2):
                    least = known[parent, direction, end]
                    low = int(lowest.children[least])
                    high = int(lowest.children[least + 1])
                    faces[cube, direction, end] = _child(below.actions, low, high, action)
            faces[cube, k - 1, 0] = parent
            least = known[faces[cube, k - 2, 0], k - 2, 1]
            low, high = int(lowest.children[least]), int(lowest.children[least + 1])
            before = int(cubes.actions[cube, k - 2])
            faces[cube, k - 1, 1] = _child(below.actions, low, high, before)
