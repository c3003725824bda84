"""The least number of cubes between two states over all homotopy classes, by exhaustive search.

Breadth first from both ends, a round at a time, where a round is any non-empty set of commuting
moves. Maximal sets alone are not enough: a vehicle that is already at its goal, with a free place
beside it, would have to leave in the first round. Single moves alone would minimise something else.
"""

from dataclasses import dataclass

from cubepath.coordinator.theory.search.budget import SpentError
from cubepath.coordinator.theory.search.transitions import Transitions

MAX_STATES = 100_000
"""The default bound on the number of states."""
_BITS_MAX = 1 << 31
"""The bound on the size of all states together, in bits."""

Parents = dict[int, tuple[int, tuple[int, ...]]]
"""For each state that was found, the one before it and the cube between them; () at the start."""


@dataclass(frozen=True, slots=True)
class Optimum:
    """The result of an exhaustive search: no path has fewer cubes than `at_least`.

    `cubes` is a shortest cube path, each cube as the numbers of its moves in `Transitions`, or None
    if a bound stopped the search first. Then only `at_least` is known. `states` is the number of
    states that were found.
    """

    at_least: int
    cubes: tuple[tuple[int, ...], ...] | None
    states: int


def optimum(
    steps: Transitions,
    start: int,
    goal: int,
    *,
    max_states: int = MAX_STATES,
    most: int | None = None,
    still: int = 0,
) -> Optimum:
    """Return a cube path from `start` to `goal` with the fewest cubes, if the bounds allow it.

    Why no path has fewer. After `a` rounds from the start and `b` from the goal, all states within
    these distances are known, and none is known from both sides, so no path has a + b cubes or
    fewer. The first state that the next round finds on the other side gives a path of a + b + 1.

    The search ends as soon as all paths are known to have more than `most` cubes. It keeps at most
    about `max_states` states, and fewer if they are large; a round of the search is either
    completed or does not count. Looking at one set of moves is a step of the budget of `steps`;
    the search stops when the budget is spent.
    Sites of `still` are not written, so paths are those of the other modules alone.
    If the goal cannot be reached at all, one side runs out of states, and the answer is the same as
    if the search was stopped.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> moves = Transitions(scene.system)
    >>> found = optimum(moves, moves.encode(scene.start_state), moves.encode(scene.goal))
    >>> len(found.cubes), found.at_least
    (3, 3)
    """
    if start == goal:
        return Optimum(0, (), 1)
    sides: tuple[Parents, Parents] = ({start: (start, ())}, {goal: (goal, ())})
    fronts = [[start], [goal]]
    depth = 0
    while fronts[0] and fronts[1]:
        if most is not None and depth >= most:
            break
        side = 0 if len(fronts[0]) <= len(fronts[1]) else 1
        known = len(sides[0]) + len(sides[1])
        room = min(max_states, _BITS_MAX // max(1, len(steps.sites))) - known
        try:
            met = _round(steps, fronts, sides, side, (room, still))
        except SpentError:
            break
        if met is not None and met >= 0:
            path = (*back(sides[0], met)[::-1], *back(sides[1], met))
            return Optimum(len(path), path, len(sides[0]) + len(sides[1]))
        if met is None:
            break
        depth += 1
    return Optimum(depth + 1, None, len(sides[0]) + len(sides[1]))


_NOT_MET = -1


def _round(
    steps: Transitions,
    fronts: list[list[int]],
    sides: tuple[Parents, Parents],
    side: int,
    limits: tuple[int, int],
) -> int | None:
    """Advance one side by a round.

    `limits` is the number of states that there is room for, and the sites that stay still. Return
    the state where it meets the other side, `_NOT_MET`, or None if the room is used up.
    """
    room, still = limits
    mine, other = sides[side], sides[1 - side]
    found: list[int] = []
    for state in fronts[side]:
        widest = len(steps.greedy(steps.possible(state, still)))
        # All subsets of a commuting set lead to different states: too many, so do not begin.
        if 1 << widest > room + len(mine):
            return None
        for there, cube in steps.cubes(state, still):
            steps.budget.spend()
            if there in mine:
                continue
            mine[there] = state, cube
            if there in other:
                return there
            found.append(there)
            if len(found) > room:
                return None
    fronts[side] = found
    return _NOT_MET


def back(parents: Parents, state: int) -> list[tuple[int, ...]]:
    """Return the cubes by which a state was found, the last one first."""
    found: list[tuple[int, ...]] = []
    while parents[state][1]:
        state, cube = parents[state]
        found.append(cube)
    return found
