"""A run: modules in processes, their edge path gathered and shortened, everything on record.

Room: coordinator. It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec

from cubepath.agents.processes.fleet import Fleet
from cubepath.coordinator.runs.conductor import Conductor, Ended, Ending
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.plan import (
    Plan,
    Task,
    check_topics,
    file_name,
    parameters_of,
    task_of,
)
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.recording import RecordingWriter
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Message,
    Stopped,
    encode,
)
from cubepath.protocol.wire.sessions import check_descriptors

_FLUSH_S = 0.5
_FLUSHES = (250, 1 << 18)
"""How much of a run a kill may lose: seconds, or messages, or bytes of them."""
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):  # noqa: N818 - it is not an error, but what the user asked for
    """The user asked the run to stop."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; the first fourteen fields are the keys of ``cubepath run --json``.

    So is `refused`, how many messages were refused. `error` is a key too if there is one. If a
    schedule was carried out, there are two more: how many cubes it has, and where it stopped, None
    if it did not.
    """

    log: str
    system: str
    rule: str
    seed: int
    modules: int
    processes: int
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    goal_reached: bool
    path_digest: str
    seconds: float
    ended: Ended
    error: str | None
    messages: int
    refused: int = 0
    schedule_cubes: int | None = None
    schedule_stopped: Stopped | None = None

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        extra = {"ended", "error", "messages"}
        if self.error is not None:
            extra -= {"error"}
        if self.schedule_cubes is None:
            extra |= {"schedule_cubes", "schedule_stopped"}
        found: dict[str, Any] = msgspec.to_builtins(
            {key: getattr(self, key) for key in self.__slots__ if key not in extra}
        )
        return found


Watch = Callable[[Gatherer], None]
Say = Callable[[str], None]


def run(plan: Plan, watch: Watch | None = None, say: Say | None = None) -> Outcome:
    """Run the plan to its end, close the recording, and return the outcome.

    InputError if the plan cannot be run at all; everything that goes wrong later (a process that
    dies, a rule that gives up, a full disk, an interrupt) is part of the outcome. `watch` is called
    after each round. `say` is told in a line where others can join, and who is waited for.
    """
    task = task_of(plan)
    modules = len(task.scene.start)
    own = min(plan.processes, modules)
    plan.network.check(modules, own)
    check_topics(task, plan)
    # Who waits for others has a session more, for that.
    check_descriptors(own + bool(plan.wait_for), files=1)
    path = plan.log or Path("logs") / file_name(plan, task)
    assignment = task.assignment
    schedule = None if assignment is None else schedule_to_jsonl(assignment.cubes)
    with RecordingWriter(
        path, task.scene, parameters_of(plan, task), schedule, flushes=_FLUSHES
    ) as writer:
        return _Run(plan, task, writer, say).play(watch)


@contextmanager
def _interrupts() -> Generator[Callable[[], None]]:
    """Turn SIGINT, SIGTERM and SIGHUP into `Interrupted`, raised between two messages.

    A second signal raises KeyboardInterrupt at once. Outside the main thread no signal is handled.
    """
    asked = threading.Event()

    def ask(_number: int, _frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    def check() -> None:
        if asked.is_set():
            raise Interrupted

    if threading.current_thread() is not threading.main_thread():
        yield check
        return
    before = {number: signal.signal(number, ask) for number in _INTERRUPTS}
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Run:
    """A run in progress: wire messages are recorded as they arrive, edges round by round.

    Cubes, certificate and summary, the coordinator's own results, are written at the end.
    """

    def __init__(self, plan: Plan, task: Task, writer: RecordingWriter, say: Say | None) -> None:
        self._plan = plan
        self._say_aloud = say
        self._processes = min(plan.processes, len(task.scene.start))
        self._task = task
        self._writer = writer
        self._conductor = Conductor(
            task.scene,
            max_rounds=task.max_rounds,
            record=self._say,
            assignment=task.assignment,
            repair=plan.repair,
        )
        self._began = self._flushed = time.monotonic()

    def play(self, watch: Watch | None) -> Outcome:
        conductor = self._conductor
        try:
            ending = self._rounds(watch)
        except Interrupted:
            ending = Ending("interrupted", "interrupted")
        except CubepathError as problem:
            ending = conductor.failed(str(problem))
        except MemoryError:
            ending = conductor.failed("out of memory")
        try:
            for message in conductor.results(ending):
                self._say(message)
            self._writer.close()
        except CubepathError as problem:
            ending = Ending("failed", ending.error or str(problem))
        return self._outcome(ending)

    def _rounds(self, watch: Watch | None) -> Ending:
        plan, task, conductor = self._plan, self._task, self._conductor
        ending = conductor.before()
        if ending is not None:
            return ending
        with (
            _interrupts() as check,
            Fleet(
                task.scene,
                task.rule,
                seed=plan.seed,
                hesitate=plan.hesitate,
                processes=plan.processes,
                schedule=None if task.assignment is None else task.assignment.own,
                patience_s=plan.patience,
                network=plan.network,
                sink=self._wire,
                check=lambda: self._between_messages(check),
                say=self._say_aloud,
                plausible=conductor.check,
            ) as fleet,
        ):
            conductor.know(fleet.modules_of, plan.seed)
            if plan.wait_for:
                self._processes = len(fleet.modules_of)
            ending = conductor.between(0, fleet.end_schedule)
            while ending is None:
                number = fleet.play_round()
                if watch is not None and conductor.gatherer.rounds == number:
                    watch(conductor.gatherer)
                ending = conductor.between(number, fleet.end_schedule)
        return ending

    def _between_messages(self, check: Callable[[], None]) -> None:
        check()
        now = time.monotonic()
        if now - self._flushed >= _FLUSH_S:
            self._flushed = now
            self._writer.flush()

    def _wire(self, message: Message, data: bytes, wall_ns: int) -> None:
        self._writer.write(topic_of(message), data, round_number=message.round, wall_ns=wall_ns)
        self._conductor.hear(message)

    def _say(self, message: Message) -> None:
        self._writer.write(
            topic_of(message),
            encode(message),
            round_number=message.round,
            wall_ns=time.time_ns(),
        )

    def _outcome(self, ending: Ending) -> Outcome:
        plan, gatherer, scene = self._plan, self._conductor.gatherer, self._task.scene
        heap = gatherer.heap
        modules = len(scene.start)
        return Outcome(
            log=str(self._writer.path),
            system=scene.spec,
            rule=self._task.name,
            seed=plan.seed,
            modules=modules,
            processes=self._processes,
            rounds=gatherer.rounds,
            moves=heap.moves,
            reduced_moves=heap.reduced_moves,
            cubes=heap.cubes,
            max_cube_dimension=heap.max_cube_dimension,
            goal_reached=gatherer.reached,
            path_digest=gatherer.digest,
            seconds=round(time.monotonic() - self._began, 3),
            ended=ending.ended,
            error=ending.error,
            messages=self._writer.messages,
            refused=self._conductor.refused,
            schedule_cubes=self._conductor.schedule_cubes,
            schedule_stopped=self._conductor.stopped,
        )
