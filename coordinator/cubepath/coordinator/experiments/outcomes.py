"""From the path of a run to the rows kept of it, however the run was played."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.experiments.instances import SceneFacts, facts_of
from cubepath.coordinator.experiments.rows import ROUND_MEASURES, RUN_COLUMNS, FinishedRun, Row
from cubepath.coordinator.experiments.setting import RunBatch, run_id
from cubepath.protocol.core.sites import Site

GOAL, MAX_ROUNDS, BLOCKED, GAVE_UP, FAULT, ERROR, DIED = (
    "goal",
    "max-rounds",
    "blocked",
    "gave-up",
    "fault",
    "error",
    "died",
)
"""How a run can end: at its goal, or after all its rounds; before that, as no move was admissible
any more, a rule gave up, or a fault ended it; it was an error of code, or its process died."""


@dataclass(slots=True)
class PlayedRun:
    """The path of a run in arrays, and how it ended.

    `costs` is the sum of costs, the rounds up to its last move summed over all modules. `moves`
    has for each move the number of its kind, and `measures` for each kind how it changes
    what is missing at the goal and the distance, shape (2, kinds). `ends` has the number of moves
    up to the end of each round, or level. `conflicts` counts the lost claims of each round; None
    where they are not known.
    """

    moves: NDArray[np.int64]
    measures: NDArray[np.int64]
    ends: NDArray[np.int64]
    sites: Sequence[Site]
    costs: int
    reduced: int
    cubes: int
    largest_cube: int
    digest: str
    ended: str
    reason: str | None = None
    conflicts: NDArray[np.int64] | None = None
    lost: int | None = None
    """How many claims were lost or attempts refused, if that is known of the whole run alone."""
    messages: int | None = None
    time: float | None = None
    recording: str | None = None
    seconds: float = 0.0


def finished(batch: RunBatch, seed: int, played: PlayedRun) -> FinishedRun:
    """Return the rows of a run."""
    setting = batch.setting
    facts = facts_of(setting.system, setting.optimum, setting.improve)
    row = _row(batch, seed, facts)
    counts = np.diff(played.ends, prepend=0)
    ended = played.ended
    if ended == MAX_ROUNDS and facts.blocked(played.sites):
        ended = BLOCKED
    reached = facts.scene.reached(played.sites)
    conflicts = played.conflicts
    lost = played.lost if conflicts is None else int(conflicts.sum())
    last = np.flatnonzero(counts)
    row |= {
        "bound": setting.proved,
        "goal": reached,
        "ended": ended,
        "reason": played.reason,
        "stuck": facts.scene.goal is not None
        and not reached
        and ended in (MAX_ROUNDS, BLOCKED, GAVE_UP),
        "rounds": len(counts),
        "moves": len(played.moves),
        "costs": played.costs,
        "reduced": played.reduced,
        "cubes": played.cubes,
        "largest_cube": played.largest_cube,
        "conflicts": lost,
        "messages": played.messages,
        "last_move": 0 if not len(last) else int(last[-1]) + 1,
        "time": played.time,
        "digest": played.digest,
        "recording": played.recording,
        "seconds": round(played.seconds, 4),
    }
    row |= scene_columns(row, facts)
    rounds = {
        "moves": counts,
        "conflicts": conflicts,
        "missing": _after_rounds(facts.missing, played.measures[0], played),
        "distance": _after_rounds(facts.distance, played.measures[1], played),
    }
    return FinishedRun(row, rounds)


def _after_rounds(
    start: int | None, changes: NDArray[np.int64], played: PlayedRun
) -> NDArray[np.int64] | None:
    """Return what a number is after each round, given what it is at the start; None if unknown."""
    if start is None:
        return None
    total = np.concatenate([[start], start + np.cumsum(changes[played.moves])])
    return total[played.ends]


def failed(
    batch: RunBatch, seed: int, ended: str, reason: str, seconds: float = 0.0, *, known: bool = True
) -> FinishedRun:
    """Return the row of a run of which nothing came but a reason.

    `known` tells whether it is known how the scene is: to find that out may take for ever.
    """
    try:
        setting = batch.setting
        facts = facts_of(setting.system, setting.optimum, setting.improve) if known else None
        row = _row(batch, seed, facts)
    except Exception:  # noqa: BLE001 - whatever ended the run may be asked for here again
        row = _row(batch, seed, None)
    row |= {
        "goal": False,
        "ended": ended,
        "reason": " ".join(reason.split()),
        "stuck": False,
        "seconds": round(seconds, 4),
    }
    nothing = np.zeros(0, np.int64)
    return FinishedRun(row, dict.fromkeys(ROUND_MEASURES, nothing))


def _row(batch: RunBatch, seed: int, facts: SceneFacts | None) -> Row:
    """Return what is known of a run before it is played, with None for all else."""
    setting = batch.setting
    row: Row = dict.fromkeys(RUN_COLUMNS)
    rates = asdict(setting.faults)
    row |= {key: rates[key] for key in rates if key in RUN_COLUMNS}
    row |= {
        "system": setting.label,
        "family": "" if facts is None else facts.scene.family,
        "modules": None if facts is None else len(facts.scene.start),
        "rule": setting.rule,
        "clock": setting.clock,
        "hesitate": setting.hesitate,
        "faults": setting.faults.text(),
        "core": setting.core,
        "processes": setting.processes,
        "keepers": setting.keepers,
        "max_rounds": setting.max_rounds,
        "seed": seed,
        "best_known": min(
            _known(setting.best_known, None if facts is None else facts.best_found), default=None
        ),
        "id": run_id(setting, seed, batch.code),
        "code": batch.code,
        "configuration": json.dumps({**setting.configuration(), "seed": seed}, sort_keys=True),
    }
    return row


def scene_columns(row: Row, facts: SceneFacts) -> Row:
    """Return the columns of a row that follow from what is known of its scene."""
    if row["rounds"] is None:  # it failed
        cubes, bound = None, None
    else:
        cubes = row["cubes"] if row["goal"] else None
        bound = max(_known(row["bound"], facts.bound(cubes)), default=None)
    best = min(_known(row["best_known"], facts.best_found), default=None)
    optimum = next(iter(_known(facts.optimum, row["optimum"])), None)
    if optimum is None and bound is not None and bound in (best, cubes):
        optimum = bound
    return {"bound": bound, "best_known": best, "optimum": optimum}


def _known(*numbers: int | None) -> list[int]:
    return [each for each in numbers if each is not None]
