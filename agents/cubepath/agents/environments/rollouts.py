"""Play a rule many times in one scene, a seed for each run: what `play` gives, as arrays.

Rules with a vectorised form are played in compiled code, all runs side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch
from cubepath.agents.arrays.state import GRANTED, LOST
from cubepath.agents.arrays.tables import UntabledError
from cubepath.agents.environments.array_world import ArrayRound
from cubepath.agents.environments.made_moves import MadeMoves, MoveKeeper, made_in
from cubepath.agents.environments.rollout import Played, check_max_rounds, play_in_python
from cubepath.agents.environments.world import Round
from cubepath.agents.rules.registry import check_seeds, scene_and_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.vector_actors import VectorActors, vector_actors_for
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, local_only

Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PlayedMany:
    """Finished runs of one rule in one scene; the arrays have shape (runs,)."""

    seeds: tuple[int, ...]
    rounds: Counts
    reached: NDArray[np.bool_]
    moves: Counts
    """How many moves were made."""
    lost: Counts
    """How many claims were lost to others."""
    failed: dict[int, str]
    """Why a rule gave up, by run."""
    sites: tuple[tuple[Site, ...], ...]
    """Where the modules are at the end of each run."""
    played: tuple[tuple[Round, ...], ...] | None = None
    """The rounds of each run, if they were to be kept."""
    made: MadeMoves | None = None
    """The moves of all runs as arrays, if they were to be kept."""


def play_many(
    system: str | Path | Scene,
    rule: str | RuleType | None,
    seeds: Sequence[int],
    *,
    hesitate: float = 0.0,
    max_rounds: int = 1000,
    keep_rounds: bool = False,
    keep_moves: bool = False,
) -> PlayedMany:
    """Play a rule once for each seed; each run is that of `play` with the seed.

    `system` and `rule` may be names, as for `play`. Rules in plain Python, and systems that fit
    into no tables, are played one run after another. `keep_rounds` and `keep_moves` ask for
    `played` and `made`, of which the latter costs far less. InputError as for `play`.

    >>> runs = play_many("hex:n=4", "chain", range(100))
    >>> bool(runs.reached.all()), float(runs.rounds.mean())
    (True, 14.0)
    """
    check_max_rounds(max_rounds)
    scene, rule = scene_and_rule(system, rule)
    check_seeds(seeds, hesitate)
    scene = local_only(scene, "environment")
    if not seeds:
        return _summed((), [], keep_rounds=keep_rounds, keep_moves=keep_moves)
    actors = vector_actors_for(scene, rule, seeds=seeds, hesitate=hesitate)
    if actors is not None:
        try:
            batch = Batch(scene, len(seeds), note_length=rule.length(len(scene.start)))
        except UntabledError:
            actors = None
        else:
            batch.reset(list(seeds))
            keeper = MoveKeeper(batch) if keep_moves else None
            playing = _Playing(batch, actors, tuple(seeds), max_rounds, keep_rounds, keeper)
            return playing.result()
    runs = [
        play_in_python(scene, rule, seed=seed, hesitate=hesitate, max_rounds=max_rounds)
        for seed in seeds
    ]
    return _summed(tuple(seeds), runs, keep_rounds=keep_rounds, keep_moves=keep_moves)


def _summed(
    seeds: tuple[int, ...], runs: list[Played], *, keep_rounds: bool, keep_moves: bool
) -> PlayedMany:
    return PlayedMany(
        seeds,
        np.array([len(run.rounds) for run in runs], np.int64),
        np.array([run.reached for run in runs], np.bool_),
        np.array([sum(len(each.moves) for each in run.rounds) for run in runs], np.int64),
        np.array([sum(len(each.lost) for each in run.rounds) for run in runs], np.int64),
        {number: run.failed for number, run in enumerate(runs) if run.failed is not None},
        tuple(run.sites for run in runs),
        tuple(run.rounds for run in runs) if keep_rounds else None,
        made_in([run.rounds for run in runs]) if keep_moves else None,
    )


@dataclass(slots=True)
class _Playing:
    """Runs side by side in one batch."""

    batch: Batch
    actors: VectorActors
    seeds: tuple[int, ...]
    max_rounds: int
    keep_rounds: bool
    keeper: MoveKeeper | None
    failed: dict[int, str] = field(default_factory=dict)

    def result(self) -> PlayedMany:
        """Play to the end."""
        batch, runs = self.batch, len(self.seeds)
        moves, lost = np.zeros((2, runs), np.int64)
        kept: list[list[ArrayRound]] = [[] for _ in range(runs)]
        seen = batch.observe()
        actions = np.zeros((runs, batch.modules), np.int32)
        speaks = np.ones((runs, batch.modules), np.bool_)
        playing = ~batch.reached & (batch.round < self.max_rounds)
        while playing.any():
            heard = seen.notes if batch.note_length else None
            self.actors.act(seen.observation, seen.mask, heard, actions, playing=playing)
            self.failed.update(self.actors.failed)
            tables = batch.tables
            before = [batch.standing(run) for run in range(runs)] if self.keep_rounds else []
            kept_before = None if self.keeper is None else self.keeper.before()
            told = (speaks & playing[:, None], self.actors.notes) if batch.note_length else None
            chosen = actions.astype(np.int64)
            outcomes = batch.step(chosen, told=told, live=playing.astype(np.uint8))
            moves += (outcomes == GRANTED).sum(axis=1)
            lost += (outcomes == LOST).sum(axis=1)
            if self.keeper is not None and kept_before is not None:
                self.keeper.keep(kept_before, actions, playing)
            if self.keep_rounds:
                for run in np.flatnonzero(playing).tolist():
                    number = int(batch.round[run])
                    kept[run].append(
                        ArrayRound(tables, number, chosen[run], outcomes[run].copy(), before[run])
                    )
            playing &= ~batch.reached & (batch.round < self.max_rounds)
            playing[list(self.actors.failed)] = False
        return PlayedMany(
            self.seeds,
            batch.round.copy(),
            batch.reached,
            moves,
            lost,
            self.failed,
            tuple(tuple(batch.sites(run)) for run in range(runs)),
            tuple(tuple(each.round() for each in run) for run in kept)
            if self.keep_rounds
            else None,
            None if self.keeper is None else self.keeper.result(),
        )
