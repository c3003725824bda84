"""The loop of a run and its ending, the same for both clocks.

However a run ends, its results are published first, then its processes are ended, and then the
results are recorded. An interrupt during the ending is raised after that.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from cubepath.agents.processes.fleet import ProcessFleet
from cubepath.agents.processes.network import Way
from cubepath.coordinator.runs.asking import Answers, Release, RunInfo, Status
from cubepath.coordinator.runs.conductor import RunEnd
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.listeners import Listeners
from cubepath.coordinator.runs.outcome import Outcome, outcome_of
from cubepath.coordinator.runs.plan import Plan, RunTask, file_name, parameters_of
from cubepath.coordinator.runs.run_lock import Interrupted, RunLock
from cubepath.protocol.core.errors import CheckError, CubepathError
from cubepath.protocol.path_files.durations import schedule_to_jsonl
from cubepath.protocol.recordings.description import format_of
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.toml import scene_to_toml

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording

Say: TypeAlias = Callable[[str], None]
Pace: TypeAlias = Callable[[], float]
Fleet = TypeVar("Fleet", bound=ProcessFleet, covariant=True)  # noqa: PLC0105 - not Fleet_co
INTERRUPTED = RunEnd("interrupted", "interrupted")


@dataclass(frozen=True, slots=True)
class RunContext:
    """What a driver needs of the run that it drives."""

    plan: Plan
    task: RunTask
    listeners: Listeners
    lock: RunLock
    say: Say
    way: Way
    pace: Pace
    """Returns how many seconds a run with rounds is to wait before its next one."""
    before: Recording | None = None
    """The recording of a run that is resumed."""


class Driver(ABC, Generic[Fleet]):
    """A run of either clock: it is begun, continues step by step, and ends once."""

    def __init__(self, context: RunContext) -> None:
        """Open the recording, and start nothing."""
        plan, task = self.plan, self.task = context.plan, context.task
        self.ending: RunEnd | None = None
        """How the run has ended, from then on; its results may not be recorded yet."""
        self.outcome: Outcome | None = None
        self.endpoint = ""
        """Where the router of the run listens, or did."""
        self.run = ""
        """The name of the run in keys."""
        self._processes = min(plan.processes, len(task.scene.start))
        self._refused = 0
        """How many messages were refused so far."""
        self._listeners = context.listeners
        self._lock = context.lock
        self._say = context.say
        self._way = context.way
        self._pace = context.pace
        self._before = context.before
        self._fleet: Fleet | None = None
        self._resources = ExitStack()
        self._results: Sequence[Any] | None = None
        self._refused_then = 0
        """How many messages had been refused when the results were found."""
        self._first_result: int | None = None
        """The number of the first result among the messages of the recording."""
        self._closed = False
        self._answers: Answers | None = None
        self._answered = 0, 0
        self._parameters = parameters_of(plan, task)
        assignment = task.assignment
        self._schedule = None if assignment is None else schedule_to_jsonl(assignment.cubes)
        log = Path(plan.log) if plan.log else Path("logs") / file_name(plan, task)
        self.writer = self._open(log)
        self._began = time.monotonic()

    def _open(self, log: Path) -> RecordingWriter:
        return RecordingWriter(log, self.task.scene, self._parameters, self._schedule)

    # What the clocks differ in.

    @property
    @abstractmethod
    def gathered(self) -> Gathered:
        """Return what was gathered so far."""

    @abstractmethod
    def _start(self, check: Callable[[], None]) -> RunEnd | None:
        """Start the processes; return how the run has ended if there is nothing to do.

        `check` is called while waiting, now and later, and may raise to end the run between two
        messages.
        """

    @abstractmethod
    def _next(self) -> RunEnd | None:
        """Go on by a round, or by a message; return how the run has ended, None if it continues."""

    @abstractmethod
    def _find_results(self, ending: RunEnd) -> Sequence[Any]:
        """Return the messages with which the coordinator publishes the results of the run."""

    @abstractmethod
    def _publish(self, message: Any) -> None:
        """Publish a message of the coordinator; nothing without processes."""

    @abstractmethod
    def _record(self, message: Any) -> None:
        """Record a message of the coordinator, and pass it to the listeners."""

    @abstractmethod
    def _failed(self, error: str) -> RunEnd:
        """Return the end of a run that failed."""

    def _interrupted(self) -> RunEnd:
        """Let what is under way come to its end, for a short while; return how the run ends."""
        return INTERRUPTED

    def _stop(self) -> None:
        """Do what comes before the processes are ended."""

    def _tidy(self, ending: RunEnd) -> None:
        """Take away what is no longer needed when the results are recorded."""

    @abstractmethod
    def _figures(self) -> dict[str, Any]:
        """Return the fields of the outcome that only this clock has."""

    @property
    def _release(self) -> Release | None:
        """Return what answers with the moves of the run, None if it does not."""
        return None

    # The loop.

    def begin(self, check: Callable[[], None]) -> None:
        """Start the processes, and end the run if there is nothing to do."""
        self._play(lambda: self._start(check))

    def advance(self) -> None:
        """Go on by a round, or by a message."""
        self._play(self._next)

    def end(self) -> None:
        """End the run where it stands, unless it has ended."""
        with self._whole():
            self._finish(INTERRUPTED)

    def _play(self, act: Callable[[], RunEnd | None]) -> None:
        with self._whole():
            try:
                with self._lock.act():
                    ending = act()
                    if ending is None:
                        self._lock.check()
            except Interrupted:
                ending = INTERRUPTED
            except CubepathError as problem:
                ending = self._failed(str(problem))
            except MemoryError:
                ending = self._failed("out of memory")
            if ending is not None:
                self._finish(ending)
        self._answer()

    @contextmanager
    def _whole(self) -> Generator[None]:
        """Do something wholly, or end the run: a round that is broken off cannot be taken up."""
        try:
            yield
        except BaseException:
            try:
                with suppress(Exception):  # what was raised first says more
                    self._finish(INTERRUPTED)
            finally:
                self._close()
            raise

    # The ending.

    def _finish(self, ending: RunEnd) -> None:
        """End the run, or continue with its end where that was broken off."""
        if self._closed:
            return
        with self._lock.act():
            if self.ending is None:
                self.ending = ending
                try:
                    if ending == INTERRUPTED:
                        self.ending = self._interrupted()
                    self._announce(self.ending)
                finally:
                    self._end_processes()
            self._conclude(self.ending)
            self._close()

    def _announce(self, ending: RunEnd) -> None:
        """Publish the results, while the router is there."""
        if self._fleet is None:
            return
        try:
            self.writer.flush()  # to find the results may take seconds
        except CubepathError as problem:  # a full disk: listeners hear of it, too
            ending = self.ending = RunEnd("failed", ending.error or str(problem))
        with suppress(CubepathError):
            results = self._find_results(ending)
            for message in results:
                self._publish(message)
            self._results, self._refused_then = results, self._refused

    def _end_processes(self) -> None:
        """Answer nobody any more, end the processes, and leave nothing running."""
        answers, self._answers = self._answers, None
        try:
            if answers is not None:
                answers.close()
        finally:
            try:
                with suppress(CubepathError):
                    self.writer.flush()  # to end the processes may take seconds
                self._stop()
            finally:
                self._fleet = None
                self._resources.close()

    def _conclude(self, ending: RunEnd) -> None:
        """Put the results in the recording, those that are not there yet, and close it."""
        writer = self.writer
        try:
            # What was refused while the processes ended is recorded, and has to be counted.
            if self._results is None or self._refused != self._refused_then:
                writer.flush()
                self._results, self._refused_then = self._find_results(ending), self._refused
            if self._first_result is None:
                self._first_result = writer.messages
            while (number := writer.messages - self._first_result) < len(self._results):
                self._record(self._results[number])
            writer.close()
        except CubepathError as problem:
            ending = self.ending = RunEnd("failed", ending.error or str(problem))
        self._tidy(ending)
        self.outcome = self.outcome_so_far()

    def _close(self) -> None:
        """Leave nothing behind, whatever happened; what was flushed is recorded."""
        if not self._closed:
            self._closed = True
            try:
                self._end_processes()
            finally:
                with suppress(CubepathError):  # the outcome has told, if there is one
                    self.writer.close()

    # What it says.

    @property
    def fleet(self) -> Fleet:
        """Return the processes; CheckError if there are none, or no more."""
        if self._fleet is None:
            raise CheckError("the run has no processes: expected one that is under way")
        return self._fleet

    @property
    def status(self) -> Status:
        """Return where the run stands."""
        gathered = self.gathered
        return Status(
            gathered.rounds,
            tuple(gathered.sites),
            gathered.moves,
            gathered.live.cubes,
            gathered.reached,
            None if self.outcome is None else self.outcome.ended,
        )

    def outcome_so_far(self) -> Outcome:
        """Return the outcome, or what it would be if the run ended where it stands."""
        assignment = self.task.assignment
        return outcome_of(
            self.plan,
            self.task,
            self.gathered,
            self.ending or INTERRUPTED,
            self.writer,
            seconds=round(time.monotonic() - self._began, 3),
            processes=self._processes,
            refused=self._refused,
            schedule_cubes=None if assignment is None else len(assignment.cubes),
            **self._figures(),
        )

    def _answer_from(self) -> None:
        """Answer queries from now on: the router is there, and nobody has joined."""
        fleet = self.fleet
        self.endpoint, self.run = fleet.endpoint, fleet.run
        about = RunInfo(
            self.run,
            format_of(self._parameters),
            self._parameters,
            scene_to_toml(self.task.scene),
            None if self._schedule is None else self._schedule.decode(),
        )
        credentials = fleet.credentials()
        self._answers = Answers(self.endpoint, credentials, self.status, about, self._release)

    def _answer(self) -> None:
        """Answer where the run stands from now on."""
        now = self.gathered.rounds, self.gathered.moves
        if self._answers is not None and now != self._answered:
            self._answered = now
            self._answers.set(self.status)

    def _watch(self) -> None:
        """Say that a round is over, or that modules have moved."""
        self._answer()
        self._listeners.watch(self.gathered)
