"""The rule `chain` for all modules of many environments together.

`chain` has the rule, its terms, and why it reaches the goal; `chain_task` has the same geometry for
one module. The conditions on moves and on sensed cells depend only on their slots, so they are
tabulated. A module's first view shows its task, so the task is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rules.chain_task import check_room, cross, goal_chain, minus, plus, tasks_from
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell, Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, EMPTY, System

_Numbers = NDArray[np.int64]

_UNKNOWN, _FIRST, _STAYS, _FAILS = 0, 1, 3, 4
"""What a module has found at its first view: nothing yet; `_FIRST` and the next are its tasks."""
_OFF, _INSIDE, _AT_END = 0, 1, 2
"""Where a module starts: off the goal, or on it."""
_STEPS = 8
"""Microseconds in plain Python, to choose for one module."""


class _Tables(NamedTuple):
    """What the rule asks of slots, and what each module knows from the start.

    Few arrays, as each costs time in every call. Sets of directions are bit masks.
    """

    moves: _Numbers
    """Shape (slots, 7), by the slot of a move: from the module's cell A to A', from A to B, where E
    and D' are sensed (-1 if they are not), and 1 if E is in the support."""
    sensed: _Numbers
    """Shape (sensed slots, 2): from A to the cell that is sensed there."""
    directions: _Numbers
    """Shape (6, 2): `HEX_DIRECTIONS`."""
    births: _Numbers
    """Shape (n, 5): the start, `_OFF`, `_INSIDE` or `_AT_END`, the directions along the goal, and
    how many tasks the module may have, at most two."""
    tasks: _Numbers
    """Shape (n, 2, 10): g_0, the direction of the goal, u, the sense of turning, the direction
    towards g_0 and the opposite one, each as a bit, and m."""


def moves_by_orbit(system: System, cells: Iterable[Site]) -> Mapping[Cell, tuple[Move, ...]] | None:
    """Return the moves of a module at the representative of each orbit, in the order of slots.

    They are what is in the slots at any other cell of the orbit as well, translated, unless they
    are excluded there. None if the system has no catalogue, or its slots at one of these `cells`
    hold something else; one cell of each orbit is looked at.
    """
    catalogue = system.catalogue
    if catalogue is None:
        return None
    found = {orbit: catalogue.proposals(orbit) for orbit in catalogue.templates}
    looked_at: set[Cell] = set()
    for site in cells:
        cell = catalogue.lattice.check(site)
        orbit = catalogue.orbit(cell)
        if orbit in looked_at:
            continue
        looked_at.add(orbit)
        wanted = catalogue.proposals(cell)
        slots = system.moves(cell)
        padded = (*wanted, *[None] * (len(slots) - len(wanted)))
        if len(slots) != len(padded) or any(
            move not in (None, one) for move, one in zip(slots, padded, strict=True)
        ):
            return None
    return found


def sensed_offsets(system: System, cell: Cell) -> tuple[Cell, ...] | None:
    """Return the sensed cells by slot, from the representative of the cell's orbit.

    None if the system has no catalogue, or if slots stand for no cell.
    """
    catalogue = system.catalogue
    if catalogue is None:
        return None
    lattice, found = catalogue.lattice, []
    back = tuple(-number for number in cell[: lattice.dimension])
    for near in system.sensed(cell):
        if near is None:
            return None
        found.append(lattice.shift(lattice.check(near), back))
    return tuple(found)


def make(knowledge: VectorKnowledge) -> VectorRule | None:
    """Return the rule of all modules; InputError if one knows that the goal cannot be reached."""
    births, tasks = _known_from_birth(knowledge)
    system, origin = knowledge.system, HEXAGONS.check(knowledge.starts[0])
    orbits, sensed = moves_by_orbit(system, knowledge.starts), sensed_offsets(system, origin)
    if orbits is None or sensed is None:
        return None
    tables = _Tables(
        moves=np.array([_numbers_of(move, sensed) for move in orbits[0, 0]], np.int64),
        sensed=np.array(sensed, np.int64),
        directions=np.array(HEX_DIRECTIONS, np.int64),
        births=births,
        tasks=tasks,
    )
    begun = np.full((knowledge.environments, knowledge.modules), _UNKNOWN, np.int8)
    steps = begun.size * _STEPS

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        if not _walk.for_work(steps, by_entries=True)(seen, tables, begun, chosen.actions):
            return ()
        gave_up = np.argwhere((begun == _FAILS) & seen.playing[:, np.newaxis])
        return [
            RuleFailure(
                environment, module, no_chain_from(HEXAGONS.check(knowledge.starts[module]))
            )
            for environment, module in gave_up.tolist()
        ]

    return choose


def no_chain_from(start: Cell) -> str:
    """Return why a module gives up that finds no straight chain at its start."""
    return f"no straight chain leads from {start} to an end of the goal"


def _numbers_of(move: Move, sensed: Sequence[Cell]) -> list[int]:
    """Return the row of `_Tables.moves` of a move from the origin."""
    there = HEXAGONS.check(move.target)
    (pivot,) = map(HEXAGONS.check, move.action.ends[0] & move.action.ends[1])
    behind, follows = minus((0, 0), there), plus(there, pivot)
    slots = [sensed.index(cell) if cell in sensed else -1 for cell in (behind, follows)]
    return [*there, *pivot, *slots, int(behind in move.action.support)]


def _known_from_birth(knowledge: VectorKnowledge) -> tuple[_Numbers, _Numbers]:
    """Return the tables of births and tasks, checked as each module would, in their order."""
    births = np.zeros((knowledge.modules, 5), np.int64)
    tasks = np.zeros((knowledge.modules, 2, 10), np.int64)
    # By identity: modules share their goals, of which each knows all.
    chains: dict[int, tuple[tuple[Cell, ...], frozenset[Cell]]] = {}
    for module, (site, known) in enumerate(zip(knowledge.starts, knowledge.goals, strict=True)):
        start = HEXAGONS.check(site)
        new = id(known) not in chains
        if new:
            cells = goal_chain(known, knowledge.modules)
            chains[id(known)] = cells, frozenset(cells)
        goals, on_goal = chains[id(known)]
        found = [] if start in on_goal else tasks_from(start, goals)
        # The cells of a goal need to be looked at once, though each module would.
        check_room(knowledge.system, [start, *goals] if new else [start])
        ends, row = (goals[0], goals[-1]), minus(goals[-1], goals[0])
        where = (_AT_END if start in ends else _INSIDE) if start in on_goal else _OFF
        along = sum(1 << k for k, cell in enumerate(HEX_DIRECTIONS) if not cross(cell, row))
        births[module] = (*start, where, along, len(found))
        for number, task in enumerate(found):
            away = HEX_DIRECTIONS.index((task.away[0], task.away[1]))
            bits = (1 << (away + 3) % 6, 1 << away)
            row_of_task = (*task.head, *task.ahead, *task.away, task.sense, *bits, task.steps)
            tasks[module, number] = row_of_task
    return births, tasks


@compiled
def _walk(
    seen: VectorView, tables: _Tables, begun: NDArray[np.int8], actions: NDArray[np.int32]
) -> int:
    """Choose for every module; return how many give up."""
    failing = 0
    for environment in range(actions.shape[0]):
        if not seen.playing[environment]:
            continue
        for module in range(actions.shape[1]):
            if begun[environment, module] == _UNKNOWN:
                beside = _beside(seen, tables, environment, module)
                begun[environment, module] = _beginning(tables.births, tables.tasks, module, beside)
            found = begun[environment, module]
            if found == _FAILS:
                failing += 1
            elif found != _STAYS:
                task = found - _FIRST
                actions[environment, module] = _step(seen, tables, environment, module, task)
    return failing


@compiled
def _beside(seen: VectorView, tables: _Tables, environment: int, module: int) -> int:
    """Return the directions in which a cell beside the module's start is on, as bits."""
    found = 0
    for direction in range(len(tables.directions)):
        # The first view may be from another cell than the start.
        q = tables.births[module, 0] + tables.directions[direction, 0]
        r = tables.births[module, 1] + tables.directions[direction, 1]
        q -= seen.observation[environment, module, 0]
        r -= seen.observation[environment, module, 1]
        for slot in range(len(tables.sensed)):
            if tables.sensed[slot, 0] == q and tables.sensed[slot, 1] == r:
                if _is_on(seen.observation, environment, module, slot):
                    found |= 1 << direction
                break
    return found


@compiled
def _beginning(births: _Numbers, tasks: _Numbers, module: int, beside: int) -> int:
    """Return what a module finds by what is beside its start: see `Task.begins` and `chain`."""
    for number in range(births[module, 4]):
        before, after = tasks[module, number, 7], tasks[module, number, 8]
        joined = beside & before != 0 or (tasks[module, number, 9] == 1 and beside & after != 0)
        if joined and beside & ~(before | after) == 0:
            return _FIRST + number
    where = births[module, 2]
    if where != _OFF:
        goes_on = beside & ~births[module, 3] == 0
        one = beside != 0 and beside & (beside - 1) == 0
        if goes_on or (one and where == _AT_END):
            return _STAYS
    return _FAILS


@compiled
def _step(seen: VectorView, tables: _Tables, environment: int, module: int, task: int) -> int:
    """Return the action of a module with this task: see `Task.guarded`."""
    moves, row, observation = tables.moves, tables.tasks, seen.observation
    # Where A is, seen from g_0.
    q = observation[environment, module, 0] - row[module, task, 0]
    r = observation[environment, module, 1] - row[module, task, 1]
    ahead_q, ahead_r = row[module, task, 2], row[module, task, 3]
    away_q, away_r = row[module, task, 4], row[module, task, 5]
    sense, count = row[module, task, 6], len(row)
    if _is_goal(q, r, ahead_q, ahead_r, count):
        return 0
    waits = _is_along(q, r, away_q, away_r)
    for slot in range(len(moves)):
        if seen.action_mask[environment, module, slot + 1] == 0:
            continue
        step_q, step_r, arm_q, arm_r = (
            moves[slot, 0],
            moves[slot, 1],
            moves[slot, 2],
            moves[slot, 3],
        )
        if step_q * arm_r - step_r * arm_q != sense:
            continue
        b_q, b_r = q + arm_q, r + arm_r
        if not (_is_goal(b_q, b_r, ahead_q, ahead_r, count) or _is_along(b_q, b_r, away_q, away_r)):
            continue
        if waits and (
            arm_q != -away_q
            or arm_r != -away_r
            or _is_on(observation, environment, module, moves[slot, 4])
        ):
            continue
        d_q, d_r = b_q + step_q, b_r + step_r
        spaced = not (
            moves[slot, 6] == 0
            or _is_goal(d_q, d_r, ahead_q, ahead_r, count)
            or _is_along(d_q, d_r, away_q, away_r)
            or _is_goal(q + step_q, r + step_r, ahead_q, ahead_r, count)
        )
        if not (spaced and _is_on(observation, environment, module, moves[slot, 5])):
            return slot + 1
    return 0


@compiled
def _is_on(observation: NDArray[np.int32], environment: int, module: int, slot: int) -> bool:
    """Return whether a cell is on, by the slot in which it is sensed; not if that is -1."""
    if slot < 0:
        return False
    code = observation[environment, module, 3 + 2 * slot]
    return bool(code not in (EMPTY, CLOSED))


@compiled
def _is_goal(q: int, r: int, ahead_q: int, ahead_r: int, count: int) -> bool:
    """Return whether a cell is of the goal, seen from g_0."""
    steps = max(abs(q), abs(r), abs(q + r))
    return q == steps * ahead_q and r == steps * ahead_r and steps < count


@compiled
def _is_along(q: int, r: int, unit_q: int, unit_r: int) -> bool:
    """Return whether a cell is on the line in this direction, seen from g_0."""
    steps = max(abs(q), abs(r), abs(q + r))
    return q == steps * unit_q and r == steps * unit_r
