"""Workers: processes on the cores of this machine, or those of a dask cluster."""

import contextlib
import multiprocessing
import os
import signal
import threading
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from multiprocessing.connection import wait
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any

from cubepath.coordinator.experiments.playing import play_batch
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
            for process in self._alive():
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

    def _alive(self) -> list[SpawnProcess]:
        found = []
        for process in self._context.started:
            with contextlib.suppress(ValueError, AssertionError, AttributeError):
                if process.is_alive():
                    found.append(process)
        return found


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
    wait([sentinel])
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
