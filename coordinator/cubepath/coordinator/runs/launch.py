"""A run: modules in processes, their edge path gathered and shortened, everything on record.

Room: coordinator. It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from cubepath.agents.processes.fleet import Fleet
from cubepath.coordinator.runs.conductor import Conductor, Ended, Ending
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_launch import FreeRun, Noticed
from cubepath.coordinator.runs.interrupts import Interrupted, interrupts
from cubepath.coordinator.runs.plan import (
    Plan,
    Task,
    check_topics,
    file_name,
    parameters_of,
    task_of,
)
from cubepath.coordinator.runs.resuming import keeper_logs, resumed
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Message,
    Stopped,
    encode,
)
from cubepath.protocol.wire.sessions import check_descriptors


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; the first fourteen fields are the keys of ``cubepath run --json``.

    So is `refused`, how many messages were refused. `error` is a key too if there is one. If a
    schedule was carried out, there are two more: how many cubes it has, and where it stopped, None
    if it did not. A run without rounds has levels in their place, and three more keys: how many
    keepers it had, which processes died, and for how long modules were held back for the record.
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
    keepers: int | None = None
    crashes: tuple[Noticed, ...] = ()
    held_back_seconds: float = 0.0

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        extra = {"ended", "error", "messages"}
        if self.error is not None:
            extra -= {"error"}
        if self.schedule_cubes is None:
            extra |= {"schedule_cubes", "schedule_stopped"}
        if self.keepers is None:
            extra |= {"keepers", "crashes", "held_back_seconds"}
        found: dict[str, Any] = msgspec.to_builtins(
            {key: getattr(self, key) for key in self.__slots__ if key not in extra}
        )
        return found


Watch = Callable[[Gathered], None]
Say = Callable[[str], None]


def run(plan: Plan, watch: Watch | None = None, say: Say | None = None) -> Outcome:
    """Run the plan to its end, close the recording, and return the outcome.

    InputError if the plan cannot be run at all; everything that goes wrong later (a process that
    dies, a rule that gives up, a full disk, an interrupt) is part of the outcome. `watch` is called
    after each round. `say` is told in a line where others can join, and who is waited for.
    """
    recording: Recording | None = None
    if plan.resume is None:
        task = task_of(plan)
    else:
        plan, task, recording = resumed(plan, plan.resume)
    modules = len(task.scene.start)
    own = min(plan.processes, modules)
    plan.network.check(modules, own)
    check_topics(task, plan)
    # Who waits for others has a session more, for that.
    keepers = plan.keepers if plan.is_free else 0
    check_descriptors(own + keepers + bool(plan.wait_for), files=1)
    path = plan.log or Path("logs") / file_name(plan, task)
    if plan.is_free and plan.resume is None and keeper_logs(path).exists():
        raise InputError(f"{keeper_logs(path)}: exists already, expected no logs of another run")
    assignment = task.assignment
    schedule = None if assignment is None else schedule_to_jsonl(assignment.cubes)
    with RecordingWriter(path, task.scene, parameters_of(plan, task), schedule) as writer:
        if plan.is_free:
            aloud = say or (lambda _: None)
            return _play_free(FreeRun(plan, task, writer, aloud, watch, recording))
        return _Run(plan, task, writer, say).play(watch)


def _play_free(free: FreeRun) -> Outcome:
    began = time.monotonic()
    plan, task, writer = free.plan, free.task, free.writer
    ending = free.play()
    return _outcome(
        plan,
        task,
        free.gatherer,
        ending,
        writer,
        seconds=time.monotonic() - began,
        processes=min(plan.processes, len(task.scene.start)),
        refused=free.refused,
        keepers=plan.keepers,
        crashes=tuple(free.crashes),
        held_back_seconds=round(free.held_back, 3),
        schedule_cubes=None if task.assignment is None else len(task.assignment.cubes),
    )


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
        self._began = time.monotonic()

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
            interrupts() as check,
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
            try:
                ending = conductor.between(0, fleet.end_schedule)
                while ending is None:
                    number = fleet.play_round()
                    self._writer.flush()  # before anyone hears that it is over, or begins the next
                    if watch is not None and conductor.gatherer.rounds == number:
                        watch(conductor.gatherer)
                    ending = conductor.between(number, fleet.end_schedule)
            finally:
                # To end the fleet may take seconds. What cannot be written is told by the results.
                with contextlib.suppress(CubepathError):
                    self._writer.flush()
        return ending

    def _between_messages(self, check: Callable[[], None]) -> None:
        check()
        self._writer.flush_if_due()

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
        conductor = self._conductor
        return _outcome(
            self._plan,
            self._task,
            conductor.gatherer,
            ending,
            self._writer,
            seconds=time.monotonic() - self._began,
            processes=self._processes,
            refused=conductor.refused,
            schedule_cubes=conductor.schedule_cubes,
            schedule_stopped=conductor.stopped,
        )


def _outcome(
    plan: Plan,
    task: Task,
    gatherer: Gathered,
    ending: Ending,
    writer: RecordingWriter,
    *,
    seconds: float,
    **more: Any,
) -> Outcome:
    heap = gatherer.heap
    return Outcome(
        log=str(writer.path),
        system=task.scene.spec,
        rule=task.name,
        seed=plan.seed,
        modules=len(task.scene.start),
        rounds=gatherer.rounds,
        moves=heap.moves,
        reduced_moves=heap.reduced_moves,
        cubes=heap.cubes,
        max_cube_dimension=heap.max_cube_dimension,
        goal_reached=gatherer.reached,
        path_digest=gatherer.digest,
        seconds=round(seconds, 3),
        ended=ending.ended,
        error=ending.error,
        messages=writer.messages,
        **more,
    )
