"""The chain rule: a straight chain of hexagons becomes another that begins where it ended.

Room: agents. Source: after J. Walter, J. Welch and N. Amato, Distributed reconfiguration of
metamorphic robot chains (PODC 2000; Distributed Computing 17, 2004). The rule itself is ours.

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
3. With catalogue 1 walkers of a track are never side by side. After A' the track goes on either
   straight, to E', which that catalogue wants off, or about B, to D'; walkers ahead only move on.

The rest of a support, E F C F' E', is five cells in a row on the second ring about B. The track is
on the convex side, so walkers can only be on E, just behind, or on E', just ahead. Thus the first
walker of a track can go: E is off by 3, or does not matter; ahead is nobody except, past A' = T, a
walker of the other side, which (space) allows. If there is no walker, the tail can peel off:
s_(t-1) or g_0 is on. So until the goal is reached some claim is made, the highest is executed, and
modules only go forward.
"""

from __future__ import annotations

from dataclasses import dataclass

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.families.hexagons import hex_catalogue


def _plus(one: Cell, other: Cell, times: int = 1) -> Cell:
    return one[0] + times * other[0], one[1] + times * other[1]


def _minus(one: Cell, other: Cell) -> Cell:
    return _plus(one, other, -1)


def _cross(one: Cell, other: Cell) -> int:
    return one[0] * other[1] - one[1] * other[0]


def _beside(cell: Cell) -> list[Cell]:
    return [_plus(cell, direction) for direction in HEX_DIRECTIONS]


def _along(origin: Cell, cell: Cell) -> tuple[int, Cell | None]:
    """Return the distance to `cell`, and its direction if that is one of the six."""
    q, r = _minus(cell, origin)
    steps = max(abs(q), abs(r), abs(q + r))
    unit = (q // steps, r // steps) if steps else (0, 0)
    return steps, unit if unit in HEX_DIRECTIONS and _plus(origin, unit, steps) == cell else None


@dataclass(frozen=True, slots=True)
class _Task:
    """The task of a module that starts off the goal, at head + steps * away (g_0 and u)."""

    head: Cell
    ahead: Cell
    count: int
    away: Cell
    steps: int

    def is_goal(self, cell: Cell) -> bool:
        steps, unit = _along(self.head, cell)
        return not steps or (unit == self.ahead and steps < self.count)

    def is_static(self, cell: Cell) -> bool:
        return self.is_goal(cell) or _along(self.head, cell)[1] == self.away

    def choose(self, view: View) -> int:
        """Return the action that this file's docstring describes; there is never more than one."""
        here = HEXAGONS.check(view.site)
        if self.is_goal(here):
            return STAY
        sense = _cross(self.ahead, self.away) or (1 if self.steps % 2 else -1)
        waits = self.is_static(here)
        for action, move in view.legal():
            there = HEXAGONS.check(move.target)
            (pivot,) = map(HEXAGONS.check, move.action.ends[0] & move.action.ends[1])
            step, arm = _minus(there, here), _minus(pivot, here)
            if _cross(step, arm) != sense or not self.is_static(pivot):
                continue
            behind, follows = _minus(here, step), _plus(there, arm)
            if waits and (pivot != _minus(here, self.away) or behind in view.occupied):
                continue
            crowds = follows in view.occupied and not self.is_static(follows)
            if not crowds or self.is_goal(there) or behind not in move.action.support:
                return action
        return STAY

    def begins(self, beside: list[Cell]) -> bool:
        """Return whether these are the neighbours in a straight start chain."""
        before, after = (_plus(self.head, self.away, self.steps + side) for side in (-1, 1))
        joined = before in beside or (self.steps == 1 and after in beside)  # g_0 may be free
        return joined and {before, after}.issuperset(beside)


def _goal_chain(knowledge: InitialKnowledge) -> tuple[Cell, ...]:
    goals = tuple(HEXAGONS.check(site) for site in knowledge.goals)
    if len(goals) != knowledge.modules:
        raise InputError(
            f"rule 'chain': {knowledge.modules} modules, found {len(goals)} goal cells"
        )
    ahead = _along(goals[0], goals[-1])[1] or (0, 0)
    line = tuple(_plus(goals[0], ahead, place) for place in range(len(goals)))
    if goals != line or len(set(goals)) < len(goals):
        raise InputError(f"rule 'chain': {goals[0]} to {goals[-1]} is no straight chain in order")
    return goals


def _tasks(start: Cell, goals: tuple[Cell, ...]) -> list[_Task]:
    """Return the tasks with this start, from either end of the goal: two in a few triangles."""
    count, found = len(goals), []
    if count == 1:
        raise InputError("rule 'chain': one module alone has nothing to pivot about")
    for chain in (goals, goals[::-1]):
        head, ahead = chain[0], _minus(chain[1], chain[0])
        steps, away = _along(head, start)
        if away is not None and away != ahead and steps <= count:
            found.append(_Task(head, ahead, count, away, steps))
    if not found:
        raise InputError(f"rule 'chain': no goal end is in line with {start} within {count} cells")
    return found


def _check_room(system: System, cells: list[Cell]) -> None:
    # The open plane has room, so n modules need not check n cells each.
    if system.open:
        return
    for near in (near for cell in cells for one in _beside(cell) for near in _beside(one)):
        if not system.has_place(near):
            raise InputError(f"rule 'chain' needs room two cells about, found none at {near}")


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module; InputError if it knows that the goal cannot be reached.

    The rest shows in the first view: whether the start is a straight chain and, if the module's
    cell is in line with both ends of the goal, which of them is g_0.
    """
    start, goals = HEXAGONS.check(knowledge.start), _goal_chain(knowledge)
    tasks = [] if start in goals else _tasks(start, goals)
    _check_room(knowledge.system, [start, *goals])
    begun: list[Rule] = []

    def choose(view: View) -> int | Choice:
        if not begun:
            beside = [cell for cell in _beside(start) if cell in view.occupied]
            begun.append(_begin(start, goals, tasks, beside))
        return begun[0](view)

    return choose


def _begin(start: Cell, goals: tuple[Cell, ...], tasks: list[_Task], beside: list[Cell]) -> Rule:
    for task in tasks:
        if task.begins(beside):
            return task.choose
    # From a goal cell the start continues along the goal, or leaves the goal at one of its ends.
    row = _minus(goals[-1], goals[0])
    goes_on = all(not _cross(_minus(cell, start), row) for cell in beside)
    if start in goals and (goes_on or (len(beside) == 1 and start in (goals[0], goals[-1]))):
        return lambda _: STAY
    return lambda _: Choice(failed=f"no straight chain leads from {start} to an end of the goal")


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    if catalogue is None or catalogue.lattice != HEXAGONS:
        return False
    both = (hex_catalogue(keeps_topology=keeps) for keeps in (True, False))
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
)
