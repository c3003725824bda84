"""The rule `chain` without rounds.

`chain` has the rule, its words, and why it reaches the goal.

Its register says what a module has to do: which end of the goal is g_0, in which of the six
directions u leads, and m. It is written once, while the module stands at its start, and read from
then on, so a module that is started again anywhere goes on as before.

*Start.* Which task a module has shows in the chain as it was at first, and others may have moved
before a slow module looks. So s_m writes its register only after s_(m-1) has written its own, and
moves only after it has written. The support of a move of s_m wants s_(m+1) off, so the first to
move is the tail, after all others have written: whoever has not yet written sees the start, however
late it sees it.

*Moves.* A commit is a move of the rule with rounds, in a round in which all others hesitate. What
the rule asks of other cells holds when it is committed, not only when it was seen: B is in the
support, the static cells are known, and where E of (wait) or D' of (space) is not in the support it
is a guard. Without it two walkers that see each other late come side by side, and are stuck. So the
invariants hold after each commit. Modules only go forward, so commits are finite in number. While
there is none, everybody comes to see what holds; then somebody has a move, and it is committed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from cubepath.agents.local.observation import View
from cubepath.agents.rules.chain_task import (
    ChainTask,
    beside_of,
    check_room,
    goal_chain,
    minus,
    plus,
    tasks_from,
)
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError


class StartNote(NamedTuple):
    """What a module off the goal has found at its start."""

    backwards: int
    """1 if the last of its goals is g_0."""
    away: int
    """Which of `HEX_DIRECTIONS` is u."""
    steps: int
    """m."""

    def task(self, goals: Sequence[Cell]) -> ChainTask:
        """Return the task with these goals in order."""
        chain = goals[::-1] if self.backwards else goals
        ahead = minus(chain[1], chain[0])
        return ChainTask(chain[0], ahead, len(chain), HEX_DIRECTIONS[self.away], self.steps)


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module; InputError if it knows that the goal cannot be reached.

    The rest shows at the start: then it gives up.
    """
    goals = goal_chain(knowledge.goals, knowledge.modules)
    system = knowledge.system
    if len(goals) == 1 and HEXAGONS.check(knowledge.start) not in goals:
        raise InputError("rule 'chain': one module alone has nothing to pivot about")
    check_room(system, list(goals))

    def choose(view: View) -> Choice:
        here = HEXAGONS.check(view.site)
        if here in goals:
            return Choice()
        if view.register is not None:
            action, guards = StartNote(*view.register).task(goals).guarded(view)
            return Choice(action, guards=guards)
        try:
            check_room(system, [here])
            tasks = tasks_from(here, goals)
        except InputError as error:
            return Choice(failed=str(error))
        return _begin(view, here, tasks, goals)

    return choose


def _begin(view: View, here: Cell, tasks: Sequence[ChainTask], goals: Sequence[Cell]) -> Choice:
    """Write the register, if it is time to."""
    beside = [cell for cell in beside_of(here) if cell in view.occupied]
    for task in tasks:
        if task.begins(beside):
            before = plus(task.head, task.away, task.steps - 1)
            if task.steps > 1 and before not in view.notes:
                return Choice()
            away = HEX_DIRECTIONS.index(task.away)
            return Choice(note=StartNote(int(task.head != goals[0]), away, task.steps))
    return Choice(failed=f"no straight chain leads from {here} to an end of the goal")
