"""A run under way: started, stepped, watched, tapped, asked and stopped.

Room: coordinator. What a run does follows from its plan alone: looking at it, or stepping through
it, changes nothing.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, TypeAlias

from cubepath.agents.free.fleet import FreeFleet
from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.processes.network import Way, straight
from cubepath.coordinator.runs.asking import Answers, Status
from cubepath.coordinator.runs.conductor import Ending
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_launch import FreeRun
from cubepath.coordinator.runs.interrupts import Interrupted, interrupts
from cubepath.coordinator.runs.lockstep_launch import LockstepRun
from cubepath.coordinator.runs.outcome import Outcome, outcome_of
from cubepath.coordinator.runs.plan import Plan, Task, check_topics, file_name, parameters_of
from cubepath.coordinator.runs.plan import task_of as checked
from cubepath.coordinator.runs.resuming import keeper_logs, resumed
from cubepath.coordinator.runs.tap import Overheard, Tap
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, process_name
from cubepath.protocol.wire.free_messages import FreeMessage
from cubepath.protocol.wire.messages import Message
from cubepath.protocol.wire.sessions import check_descriptors

Watch: TypeAlias = Callable[[Gathered], None]
Say: TypeAlias = Callable[[str], None]
Hear: TypeAlias = Callable[[Overheard], None]
_TIMEOUT_S = 60.0


class _Driver(Protocol):
    """A run of either clock."""

    @property
    def gathered(self) -> Gathered: ...
    @property
    def fleet(self) -> Fleet | FreeFleet: ...
    def begin(self, check: Callable[[], None]) -> Ending | None: ...
    def advance(self) -> Ending | None: ...
    def interrupted(self) -> None: ...
    def end(self) -> None: ...
    def failed(self, error: str) -> Ending: ...
    def conclude(self, ending: Ending) -> None: ...
    def tidy(self, ending: Ending) -> None: ...
    def figures(self) -> Mapping[str, Any]: ...


class Running:
    """A run as a context manager: nothing of it is left when the block ends.

    A run with rounds goes on only when it is told to, by `step`, `until` or `play`. Without rounds
    modules act when they are ready; the same functions listen to what they do. What goes wrong with
    the run (a process that dies, a rule that gives up) ends it, and `outcome` says how; so does a
    block that is left before its end. The recording is closed in any case.

    `watch` is called after each round, and without rounds now and then; `say` is told in a line
    where others can join, who is waited for, and who died.

    >>> with start("hex:n=3", log="logs/steps.mcap", processes=1) as run:
    ...     while run.step() and run.status.moves < 3:
    ...         pass
    ...     status = run.status
    >>> status.round, status.moves, run.outcome.ended
    (3, 3, 'interrupted')
    """

    def __init__(
        self,
        plan: Plan,
        *,
        watch: Watch | None = None,
        say: Say | None = None,
        way: Way = straight,
    ) -> None:
        """Check the plan, and start nothing yet; InputError as for `run`."""
        self._before: Recording | None = None
        if plan.resume is None:
            task = checked(plan)
        else:
            plan, task, self._before = resumed(plan, plan.resume)
        _check(plan, task)
        self.plan = plan
        self.scene: Scene = task.scene
        self.endpoint = ""
        """Where whoever may join can listen: ``cubepath.protocol.open_client(endpoint)``."""
        self.run = ""
        """The name of the run in keys: ``cubepath/RUN/...``."""
        self.check: Callable[[], None] = lambda: None
        """Called while the run waits, from its start on; what it raises ends the run."""
        self._task = task
        self._watch = watch
        self._say = say or (lambda _: None)
        self._way = way
        self._hears: list[Hear] = []
        self._began = time.monotonic()
        self._opened: tuple[RecordingWriter, _Driver] | None = None
        self._answers: Answers | None = None
        self._ending: Ending | None = None
        self._outcome: Outcome | None = None

    def __enter__(self) -> Self:
        """Start the processes; CheckError if they cannot be started, or one dies meanwhile."""
        self._open()
        with ExitStack() as stack:
            stack.callback(self._abandon)
            self._begin(self.check)
            self._conclude()
            if self._outcome is not None and self._outcome.ended == "failed":
                raise CheckError(str(self._outcome.error))
            stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End what is still running, and close the recording."""
        try:
            self.stop()
        finally:
            self._abandon()

    def play_from_the_start(self) -> Outcome:
        """Begin, and go on to the end, which an interrupt brings about as well."""
        self._open()
        try:
            with interrupts() as check:
                self._begin(check)
                while self._ending is None:
                    self._attempt(self._driver.advance)
            self._conclude()
        finally:
            self._abandon()
        return self.outcome

    def _open(self) -> None:
        """Open the recording."""
        plan, task = self.plan, self._task
        path = Path(plan.log) if plan.log else Path("logs") / file_name(plan, task)
        if plan.is_free and plan.resume is None and keeper_logs(path).exists():
            raise InputError(
                f"{keeper_logs(path)}: exists already, expected no logs of another run"
            )
        schedule = None if task.assignment is None else schedule_to_jsonl(task.assignment.cubes)
        writer = RecordingWriter(path, task.scene, parameters_of(plan, task), schedule)
        common: dict[str, Any] = {
            "say": self._say,
            "watch": self._watched,
            "hear": self._heard,
            "way": self._way,
        }
        driver: _Driver = (
            FreeRun(plan, task, writer, before=self._before, **common)
            if plan.is_free
            else LockstepRun(plan, task, writer, **common)
        )
        self._began = time.monotonic()
        self._opened = writer, driver

    @property
    def _driver(self) -> _Driver:
        if self._opened is None:
            raise CheckError("the run has not begun: expected 'with start(...) as run:'")
        return self._opened[1]

    def _begin(self, check: Callable[[], None]) -> None:
        self._attempt(lambda: self._driver.begin(check))
        if self._ending is None:
            fleet = self._driver.fleet
            self.endpoint, self.run = fleet.endpoint, fleet.run
            self._answers = Answers(self.run, self.endpoint, fleet.credentials(), self.status)

    # How it goes on.

    def step(self, count: int = 1, *, timeout_s: float = _TIMEOUT_S) -> bool:
        """Play so many rounds, or listen until so many more moves; return whether the run goes on.

        Without rounds, TimeoutError if they do not come in time.
        """
        if not self.plan.is_free:
            for _ in range(count):
                self._advance()
            return self.goes_on
        enough = self.gathered.moves + count
        self.until(lambda run: not run.goes_on or run.gathered.moves >= enough, timeout_s=timeout_s)
        return self.goes_on

    def until(self, what: Callable[[Running], object], *, timeout_s: float = _TIMEOUT_S) -> None:
        """Go on until something holds of the run, which is looked at after each round.

        Without rounds it is looked at after each message. CheckError if the run ends before it
        holds, TimeoutError if it takes longer than `timeout_s`.
        """
        end = time.monotonic() + timeout_s
        while not what(self):
            if not self.goes_on:
                why = self.outcome.error or self.outcome.ended
                raise CheckError(f"the run ended before that: {why} ({_stands(self.status)})")
            if time.monotonic() > end:
                raise TimeoutError(f"not within {timeout_s:g} s ({_stands(self.status)})")
            self._advance()

    def play(self) -> Outcome:
        """Go on to the end of the run, and return its outcome."""
        while self.goes_on:
            self._advance()
        return self.outcome

    def stop(self) -> Outcome:
        """End the run where it stands, unless it has ended; return its outcome."""
        if self._ending is None:
            self._end(Ending("interrupted", "interrupted"))
        self._conclude()
        return self.outcome

    def messages(self, *kinds: str) -> Iterator[Overheard]:
        """Go on to the end of the run, and yield each message, or each of these kinds."""
        tap = self.tap(*kinds)
        try:
            while self.goes_on:
                yield from tap
                self._advance()
            yield from tap
        finally:
            self._hears.remove(tap.hear)

    # What it says.

    def tap(self, *kinds: str) -> Tap:
        """Return what is heard from now on, in order; with kinds, what is of these kinds alone.

        What modules say to each other in one message, claims for instance, comes part by part.
        """
        tap = Tap(kinds)
        self.listen(tap.hear)
        return tap

    def listen(self, hear: Hear) -> None:
        """Have a function called with each message from now on, and with each part of one.

        It may look at the run and end its processes; it may not step it.
        """
        self._hears.append(hear)

    # How it stands.

    @property
    def goes_on(self) -> bool:
        """Return whether the run has not ended."""
        return self._outcome is None

    @property
    def outcome(self) -> Outcome:
        """Return the outcome; CheckError while the run goes on."""
        if self._outcome is None:
            raise CheckError("the run goes on: expected it to have ended")
        return self._outcome

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far: the edge path, its heap, and who stands where."""
        return self._driver.gathered

    @property
    def status(self) -> Status:
        """Return where the run stands."""
        gathered = self.gathered
        heap = gathered.live
        return Status(
            gathered.rounds,
            tuple(gathered.sites),
            gathered.moves,
            heap.cubes,
            gathered.reached,
            None if self._outcome is None else self._outcome.ended,
        )

    @property
    def round(self) -> int:
        """Return the last complete round, or the greatest level."""
        return self.gathered.rounds

    @property
    def sites(self) -> tuple[Site, ...]:
        """Return where each module stands."""
        return tuple(self.gathered.sites)

    @property
    def goal_reached(self) -> bool:
        """Return whether the modules are at the goal."""
        return self.gathered.reached

    @property
    def log(self) -> Path:
        """Return the path of the recording; it is whole when the run has ended."""
        if self._opened is None:
            raise CheckError("the run has not begun, and has no recording yet")
        return self._opened[0].path

    # Its processes.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name: ``process_0``, ``keeper_0``, ``router``."""
        return self._driver.fleet.pids

    def process_of(self, module: int) -> str:
        """Return the name of the process that has a module."""
        for number, modules in enumerate(self._driver.fleet.modules_of):
            if module in modules:
                return process_name(number)
        raise InputError(f"module_{module}: expected module_0 to module_{len(self.sites) - 1}")

    def modules_of(self, process: str) -> tuple[int, ...]:
        """Return the modules of a process; none of a keeper, or of the router."""
        for number, modules in enumerate(self._driver.fleet.modules_of):
            if process_name(number) == process:
                return tuple(modules)
        return ()

    def signal(self, process: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a process of the run by name; InputError if it has no such process.

        A process that stands still (SIGSTOP) is killed when the run ends, if nobody lets it go on.
        """
        pids = self.pids
        if process not in pids:
            raise InputError(f"{process}: expected one of {', '.join(pids)}")
        os.kill(pids[process], number)

    def restart(self, process: str) -> None:
        """Start a process again that has died; InputError for runs with rounds, which then fail."""
        fleet = self._driver.fleet
        if not isinstance(fleet, FreeFleet):
            raise InputError(f"{process}: started again only in runs without rounds (clock=free)")
        fleet.start_again(process)

    def credentials(self, name: str = COORDINATOR) -> Credentials:
        """Return by what the one of this name shows who speaks, at a private router."""
        return self._driver.fleet.credentials(name)

    # Inside.

    def _advance(self) -> None:
        if self.goes_on:
            self._attempt(self._driver.advance)
            self._conclude()

    def _attempt(self, act: Callable[[], Ending | None]) -> None:
        """Do something; end the processes if the run has come to its end by that."""
        driver = self._driver
        try:
            ending = act()
        except Interrupted:
            ending = Ending("interrupted", "interrupted")
        except CubepathError as problem:
            ending = driver.failed(str(problem))
        except MemoryError:
            ending = driver.failed("out of memory")
        if ending is not None:
            self._end(ending)

    def _end(self, ending: Ending) -> None:
        self._ending = ending
        driver = self._driver
        try:
            if ending.ended == "interrupted":
                driver.interrupted()
        finally:
            self._release(driver)

    def _release(self, driver: _Driver) -> None:
        """End the processes and the session that answers."""
        answers, self._answers = self._answers, None
        try:
            if answers is not None:
                answers.close()
        finally:
            driver.end()

    def _conclude(self) -> None:
        """Write what came of a run that has ended, and close the recording."""
        if self._opened is None or self._ending is None or self._outcome is not None:
            return
        writer, driver = self._opened
        ending = self._ending
        try:
            driver.conclude(ending)
        except CubepathError as problem:
            ending = Ending("failed", ending.error or str(problem))
        driver.tidy(ending)
        seconds = round(time.monotonic() - self._began, 3)
        figures = driver.figures()
        self._outcome = outcome_of(
            self.plan, self._task, driver.gathered, ending, writer, seconds=seconds, **figures
        )

    def _abandon(self) -> None:
        """Leave nothing behind, whatever happened; what was flushed is on record."""
        if self._opened is not None:
            writer, driver = self._opened
            try:
                self._release(driver)
            finally:
                with suppress(CubepathError):  # the outcome has told, if there is one
                    writer.close()

    def _watched(self, gathered: Gathered) -> None:
        if self._answers is not None:
            self._answers.set(self.status)
        if self._watch is not None:
            self._watch(gathered)

    def _heard(self, message: Message | FreeMessage, wall_ns: int) -> None:
        if not self._hears:
            return
        for each in (message, *getattr(message, "parts", ())):
            kind = str(type(each).__struct_config__.tag)
            at = getattr(each, "round", getattr(each, "level", 0))
            overheard = Overheard(kind, at, each, wall_ns)
            for hear in tuple(self._hears):
                hear(overheard)


def _check(plan: Plan, task: Task) -> None:
    """Refuse what the network, the recording or the system cannot carry."""
    modules = len(task.scene.start)
    own = min(plan.processes, modules)
    plan.network.check(modules, own)
    check_topics(task, plan)
    # Who waits for others has a session more, for that.
    keepers = plan.keepers if plan.is_free else 0
    check_descriptors(own + keepers + bool(plan.wait_for), files=1)


def _stands(status: Status) -> str:
    at = "" if status.goal_reached else " not"
    return f"round {status.round}, {status.moves} moves, goal{at} reached"
