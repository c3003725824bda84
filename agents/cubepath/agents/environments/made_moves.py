"""The moves of many runs as arrays: each distinct move once, and by number wherever it was made.

A run of a thousand rounds makes hundreds of thousands of moves of few hundred kinds; as objects,
round by round, they would cost more than to play them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import starmap

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch
from cubepath.agents.arrays.state import GRANTED, LOST
from cubepath.agents.arrays.tables import Tables
from cubepath.agents.environments.world import Round
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Ordinals

Counts = NDArray[np.int64]
_COLUMNS = 6


@dataclass(frozen=True, slots=True)
class MadeMoves:
    """The moves of many runs, by run, round and module in increasing order.

    The first four arrays have an entry for each move, shape (moves,); rounds count from 1, and
    `move` holds numbers of `moves`, where each distinct move stands once. `lost` has an array for
    each run, shape (rounds,): how many claims were lost in each round.
    """

    run: Counts
    round: Counts
    module: Counts
    move: Counts
    moves: tuple[Move, ...]
    lost: tuple[Counts, ...]


def made_in(runs: Sequence[Sequence[Round]]) -> MadeMoves:
    """Return the moves of runs that are given round by round."""
    numbers = Ordinals[Move]()
    rows = [
        (run, each.number, module, numbers[move])
        for run, rounds in enumerate(runs)
        for each in rounds
        for module, move in each.moves.items()
    ]
    columns = np.array(rows, np.int64).reshape(len(rows), 4).T
    lost = tuple(np.array([len(each.lost) for each in rounds], np.int64) for rounds in runs)
    return _made(columns, numbers, lost)


@dataclass(slots=True)
class MoveKeeper:
    """Keeps the moves of a batch of runs, round by round."""

    batch: Batch
    _numbers: Ordinals[Move] = field(default_factory=Ordinals)
    _tables: Tables | None = None
    _rounds: list[NDArray[np.int32]] = field(default_factory=list)
    """What was kept since the tables were made: columns of run, round, module, place, code, action,
    shape (6, moves)."""
    _found: list[Counts] = field(default_factory=list)
    """What was kept before: columns of run, round, module and number of the move."""
    _lost: list[tuple[NDArray[np.bool_], Counts]] = field(default_factory=list)

    def before(self) -> tuple[Tables, NDArray[np.int32], NDArray[np.int32]]:
        """Return the tables and where modules stand, which `keep` takes after the round."""
        return (self.batch.tables, *self.batch.standings())

    def keep(
        self,
        before: tuple[Tables, NDArray[np.int32], NDArray[np.int32]],
        actions: NDArray[np.int32],
        playing: NDArray[np.bool_],
    ) -> None:
        """Keep what came of a round; `actions` were chosen, shape (runs, modules)."""
        tables, places, codes = before
        if tables is not self._tables:
            self._name()
            self._tables = tables
        outcomes = self.batch.outcomes
        runs, modules = np.nonzero((outcomes == GRANTED) & playing[:, None])
        columns = np.empty((_COLUMNS, len(runs)), np.int32)
        columns[0], columns[1], columns[2] = runs, self.batch.round[runs], modules
        at = runs, modules
        columns[3], columns[4], columns[5] = places[at], codes[at], actions[at]
        self._rounds.append(columns)
        self._lost.append((playing.copy(), (outcomes == LOST).sum(axis=1)))

    def _name(self) -> None:
        """Give numbers to the moves that were kept since the tables were made."""
        tables, rounds = self._tables, self._rounds
        if tables is None or not rounds:
            return
        columns = np.concatenate(rounds, axis=1)
        rounds.clear()
        # One number for place, code and action: rows are sorted ten times slower.
        places, codes, actions = columns[3:].astype(np.int64)
        most_codes, most_actions = 1 + codes.max(initial=0), 1 + actions.max(initial=0)
        keys = (places * most_codes + codes) * most_actions + actions
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        distinct = columns[3:, first]
        system = tables.scene.system

        def number(place: int, code: int, action: int) -> int:
            site = tables.site(place, code)
            move = system.moves(site)[action - 1]
            if move is None:
                raise AssertionError(f"no move {action} from {site!r} was granted")
            return self._numbers[move]

        named = np.array(list(starmap(number, distinct.T.tolist())), np.int64)
        move = named[inverse] if len(named) else np.zeros(0, np.int64)
        self._found.append(np.vstack([columns[:3].astype(np.int64), move]))

    def result(self) -> MadeMoves:
        """Return all that was kept."""
        self._name()
        found = np.concatenate([np.zeros((4, 0), np.int64), *self._found], axis=1)
        found = found[:, np.lexsort((found[2], found[1], found[0]))]
        lost = tuple(
            np.array([counts[run] for live, counts in self._lost if live[run]], np.int64)
            for run in range(self.batch.environments)
        )
        return _made(found, self._numbers, lost)


def _made(columns: Counts, numbers: Ordinals[Move], lost: tuple[Counts, ...]) -> MadeMoves:
    """Return moves from columns of run, round, module and number of the move, shape (4, moves)."""
    run, round_number, module, move = columns
    return MadeMoves(run, round_number, module, move, tuple(numbers), lost)
