"""A run under way: started, stepped, watched, tapped, asked and stopped.

What a run does follows from its plan alone: looking at it, or stepping through it, changes nothing.
"""

from __future__ import annotations

import os
import time
import weakref
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

from cubepath.agents.free.fleet import FreeFleet
from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.processes.network import Network, Way, straight
from cubepath.coordinator.runs.asking import About, Answers, Status
from cubepath.coordinator.runs.conductor import Ending
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.runs.free_launch import FreeRun
from cubepath.coordinator.runs.lockstep_launch import LockstepRun
from cubepath.coordinator.runs.outcome import Outcome, outcome_of
from cubepath.coordinator.runs.plan import (
    Branch,
    Plan,
    Task,
    check_topics,
    file_name,
    parameters_of,
    task_of as checked,
)
from cubepath.coordinator.runs.resuming import check_logs, keeper_logs, locked_logs, resumed
from cubepath.coordinator.runs.standing import Driver, Standing, Watch
from cubepath.coordinator.runs.tap import Overheard, Tap
from cubepath.coordinator.runs.turns import Interrupted, Turns, interrupts
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.given import function, seconds, whole_number
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.description import format_of
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.free_messages import FreeMessage
from cubepath.protocol.wire.messages import Message
from cubepath.protocol.wire.sessions import check_descriptors

Say: TypeAlias = Callable[[str], None]
Hear: TypeAlias = Callable[[Overheard], None]
_TIMEOUT_S = 60.0


class Running(Standing):
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
        branch: Branch | None = None,
    ) -> None:
        """Check the plan, and start nothing yet; InputError as for `run`.

        With a `branch` modules choose first as in another recording.
        """
        self._before: Recording | None = None
        if plan.resume is None:
            task = replace(checked(plan), branch=branch)
        else:
            plan, task, self._before = resumed(plan, plan.resume)
        _check(plan, task)
        super().__init__(plan, task.scene)
        self.check_files()
        self.endpoint = ""
        """Where whoever may join can listen: ``cubepath.protocol.open_client(endpoint)``."""
        self.run = ""
        """The name of the run in keys: ``cubepath/RUN/...``."""
        self.check: Callable[[], None] = lambda: None
        """Called while the run waits, from its start on; what it raises ends the run."""
        self._task = task
        self._watches += [] if watch is None else [watch]
        self._say = say or (lambda _: None)
        self._way = way
        self._hears: list[Hear] = []
        self._turns = Turns()
        self._began = time.monotonic()
        self._answers: Answers | None = None
        self._said: tuple[dict[str, str], str | None] = {}, None
        self._told: tuple[int, int] = 0, 0
        self._ending: Ending | None = None
        self._abandoned = False

    def __enter__(self) -> Self:
        """Start the processes; CheckError if they cannot be started, or one dies meanwhile.

        A run is entered once.
        """
        with self._turns.hold():
            self._open()
            with self._whole():

                def check() -> None:
                    self._turns.check()
                    self.check()

                self._begin(check)
                self._conclude()
                if self._outcome is not None and self._outcome.ended == "failed":
                    raise CheckError(str(self._outcome.error))
                self._turns.tell()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End what is still running, and close the recording; nothing if that has been done.

        What listeners raise at the end is raised, unless the block is left by an error of its own.
        """
        try:
            with self._turns.to_close() as free:
                if not free:
                    return  # it was noted
                self._finish()
                self._abandon()
        except BaseException:
            self._abandon()
            raise
        if error is None:
            self._turns.tell()

    def play_from_the_start(self) -> Outcome:
        """Begin, and go on to the end, which an interrupt brings about as well."""
        with self._turns.hold():
            self._open()
            with interrupts() as check, self._whole():

                def both() -> None:
                    check()
                    self._turns.check()

                self._begin(both)
                self._turns.tell()
                while self._ending is None:
                    self._attempt(self._driver.advance)
                    self._turns.tell()
            with self._whole():
                self._conclude()
            self._abandon()
            self._turns.tell()
        return self.outcome

    def _open(self) -> None:
        """Open the recording."""
        if self._opened is not None:
            raise CheckError(
                "the run has begun before: expected another start(...) for another run"
            )
        plan, task = self.plan, self._task
        path = Path(plan.log) if plan.log else Path("logs") / file_name(plan, task)
        if plan.is_free and plan.resume is None and os.path.lexists(keeper_logs(path)):
            raise InputError(
                f"{keeper_logs(path)}: exists already, expected no logs of another run"
            )
        schedule = None if task.assignment is None else schedule_to_jsonl(task.assignment.cubes)
        parameters = parameters_of(plan, task)
        lock = None if plan.resume is None else locked_logs(keeper_logs(plan.resume))
        try:
            if plan.resume is not None and self._before is not None:
                check_logs(keeper_logs(plan.resume), self._before, plan.keepers)
            writer = RecordingWriter(path, task.scene, parameters, schedule)
        except BaseException:
            if lock is not None:
                lock.close()
            raise
        self._said = parameters, None if schedule is None else schedule.decode()
        common: dict[str, Any] = {
            "say": self._say,
            "watch": self._watched,
            "hear": self._heard,
            "way": self._way,
            "opened": self._answer_from,
        }
        driver: Driver = (
            FreeRun(plan, task, writer, before=self._before, lock=lock, **common)
            if plan.is_free
            else LockstepRun(plan, task, writer, pace=self._left, **common)
        )
        self._began = time.monotonic()
        self._opened = writer, driver

    def _begin(self, check: Callable[[], None]) -> None:
        def begin() -> Ending | None:
            ending = self._driver.begin(check)
            if ending is None:
                self._answer()
            return ending

        self._attempt(begin)

    def _answer_from(self, fleet: Fleet | FreeFleet) -> None:
        """Answer whoever asks, from now on."""
        self.endpoint, self.run = fleet.endpoint, fleet.run
        parameters, schedule = self._said
        about = About(
            self.run, format_of(parameters), parameters, scene_to_toml(self.scene), schedule
        )
        gathered = self.gathered
        release = gathered.released if isinstance(gathered, FreeGatherer) else None
        self._answers = Answers(self.endpoint, fleet.credentials(), self.status, about, release)

    def check_files(self, more: int = 0) -> None:
        """Check that this process may open as many files as the run takes, and so many more.

        CubepathError says how many it takes.
        """
        plan = self.plan
        own = min(plan.processes, len(self.scene.start))
        keepers = plan.keepers if plan.is_free else 0
        # Who waits for others has a session more, for that.
        check_descriptors(own + keepers + (plan.network != Network()), files=1 + more)

    @property
    def rule(self) -> str:
        """Return the name of the rule that modules follow at the beginning."""
        return self._task.name

    # How it goes on.

    def step(self, count: int = 1, *, timeout_s: float = _TIMEOUT_S) -> bool:
        """Play so many rounds, or listen until so many more moves; return whether the run goes on.

        Without rounds, TimeoutError if they do not come in time.
        """
        count, timeout_s = whole_number("step", count, 0), seconds("timeout_s", timeout_s)
        with self._turns.hold():
            if not self.plan.is_free:
                for _ in range(count):
                    self._advance()
                return self.goes_on
            enough = self.gathered.moves + count
            self.until(
                lambda run: not run.goes_on or run.gathered.moves >= enough, timeout_s=timeout_s
            )
            return self.goes_on

    def until(self, what: Callable[[Running], object], *, timeout_s: float = _TIMEOUT_S) -> None:
        """Go on until something holds of the run, which is looked at after each round.

        Without rounds it is looked at after each message. CheckError if the run ends before it
        holds, TimeoutError if it takes longer than `timeout_s`.
        """
        function("until", what)
        timeout_s = seconds("timeout_s", timeout_s)
        with self._turns.hold():
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
        with self._turns.hold():
            while self.goes_on:
                self._advance()
            return self.outcome

    def stop(self) -> Outcome:
        """End the run where it stands, unless it has ended; return its outcome.

        What listens to a round, or another thread, can ask for that as well: whoever goes on with
        the run then ends it before the next message, and what is returned is how it stands so far.
        """
        driver = self._driver
        with self._turns.to_stop() as free:
            if not free and self._outcome is None:
                return self._found(driver, self._ending or Ending("interrupted", "interrupted"))
            self._finish()
        self._turns.tell()
        return self.outcome

    def messages(self, *kinds: str) -> Iterator[Overheard]:
        """Go on to the end of the run, and yield each message, or each of these kinds.

        Who breaks out of the loop leaves the run where it is: `step` and its like go on from there.
        InputError if there is no such kind.
        """
        return self._messages(Tap(kinds))

    def _messages(self, tap: Tap) -> Iterator[Overheard]:
        self.listen(tap.hear)
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

        What modules say to each other in one message, claims for instance, comes part by part. A
        tap holds a million messages at most, then the oldest are dropped, and counted; it is gone
        when nobody holds it any more. InputError if there is no such kind.
        """
        tap = Tap(kinds)
        held = weakref.ref(tap, lambda _: self._hears.remove(hear))

        def hear(overheard: Overheard) -> None:
            found = held()
            if found is not None:
                found.hear(overheard)

        self.listen(hear)
        return tap

    def listen(self, hear: Hear) -> None:
        """Have a function called with each message from now on, and with each part of one.

        It may look at the run, end its processes and stop it; it may not step it. What it raises is
        raised by `step` and its like after the round, which is completed: the run can go on.
        """
        if not callable(hear):
            raise InputError(f"listen: {hear!r}: expected a function of one message")
        self._hears.append(hear)

    # Inside.

    def _advance(self) -> None:
        with self._turns.hold():
            if self.goes_on:
                with self._whole():
                    self._attempt(self._driver.advance)
                    self._conclude()
                self._answer()
            self._turns.tell()

    @contextmanager
    def _whole(self) -> Generator[None]:
        """Do something wholly, or end the run: a round that is broken off cannot be taken up."""
        try:
            yield
        except BaseException:
            try:
                with suppress(Exception):  # what was raised first says more
                    self._finish()
            finally:
                self._abandon()
            raise

    def _finish(self) -> None:
        """End the run where it stands, unless it has ended or never begun."""
        if self._opened is None:
            return
        if self._ending is None:
            self._end(Ending("interrupted", "interrupted"))
        self._conclude()

    def _attempt(self, act: Callable[[], Ending | None]) -> None:
        """Do something; end the processes if the run has come to its end by that."""
        driver = self._driver
        try:
            with self._turns.act():
                ending = act()
                if ending is None:
                    self._turns.check()
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
            with self._turns.act():
                if ending.ended == "interrupted":
                    ending = self._ending = driver.interrupted()
                with suppress(CubepathError):  # what comes of the run is found once more
                    driver.announce(ending)
        finally:
            with self._turns.act():
                self._release(driver)

    def _release(self, driver: Driver) -> None:
        """End the processes and the session that answers."""
        answers, self._answers = self._answers, None
        try:
            if answers is not None:
                answers.close()
        finally:
            driver.end()

    def _conclude(self) -> None:
        """Write what came of a run that has ended, and close the recording."""
        if self._opened is None or self._ending is None or self._concluded:
            return
        driver, ending = self._driver, self._ending
        self._concluded = True
        try:
            with self._turns.act():
                driver.conclude(ending)
        except CubepathError as problem:
            ending = Ending("failed", ending.error or str(problem))
        driver.tidy(ending)
        self._outcome = self._found(driver, ending)

    def _found(self, driver: Driver, ending: Ending) -> Outcome:
        if self._opened is None:
            raise AssertionError("a driver without a recording")  # they come together
        return outcome_of(
            self.plan,
            self._task,
            driver.gathered,
            ending,
            self._opened[0],
            seconds=round(time.monotonic() - self._began, 3),
            **driver.figures(),
        )

    def _abandon(self) -> None:
        """Leave nothing behind, whatever happened; what was flushed is on record."""
        if self._opened is not None and not self._abandoned:
            writer, driver = self._opened
            self._abandoned = True
            try:
                self._release(driver)
            finally:
                with suppress(CubepathError):  # the outcome has told, if there is one
                    writer.close()

    def _answer(self) -> None:
        """Answer where the run stands from now on."""
        gathered = self.gathered
        now = gathered.rounds, gathered.moves
        if self._answers is not None and now != self._told:
            self._told = now
            self._answers.set(self.status)

    def _watched(self, gathered: Gathered) -> None:
        self._answer()
        for watch in tuple(self._watches):
            self._turns.call(partial(watch, gathered))

    def _heard(self, message: Message | FreeMessage, wall_ns: int) -> None:
        if not self._hears:
            return
        for each in (message, *getattr(message, "parts", ())):
            kind = str(type(each).__struct_config__.tag)
            at = getattr(each, "round", getattr(each, "level", 0))
            overheard = Overheard(kind, at, each, wall_ns)
            for hear in tuple(self._hears):
                self._turns.call(partial(hear, overheard))


def _check(plan: Plan, task: Task) -> None:
    """Refuse what the network, the recording or the system cannot carry."""
    modules = len(task.scene.start)
    plan.network.check(modules, min(plan.processes, modules))
    check_topics(task, plan)


def _stands(status: Status) -> str:
    at = "" if status.goal_reached else " not"
    return f"round {status.round}, {status.moves} moves, goal{at} reached"
