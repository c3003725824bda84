"""What is kept of runs and of their rounds: the columns, and their canonical order.

A row is a dict with all keys; None is what is not known.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.experiments.instances import SceneFacts, facts_of
from cubepath.coordinator.experiments.setting import RunBatch, run_id
from cubepath.protocol.core.sites import Site

Row: TypeAlias = dict[str, Any]

RUN_COLUMNS: Mapping[str, str] = {
    "system": "string",
    "family": "string",
    "modules": "int64",
    "rule": "string",
    "clock": "string",
    "hesitate": "float64",
    "faults": "string",
    "loss": "float64",
    "delay": "float64",
    "duplicate": "float64",
    "crash": "float64",
    "slow": "float64",
    "slow_factor": "int64",
    "core": "string",
    "processes": "int64",
    "keepers": "int64",
    "max_rounds": "int64",
    "seed": "int64",
    "goal": "bool",
    "ended": "string",
    "reason": "string",
    "stuck": "bool",
    "rounds": "int64",
    "moves": "int64",
    "reduced": "int64",
    "cubes": "int64",
    "largest_cube": "int64",
    "bound": "int64",
    "optimum": "int64",
    "best_known": "int64",
    "conflicts": "int64",
    "messages": "int64",
    "last_move": "int64",
    "time": "float64",
    "digest": "string",
    "recording": "string",
    "seconds": "float64",
    "id": "string",
    "code": "string",
    "configuration": "string",
}
"""The columns of a run, each with the type of its values."""
ROUND_COLUMNS: Mapping[str, str] = {
    "id": "string",
    "round": "int64",
    "moves": "int64",
    "conflicts": "int64",
    "missing": "int64",
    "distance": "int64",
}
"""The columns of a round; `id` is that of its run, and rounds count from 1."""
PREVENTED = "prevented"
"""How a run ends that could not be played, or kept, where it was to be, by no fault of its own."""
TIMEOUT = "timeout"
"""How a run ends that was over its limit of time."""
AGAIN = ("died", PREVENTED, TIMEOUT)
"""How runs end that are played again the next time: it may have been the machine.

One that was over its limit is played again with a longer one, or with none."""
FAILURES = ("error", *AGAIN)
"""How a run ends that failed by an error of code, whose process died twice, that was over its limit
of time, or that was prevented."""
ROUND_MEASURES = tuple(ROUND_COLUMNS)[2:]
_ORDER = ("system", "rule", "clock", "core", "hesitate", "faults", "max_rounds", "seed", "id")
_NUMBERS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """A run that is over: its row, and its rounds.

    `rounds` has for each of `ROUND_MEASURES` an array of shape (rounds,), None if it is not known.
    """

    run: Row
    rounds: Mapping[str, NDArray[np.int64] | None]

    @property
    def failed(self) -> bool:
        """Return whether it ended as one of `FAILURES`."""
        return self.run["ended"] in FAILURES

    def round_rows(self) -> list[Row]:
        """Return a row for each round."""
        count = self.run["rounds"] or 0
        columns = [
            [None] * count if found is None else found.tolist()
            for found in (self.rounds[name] for name in ROUND_MEASURES)
        ]
        return [
            dict(zip(ROUND_COLUMNS, (self.run["id"], number, *values), strict=True))
            for number, values in enumerate(zip(*columns, strict=True), 1)
        ]


def natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Return a key that sorts texts with their numbers as numbers.

    >>> sorted(["hex:n=12", "hex:n=4", "arm:n=5"], key=natural)
    ['arm:n=5', 'hex:n=4', 'hex:n=12']
    """
    return tuple(
        (0, int(part), "") if part.isdigit() and part.isascii() else (1, 0, part)
        for part in _NUMBERS.split(text)
        if part
    )


def in_canonical_order(rows: Iterable[Row]) -> list[Row]:
    """Return rows of runs by system, rule, clock, core, hesitation, faults and seed."""

    def key(row: Row) -> tuple[Any, ...]:
        return tuple(
            natural(row[name]) if isinstance(row[name], str) else row[name] for name in _ORDER
        )

    return sorted(rows, key=key)


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

    `moves` has for each move the number of its kind, and `measures` for each kind how it changes
    what is missing at the goal and the distance, shape (2, kinds). `ends` has the number of moves
    up to the end of each round, or level. `conflicts` counts the lost claims of each round; None
    where they are not known.
    """

    moves: NDArray[np.int64]
    measures: NDArray[np.int64]
    ends: NDArray[np.int64]
    sites: Sequence[Site]
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
    setting = batch.setting
    bound = _greatest(facts.bound(played.cubes if reached else None), setting.proved)
    row |= {
        "bound": bound,
        "optimum": _optimum(
            facts.optimum, bound, {row["best_known"], played.cubes if reached else None}
        ),
        "goal": reached,
        "ended": ended,
        "reason": played.reason,
        "stuck": facts.scene.goal is not None
        and not reached
        and ended in (MAX_ROUNDS, BLOCKED, GAVE_UP),
        "rounds": len(counts),
        "moves": len(played.moves),
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
        "best_known": _least(setting.best_known, None if facts is None else facts.best_found),
        "id": run_id(setting, seed, batch.code),
        "code": batch.code,
        "configuration": json.dumps({**setting.configuration(), "seed": seed}, sort_keys=True),
    }
    return row


def _greatest(one: int | None, other: int | None) -> int | None:
    return max((each for each in (one, other) if each is not None), default=None)


def _least(one: int | None, other: int | None) -> int | None:
    return min((each for each in (one, other) if each is not None), default=None)


def _optimum(found: int | None, bound: int | None, known: set[int | None]) -> int | None:
    """Return the least number of cubes, if a search proves it, or a path as short as the bound."""
    return bound if found is None and bound in known else found
