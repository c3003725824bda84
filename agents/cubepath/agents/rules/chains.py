"""The rule `chains`: a straight chain of hexagons becomes any other, by way of straight chains.

Source: own, by the rule `chain` in stages; see there for its words and why a stage reaches its end.

*Stages.* From the start and the goal every module derives the same `routes`, and takes the first
for which there is room. Stage 1 leads from the start to the first chain on the way, and so on.
*Start.* In stage 0 modules learn the start. The first module of the chain, by the order of
directions, sees that it is the first, and says which row of cells the start is. Another repeats
that once the one before it has, if the row is what it sees beside it.
*End of a stage.* A chain is filled in order, so if a module is on the last cell, all others have
arrived: it goes to the next stage. So does a module that hears of a later stage than its own.
*Moves.* A module does what `chain` asks of it. It leaves the row of the stage only after the one
before it has said that it is in this stage, too.

A note has the stage, how far from g_0 the module stood when it learned of it (m in `chain`), and
the first cell and the direction of the start. A module keeps its last note, and what follows from
it. It senses what `chain` does.

Why it leads to the goal. A stage begins when all modules stand on its row, since who says so was on
the last cell. A module that has not heard of it yet stands still, as if it hesitated, and `chain`
allows that; it has not moved since, so its m is right however late it learns it. It does learn it:
while it stands on the row, so do its neighbours, as the one behind waits for it, and the news goes
along the row. So every stage ends, under hesitation and lost claims.

Without rounds a note is a register, what it says stays true, and a module keeps nothing else, so
late views and restarts only delay. The end of stage 0 says that all have seen the start, and nobody
moves earlier. A module is on the last cell of its stage by its own site, which is never out of
date. Moves have the guards of `chain`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from cubepath.agents.local.observation import View
from cubepath.agents.rules import chain
from cubepath.agents.rules.chain_route import Row, Stages, routes
from cubepath.agents.rules.chain_task import along, beside_of, check_room, goal_chain, minus, plus
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System


class Progress(NamedTuple):
    """How far a module knows that the chain is, as a note."""

    stage: int
    """The stage, from 0."""
    steps: int
    """How far from g_0 the module stood when it learned of the stage."""
    q: int
    """The first cell of the start."""
    r: int
    """Its other coordinate."""
    direction: int
    """Which of `HEX_DIRECTIONS` leads along the start."""

    def start(self, count: int) -> Row:
        """Return the start, which has this many cells."""
        return Row((self.q, self.r), HEX_DIRECTIONS[self.direction], count)


class _Module:
    """Decides by what it sees, and the last note that it gave."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        goals = goal_chain(knowledge.goals, knowledge.modules)
        if len(goals) == 1 and HEXAGONS.check(knowledge.start) not in goals:
            raise InputError("rule 'chains': one module alone has nothing to pivot about")
        self._system = knowledge.system
        self._count = len(goals)
        self._goal = Row(goals[0], along(goals[0], goals[-1])[1] or (0, 0), len(goals))
        self._stages = lru_cache(maxsize=1)(self._with_room)

    def choose(self, view: View, known: Progress | None) -> Choice:
        """Go to the next stage, or move in this one."""
        here = HEXAGONS.check(view.site)
        if self._count == 1:
            return Choice()
        if known is None:
            return self._begun(view, here)
        start = known.start(self._count)
        stages = self._stages(start)
        heard = [note[0] for note in view.notes.values()]
        ended = known.stage < len(stages) and here == _last(start, stages, known.stage)
        stage = max(known.stage + ended, *heard, 0)
        if stage > known.stage:
            steps, _ = along(stages[stage - 1].head, here)
            return Choice(note=known._replace(stage=stage, steps=steps))
        if not stage:
            return Choice()
        task = replace(stages[stage - 1], steps=known.steps)
        before = view.notes.get(minus(here, task.away), (0,))
        if task.is_static(here) and before[0] < stage:
            return Choice()
        action, guards = task.guarded(view)
        return Choice(action, guards=guards)

    def _begun(self, view: View, here: Cell) -> Choice:
        """Learn the start, and say it."""
        beside = {cell for cell in beside_of(here) if cell in view.occupied}
        for number, ahead in enumerate(HEX_DIRECTIONS[:3]):
            before, after = minus(here, ahead), plus(here, ahead)
            if not beside or not beside <= {before, after}:
                continue
            known = Progress(0, 0, here[0], here[1], number)
            if before in beside:
                if before not in view.notes:
                    return Choice()
                known = Progress._make(view.notes[before])._replace(stage=0, steps=0)
            row = known.start(self._count)
            place, way = along(row.first, here)
            if way in (None, ahead) and (after in beside) == (place < self._count - 1):
                return self._announce(known)
        return Choice(failed=f"no straight chain of {self._count} modules stands at {here}")

    def _announce(self, known: Progress) -> Choice:
        """Announce the start, unless there is no room for a way to the goal."""
        try:
            self._stages(known.start(self._count))
        except InputError as error:
            return Choice(failed=str(error))
        return Choice(note=known)

    def _with_room(self, start: Row) -> Stages:
        """Return the first route for which there is room; InputError if there is none."""
        refused = InputError("")
        for stages in routes(start, self._goal):
            ends = [start, *(Row(task.head, task.ahead, task.count) for task in stages)]
            try:
                check_room(self._system, [cell for row in ends for cell in row.cells])
            except InputError as error:
                refused = error
            else:
                return stages
        raise refused


def _last(start: Row, stages: Stages, stage: int) -> Cell:
    """Return the cell of a stage that is filled last."""
    if not stage:
        return start.last
    task = stages[stage - 1]
    return plus(task.head, task.ahead, task.count - 1)


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module; InputError if the goal is no straight chain in order."""
    module = _Module(knowledge)
    known: Progress | None = None

    def choose(view: View) -> Choice:
        nonlocal known
        choice = module.choose(view, known)
        if choice.note is not None:
            known = Progress(*choice.note)
        return choice

    return choose


def make_free(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module, which keeps what it knows in its register."""
    module = _Module(knowledge)
    return lambda view: module.choose(view, Progress(*view.register) if view.register else None)


def _fits(system: System) -> bool:
    return chain.CHAIN.is_for(system) and not system.filled


CHAINS = RuleType(
    name="chains",
    summary="a straight chain of hexagons slides and bends, chain by chain, to become any other",
    source="own, by the rule chain in stages, see cubepath.agents.rules.chains",
    fits=_fits,
    make=make,
    note_length=lambda _: len(Progress._fields),
    free=FreeRule(
        why="as for chain in each stage; what modules say of stages stays true",
        make=make_free,
        note_length=lambda _: len(Progress._fields),
    ),
)
