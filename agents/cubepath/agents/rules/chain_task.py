"""What the modules of a chain have to do: the geometry of the rule `chain`.

The docstring of `chain` has the words, and why the chain reaches its goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cubepath.agents.local.observation import STAY, View
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System


def plus(one: Cell, other: Cell, times: int = 1) -> Cell:
    """Return one cell moved by this many times another."""
    return one[0] + times * other[0], one[1] + times * other[1]


def minus(one: Cell, other: Cell) -> Cell:
    """Return how one cell lies from another."""
    return plus(one, other, -1)


def cross(one: Cell, other: Cell) -> int:
    """Return the cross product: its sign says on which side of the one the other lies."""
    return one[0] * other[1] - one[1] * other[0]


def beside_of(cell: Cell) -> list[Cell]:
    """Return the six cells about a cell."""
    return [plus(cell, direction) for direction in HEX_DIRECTIONS]


def along(origin: Cell, cell: Cell) -> tuple[int, Cell | None]:
    """Return the distance to `cell`, and its direction if that is one of the six."""
    q, r = minus(cell, origin)
    steps = max(abs(q), abs(r), abs(q + r))
    unit = (q // steps, r // steps) if steps else (0, 0)
    return steps, unit if unit in HEX_DIRECTIONS and plus(origin, unit, steps) == cell else None


@dataclass(frozen=True, slots=True)
class ChainTask:
    """The task of a module that starts off the goal, at head + steps * away (g_0 and u)."""

    head: Cell
    ahead: Cell
    count: int
    away: Cell
    steps: int

    @property
    def sense(self) -> int:
        """Return in which sense a walker turns about its pivots, as the sign of `cross`."""
        return cross(self.ahead, self.away) or (1 if self.steps % 2 else -1)

    def is_goal(self, cell: Cell) -> bool:
        """Return whether this is a cell of the goal."""
        steps, unit = along(self.head, cell)
        return not steps or (unit == self.ahead and steps < self.count)

    def is_static(self, cell: Cell) -> bool:
        """Return whether this is a cell of the goal, or of the line of the start."""
        return self.is_goal(cell) or along(self.head, cell)[1] == self.away

    def choose(self, view: View) -> int:
        """Return the action that `chain` describes; there is never more than one."""
        return self.guarded(view)[0]

    def guarded(self, view: View) -> tuple[int, tuple[Cell, ...]]:
        """Return that action, and the cells that must be free for it although no support says so.

        They are the E and D' of (wait) and (space).
        """
        here = HEXAGONS.check(view.site)
        if self.is_goal(here):
            return STAY, ()
        sense, waits = self.sense, self.is_static(here)
        for action, move in view.legal():
            there = HEXAGONS.check(move.target)
            (pivot,) = map(HEXAGONS.check, move.action.ends[0] & move.action.ends[1])
            step, arm = minus(there, here), minus(pivot, here)
            if cross(step, arm) != sense or not self.is_static(pivot):
                continue
            behind, follows = minus(here, step), plus(there, arm)
            if waits and (pivot != minus(here, self.away) or behind in view.occupied):
                continue
            spaced = not (
                self.is_static(follows) or self.is_goal(there) or behind not in move.action.support
            )
            if not spaced or follows not in view.occupied:
                return action, (behind,) * waits + (follows,) * spaced
        return STAY, ()

    def begins(self, beside: list[Cell]) -> bool:
        """Return whether these are the neighbours in a straight start chain."""
        before, after = (plus(self.head, self.away, self.steps + side) for side in (-1, 1))
        joined = before in beside or (self.steps == 1 and after in beside)  # g_0 may be free
        return joined and {before, after}.issuperset(beside)


def goal_chain(sites: Sequence[Site], modules: int) -> tuple[Cell, ...]:
    """Return the cells of the goal in order; InputError if they are no straight chain."""
    goals = tuple(HEXAGONS.check(site) for site in sites)
    if len(goals) != modules:
        raise InputError(f"rule 'chain': {modules} modules, found {len(goals)} goal cells")
    ahead = along(goals[0], goals[-1])[1] or (0, 0)
    line = tuple(plus(goals[0], ahead, place) for place in range(len(goals)))
    if goals != line or len(set(goals)) < len(goals):
        raise InputError(f"rule 'chain': {goals[0]} to {goals[-1]} is no straight chain in order")
    return goals


def tasks_from(start: Cell, goals: tuple[Cell, ...]) -> list[ChainTask]:
    """Return the tasks with this start, from either end of the goal: two in a few triangles."""
    count, found = len(goals), []
    if count == 1:
        raise InputError("rule 'chain': one module alone has nothing to pivot about")
    for chain in (goals, goals[::-1]):
        head, ahead = chain[0], minus(chain[1], chain[0])
        steps, away = along(head, start)
        if away is not None and away != ahead and steps <= count:
            found.append(ChainTask(head, ahead, count, away, steps))
    if not found:
        raise InputError(f"rule 'chain': no goal end is in line with {start} within {count} cells")
    return found


def check_room(system: System, cells: list[Cell]) -> None:
    """Raise InputError if a place is missing within two cells about one of these."""
    # The open plane has room, so n modules need not check n cells each.
    if system.open:
        return
    for near in (near for cell in cells for one in beside_of(cell) for near in beside_of(one)):
        if not system.has_place(near):
            raise InputError(f"rule 'chain' needs room two cells about, found none at {near}")
