"""The lockstep world of one environment in compiled code.

It answers as `World` does, for all modules at once.

The moves of many runs are arrays too: each distinct move is stored once and referred to by number.
A run of a thousand rounds makes hundreds of thousands of moves of a few hundred kinds; keeping an
object for each would cost more than playing them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import starmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch, RelativeArrays
from cubepath.agents.arrays.rounds import GRANTED, ILLEGAL, LOST
from cubepath.agents.arrays.tables import Tables
from cubepath.agents.environments.world import Round, World
from cubepath.agents.local.observation import Note, Observation
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Ordinals, Site
from cubepath.protocol.core.system import Scene

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
        """Keep the results of a round; `actions` were chosen, shape (runs, modules)."""
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


Infos = dict[str, dict[str, Any]]


class ArrayWorld:
    """All modules of a scene in one batch of one environment."""

    def __init__(
        self, scene: Scene, *, seed: int, note_length: int = 0, relative: bool = False
    ) -> None:
        """Put every module at its start; `UntabledError` if the system does not fit into tables."""
        self.scene = scene
        self.note_length = note_length
        self.batch = Batch(scene, note_length=note_length)
        self._relative = RelativeArrays(self.batch) if relative else None
        modules = len(scene.start)
        self._speaks = np.zeros((1, modules), np.bool_)
        self._notes_out = np.zeros((1, modules, note_length), np.int32)
        self.reset(seed)

    @classmethod
    def after(cls, world: World, *, relative: bool) -> ArrayWorld:
        """Return a world in the state of a plain one, from which it continues."""
        found = cls(world.scene, seed=world.seed, note_length=world.note_length, relative=relative)
        found.put(world.sites, world.round, world.spoken())
        return found

    def put(self, sites: Sequence[Site], round_number: int, notes: Sequence[Note]) -> None:
        """Put every module at its site after a round, with its last note."""
        self.batch.put(0, sites, round_number, notes)
        self.batch.observe()

    def spoken(self) -> list[Note]:
        """Return the last note of each module, by number; zeros where a rule has sent none."""
        return [tuple(numbers) for numbers in self.batch.notes[0].tolist()]

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        self.seed = seed
        self.batch.reset([seed])
        self.batch.observe()

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    @property
    def round(self) -> int:
        """Return how many rounds have been played."""
        return int(self.batch.round[0])

    @property
    def sites(self) -> list[Site]:
        """Return the site of each module, by number."""
        return self.batch.sites()

    @property
    def at_goal(self) -> int:
        """Return how many modules are on sites of the goal."""
        return int(self.batch.at_goal[0])

    @property
    def reached(self) -> bool:
        """Return whether the goal is reached."""
        return bool(self.batch.reached[0])

    def observations(self, names: Sequence[str], *, copy: bool) -> dict[str, Observation]:
        """Return what all modules observe: copies, or the arrays that every step overwrites."""
        observed = self.batch.observed
        seen: NDArray[Any] = self._seen()
        masks = observed.mask[0]
        if copy:
            seen, masks = seen.copy(), masks.copy()
        if not self.note_length:
            return {
                name: {"observation": one, "action_mask": mask}
                for name, one, mask in zip(names, seen, masks, strict=True)
            }
        notes = observed.notes[0].copy() if copy else observed.notes[0]
        return {
            name: {"observation": one, "action_mask": mask, "notes": heard}
            for name, one, mask, heard in zip(names, seen, masks, notes, strict=True)
        }

    def _seen(self) -> NDArray[Any]:
        if self._relative is None:
            own: NDArray[Any] = self.batch.observed.observation[0]
        else:
            own = self._relative.update()[0]
        return own

    def refresh(self) -> None:
        """Overwrite the arrays that were returned without a copy."""
        self._seen()

    def places(self) -> NDArray[np.int32]:
        """Return the encoded sites of all modules, shape (modules, site_size)."""
        return self.batch.observed.observation[0, :, : self.scene.system.site_size].copy()

    def step(self, actions: NDArray[np.int64], notes: Mapping[int, Note]) -> ArrayRound:
        """Play a round with an action for each module, and notes for some."""
        spoken = None
        if notes:
            self._speaks[:] = False
            for module, note in notes.items():
                self._speaks[0, module] = True
                self._notes_out[0, module] = note
            spoken = self._speaks, self._notes_out
        places, codes = self.batch.standings()
        tables = self.batch.tables
        outcomes = self.batch.step(actions[None], spoken=spoken)[0]
        return ArrayRound(tables, self.round, actions, outcomes.copy(), (places[0], codes[0]))


class ArrayRound:
    """What a round did; the moves are looked up when they are asked for."""

    def __init__(
        self,
        tables: Tables,
        number: int,
        actions: NDArray[np.int64],
        outcomes: NDArray[np.int8],
        before: tuple[NDArray[np.int32], NDArray[np.int32]],
    ) -> None:
        self.number = number
        self._tables, self._actions, self._before = tables, actions, before
        self._outcomes = outcomes

    def illegal(self) -> NDArray[np.intp]:
        """Return the modules whose actions were not admissible."""
        return np.flatnonzero(self._outcomes == ILLEGAL)

    def round(self) -> Round:
        """Return the round as the plain world gives it."""
        tables, system = self._tables, self._tables.scene.system
        places, codes = self._before
        moves = {}
        for module in np.flatnonzero(self._outcomes == GRANTED).tolist():
            site = tables.site(int(places[module]), int(codes[module]))
            move = system.moves(site)[int(self._actions[module]) - 1]
            if move is None:
                raise AssertionError(f"module_{module} made no move from {site!r}")
            moves[module] = move
        lost = tuple(np.flatnonzero(self._outcomes == LOST).tolist())
        return Round(self.number, moves, lost)
