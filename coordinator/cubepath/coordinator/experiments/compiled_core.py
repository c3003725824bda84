"""Runs in this process, without messages: with rounds in compiled code, many seeds side by side.

They are the runs of `cubepath.agents.play_many` and `play_free`. The same seeds give the same runs
in the simulator and over the wire.
"""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import is_compiled
from cubepath.agents.environments.array_world import MadeMoves, made_in
from cubepath.agents.environments.rollouts import Rollout, play_free, play_in_python, play_many
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.experiments.instances import SceneFacts
from cubepath.coordinator.experiments.outcomes import GAVE_UP, GOAL, MAX_ROUNDS, PlayedRun
from cubepath.coordinator.experiments.rows import sum_of_costs
from cubepath.coordinator.experiments.setting import RunSetting, slow_modules
from cubepath.coordinator.experiments.wire_core import gathered_run
from cubepath.coordinator.normal_form.compiled_heap import PathCounter
from cubepath.coordinator.runs.edge_path import PathDigest
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.messages import Executed

_FEW = 200
"""Batches with fewer modules in all runs together are played in plain Python, until this many
were that compiled code would have been worth while."""
_LOADING_STEPS, _COMPILING_STEPS = 40_000, 600_000
"""This many turns of modules in plain Python take as long as compiled code takes to load, a second,
and to compile, once for an installation."""
_JITTER = 0.5
_End: TypeAlias = tuple[tuple[Site, ...], bool, str | None]
"""Where the modules are, whether that is the goal, and why a rule gave up."""


class _DoneInPython:
    """How many turns this process has played in plain Python: of all batches, as of one sweep.

    It decides where runs are played, and so how long they take, but not their results.
    """

    def __init__(self) -> None:
        self.steps = 0

    def pays(self) -> bool:
        """Return whether the rest is better played in compiled code."""
        return self.steps >= _LOADING_STEPS and (self.steps >= _COMPILING_STEPS or is_compiled())


_done_in_python = _DoneInPython()


def play_compiled(
    setting: RunSetting, facts: SceneFacts, seeds: tuple[int, ...]
) -> Iterator[PlayedRun]:
    """Yield the runs of a setting, one for each seed."""
    if setting.clock == "free":
        for seed in seeds:
            yield _free(setting, facts, seed)
        return
    scene = facts.scene
    rule = rule_named(setting.rule, scene.system)
    few = rule.vectorised is None or len(seeds) * len(scene.start) < _FEW
    began, plain = time.monotonic(), list[Rollout]()
    for seed in seeds if few else ():
        if rule.vectorised is not None and _done_in_python.pays():
            break
        plain.append(
            play_in_python(
                scene, rule, seed=seed, hesitate=setting.hesitate, max_rounds=setting.max_rounds
            )
        )
        _done_in_python.steps += len(plain[-1].rounds) * len(scene.start)
    if plain:
        made = made_in([run.rounds for run in plain])
        ends = [(run.sites, run.reached, run.failed) for run in plain]
        yield from _all_played(setting, facts, seeds[: len(plain)], made, ends, began)
    rest = seeds[len(plain) :]
    if not rest:
        return
    began = time.monotonic()
    many = play_many(
        scene, rule, rest, hesitate=setting.hesitate, max_rounds=setting.max_rounds, keep_moves=True
    )
    if many.made is None:  # they were asked for
        raise AssertionError("no moves were kept")
    ends = [
        (many.sites[run], bool(many.reached[run]), many.failed.get(run)) for run in range(len(rest))
    ]
    yield from _all_played(setting, facts, rest, many.made, ends, began)


def _all_played(  # noqa: PLR0917 - what runs side by side have in common, and what each has
    setting: RunSetting,
    facts: SceneFacts,
    seeds: tuple[int, ...],
    made: MadeMoves,
    ends: Sequence[_End],
    began: float,
) -> Iterator[PlayedRun]:
    kinds = _kinds(made, facts)
    share = (time.monotonic() - began) / len(seeds)
    for run, seed in enumerate(seeds):
        began = time.monotonic()
        played = _played(made, kinds, run, ends[run])
        slow = slow_modules(setting, facts.scene, seed)
        played.time = float(len(played.ends) * (setting.faults.slow_factor if slow else 1))
        played.seconds = share + time.monotonic() - began
        yield played


class _Kinds(NamedTuple):
    """What is the same for all moves of a kind, in the order of `MadeMoves.moves`."""

    names: list[tuple[str, Site]]
    """The generator and the place."""
    counter: PathCounter
    measures: NDArray[np.int64]


def _kinds(made: MadeMoves, facts: SceneFacts) -> _Kinds:
    motions = (
        (frozenset(site for site, _ in move.motion), frozenset(site for _, site in move.motion))
        for move in made.moves
    )
    return _Kinds(
        [(move.generator, move.at) for move in made.moves],
        PathCounter(move.action for move in made.moves),
        facts.measures((before - after, after - before) for before, after in motions),
    )


def _played(made: MadeMoves, kinds: _Kinds, run: int, end: _End) -> PlayedRun:
    first, last = np.searchsorted(made.run, [run, run + 1]).tolist()
    moves, lost = made.move[first:last], made.lost[run]
    ends = np.searchsorted(made.round[first:last], np.arange(1, len(lost) + 1), side="right")
    counts = kinds.counter.count(moves)
    movers = made.module[first:last].tolist()
    sites, reached, failed = end
    return PlayedRun(
        moves=moves,
        measures=kinds.measures,
        ends=ends,
        sites=sites,
        costs=sum_of_costs(movers, ends),
        reduced=counts.reduced_moves,
        cubes=counts.cubes,
        largest_cube=counts.max_cube_dimension,
        digest=_digest(kinds, movers, moves.tolist(), ends.tolist()),
        ended=GOAL if reached else MAX_ROUNDS if failed is None else GAVE_UP,
        reason=failed,
        conflicts=lost,
    )


def _digest(kinds: _Kinds, modules: list[int], moves: list[int], ends: list[int]) -> str:
    names = kinds.names
    executed = [Executed(module, *names[move]) for module, move in zip(modules, moves, strict=True)]
    digest, at = PathDigest(), 0
    for number, end in enumerate(ends, 1):
        if at < end:
            digest.add(number, executed[at:end])
        at = end
    return digest.text()


def _free(setting: RunSetting, facts: SceneFacts, seed: int) -> PlayedRun:
    began, scene = time.monotonic(), facts.scene
    slow = slow_modules(setting, scene, seed)
    played = play_free(
        scene,
        rule_named(setting.rule, scene.system, "free"),
        seed=seed,
        hesitate=setting.hesitate,
        max_cycles=setting.max_rounds,
        speeds=dict.fromkeys(slow, setting.faults.slow_factor),
        jitter=_JITTER,
    )
    gatherer = FreeGatherer(scene, 1)
    for commit in played.commits:
        gatherer.take(commit)
    found = gathered_run(gatherer, facts, GAVE_UP if played.failed else MAX_ROUNDS, played.failed)
    found.lost = played.refused
    found.time = played.time
    found.seconds = time.monotonic() - began
    return found
