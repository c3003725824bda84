"""A run under way: started, stepped, watched, tapped, asked and stopped.

What a run does follows from its plan alone: looking at it, or stepping through it, changes nothing.
"""

from __future__ import annotations

import os
import signal
import time
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, Unpack

from cubepath.agents.processes.fleet import ProcessFleet
from cubepath.agents.processes.network import NetworkConfig, Way, straight
from cubepath.coordinator.progress import each_of, progress_bar, showing_run
from cubepath.coordinator.runs.asking import Status
from cubepath.coordinator.runs.driver import Driver, Pace, RunContext, Say
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.listeners import Hear, Listeners, Tap, TappedMessage, Watch
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import (
    Branch,
    Plan,
    PlanOptions,
    RunTask,
    check_topics,
    plan_of,
    task_of as checked,
)
from cubepath.coordinator.runs.run_lock import RunLock, interrupts
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import function, seconds, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, process_name
from cubepath.protocol.wire.sessions import check_descriptors

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording

_TIMEOUT_S = 60.0


class Run:
    """A run as a context manager: nothing of it is left when the block ends.

    A run with rounds advances only when you call `step`, `until` or `play`. Without rounds modules
    act when they are ready; the same functions listen to what they do. What goes wrong with the run
    (a process that dies, a rule that gives up) ends it, and `outcome` says how; so does a block
    that is left before its end. The recording is closed in any case.

    `watch` is called after each round, and without rounds now and then; `say` gets a line with the
    address where others can join, whom the run waits for, and what died.

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
        before: Recording | None = None
        if plan.resume is None:
            task = replace(checked(plan), branch=branch)
        else:
            from cubepath.coordinator.runs.resuming import resumed  # noqa: PLC0415 - for few runs

            plan, task, before = resumed(plan, plan.resume)
        _check(plan, task)
        self.plan = plan
        self.scene = task.scene
        self.check_files()
        self.check: Callable[[], None] = lambda: None
        """Called while the run waits, from its start on; what it raises ends the run."""
        self.pace: Pace = lambda: 0.0
        """Asked before each round how many seconds it is to wait yet, until that is 0."""
        self._listeners = Listeners()
        self._listeners.watches += [] if watch is None else [watch]
        self._lock = RunLock()
        self._context = RunContext(
            plan,
            task,
            self._listeners,
            self._lock,
            say or (lambda _: None),
            way,
            self._wait_s,
            before,
        )
        self._driver: Driver[ProcessFleet] | None = None

    def __enter__(self) -> Self:
        """Start the processes; CheckError if they cannot be started, or one dies meanwhile.

        A run is entered once.
        """
        with self._lock.hold():
            self._begin(self._check)
            outcome = None if self._driver is None else self._driver.outcome
            if outcome is not None and outcome.ended == "failed":
                raise CheckError(str(outcome.error))
            self._listeners.raise_first()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End what is still running, and close the recording; nothing if that has been done.

        What listeners raise at the end is raised, unless the block is left by its own error.
        """
        with self._lock.to_close() as free:
            if not free:
                return  # it was noted
            if self._driver is not None:
                self._driver.end()
        if error is None:
            self._listeners.raise_first()

    def play_from_the_start(self) -> Outcome:
        """Begin, and continue to the end, which an interrupt brings about as well."""
        with self._lock.hold(), interrupts() as interrupted:

            def check() -> None:
                interrupted()
                self._check()

            driver = self._begin(check)
            try:
                self._listeners.raise_first()
                while driver.ending is None:
                    driver.advance()
                    self._listeners.raise_first()
            finally:
                driver.end()
        return self.outcome

    def _begin(self, check: Callable[[], None]) -> Driver[ProcessFleet]:
        """Open the recording, and start the processes."""
        if self._driver is not None:
            raise CheckError(
                "the run has begun before: expected another start(...) for another run"
            )
        context = self._context
        driver = self._driver = _driver(context)
        driver.begin(check)
        return driver

    def _wait_s(self) -> float:
        return self.pace()  # which may have changed

    def _check(self) -> None:
        self._lock.check()
        self.check()

    def check_files(self, more: int = 0) -> None:
        """Check that this process may open as many files as the run takes, and this many more.

        CubepathError says how many it takes.
        """
        plan = self.plan
        own = min(plan.processes, len(self.scene.start))
        keepers = plan.keepers if plan.is_free else 0
        # Waiting for remote processes opens one more session.
        check_descriptors(own + keepers + (plan.network != NetworkConfig()), files=1 + more)

    @property
    def rule(self) -> str:
        """Return the name of the rule that modules follow at the beginning."""
        return self._context.task.name

    # How it continues.

    def step(self, count: int = 1, *, timeout_s: float = _TIMEOUT_S) -> bool:
        """Play `count` rounds, or wait for `count` more moves; return whether the run continues.

        Without rounds, TimeoutError if they do not come in time.
        """
        count, timeout_s = whole_number("step", count, 0), seconds("timeout_s", timeout_s)
        with self._lock.hold():
            if not self.plan.is_free:
                for _ in range(count):
                    self._advance()
                return self.goes_on
            enough = self.gathered.moves + count
            self.until(
                lambda run: not run.goes_on or run.gathered.moves >= enough, timeout_s=timeout_s
            )
            return self.goes_on

    def until(self, what: Callable[[Run], object], *, timeout_s: float = _TIMEOUT_S) -> None:
        """Go on until something holds of the run, which is looked at after each round.

        Without rounds it is looked at after each message. CheckError if the run ends before it
        holds, TimeoutError if it takes longer than `timeout_s`.
        """
        function("until", what)
        timeout_s = seconds("timeout_s", timeout_s)
        with self._lock.hold():
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
        with self._lock.hold():
            while self.goes_on:
                self._advance()
            return self.outcome

    def stop(self) -> Outcome:
        """End the run where it stands, unless it has ended; return its outcome.

        What listens to a round, or another thread, can ask for that as well: the thread that steps
        the run then ends it before the next message; the result is the status so far.
        """
        driver = self._begun
        with self._lock.to_stop() as free:
            if not free and driver.outcome is None:
                return driver.outcome_so_far()
            driver.end()
        self._listeners.raise_first()
        return self.outcome

    def messages(self, *kinds: str) -> Iterator[TappedMessage]:
        """Go on to the end of the run, and yield each message, or each of these kinds.

        Breaking out of the loop leaves the run where it is: `step` and its like continue from
        there. InputError if there is no such kind.
        """
        return self._messages(Tap(kinds))

    def _messages(self, tap: Tap) -> Iterator[TappedMessage]:
        self.listen(tap.hear)
        try:
            while self.goes_on:
                yield from tap
                self._advance()
            yield from tap
        finally:
            self._listeners.hears.remove(tap.hear)

    # What it says.

    def tap(self, *kinds: str) -> Tap:
        """Return what is heard from now on, in order; with kinds, what is of these kinds alone.

        What modules say to each other in one message, claims for instance, comes part by part. A
        tap holds a million messages at most, then the oldest are dropped, and counted; it is gone
        when nobody holds it any more. InputError if there is no such kind.
        """
        tap = Tap(kinds)
        held = weakref.ref(tap, lambda _: self._listeners.hears.remove(hear))

        def hear(tapped: TappedMessage) -> None:
            found = held()
            if found is not None:
                found.hear(tapped)

        self.listen(hear)
        return tap

    def listen(self, hear: Hear) -> None:
        """Have a function called with each message from now on, and with each part of one.

        It may look at the run, end its processes and stop it; it may not step it. What it raises is
        raised by `step` and its like after the round, which is completed: the run can continue.
        """
        if not callable(hear):
            raise InputError(f"listen: {hear!r}: expected a function of one message")
        self._listeners.hears.append(hear)

    def attend(self, watch: Watch) -> None:
        """Have a function called with what was gathered after each round, from now on."""
        self._listeners.watches.append(watch)

    def _advance(self) -> None:
        with self._lock.hold():
            if self.goes_on:
                self._begun.advance()
            self._listeners.raise_first()

    # How it stands.

    @property
    def _begun(self) -> Driver[ProcessFleet]:
        if self._driver is None:
            raise CheckError("the run has not begun: expected 'with start(...) as run:'")
        return self._driver

    @property
    def goes_on(self) -> bool:
        """Return whether the run has not ended."""
        return self._driver is None or self._driver.ending is None

    @property
    def outcome(self) -> Outcome:
        """Return the outcome; CheckError before the run, and while it continues."""
        driver = self._begun
        if driver.outcome is None:
            how = "goes on" if driver.ending is None else "was broken off while it ended"
            raise CheckError(f"the run {how}: expected it to have ended")
        return driver.outcome

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far: the edge path, its heap, and who stands where."""
        return self._begun.gathered

    @property
    def status(self) -> Status:
        """Return where the run stands."""
        return self._begun.status

    @property
    def endpoint(self) -> str:
        """Return the endpoint for other programs: ``cubepath.protocol.open_client(endpoint)``."""
        return "" if self._driver is None else self._driver.endpoint

    @property
    def run(self) -> str:
        """Return the name of the run in keys: ``cubepath/RUN/...``."""
        return "" if self._driver is None else self._driver.run

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
        if self._driver is None:
            raise CheckError("the run has not begun, and has no recording yet")
        return self._driver.writer.path

    # Its processes.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name: ``process_0``, ``keeper_0``, ``router``."""
        return self._begun.fleet.pids

    def process_of(self, module: int | str) -> str:
        """Return the name of the process that has a module: 3, or ``module_3``."""
        name = f"module_{module}" if isinstance(module, int) else str(module)
        for number, modules in enumerate(self._begun.fleet.modules_of):
            if name in map("module_{}".format, modules):
                return process_name(number)
        name = f"module_{name.removeprefix('module_')}"
        raise InputError(f"{name}: expected module_0 to module_{len(self.sites) - 1}")

    def modules_of(self, process: str) -> tuple[int, ...]:
        """Return the modules of a process; none of a keeper, or of the router."""
        for number, modules in enumerate(self._begun.fleet.modules_of):
            if process_name(number) == process:
                return tuple(modules)
        return ()

    def signal(self, process: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a process of the run by name; InputError if it has no such process.

        A process that stands still (SIGSTOP) is killed when the run ends, if nobody lets it
        continue.
        """
        pids = self.pids
        if process not in pids:
            raise InputError(f"{process}: expected one of {', '.join(pids)}")
        number = whole_number("signal", number)
        if number not in signal.valid_signals():
            raise InputError(f"signal={number}: expected the number of a signal, as signal.SIGSTOP")
        os.kill(pids[process], number)

    def restart(self, process: str) -> None:
        """Start a process again that has died.

        InputError for one that lives, or is unknown, and for runs with rounds, which then fail.
        """
        self._begun.fleet.start_again(process)

    def credentials(self, name: str = COORDINATOR) -> Credentials:
        """Return by what the one of this name shows who speaks, at a private router."""
        return self._begun.fleet.credentials(name)


def run(
    what: Plan | str | Path | Scene | None = None,
    rule: str | None = None,
    *,
    watch: Watch | None = None,
    say: Say | None = None,
    progress: bool = False,
    **options: Unpack[PlanOptions],
) -> Outcome:
    """Run a system in processes to its end, and return the outcome.

    `what` is a system as the command line names it, a scene, or a whole `Plan`; `rule` is a name or
    ``FILE.py:NAME``, and None means the rule of the system's family. The options are the fields of
    `Plan`. `watch` is called after each round. `say` gets a line with the address where others can
    join, and with whom the run waits for. `progress` shows a bar of `tqdm`.

    InputError if that cannot be run at all; everything that goes wrong later (a process that dies,
    a rule that gives up, a full disk, an interrupt) is part of the outcome.

    >>> outcome = run("hex:n=4", seed=1, processes=0, log="logs/four.mcap")
    >>> outcome.goal_reached, outcome.rounds, outcome.cubes, len(outcome.path)
    (True, 14, 14, 18)
    """
    plan = plan_of(what, rule, options)
    free = plan.is_free or plan.resume is not None
    with progress_bar("run", " moves" if free else " rounds", shown=progress) as bar:
        told = each_of(watch, showing_run(bar, free=free)) if progress else watch
        return Run(plan, watch=told, say=say).play_from_the_start()


def start(
    what: Plan | str | Path | Scene | None = None,
    rule: str | None = None,
    *,
    watch: Watch | None = None,
    say: Say | None = None,
    way: Way = straight,
    **options: Unpack[PlanOptions],
) -> Run:
    """Return a run to be stepped, watched, tapped, asked and stopped, as a context manager.

    The arguments are those of `run`. Processes take the `way` to the router, which a test can lay
    through its own link. InputError as for `run`, CheckError if the processes do not start.

    >>> with start("hex:n=4", processes=2, log="logs/stepped.mcap") as running:
    ...     claims = running.tap("claim")
    ...     running.step(3)
    ...     len(claims), running.status.moves
    ...     running.until(lambda run: run.gathered.moves >= 10)
    True
    (12, 3)
    >>> running.outcome.ended
    'interrupted'
    """
    return Run(plan_of(what, rule, options), watch=watch, say=say, way=way)


def _driver(context: RunContext) -> Driver[ProcessFleet]:
    """Return a driver for the clock of the run; that of the other clock is not loaded."""
    if context.plan.is_free:
        from cubepath.coordinator.runs.free_driver import FreeDriver  # noqa: PLC0415 - as above

        return FreeDriver(context)
    from cubepath.coordinator.runs.lockstep_driver import LockstepDriver  # noqa: PLC0415 - as above

    return LockstepDriver(context)


def _check(plan: Plan, task: RunTask) -> None:
    """Refuse what the network, the recording or the system cannot carry."""
    modules = len(task.scene.start)
    plan.network.check(modules, min(plan.processes, modules), plan.keepers if plan.is_free else 0)
    check_topics(task, plan)


def _stands(status: Status) -> str:
    at = "" if status.goal_reached else " not"
    return f"round {status.round}, {status.moves} moves, goal{at} reached"
