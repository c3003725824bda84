"""Links of vertices, Gromov's link condition and non-positive curvature: checked, not assumed.

Source: Abrams and Ghrist, definitions of link and link condition, after Gromov: a cube complex is
non-positively curved iff in the link of every vertex any k + 1 vertices that are pairwise joined
by edges bound a unique k-simplex. The link of one state follows from the definition without any
exploration: the complex of a non-local system may be far too large.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene


@compiled
def following(
    agree: NDArray[np.bool_],
    chosen: NDArray[np.int32],
    depth: int,
    deeper: bool,  # noqa: FBT001
) -> int:
    """Change the clique ``chosen[:depth]`` into the next one; return its size, 0 after the last.

    `agree` is symmetric, shape (size, size); `chosen` has room for `size` vertices in ascending
    order. Cliques come in lexicographic order, beginning with depth 0, the empty one. Without
    `deeper`, cliques that contain the current one are skipped.
    """
    size = len(agree)
    place = chosen[depth - 1] + 1 if depth else 0
    if not deeper:
        depth -= 1
    while True:
        while place < size:
            fits = True
            for other in range(depth):
                if not agree[place, chosen[other]]:
                    fits = False
                    break
            if fits:
                chosen[depth] = place
                return depth + 1
            place += 1
        if depth == 0:
            return 0
        depth -= 1
        place = chosen[depth] + 1


Ints = NDArray[np.int64]
Ends = NDArray[np.int32]


class Ranges(NamedTuple):
    """Values by key: those of key i are ``values[starts[i]:starts[i + 1]]``, in ascending order."""

    starts: Ints
    values: Ints


_WITNESSES = 5
"""The number of failing links that are described."""


@dataclass(frozen=True, slots=True)
class Failing:
    """Ends of edges at a vertex that are pairwise in squares but in no cube, or in several.

    Each of `ends` is an edge and which of its ends (0 or 1) is at the vertex.
    """

    vertex: int
    ends: tuple[tuple[int, int], ...]
    simplices: int

    def __str__(self) -> str:
        edges = ", ".join(str(edge) for edge, _ in self.ends)
        return (
            f"vertex {self.vertex}: edges {edges} bound {self.simplices or 'no'} "
            f"{'simplex' if self.simplices < 2 else 'simplices'} of the link, expected one"
        )


@dataclass(frozen=True, slots=True)
class Links:
    """The outcome of the link condition at all vertices."""

    checked: int
    failing: tuple[Failing, ...]
    """The first few failures."""
    failures: int
    """The number of vertices at which it fails."""

    @property
    def npc(self) -> bool:
        """Return whether the complex is non-positively curved."""
        return not self.failures


def bytes_for_links(counts: Sequence[int]) -> int:
    """Return roughly the most bytes that `check_links` takes for a complex of this f-vector.

    They hold the corners of the cubes of one dimension, with four copies of their ends while these
    are sorted.
    """
    return max((count * 16 * (k + 2) << k for k, count in enumerate(counts)), default=0)


def check_links(complex_: CubicalComplex) -> Links:
    """Check the link condition at every vertex, from the cubes alone.

    The k-cubes that have a corner at a vertex are the (k - 1)-simplices of its link, each given by
    the k ends of edges there (both ends of an edge may occur). The condition holds iff no two
    simplices have the same vertices, no simplex has a vertex twice, and the link has as many
    simplices of each dimension as its graph has cliques of that size.

    >>> built = state_complex(explore(scene_from_spec("agv:graph=K5,n=2")))
    >>> found = check_links(built.complex)
    >>> found.checked, found.npc
    (10, True)
    """
    vertices = complex_.f_vector[0] if complex_.faces else 0
    bad: dict[int, Failing] = {}
    simplices: list[Ints] = []
    graph = ends = Ranges(np.zeros(vertices + 1, np.int64), np.empty(0, np.int64))
    for k, (corners, found) in enumerate(_corners(complex_), 1):
        order = np.lexsort((*found.T[::-1], corners))
        at, rows = corners[order], found[order]
        if k == 1:
            ends = _grouped(at, rows[:, 0], vertices)
        for place in np.flatnonzero((rows[:, 1:] == rows[:, :-1]).any(axis=1)):
            bad.setdefault(int(at[place]), _failing(int(at[place]), rows[place], 1))
        same = (rows[1:] == rows[:-1]).all(axis=1) & (at[1:] == at[:-1])
        for place in np.flatnonzero(same):
            bad.setdefault(int(at[place]), _failing(int(at[place]), rows[place], 2))
        if k == 2:
            pairs = np.concatenate([rows, rows[:, ::-1]])
            graph = _neighbours(pairs, 2 * complex_.f_vector[1])
        simplices.append(np.bincount(at, minlength=vertices))
    wrong = set(bad)
    if len(simplices) > 1:
        counts = np.stack(simplices, axis=1)
        sizes = np.diff(ends.starts)
        steps = 4 * int((sizes * sizes).sum() + counts.sum())
        differ = _cliques_differ.for_work(steps)(ends, graph, counts)
        wrong |= set(np.flatnonzero(differ).tolist())
    failing = [
        bad.get(vertex) or _unfilled(complex_, vertex, ends, graph)
        for vertex in sorted(wrong)[:_WITNESSES]
    ]
    return Links(checked=vertices, failing=tuple(failing), failures=len(wrong))


def _failing(vertex: int, row: Ends, simplices: int) -> Failing:
    ends = tuple((int(end) >> 1, int(end) & 1) for end in row)
    return Failing(vertex, ends, simplices)


def _corners(complex_: CubicalComplex) -> Iterator[tuple[Ends, Ends]]:
    """Yield for k = 1, 2, ... the corners of all k-cubes: vertex, and the k ends of edges there.

    The arrays have shapes (corners,) and (corners, k), with the ends in ascending order; end e of
    edge i has the number 2 i + e.
    """
    if not complex_.faces:
        return
    vertices = np.arange(complex_.f_vector[0], dtype=np.int32)[:, None]
    ends: Ends = np.empty((len(vertices), 1, 0), dtype=np.int32)
    for k in range(1, len(complex_.faces)):
        faces = complex_.faces[k]
        cubes = np.arange(len(faces), dtype=np.int32)
        # Corner number c of a cube is at end (c >> j) & 1 of direction j.
        low, high = faces[:, k - 1, 0], faces[:, k - 1, 1]
        if k == 1:
            last = np.stack([2 * cubes, 2 * cubes + 1], axis=1)
        else:
            # The edge in the last direction is an edge of the face that fixes direction 0.
            half = np.arange(1 << k)
            last = np.where(
                half & 1,
                ends[faces[:, 0, 1]][:, half >> 1, k - 2],
                ends[faces[:, 0, 0]][:, half >> 1, k - 2],
            )
        others = np.concatenate([ends[low], ends[high]], axis=1)
        vertices = np.concatenate([vertices[low], vertices[high]], axis=1)
        ends = np.concatenate([others, last[:, :, None]], axis=2)
        yield vertices.ravel(), np.sort(ends.reshape(-1, k), axis=1)


def _grouped(keys: Ends, values: Ends, count: int) -> Ranges:
    """Return the values by key, in ascending order."""
    order = np.lexsort((values, keys))
    starts = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(np.bincount(keys, minlength=count), out=starts[1:])
    return Ranges(starts, values[order].astype(np.int64))


def _neighbours(pairs: Ends, ends: int) -> Ranges:
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return _grouped(pairs[:, 0], pairs[:, 1], ends)


@compiled
def _joined(graph: Ranges, one: int, other: int) -> bool:
    low, high = graph.starts[one], graph.starts[one + 1]
    while low < high:
        middle = (low + high) // 2
        if graph.values[middle] < other:
            low = middle + 1
        else:
            high = middle
    return bool(low < graph.starts[one + 1] and graph.values[low] == other)


@compiled
def _cliques_differ(ends: Ranges, graph: Ranges, simplices: Ints) -> NDArray[np.bool_]:
    """Return for each vertex whether the numbers of simplices and cliques in its link differ."""
    found = np.zeros(len(ends.starts) - 1, dtype=np.bool_)
    largest = simplices.shape[1]
    for vertex in range(len(found)):
        first = ends.starts[vertex]
        size = ends.starts[vertex + 1] - first
        agree = np.zeros((size, size), dtype=np.bool_)
        for one in range(size):
            for other in range(one):
                mine, theirs = ends.values[first + one], ends.values[first + other]
                joined = _joined(graph, int(mine), int(theirs))
                agree[one, other] = joined
                agree[other, one] = joined
        counts = np.zeros(largest + 1, dtype=np.int64)
        chosen = np.zeros(size, dtype=np.int32)
        depth = following(agree, chosen, 0, True)
        while depth:
            counts[depth - 1] += 1
            depth = following(agree, chosen, depth, depth <= largest)
        # A clique larger than the largest cube bounds no simplex.
        found[vertex] = counts[largest] or (counts[:largest] != simplices[vertex]).any()
    return found


def _unfilled(complex_: CubicalComplex, vertex: int, ends: Ranges, graph: Ranges) -> Failing:
    """Return the first smallest clique at the vertex that bounds no simplex."""
    here = ends.values[ends.starts[vertex] : ends.starts[vertex + 1]].tolist()
    for k, (at, rows) in enumerate(_corners(complex_), 1):
        filled = {tuple(row) for row in rows[at == vertex].tolist()}
        for clique in combinations(here, k):
            if _pairwise(clique, graph) and clique not in filled:
                return _failing(vertex, np.array(clique, dtype=np.int32), 0)
    size = len(complex_.faces)
    clique = next(each for each in combinations(here, size) if _pairwise(each, graph))
    return _failing(vertex, np.array(clique, dtype=np.int32), 0)


def _pairwise(clique: Sequence[int], graph: Ranges) -> bool:
    return all(_joined.for_work(10)(graph, one, other) for one, other in combinations(clique, 2))


def actions_at(scene: Scene, state: State) -> list[Action]:
    """Return the actions that may be executed at the state, by site and slot.

    >>> scene = scene_from_spec("hex:n=3")
    >>> [action.label for action in actions_at(scene, scene.start_state)][:2]
    ['pivot-1-right at [0, 0]', 'pivot-2-right at [1, -1]']
    """
    system = scene.system
    found = {
        move.action: None
        for site in in_order(state - system.filled)
        for move in system.moves(site)
        if move is not None and admissible(move.action, state)
    }
    return [action for action in found if system.legal(apply(action, state))]


def spans_cube(scene: Scene, state: State, actions: Sequence[Action]) -> bool:
    """Return whether actions admissible at the state span a cube: all its corners are states."""
    if not all(commute(one, other) for one, other in combinations(actions, 2)):
        return False
    if scene.system.local:
        return True
    corners = [frozenset(state)]
    for action in actions:
        corners += [apply(action, corner) for corner in corners]
    return all(scene.system.legal(corner) for corner in corners)


def unfilled(scene: Scene, state: State) -> list[tuple[Action, ...]]:
    """Return the minimal sets of actions that fail the link condition at the state.

    Each has at least three actions; any proper subset of them spans a cube, but all together do
    not. A local system has none (the paper's theorem on non-positive curvature).

    >>> scene = scene_from_spec("hex:n=3")
    >>> unfilled(scene, scene.start_state)
    []
    """
    actions = actions_at(scene, state)
    filled: set[tuple[int, ...]] = {(number,) for number in range(len(actions))}
    layer = sorted(filled)
    missing: list[tuple[Action, ...]] = []
    while layer:
        following = []
        for chosen in layer:
            for number in range(chosen[-1] + 1, len(actions)):
                larger = (*chosen, number)
                if any(part not in filled for part in combinations(larger, len(chosen))):
                    continue
                found = [actions[each] for each in larger]
                if spans_cube(scene, state, found):
                    following.append(larger)
                elif len(larger) > 2:
                    missing.append(tuple(found))
        filled.update(following)
        layer = following
    return missing
