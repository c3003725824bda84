"""The chain rule: a straight chain of hexagons becomes another that begins where it ended.

Source: after J. Walter, J. Welch and N. Amato, Distributed reconfiguration of metamorphic robot
chains (PODC 2000; Distributed Computing 17, 2004). The rule itself is ours.

Words. The goal is g_0 ... g_(n-1), and the start lies on the line s_m = g_0 + m u: it ends at g_0,
one cell before it, or for short slides further on in the goal. *Static* are the goal cells and the
cells s_m with m > 0. A module on a goal cell stays forever, on s_m it waits, elsewhere it is a
*walker*. Walkers turn in a fixed sense, so they move along the static cells on one side, their
*track*: a bend has one, around its outer side; a slide has two, one for odd and one for even m. A
module at A claims the move about B to A' if B is static and

- (wait) from A = s_m: B is s_(m-1), and the cell E behind it (A' reflected in A) is free;
- (space) no walker is on the cell D' that follows A' in a turn about B, or A' is a goal cell, or
  the catalogue is the second: then walkers may close up, as E and E' are not in the support.

Why the chain reaches its goal. Let s_t ... s_1 and g_0 ... g_k be the static cells that are on, the
*tip* the last of them, and T the goal cell after the tip. Every move preserves these invariants:

1. There is no gap in them: only the tail s_t peels off, since a move of s_m needs F = s_(m+1) off;
   and walkers, being on the convex side, touch no free goal cell but T.
2. A walker beside the start row touches an s_j ahead of it that is on: when s_t leaves, the cells
   that touch only s_t and s_(t+1) are C and E of its move, so they are free.
3. With catalogue 1 walkers of a track are never side by side. After A' the track continues either
   straight, to E', which that catalogue wants off, or about B, to D'; walkers ahead only move on.

The rest of a support, E F C F' E', is five cells in a row on the second ring about B. The track is
on the convex side, so walkers can only be on E, just behind, or on E', just ahead. Thus the first
walker of a track can go: E is off by 3, or does not matter; ahead is nobody except, past A' = T, a
walker of the other side, which (space) allows. If there is no walker, the tail can peel off:
s_(t-1) or g_0 is on. So until the goal is reached some claim is made, the highest is executed, and
modules only go forward.

*Without rounds.* Its register says what a module has to do: which end of the goal is g_0, in which
of the six directions u leads, and m. It is written once, while the module stands at its start, and
read from then on, so a module that is started again anywhere continues as before.

*Start.* Which task a module has shows in the chain as it was at first, and others may have moved
before a slow module looks. So s_m writes its register only after s_(m-1) has written its own, and
moves only after it has written. The support of a move of s_m wants s_(m+1) off, so the first to
move is the tail, after all others have written: a module that has not yet written sees the start,
however late it sees it.

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

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules import vector_chain
from cubepath.agents.rules.chain_task import (
    ChainTask,
    beside_of,
    check_room,
    cross,
    goal_chain,
    minus,
    plus,
    tasks_from,
)
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.built_in_pages import page_catalogue


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


def make_free(knowledge: InitialKnowledge) -> Rule:
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
        return _begin_free(view, here, tasks, goals)

    return choose


def _begin_free(
    view: View, here: Cell, tasks: Sequence[ChainTask], goals: Sequence[Cell]
) -> Choice:
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


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module; InputError if it knows that the goal cannot be reached.

    The rest shows in the first view: whether the start is a straight chain and, if the module's
    cell is in line with both ends of the goal, which of them is g_0.
    """
    start = HEXAGONS.check(knowledge.start)
    goals = goal_chain(knowledge.goals, knowledge.modules)
    tasks = [] if start in goals else tasks_from(start, goals)
    check_room(knowledge.system, [start, *goals])
    begun: list[Rule] = []

    def choose(view: View) -> int | Choice:
        if not begun:
            beside = [cell for cell in beside_of(start) if cell in view.occupied]
            begun.append(_begin(start, goals, tasks, beside))
        return begun[0](view)

    return choose


def _begin(
    start: Cell, goals: tuple[Cell, ...], tasks: list[ChainTask], beside: list[Cell]
) -> Rule:
    for task in tasks:
        if task.begins(beside):
            return task.choose
    # From a goal cell the start continues along the goal, or leaves the goal at one of its ends.
    row = minus(goals[-1], goals[0])
    goes_on = all(not cross(minus(cell, start), row) for cell in beside)
    if start in goals and (goes_on or (len(beside) == 1 and start in (goals[0], goals[-1]))):
        return lambda _: STAY
    return lambda _: Choice(failed=vector_chain.no_chain_from(start))


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    if catalogue is None or catalogue.lattice != HEXAGONS:
        return False
    both = map(page_catalogue, ("hexagons-1", "hexagons-2"))
    # By content: a file may list generators and cells in another order.
    mine, one, other = (
        {move.action for move in known.proposals((0, 0))} for known in (catalogue, *both)
    )
    return mine in (one, other)


CHAIN = RuleType(
    name="chain",
    summary="a straight chain of hexagons walks round itself to become another one",
    source="after Walter, Welch and Amato, see cubepath.agents.rules.chain",
    fits=_fits,
    make=make,
    free=FreeRule(
        why="each commit is a move of the rule with rounds, where others hesitate; a guard keeps"
        " walkers apart",
        make=make_free,
        note_length=lambda _: len(StartNote._fields),
    ),
    vectorised=vector_chain.make,
)
