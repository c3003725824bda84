"""Batches of runs handed to workers: processes of this machine, or of a dask cluster.

An executor needs to do only what `concurrent.futures.Executor` promises. When a process dies, no
result is lost: each run that may have killed it is played once more, alone, and gets a row with the
reason if it ends in the same way again.
"""

import contextlib
import multiprocessing
import multiprocessing.connection as connections
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, field, replace
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.experiments.batch_runs import GRACE_S, late, play_batch
from cubepath.coordinator.experiments.outcomes import DIED, failed
from cubepath.coordinator.experiments.rows import FinishedRun
from cubepath.coordinator.experiments.setting import RunBatch
from cubepath.coordinator.experiments.wire_core import discard_scratch
from cubepath.protocol.core.errors import CheckError, InputError

_END_S_MAX = 10.0
_CONNECT_S = 10
_ENDED = 3


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


class _Spawning(SpawnContext):
    """The way in which processes are started, which remembers those that were."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    # What is a class in `SpawnContext` is called in the same way.
    def Process(self, *given: Any, **named: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802
        process = SpawnProcess(*given, **named)
        self.started.append(process)
        return process


def _end() -> None:
    discard_scratch()
    os._exit(_ENDED)


def play_or_end(batch: RunBatch, recordings: Path | None) -> list[FinishedRun]:
    """Play a batch in a process of a pool, which ends if one of its runs is told to."""
    try:
        return play_batch(batch, recordings)
    except KeyboardInterrupt:  # which the pool would take for an answer, and go on
        _end()
        raise


class Pool:
    """Processes of this machine, which end with this one."""

    play = staticmethod(play_or_end)

    def __init__(self, count: int, instead: str = "jobs=1") -> None:
        """Have this many; `instead` says how one does without, if none can be started."""
        self.count = count
        self._instead = instead
        self._executor: ProcessPoolExecutor | None = None
        self._context = _Spawning()
        self._works = False

    def start(self) -> Executor:
        """Return a pool; InputError if its processes cannot be started from this program."""
        self._context = _Spawning()
        executor = self._executor = ProcessPoolExecutor(
            self.count, mp_context=self._context, initializer=_begin
        )
        if not self._works:
            try:
                executor.submit(os.getpid).result()
            except BrokenExecutor:
                self.end(at_once=True)
                raise InputError(
                    "jobs: no process can be started from here, expected a program whose work is"
                    f' under if __name__ == "__main__":, or {self._instead}'
                ) from None
            self._works = True
        return executor

    def end(self, *, at_once: bool) -> None:
        """End the processes."""
        if self._executor is None:
            return
        executor, self._executor = self._executor, None
        if at_once:
            for process in self._context.started:
                with contextlib.suppress(ValueError, AttributeError):  # closed, or never started
                    process.terminate()
            for process in self._context.started:
                with contextlib.suppress(ValueError, AssertionError, AttributeError):
                    process.join(_END_S_MAX)
                    if process.is_alive():
                        process.kill()
                        process.join()
            # One that was ended while it sent an answer leaves half of it. The thread that reads
            # answers waits for the rest for as long as anybody, this process too, could write it.
            private: Any = executor
            private._result_queue._writer.close()  # noqa: SLF001 - there is no public way to it
        # It waits for the thread that reaps them, too: until then one may look alive that is not.
        executor.shutdown(wait=True, cancel_futures=at_once)


def _begin() -> None:
    """Leave interrupts to the process that hands out the work, and end when that has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    # A run in separate processes handles this itself, to end them; see `play_or_end`.
    signal.signal(signal.SIGTERM, lambda *_: _end())
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connections.wait([sentinel])
    _end()


class Cluster:
    """The workers of a dask cluster that is there already."""

    play = staticmethod(play_batch)

    def __init__(self, address: str) -> None:
        """Name the scheduler by its address; nothing is connected to yet."""
        self.address = address
        self.count = 1
        """How many tasks its workers took at a time when it was connected to."""
        self._client: Any = None
        self._executor: Any = None

    def start(self) -> Executor:
        """Connect; InputError if dask is not installed, CheckError if there is no answer."""
        try:
            import distributed  # noqa: PLC0415 - an extra
        except ImportError:
            raise InputError(
                "cluster: needs dask's distributed, expected it installed (pip install"
                " 'cubepath[cluster]')"
            ) from None
        try:
            connect: Any = distributed.Client
            self._client = connect(self.address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            text = " ".join(str(error).split()) or type(error).__name__
            raise CheckError(f"{self.address}: no dask scheduler: {text}") from None
        self.count = max(1, sum(self._client.nthreads().values()))
        self._executor = self._client.get_executor()
        executor: Executor = self._executor
        return executor

    def end(self, *, at_once: bool) -> None:
        """Disconnect; tasks that have begun are left to end by themselves."""
        if self._client is None:
            return
        client, self._client = self._client, None
        if not at_once:
            self._executor.shutdown(wait=True)
        client.close()


Workers: TypeAlias = Pool | Cluster
"""Executors one after another: a new one each time that the last one is broken."""


_AHEAD = 2
"""This many batches for each worker are handed out at a time."""
_LOOK_S = 0.5


def played_here(
    batches: Iterable[RunBatch], recordings: Path | None
) -> Iterator[list[FinishedRun]]:
    """Play batches in this process, one after another."""
    for batch in batches:
        yield play_batch(batch, recordings)


def played_by(
    workers: Workers, batches: Iterable[RunBatch], recordings: Path | None
) -> Generator[list[FinishedRun]]:
    """Yield the rows of batches as they are finished; whatever happens, no worker is left at it."""
    playing = _Playing(workers, deque(batches), recordings)
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
    running: dict[Future[list[FinishedRun]], RunBatch] = field(default_factory=dict)
    _suspects: deque[RunBatch] = field(default_factory=deque)
    """Runs during which a process died: each has to be played alone."""
    _alone: bool = False
    """Whether one of these is played now."""
    _began_s: float = 0.0
    """When something was handed out last."""

    def results(self) -> Iterator[list[FinishedRun]]:
        executor = self.workers.start()
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
