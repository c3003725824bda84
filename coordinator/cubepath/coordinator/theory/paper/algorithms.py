"""The paper's algorithms as printed, under their own names, and a mended version.

Source: Abrams and Ghrist, State Complexes for Metamorphic Robots, section "Optimizing paths":
algorithms TimeGeodesic and ShrinkCubePath, subroutines Commute, ExciseTrivial and CommonEdge. A
cube is the list of its actions, a cube path the list of its cubes; the state is left out, as in
the paper, which counts cubes from 1, the code from 0. This is the reference to read and to compare
with; `cubepath.coordinator.normal_form.heap` does the work.

Where the printed text falls short, and what `mended_time_geodesic` does about it (docs/complexes.md
has the numbers):

- It requires a genuine cube path, in which consecutive cubes share no edge. The edge path of a run
  may step back and forth, and is not genuine. `genuine_cube_path` makes it so first.
- The last pair of cubes never gets to `CommonEdge`, because line 9 stops before i reaches the last
  cube and line 6 looks back. So ``[a], [a]`` is returned unchanged.
- TimeGeodesic stops when a call has not changed the length. With a common edge inside the path,
  that can be too early: a call may leave one inside, where cubes have vanished and their neighbours
  meet, even on a genuine path. What does hold: if a call does not change the length of a *genuine*
  cube path, then no path of the class is shorter. Each cube then contains an action that an action
  of the previous cube did not let pass, down from the last cube to the first, and neither can
  cancel: its equal would have to pass the other.
- If TimeGeodesic succeeds, it returns a shortest cube path, but not yet the normal one, which is
  the fixed point of ShrinkCubePath. `mended_time_geodesic` continues until nothing changes.
- The paper bounds the cost by the sum of the dimensions, which it says falls in every loop. Commute
  keeps that sum; only cancellation lowers it. The sum of i * dim(C_i) falls whenever something
  changes, as the proof of the theorem says: see `weight`.
- The paper does not say what i is after ExciseTrivial has removed cubes and reindexed the path:
  `READINGS` lists four answers. In no reading is the result too short.

The star condition of the definition must be read at the vertex between two cubes, in the universal
cover: see `cubepath.coordinator.normal_form.definitions.is_normal`. Commute does so, by the lemma
beside it. In the envelope of time-optimal paths, the normal cube path makes every move as early as
possible, and counted from the other end as late as possible in the same number of cubes.
"""

from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.actions import Action, commute


def latest_cubes(cubes: Iterable[Iterable[Action]]) -> tuple[tuple[Action, ...], ...]:
    """Return the moves of a normal cube path in as many cubes, each move as late as possible.

    It is the normal cube path of the way back, read backwards.
    """
    moves = [action for cube in cubes for action in cube]
    return normal_cube_path(reversed(moves))[::-1]


Cube: TypeAlias = list[Action]
"""A cube: its actions, in the order in which they joined it."""
CubePath: TypeAlias = list[Cube]
"""A cube path: its cubes in order."""
Reading: TypeAlias = Literal["keeps", "follows", "steps back", "restarts"]
"""What i is after cubes have been taken out of the path, see `READINGS`."""

READINGS: dict[Reading, str] = {
    "keeps": "i keeps its value",
    "follows": "i stays with its cube, or with the next one if that is gone",
    "steps back": "i stays with its cube, or with the one before if that is gone",
    "restarts": "i is 1 again",
}
"""The readings of the reindexing in ExciseTrivial; the first is the text to the letter."""


def Commute(cube: Sequence[Action], following: Sequence[Action]) -> Cube:  # noqa: N802 - the paper's name
    """Return the actions of `following` that commute with all of `cube` (subroutine Commute).

    The paper first unites the supports and traces of the cube. To be disjoint from the union is the
    same as from each of them, so this uses `commute`, the only definition.
    """
    return [action for action in following if all(commute(other, action) for other in cube)]


def ExciseTrivial(path: CubePath, *places: int) -> None:  # noqa: N802 - the paper's name
    """Remove the cubes at these places from the path, in place, if they are empty lists.

    Later cubes move up (subroutine ExciseTrivial).
    """
    for place in sorted(places, reverse=True):
        if not path[place]:
            del path[place]


def CommonEdge(path: CubePath, before: int, place: int) -> None:  # noqa: N802 - the paper's name
    """Delete from both the actions that the cubes at these places share (subroutine CommonEdge).

    The same move at the end of one cube and the start of the next is a step there and back. This
    may leave a cube empty.
    """
    common = set(path[before]).intersection(path[place])
    if common:
        path[before] = [action for action in path[before] if action not in common]
        path[place] = [action for action in path[place] if action not in common]


def ShrinkCubePath(  # noqa: N802 - the paper's name
    cubes: Iterable[Iterable[Action]], reading: Reading = "keeps"
) -> CubePath:
    """Return the cube path after one call of algorithm ShrinkCubePath, as printed.

    Actions of the next cube that commute with a cube move into it. Numbers in comments are lines of
    the paper, and `reading` says what i is after cubes have been removed. The input is not changed.
    Shrinking a path that is already normal changes nothing.
    """
    path = [list(cube) for cube in cubes]
    i = 0  # 1
    while i + 1 < len(path):  # 9: a missing cube counts as empty
        moved = Commute(path[i], path[i + 1])  # 2
        if moved:
            path[i] = path[i] + moved  # 3
            gone = set(moved)
            path[i + 1] = [action for action in path[i + 1] if action not in gone]  # 4
        if not path[i + 1]:
            ExciseTrivial(path, i + 1)  # 5
            i = 0 if reading == "restarts" else i
        if i > 0:
            CommonEdge(path, i - 1, i)  # 6
            before, own = not path[i - 1], not path[i]
            ExciseTrivial(path, i - 1, i)  # 7
            i = _reindexed(i, reading, before=before, own=own)
        if not moved:
            i += 1  # 8
    return path


def _reindexed(i: int, reading: Reading, *, before: bool, own: bool) -> int:
    """Return what i is after the cube before it, or its own, or both have been removed."""
    match reading:
        case "keeps":
            return i
        case "follows":
            return i - before
        case "steps back":
            return max(0, i - before - own)
        case "restarts":
            return 0 if before or own else i


def TimeGeodesic(  # noqa: N802 - the paper's name
    cubes: Iterable[Iterable[Action]], reading: Reading = "keeps"
) -> CubePath:
    """Return the result of algorithm TimeGeodesic, as printed, on a cube path.

    It is a homotopic path, never longer, and the shortest unless there is a common edge inside
    before the last call; see the docstring of this module. An edge path is given as cubes of one
    action. Costs O(N) calls of ShrinkCubePath, each with O(N) calls of Commute unless i restarts.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> TimeGeodesic([[a], [b]]) == [[a, b]]
    True
    >>> TimeGeodesic([[a], [a]]) == [[a], [a]], mended_time_geodesic([[a], [a]])
    (True, [])
    """
    path = [list(cube) for cube in cubes]
    while True:
        length = len(path)  # 1
        path = ShrinkCubePath(path, reading)  # 2
        if len(path) == length:  # 3
            return path


def genuine_cube_path(cubes: Iterable[Iterable[Action]]) -> CubePath:
    """Return the path after cancelling all common edges of consecutive cubes.

    The result is a cube path by the paper's definition: no cube is empty and no two consecutive
    cubes share an edge. CommonEdge and ExciseTrivial are applied to every pair, including the last
    one, and to the pairs that meet when a cube between them vanishes.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> genuine_cube_path([[a], [b], [b], [a]])
    []
    """
    path: CubePath = []
    for cube in cubes:
        path.append(list(cube))
        # When a cube vanishes, its two neighbours meet.
        while len(path) > 1:
            length = len(path)
            CommonEdge(path, length - 2, length - 1)
            ExciseTrivial(path, length - 2)
            if len(path) == length:
                break
        ExciseTrivial(path, len(path) - 1)
    return path


def mended_time_geodesic(cubes: Iterable[Iterable[Action]]) -> CubePath:
    """Return the normal cube path: the fixed point of ShrinkCubePath on genuine cube paths.

    The path is made genuine before and after every call, and the loop stops when nothing has
    changed, not only the length. It terminates because `weight` falls in every round but the last.
    After that round no action is in the previous cube or commutes with all of it, which is the
    definition of normal. `cubes` is any sequence of cubes, genuine or not; an edge path is given as
    cubes of one action. At most N(N + 1)/2 rounds, the weight of an edge path.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> TimeGeodesic([[a], [b], [a]]) == [[a, b], [a]]
    True
    >>> mended_time_geodesic([[a], [b], [a]]) == [[b]]
    True
    """
    path = genuine_cube_path(cubes)
    while True:
        following = genuine_cube_path(ShrinkCubePath(path))
        if following == path:
            return path
        path = following


def weight(cubes: Iterable[Sequence[Action]]) -> int:
    """Return the sum of i * dim(C_i), i from 1; it falls whenever ShrinkCubePath changes a path.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> weight([[a], [b]]), weight([[a, b]])
    (3, 2)
    """
    return sum(number * len(cube) for number, cube in enumerate(cubes, start=1))
