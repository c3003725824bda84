"""Batches of runs handed to executors, whose processes may die.

An executor needs to do only what `concurrent.futures.Executor` promises. When a process dies, no
result is lost: each run that may have killed it is played once more, alone, and gets a row with the
reason if it ends in the same way again.

What is compiled once per installation is compiled first, in two processes side by side. Otherwise
every worker would compile the same functions; instead they load what these two leave on disk.
"""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cubepath.agents.arrays.batch import compile_world, is_compiled
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.vector_actors import vector_actors_for
from cubepath.coordinator.experiments.outcomes import DIED, failed
from cubepath.coordinator.experiments.playing import GRACE_S, late, play_batch
from cubepath.coordinator.experiments.rows import FinishedRun
from cubepath.coordinator.experiments.setting import RunBatch
from cubepath.coordinator.normal_form.compiled_heap import PathCounter
from cubepath.protocol.compiled import PLAIN_STEPS, allowance
from cubepath.protocol.scenes.specs import scene_from_spec


def warm(executor: Executor, batches: Iterable[RunBatch]) -> None:
    """Let two workers compile what runs of these batches take, if it is not on disk."""
    rules = {
        batch.setting.rule: batch.setting.system
        for batch in batches
        if batch.setting.core == "compiled" and batch.setting.clock == "lockstep"
    }
    if rules and not is_compiled():
        world = executor.submit(compile_world)
        wait([world, executor.submit(compile_rest, tuple(rules.items()))])


def compile_rest(rules: Iterable[tuple[str, str]]) -> None:
    """Compile the heap of moves, and rules by name, each with a system that it is for."""
    allowance.grant(PLAIN_STEPS)  # from now on nothing is done in plain Python
    scene = scene_from_spec("hex:n=2")
    actions = [move.action for move in scene.system.moves_at(scene.start[0])]
    PathCounter(actions).count(np.zeros(2, np.int64))
    for rule, system in rules:
        _compile_rule(rule, system)


def _compile_rule(rule: str, system: str) -> None:
    scene = scene_from_spec(system)
    kind = rule_named(rule, scene.system)
    actors = vector_actors_for(scene, kind, seeds=[0], hesitate=0.5)
    if actors is None:
        return
    env = CubepathEnv(scene, note_length=kind.length(len(scene.start)))
    seen = list(env.reset(seed=0)[0].values())
    columns: dict[str, Any] = {name: np.array([[each[name] for each in seen]]) for name in seen[0]}
    out = np.zeros((1, len(seen)), np.int32)
    actors.act(columns["observation"], columns["action_mask"], columns.get("notes"), out)


_AHEAD = 2
"""This many batches for each worker are handed out at a time."""
_LOOK_S = 0.5


class Workers(Protocol):
    """Executors one after another: a new one each time that the last one is broken."""

    count: int
    """How many workers there are, once they are started."""

    @property
    def play(self) -> Callable[[RunBatch, Path | None], list[FinishedRun]]:
        """Return what a worker calls with a batch."""
        ...

    def start(self) -> Executor:
        """Return an executor that works; InputError if there can be none."""
        ...

    def end(self, *, at_once: bool) -> None:
        """End what was started last; `at_once` whatever it is doing."""
        ...


def played_here(
    batches: Iterable[RunBatch], recordings: Path | None
) -> Iterator[list[FinishedRun]]:
    """Play batches in this process, one after another."""
    for batch in batches:
        yield play_batch(batch, recordings)


def played_by(
    workers: Workers, batches: Iterable[RunBatch], recordings: Path | None, *, few: bool = False
) -> Generator[list[FinishedRun]]:
    """Yield the rows of batches as they are finished; whatever happens, no worker is left at it.

    For `few` runs nothing is compiled beforehand.
    """
    playing = _Playing(workers, deque(batches), recordings, few)
    done = False
    try:
        yield from playing.results()
        done = True
    finally:
        for future in playing.running:
            future.cancel()
        workers.end(at_once=not done)


@dataclass(slots=True)
class _Playing:
    """What is handed out, and what has to be played alone."""

    workers: Workers
    left: deque[RunBatch]
    recordings: Path | None
    few: bool
    running: dict[Future[list[FinishedRun]], RunBatch] = field(default_factory=dict)
    _suspects: deque[RunBatch] = field(default_factory=deque)
    """Runs during which a process died: each has to be played alone."""
    _alone: bool = False
    """Whether one of these is played now."""
    _began_s: float = 0.0
    """When something was handed out last."""

    def results(self) -> Iterator[list[FinishedRun]]:
        executor = self.workers.start()
        with suppress(Exception):  # whoever plays a run meets it again, and says so in its row
            warm(executor, () if self.few else self.left)
        while self.left or self._suspects or self.running:
            self._hand_out(executor)
            # With a timeout, so that an interrupt is noticed wherever it is that one waits.
            done = wait(self.running, timeout=_LOOK_S, return_when=FIRST_COMPLETED).done
            broken = any(isinstance(_error(future), BrokenExecutor) for future in done)
            if broken:  # and so are all others, or they are finished
                done = wait(self.running).done
            for future in done:
                batch, error = self.running.pop(future), _error(future)
                if error is None:
                    yield future.result()
                elif self._alone:
                    yield [self._died(batch, error)]
                else:
                    self._suspects.extend(replace(batch, seeds=(seed,)) for seed in batch.seeds)
            if broken:
                self.workers.end(at_once=True)
                executor = self.workers.start()

    def _hand_out(self, executor: Executor) -> None:
        if self._suspects or self._alone:
            # One at a time: only what it does itself can then end its process.
            if not self.running:
                self._alone = bool(self._suspects)
                if self._suspects:
                    self._submit(executor, self._suspects.popleft())
            return
        while self.left and len(self.running) < _AHEAD * self.workers.count:
            self._submit(executor, self.left.popleft())

    def _submit(self, executor: Executor, batch: RunBatch) -> None:
        try:
            future = executor.submit(self.workers.play, batch, self.recordings)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        self.running[future] = batch
        self._began_s = time.monotonic()

    def _died(self, batch: RunBatch, error: BaseException) -> FinishedRun:
        """Return the row of the one run of a batch, whose process died, or failed, twice."""
        seconds = time.monotonic() - self._began_s
        if batch.timeout_s is not None and seconds >= batch.timeout_s + GRACE_S:
            more = ", and could not be interrupted: its process was ended"
            return late(batch, seconds, known=False, more=more)
        return failed(batch, batch.seeds[0], DIED, _why(error))


def _error(future: Future[list[FinishedRun]]) -> BaseException | None:
    return CancelledError("cancelled") if future.cancelled() else future.exception()


def _why(error: BaseException) -> str:
    if isinstance(error, BrokenExecutor):
        return "its process died, and died again when the run was played alone"
    return f"its process failed twice: {type(error).__name__}: {error}"
