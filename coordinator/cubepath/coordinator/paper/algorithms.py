"""The paper's algorithms as they are printed, under their own names, and what mends them.

Source: Abrams and Ghrist, State Complexes for Metamorphic Robots, section "Optimizing paths":
algorithms TimeGeodesic and ShrinkCubePath, subroutines Commute, ExciseTrivial and CommonEdge. A
cube is the list of its actions, a cube path the list of its cubes; the state is left out, as in
the paper. This is the reference to read and to compare with;
`cubepath.coordinator.normal_form.heap` does the work.

Where the printed text falls short, and what `mended_time_geodesic` does about it:

- It asks for a genuine cube path, in which consecutive cubes share no edge. The edge path of a run
  may step back and forth, and is none. `genuine_cube_path` makes it one first.
- The last pair of cubes never comes to `CommonEdge`, for line 9 stops before i reaches the last
  cube and line 6 looks back. So ``[a], [a]`` comes out unchanged, and the genuine cube path
  ``[a], [b], [a]`` with commuting a and b comes out as ``[a, b], [a]``, which has a common edge,
  where the normal cube path is ``[b]``.
- TimeGeodesic stops when a call has not changed the length. With a common edge inside, that can be
  too early: one vehicle takes three steps out along a path, the same three back and then one step
  the other way, a second walks six steps on a path of its own; of seven cubes, the i-th holds the
  i-th step of each. The first call cancels the two steps in the middle and keeps seven cubes; the
  normal cube path has six.
- A genuine cube path to start with does not help: a call may itself leave a common edge inside,
  where cubes have vanished and their neighbours meet. The tests hold a genuine path of ten cubes
  of which the printed text to the letter makes seven where the normal cube path has six.
  What does hold: if a call leaves the length of a *genuine* cube path as it is, then no path of the
  class is shorter. For then each cube holds an action that one of the cube before did not let pass,
  down from the last cube to the first, and neither can cancel: their equals would have to pass the
  other.
- What TimeGeodesic returns when it does succeed is a shortest cube path, not yet the normal one:
  that is the fixed point of ShrinkCubePath. `mended_time_geodesic` goes on until nothing changes.
- Its cost is argued from the sum of the dimensions, which is said to fall in every loop. Commute
  keeps that sum, only cancellation lowers it. What falls whenever something changes is the sum of
  i * dim(C_i), as the proof of the theorem says: see `weight`.
- What i is after ExciseTrivial has taken cubes out and reindexed the path is not said. `READINGS`
  has four answers. ``[a], [b], [a]`` comes out with two cubes in each of them. The path of ten
  cubes comes out with seven where i keeps its value or goes to the next cube, and with six, as it
  should, where i steps back or is 1 again. In no reading is the result ever too short.

The star condition of the definition is to be read at the vertex between two cubes, in the universal
cover: see `cubepath.coordinator.normal_form.definitions.is_normal`. That is what Commute does, by
the lemma beside it.

Coordinator; touches nothing. The paper counts cubes from 1, the code from 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

from cubepath.protocol.core.actions import Action, commute

Cube: TypeAlias = list[Action]
"""A cube: its actions, in the order in which they came to it."""
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

    The paper gathers the supports and traces of the cube first; being disjoint from all of them
    together and from each is the same, and `commute` is the one definition.
    """
    return [action for action in following if all(commute(other, action) for other in cube)]


def ExciseTrivial(path: CubePath, *places: int) -> None:  # noqa: N802 - the paper's name
    """Take the cubes at these places out of the path, in place, where they are empty lists.

    Later cubes move up (subroutine ExciseTrivial).
    """
    for place in sorted(places, reverse=True):
        if not path[place]:
            del path[place]


def CommonEdge(path: CubePath, before: int, place: int) -> None:  # noqa: N802 - the paper's name
    """Delete from both the actions that the cubes at these places share (subroutine CommonEdge).

    The same move at the end of one cube and the start of the next is a step there and back. May
    leave a cube empty.
    """
    common = set(path[before]).intersection(path[place])
    if common:
        path[before] = [action for action in path[before] if action not in common]
        path[place] = [action for action in path[place] if action not in common]


def ShrinkCubePath(  # noqa: N802 - the paper's name
    cubes: Iterable[Iterable[Action]], reading: Reading = "keeps"
) -> CubePath:
    """Return the cube path after one call of algorithm ShrinkCubePath, as printed.

    What commutes with a cube moves into it from the next one. Numbers are the lines of the paper,
    and `reading` says what i is after cubes have been taken out. The input is left as it is.
    Shrinking a path that is already normal changes nothing.
    """
    path = [list(cube) for cube in cubes]
    i = 0  # 1
    while i + 1 < len(path):  # 9: a cube that is not there is empty
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
    """Return what i is after the cube before it, or its own, or both have been taken out."""
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
    """Return what algorithm TimeGeodesic makes of a cube path, as printed.

    A homotopic path, never longer, and the shortest unless a common edge is inside before the last
    call: the module's docstring says when. An edge path is given as cubes of one action. Costs O(N)
    calls of ShrinkCubePath, each of O(N) calls of Commute unless i restarts.

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
    """Return the path after all cancellation of common edges of consecutive cubes.

    What is left is a cube path by the paper's definition: no cube is empty and no two consecutive
    ones share an edge. CommonEdge and ExciseTrivial for every pair, the last one included, and for
    the pairs that come together when a cube between them vanishes.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> genuine_cube_path([[a], [b], [b], [a]])
    []
    """
    path: CubePath = []
    for cube in cubes:
        path.append(list(cube))
        # When a cube vanishes, the last one meets the one before that.
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

    Before and after every call the path is made genuine, and the stop rule asks whether
    anything changed, not only the length. It comes to an end because `weight` falls in every round
    but the last. There no action commutes with all of the cube before or is in it, which is the
    definition of normal. `cubes` is any sequence of cubes, genuine or not; an edge path is given
    as cubes of one action. Up to N(N + 1)/2 rounds, the weight of an edge path.

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
    """Return the sum of i * dim(C_i), i from 1: what falls whenever ShrinkCubePath changes a path.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> weight([[a], [b]]), weight([[a, b]])
    (3, 2)
    """
    return sum(number * len(cube) for number, cube in enumerate(cubes, start=1))
