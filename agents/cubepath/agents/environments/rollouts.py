"""Play a rule in one process: once or with many seeds, with rounds or without.

Rules with a vectorised form run in compiled code, all runs side by side.
"""

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch, is_due
from cubepath.agents.arrays.rounds import GRANTED, LOST
from cubepath.agents.arrays.tables import UntabledError
from cubepath.agents.environments.array_world import ArrayRound, MadeMoves, MoveKeeper, made_in
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.agents.environments.free_world import ActionResult, FreeWorld
from cubepath.agents.environments.world import Round
from cubepath.agents.local.observation import Note
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import check_seeds, scene_and_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.vector_actors import VectorActors, vector_actors_for
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import function, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.displays import Displayed
from cubepath.protocol.wire.free_messages import Commit


@dataclass(frozen=True, slots=True)
class Rollout(Displayed):
    """A finished run: its rounds in order, the final sites, and why a rule gave up, if one did."""

    scene: Scene = field(compare=False, repr=False)
    rounds: tuple[Round, ...]
    sites: tuple[Site, ...]
    reached: bool
    failed: str | None = None

    @property
    def path(self) -> tuple[Action, ...]:
        """The edge path: the moves of each round, in increasing order of their movers."""
        return tuple(move.action for each in self.rounds for move in each.moves.values())

    @property
    def steps(self) -> tuple[tuple[Action, ...], ...]:
        """The edge path round by round, as pictures and films take it."""
        return tuple(tuple(move.action for move in each.moves.values()) for each in self.rounds)

    @property
    def placed(self) -> tuple[GeneratorPlacement, ...]:
        """The edge path, each move as a generator and a place."""
        return tuple(
            GeneratorPlacement(move.generator, move.at)
            for each in self.rounds
            for move in each.moves.values()
        )


def play_in_python(
    scene: Scene,
    rule: RuleType,
    *,
    seed: int,
    hesitate: float,
    max_rounds: int,
    world: str = "auto",
) -> Rollout:
    """Play as `play` does, with the rule in plain Python, in a world of `CubepathEnv`."""
    note_length = rule.note_length(len(scene.start))
    env = CubepathEnv(scene, world=world, max_cycles=max_rounds, note_length=note_length)
    actors = actors_for(scene, rule, seed=seed, hesitate=hesitate)
    observations, _ = env.reset(seed=seed)
    spoken: dict[str, Note] = {}
    rounds: list[Round] = []
    failed: str | None = None
    while (
        len(rounds) < max_rounds and env.agents and failed is None and not scene.reached(env.sites)
    ):
        actions = {}
        for number, name in enumerate(env.possible_agents):
            choice = actors[number].act(observations[name])
            actions[name] = choice.action
            if choice.note is not None:
                spoken[name] = choice.note
            if choice.failed is not None and failed is None:
                failed = f"{name}: {choice.failed}"
        observations, *_ = env.step(actions, spoken)
        played = env.last_round
        if played is None:  # step has just set it
            raise AssertionError("a step without a round")
        rounds.append(played)
    return Rollout(scene, tuple(rounds), env.sites, scene.reached(env.sites), failed)


Watch: TypeAlias = Callable[[FreeWorld, ActionResult], None]
"""Called after each turn with the turn and the world."""


@dataclass(frozen=True, slots=True)
class FreeRollout(Displayed):
    """A finished run: what was committed, in order, the turns, and how it ended."""

    scene: Scene = field(compare=False, repr=False)
    commits: tuple[Commit, ...]
    """Those without a generator wrote registers alone."""
    turns: int
    refused: int
    """Attempts that were refused."""
    sites: tuple[Site, ...]
    reached: bool
    failed: str | None = None
    time: float = 0.0
    """When the last turn began; a module of speed factor 1 takes 1 for a turn."""

    @property
    def moves(self) -> tuple[Commit, ...]:
        """Return the commits that moved modules."""
        return tuple(commit for commit in self.commits if commit.generator is not None)

    @property
    def path(self) -> tuple[Action, ...]:
        """The edge path, in the order of the commits."""
        system = self.scene.system
        return tuple(system.read_action(each) for each in self.placed)

    @property
    def placed(self) -> tuple[GeneratorPlacement, ...]:
        """The edge path, each move as a generator and a place."""
        return tuple(
            GeneratorPlacement(each.generator, each.at)
            for each in self.commits
            if each.generator is not None
        )


def play_free(
    system: str | Path | Scene = "hex",
    rule: str | RuleType | None = None,
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    max_cycles: int = 2000,
    scheduler: str = "random",
    speeds: Mapping[int, int] | None = None,
    jitter: float = 0.5,
    lag: int = 0,
    restarts: Mapping[int, Collection[int]] | None = None,
    watch: Watch | None = None,
) -> FreeRollout:
    """Play until the goal is reached, a rule gives up, or after `max_cycles` turns a module.

    `system` is a scene or its name, and `rule` a rule or its name, as for `play`. The arguments
    from `scheduler` to `lag` are those of `FreeEnv`. `restarts` has the modules that lose all they
    know before a turn, by its number from 1. `watch` is called after each turn. InputError as for
    `play`, or if `max_cycles` is negative.

    >>> played = play_free("hex:n=4", seed=1)
    >>> played.reached, len(played.path)
    (True, 18)
    """
    whole_number("max_cycles", max_cycles, 0)
    _check_restarts(restarts)
    if watch is not None:
        function("watch", watch)
    scene, rule = scene_and_rule(system, rule, "free")
    check_seeds([seed], hesitate)
    env = FreeEnv(
        scene,
        max_cycles=max_cycles,
        note_length=rule.length(len(scene.start), "free"),
        scheduler=scheduler,
        speeds=speeds,
        jitter=jitter,
        lag=lag,
    )
    actors = actors_for(scene, rule, seed=seed, hesitate=hesitate, clock="free")
    env.reset(seed=seed)
    world = env.world
    commits: list[Commit] = []
    refused = 0
    failed: str | None = None
    turns = max_cycles * len(scene.start)
    while world.turns < turns and failed is None and not scene.reached(world.sites):
        for module in (restarts or {}).get(world.turns + 1, ()):
            world.restart(module)
            sites = {module: world.sites[module]}
            actors |= actors_for(
                scene,
                rule,
                seed=seed,
                hesitate=hesitate,
                modules=[module],
                sites=sites,
                clock="free",
            )
        name = env.agent_selection
        choice = actors[env.possible_agents.index(name)].act(env.observe(name))
        if choice.failed is not None:
            failed = f"{name}: {choice.failed}"
        acted = env.act(choice)
        refused += bool(acted.why)
        if acted.moved is not None:
            commits.append(acted.moved)
        if watch is not None:
            watch(world, acted)
    reached = scene.reached(world.sites)
    return FreeRollout(
        scene, tuple(commits), world.turns, refused, env.sites, reached, failed, env.time
    )


def _check_restarts(found: object) -> None:
    """Check who restarts when; InputError if it is of another type."""
    given: Any = found
    try:
        for turn, modules in (given or {}).items():
            for number in (turn, *modules):
                operator.index(number)
    except (AttributeError, TypeError):
        raise InputError(
            f"restarts={found!r}: expected turns with modules, as in {{12: [0]}}"
        ) from None


Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Rollouts:
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
) -> Rollouts:
    """Play a rule once for each seed; each run is that of `play` with the seed.

    `system` and `rule` may be names, as for `play`. Rules in plain Python, and systems that fit
    into no tables, are played one run after another. `keep_rounds` and `keep_moves` ask for
    `played` and `made`, of which the latter costs far less. InputError as for `play`.

    >>> runs = play_many("hex:n=4", "chain", range(100))
    >>> bool(runs.reached.all()), float(runs.rounds.mean())
    (True, 14.0)
    """
    whole_number("max_rounds", max_rounds, 0)
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
            return _side_by_side(
                batch, actors, tuple(seeds), max_rounds, keep_rounds=keep_rounds, keeper=keeper
            )
    runs = [
        play_in_python(scene, rule, seed=seed, hesitate=hesitate, max_rounds=max_rounds)
        for seed in seeds
    ]
    return _summed(tuple(seeds), runs, keep_rounds=keep_rounds, keep_moves=keep_moves)


def _summed(
    seeds: tuple[int, ...], runs: list[Rollout], *, keep_rounds: bool, keep_moves: bool
) -> Rollouts:
    return Rollouts(
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


def _side_by_side(
    batch: Batch,
    actors: VectorActors,
    seeds: tuple[int, ...],
    max_rounds: int,
    *,
    keep_rounds: bool,
    keeper: MoveKeeper | None,
) -> Rollouts:
    """Play all runs to the end in one batch."""
    failed: dict[int, str] = {}
    moves, lost = np.zeros((2, len(seeds)), np.int64)
    kept: list[list[ArrayRound]] = [[] for _ in seeds]
    seen = batch.observe()
    actions = np.zeros((len(seeds), batch.modules), np.int32)
    speaks = np.ones(actions.shape, np.bool_)
    playing = ~batch.reached & (batch.round < max_rounds)
    while playing.any():
        heard = seen.notes if batch.note_length else None
        actors.act(seen.observation, seen.mask, heard, actions, playing=playing)
        failed |= actors.failed
        tables = batch.tables
        before = list(zip(*batch.standings(), strict=True)) if keep_rounds else []
        kept_before = None if keeper is None else keeper.before()
        told = (speaks & playing[:, None], actors.notes) if batch.note_length else None
        chosen = actions.astype(np.int64)
        outcomes = batch.step(chosen, spoken=told, live=playing.astype(np.uint8))
        moves += (outcomes == GRANTED).sum(axis=1)
        lost += (outcomes == LOST).sum(axis=1)
        if keeper is not None and kept_before is not None:
            keeper.keep(kept_before, actions, playing)
        for run in np.flatnonzero(playing).tolist() if keep_rounds else ():
            number = int(batch.round[run])
            kept[run].append(
                ArrayRound(tables, number, chosen[run], outcomes[run].copy(), before[run])
            )
        playing &= ~batch.reached & (batch.round < max_rounds)
        playing[list(actors.failed)] = False
    return Rollouts(
        seeds,
        batch.round.copy(),
        batch.reached,
        moves,
        lost,
        failed,
        tuple(tuple(batch.sites(run)) for run in range(len(seeds))),
        tuple(tuple(each.round() for each in run) for run in kept) if keep_rounds else None,
        None if keeper is None else keeper.result(),
    )


_ROUNDS = 20
"""A run is taken to have this many rounds, to tell whether compiled code pays."""


def play(
    system: str | Path | Scene = "hex",
    rule: str | RuleType | None = None,
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    max_rounds: int = 1000,
) -> Rollout:
    """Play until the goal is reached, a rule gives up, or `max_rounds` are over.

    `system` is a scene, or its name as on the command line. `rule` is a rule or the name of one,
    and None means the rule of the system's family. One that has a vectorised form is played in
    compiled code once that is ready. InputError if the system or the rule is not known, or they do
    not go together, or `max_rounds` is negative.

    >>> played = play("hex:n=4", seed=1)
    >>> played.reached, len(played.rounds), len(played.path), played.sites[0]
    (True, 14, 18, (3, 1))
    >>> first = played.placed[0]
    >>> first.generator, first.at
    ('pivot-2-right', (1, -1))
    """
    whole_number("max_rounds", max_rounds, 0)
    scene, rule = scene_and_rule(system, rule)
    check_seeds([seed], hesitate)
    if rule.vectorised is not None and is_due(_ROUNDS * len(scene.start)):
        runs = play_many(
            scene, rule, [seed], hesitate=hesitate, max_rounds=max_rounds, keep_rounds=True
        )
        played = () if runs.played is None else runs.played[0]
        return Rollout(scene, played, runs.sites[0], bool(runs.reached[0]), runs.failed.get(0))
    return play_in_python(scene, rule, seed=seed, hesitate=hesitate, max_rounds=max_rounds)
