"""The straight chains that lead from one straight chain to any other, each by the rule `chain`.

A chain slides along its line by at most its length at a time, and bends about one of its ends. To
a goal on another line it slides until an end is where the lines cross, bends, and slides on. To a
parallel goal it bends twice, onto a line across both and off it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from cubepath.agents.rules.chain_task import ChainTask, along, cross, minus, plus
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, Cell


class Row(NamedTuple):
    """A straight chain: its first cell, the direction of the others, and how many there are."""

    first: Cell
    ahead: Cell
    size: int

    @property
    def last(self) -> Cell:
        """Return the other end."""
        return plus(self.first, self.ahead, self.size - 1)

    @property
    def cells(self) -> list[Cell]:
        """Return the cells in order."""
        return [plus(self.first, self.ahead, place) for place in range(self.size)]

    @property
    def backwards(self) -> Row:
        """Return the same cells in reverse order."""
        return Row(self.last, minus((0, 0), self.ahead), self.size)

    def meets(self, point: Cell, way: Cell) -> Cell:
        """Return where its line crosses the line through a cell in another direction."""
        # Two of the six directions that are not parallel have the cross product 1 or -1.
        steps = cross(minus(point, self.first), way) * cross(self.ahead, way)
        return plus(self.first, self.ahead, steps)


Stages = tuple[ChainTask, ...]
"""The tasks of the tails, one for each chain on the way; `steps` says how many modules walk."""


def routes(start: Row, goal: Row) -> list[Stages]:
    """Return ways from one straight chain to another, from the one with the fewest stages on.

    Among as many stages those where fewer modules walk come first.

    >>> [len(routes(Row((0, 0), (1, 0), 6), goal)[0]) for goal in (
    ...     Row((9, 0), (1, 0), 6), Row((3, -2), (0, 1), 6), Row((1, 2), (1, 0), 6))]
    [2, 3, 4]
    """
    found = (
        tuple(stages) for corners in _corners(start, goal) for stages in _ways(start, corners, goal)
    )
    return sorted(found, key=lambda stages: (len(stages), sum(task.steps for task in stages)))


_Corners = Sequence[tuple[Cell, Cell]]
"""Where a chain bends, and a direction of the line that it then lies on."""


def _corners(start: Row, goal: Row) -> Iterator[_Corners]:
    """Yield where a chain may bend on the way."""
    if cross(start.ahead, goal.ahead):
        yield [(start.meets(goal.first, goal.ahead), goal.ahead)]
    elif not cross(minus(goal.first, start.first), start.ahead):
        yield []
    else:
        # With the line across through an end of the start or the goal, one slide is not needed.
        for way in HEX_DIRECTIONS[:3]:
            for end in (start.first, start.last, goal.first, goal.last):
                if cross(way, start.ahead):
                    yield [(start.meets(end, way), way), (goal.meets(end, way), goal.ahead)]


def _ways(row: Row, corners: _Corners, goal: Row) -> Iterator[list[ChainTask]]:
    """Yield the ways by these corners, about either end and to either side of a line."""
    if not corners:
        same = goal if goal.ahead == row.ahead else goal.backwards
        yield _slides(row, same.first)
        return
    (corner, way), *others = corners
    for one in (row, row.backwards):
        for ahead in (way, minus((0, 0), way)):
            bend = ChainTask(corner, ahead, row.size, one.ahead, row.size - 1)
            for following in _ways(Row(corner, ahead, row.size), others, goal):
                yield [*_slides(one, corner), bend, *following]


def _slides(row: Row, first: Cell) -> list[ChainTask]:
    """Return the slides that take the first cell of a row to another on its line."""
    distance, ahead = along(row.first, first)
    if ahead is None:
        return []
    away, tail = minus((0, 0), ahead), (row if ahead == row.ahead else row.backwards).first
    found = []
    for done in range(0, distance, row.size):
        steps = min(row.size, distance - done)
        tail = plus(tail, ahead, steps)
        found.append(ChainTask(tail, ahead, row.size, away, steps))
    return found
