"""The columns kept of runs and of their rounds, and their canonical order.

A row is a dict with all keys; None means unknown.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

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
    "costs": "int64",
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
"""How a run ends that could not be played, or stored, for reasons outside the run."""
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


def sum_of_costs(movers: Iterable[int], ends: NDArray[np.int64]) -> int:
    """Return the rounds up to each module's last move, summed; `movers` are in order of moves."""
    rounds = np.repeat(np.arange(1, len(ends) + 1), np.diff(ends, prepend=0)).tolist()
    return sum(dict(zip(movers, rounds, strict=True)).values())


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
