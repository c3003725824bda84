"""The rule `tunnel`: a line of hexagons in a channel of four rows climbs along to its goal.

Source: own, after Ardila, Bastidas, Ceballos and Guo, The configuration space of a robotic arm in a
tunnel (2017); the scene is `hex-tunnel`, whose lower free row has the line and the goal, a straight
part of that row.

*Direction.* The line's left end, the module in the lower row with no other to its left, sees where
the goal lies: right if the goal begins no further left than the end does, once those in the upper
row have come down; else left. It says so in its note, 1 or -1; every other module says what the one
to its left, or one below it, said. A module that has not heard the direction waits.
*Moves.* With the goal to the right, the module at the left end climbs if it is not on a goal cell,
and if no module is on the upper row next to where it comes to stand. A module on the upper row goes
right, and comes down at the right end. With the goal to the left it is the mirror image.

Why it leads to the goal. The direction does not change while the goal is not reached: the line
moves by one column for each module that goes from one end to the other, and never past the goal.
Modules on the upper row keep two cells apart, so none is stuck: the first of them goes to the end
and comes down. While there is none, the end climbs, unless all are on goal cells. Each move brings
a module one step further, so they are finite in number, hesitation and lost claims or not. If the
line begins with modules on the upper row next to one another, the one behind goes back down first,
if it can.

*Why notes.* No radius suffices to tell from one view alone whether a move leads towards the goal.
Take n > 2 r + 3 modules, one on the upper row in the middle of n - 1 in the lower, at columns a to
a + n - 2, and let the goal begin at column g. For a = g the module has to go right, and the line is
then at g; for a = g + 1 it has to go left. Both states belong to one component if the channel has a
free column to the right of the goal. If the upper module is at the same cell in both, all that it
sees within distance r is the same. So it has to hear from an end. A run that begins to the left of
the goal never meets the second kind of state.

Without rounds the notes are the same; nobody comes to stand to the left of a module that has said
that the goal lies to the right, so what was said of an earlier view still holds. A walk reads that
the cell ahead of its target is free, and a climb guards that, so modules on the upper row stay
apart. A module keeps nothing in mind.
"""

from __future__ import annotations

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, RuleType
from cubepath.protocol.core.catalogue import HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.built_in_pages import page_catalogue

_UNKNOWN = 0
"""In a note: the direction is not known."""


def _across(cell: Cell) -> int:
    """Return how far right a cell lies, in half columns."""
    return 2 * cell[0] + cell[1]


class _Module:
    """A module of the line, whose goal begins at a cell of the lower row."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        self._goals = sorted(map(HEXAGONS.check, knowledge.goals))
        rows = {row for _, row in self._goals}
        if len(rows) != 1 or self._goals[-1][0] - self._goals[0][0] != len(self._goals) - 1:
            raise InputError("rule 'tunnel' needs a goal that is a straight part of one row")
        self._begin, self._row = self._goals[0]

    def __call__(self, view: View) -> Choice:
        here = HEXAGONS.check(view.site)
        way = self._direction(view, here)
        legal = view.legal() if way else []
        found = (
            Choice(action, (way,), guards=guards)
            for action, move in legal
            if (guards := self._guards(view, here, HEXAGONS.check(move.target), way)) is not None
        )
        return next(found, Choice(STAY, (way,)))

    def _direction(self, view: View, here: Cell) -> int:
        """Return 1 if the goal lies to the right, -1 if to the left."""
        q, r = here
        left = (q - 1, r) if r == self._row else (q, r - 1)
        for cell in (left,) if r == self._row else (left, (q + 1, r - 1)):
            if view.notes.get(cell, (_UNKNOWN,))[0]:
                return view.notes[cell][0]
        if r != self._row or left in view.occupied:
            return _UNKNOWN
        return 1 if q <= self._begin else -1

    def _guards(self, view: View, here: Cell, there: Cell, way: int) -> tuple[Cell, ...] | None:
        """Return what a move relies on apart from its support; None if it is not to be made."""
        ahead = there[0] + way, there[1]
        onward = (_across(there) - _across(here)) * way > 0
        if here[1] == self._row:
            free = ahead not in view.occupied
            return (ahead,) if onward and free and here not in self._goals else None
        stuck = (here[0] + way, here[1]) in view.occupied
        return () if onward or (stuck and there[1] == self._row) else None


def _fits(system: System) -> bool:
    """Return whether the moves are the tunnel's, in a channel with a floor and a ceiling."""
    walls = bool(system.filled and system.empty)
    return walls and system.catalogue == page_catalogue("hexagons-tunnel")


TUNNEL = RuleType(
    name="tunnel",
    summary="hexagons in a channel climb over one another, towards where the end says the goal is",
    source="own, after Ardila, Bastidas, Ceballos and Guo; see cubepath.agents.rules.tunnel",
    fits=_fits,
    make=_Module,
    note_length=lambda _: 1,
    free=FreeRule(
        why="the direction never changes, and a guard keeps modules on the upper row apart",
        note_length=lambda _: 1,
    ),
)
