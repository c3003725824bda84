"""A run without rounds: keepers and modules in processes, what they did gathered and on record.

Room: coordinator. It starts the fleet and listens; nothing in the run waits for it. It ends when
the modules are at their goal, at a level, or when nothing has come of anyone for long.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from cubepath.agents.free.fleet import FreeFleet
from cubepath.agents.free.host_node import HALT_S
from cubepath.coordinator.runs.collector import Collector, refusals_in
from cubepath.coordinator.runs.conductor import Ending, results_of
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.runs.free_schedule import own_moves
from cubepath.coordinator.runs.interrupts import Interrupted, interrupts
from cubepath.coordinator.runs.plan import Plan, Task
from cubepath.coordinator.runs.resuming import is_said, keeper_logs
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.credentials import keeper_name
from cubepath.protocol.wire.free_messages import FreeMessage, decode_free, free_topic, level_of
from cubepath.protocol.wire.messages import Edges, Go, encode
from cubepath.protocol.wire.nodes import Keep
from cubepath.protocol.wire.shell import Shell

BEHIND_MAX, BEHIND_MIN = 8000, 500
"""Modules halt while so many messages wait to be put on record, until so few do."""
_STEP_S = 0.05
_LOOK_S = 0.2
_SETTLE_S_MAX = 5.0
"""How long the end of a run waits for what is under way, since anything new was heard of."""
_SETTLE_S_IN_ALL = 120.0
_INTERRUPT_S_MAX = 2.0
"""And so long if the user asked for it."""


@dataclass(slots=True)
class Noticed:
    """A process that died: how, whether it was started again, and when that was noticed.

    `seconds` are from the start of the run, and `idle_seconds` from then until the next commit of
    anyone; None if there was none.
    """

    name: str
    how: str
    restarted: bool
    seconds: float
    idle_seconds: float | None = None


@dataclass(slots=True)
class FreeRun:
    """A run in progress: messages are recorded as they arrive, and gathered by their versions."""

    plan: Plan
    task: Task
    writer: RecordingWriter
    say: Callable[[str], None]
    watch: Callable[[Gathered], None] | None = None
    before: Recording | None = None
    """What is on record of a run that is taken up again."""
    refused: int = 0
    held_back: float = 0.0
    """For how many seconds modules were halted, as more was said than could be recorded."""
    crashes: list[Noticed] = field(default_factory=list)
    gatherer: FreeGatherer = field(init=False)
    _collector: Collector = field(init=False)
    _level: int = 0
    _looked: float = 0.0
    _halted: float | None = None
    """Since when modules halt so that the record can keep up."""
    _said_over: float = 0.0
    _watched: float = 0.0
    _began: float = field(default_factory=time.monotonic)
    _heard: float = 0.0
    """When anything was last committed."""

    def __post_init__(self) -> None:
        self.gatherer = FreeGatherer(self.task.scene, self.plan.keepers)

    def play(self) -> Ending:
        """Run to the end, and write what came of it."""
        try:
            ending = self._play()
        except Interrupted:
            ending = Ending("interrupted", "interrupted")
        except CubepathError as problem:
            ending = Ending("failed", str(problem))
        except MemoryError:
            ending = Ending("failed", "out of memory")
        try:
            for step in self.gatherer.steps:
                edges = Edges(step.round, list(step.executed))
                self._write(edges, encode(edges), time.time_ns())
            self.writer.flush()  # to find the results may take seconds
            assignment = self.task.assignment
            for message in results_of(
                self.gatherer,
                ending,
                refused=self.refused,
                schedule_cubes=None if assignment is None else len(assignment.cubes),
            ):
                self._write(message, encode(message), time.time_ns())
            self.writer.close()
        except CubepathError as problem:
            ending = Ending("failed", ending.error or str(problem))
        if ending.ended != "failed" or self.gatherer.failed is not None:
            shutil.rmtree(keeper_logs(self.writer.path), ignore_errors=True)
        return ending

    def _play(self) -> Ending:
        plan, task = self.plan, self.task
        self._take_up()
        if self.gatherer.reached and task.assignment is None:
            return Ending("goal")
        if not task.max_rounds and plan.resume is None:
            return Ending("max-rounds")
        path = self.writer.path
        logs = keeper_logs(path) if path.is_file() else None  # beside a device there is no room
        if plan.resume is not None and logs is not None:
            keeper_logs(plan.resume).rename(logs)  # this run may be cut off in its turn
        with (
            interrupts() as check,
            FreeFleet(
                task.scene,
                task.rule,
                seed=plan.seed,
                hesitate=plan.hesitate,
                processes=plan.processes,
                keepers=plan.keepers,
                speeds=plan.speeds,
                jitter=plan.jitter,
                on_crash=plan.on_crash,
                schedule=None
                if task.assignment is None
                else own_moves(task.scene, task.assignment),
                logs=logs,
            ) as fleet,
        ):
            collector = self._collector = Collector(
                fleet.run, self.gatherer, plan.keepers, fleet.modules_of
            )
            credentials = fleet.credentials()
            with Shell(collector, fleet.endpoint, self._keep, credentials=credentials) as shell:
                shell.start()
                try:
                    self._wait_for_keepers(shell, fleet, check)
                    fleet.begin()
                    return self._until_the_end(shell, fleet, check)
                except Interrupted:
                    # A second interrupt comes through everything.
                    with contextlib.suppress(CubepathError):
                        self._settle(shell, fleet, lambda: None, _INTERRUPT_S_MAX)
                    raise
                finally:
                    with contextlib.suppress(CubepathError):  # the results will tell
                        self.writer.flush()
                    shell.carry_out(collector.say(Go(collector.level, "stop")))

    def _take_up(self) -> None:
        """Take up what is on record already."""
        for record in self.before.records if self.before is not None else ():
            if not is_said(record.kind):
                continue
            self.writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
            if record.kind in ("moved", "tail", "turns"):
                message = decode_free(record.data)
                self.gatherer.take(message)
                self._level = max(self._level, level_of(message))
        self.writer.flush()  # to start the fleet may take seconds, and to end it

    def _wait_for_keepers(self, shell: Shell, fleet: FreeFleet, check: Callable[[], None]) -> None:
        """Wait until all keepers have answered: from then on everything is on record."""
        collector = self._collector
        asked = time.monotonic()
        until = asked + self.plan.patience
        while len(collector.tails) < self.plan.keepers:
            shell.step(_STEP_S)
            check()
            self._look_after(fleet)
            now = time.monotonic()
            if now - asked > _LOOK_S:
                asked = now
                shell.carry_out(collector.fetch())
            if now > until:
                missing = set(range(self.plan.keepers)) - collector.tails.keys()
                raise CubepathError(f"keeper_{min(missing)} did not answer in time")

    def _until_the_end(self, shell: Shell, fleet: FreeFleet, check: Callable[[], None]) -> Ending:
        collector = self._collector
        self._heard = time.monotonic()
        ending: Ending | None = None
        while True:
            moves = self.gatherer.moves
            came = shell.step(_STEP_S)
            check()
            self._look_after(fleet)
            self._keep_up(shell)
            if self.gatherer.moves > moves:
                self._heard = time.monotonic()
                self._goes_on()
                if self.watch is not None and self._heard - self._watched > _LOOK_S:
                    self._watched = self._heard
                    self.watch(self.gatherer)
            elif came and ending is None:
                continue
            ending = self._ended()
            if ending is None:
                continue
            self._settle(shell, fleet, check)
            if ending.ended != "goal" or self.gatherer.reached:
                return ending
            shell.carry_out(collector.say(Go(collector.level, "sense")))  # it only came past it

    def _keep_up(self, shell: Shell) -> None:
        """Halt the modules for as long as more is said than can be put on record.

        Otherwise what is said would be lost here, and the run would end with a record full of gaps.
        """
        now, collector = time.monotonic(), self._collector
        waiting = shell.waiting
        if self._halted is None:
            if waiting > BEHIND_MAX:
                self._halted = self._said_over = now
                shell.carry_out(collector.say(Go(collector.level, "over")))
        elif waiting < BEHIND_MIN:
            self.held_back += now - self._halted
            self._halted = None
            collector.resting.clear()
            shell.carry_out(collector.say(Go(collector.level, "sense")))
        elif now - self._said_over > HALT_S / 5:
            self._said_over = now
            shell.carry_out(collector.say(Go(collector.level, "over")))

    def _goes_on(self) -> None:
        """Take note of how long nothing was committed after a process had died."""
        after = self._heard - self._began
        for crash in self.crashes:
            if crash.idle_seconds is None:
                crash.idle_seconds = round(after - crash.seconds, 3)

    def _ended(self) -> Ending | None:
        gatherer, collector, plan = self.gatherer, self._collector, self.plan
        if gatherer.failed is not None:
            return Ending("failed", gatherer.failed)
        if self.task.assignment is not None:
            if gatherer.moves >= sum(map(len, self.task.assignment.cubes)):
                return Ending("goal")
        elif gatherer.reached:
            return Ending("goal")
        if collector.level >= self.task.max_rounds:
            return Ending("max-rounds")
        if time.monotonic() - self._heard > plan.patience:
            return Ending("failed", self._stuck())
        return None

    def _stuck(self) -> str:
        dead = sorted({crash.name for crash in self.crashes if not crash.restarted})
        who = f"; {', '.join(dead)} had died" if dead else ""
        silent = [
            name for each in self._collector.silent if (name := keeper_name(each)) not in dead
        ]
        who += f"; {', '.join(silent)} did not answer" if silent else ""
        return f"nothing was committed for {self.plan.patience:g} s{who}"

    def _settle(
        self,
        shell: Shell,
        fleet: FreeFleet,
        check: Callable[[], None],
        seconds: float = _SETTLE_S_MAX,
    ) -> None:
        """Halt the modules, and wait until everything that was committed is known."""
        collector = self._collector
        until = time.monotonic() + seconds
        at_most = until if seconds < _SETTLE_S_MAX else until + _SETTLE_S_IN_ALL
        known = self._known()
        collector.resting.clear()
        asked = halted = 0.0
        settled = rested = False
        while not settled and time.monotonic() < until:
            check()
            self._look_after(fleet)
            all_rest = fleet.processes_alive() <= collector.resting
            if all_rest and not rested:
                collector.tails.clear()  # who rests commits nothing: what is told now is the end
                asked = 0.0
            rested = all_rest
            settled = rested and collector.settled
            now = time.monotonic()
            if not settled and now - asked > _LOOK_S:
                asked = now
                if all_rest:
                    shell.carry_out(collector.fetch())
                if not all_rest or now - halted > HALT_S / 5:  # told once, they halt for a while
                    halted = now
                    shell.carry_out(collector.say(Go(collector.level, "over")))
            shell.step(_STEP_S)
            if known != (known := self._known()):  # in a large run there may be much to catch up
                until = min(time.monotonic() + seconds, at_most)

    def _known(self) -> tuple[int, ...]:
        """Return what changes while the record of the run is being completed."""
        collector = self._collector
        commits = sum(map(self.gatherer.known, range(self.plan.keepers)))
        return commits, self.gatherer.moves, collector.lacking, len(collector.resting)

    def _look_after(self, fleet: FreeFleet) -> None:
        self.writer.flush_if_due()
        now = time.monotonic()
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        for crash in fleet.look():
            after = round(now - self._began, 3)
            self.crashes.append(Noticed(crash.name, crash.how, crash.restarted, after))
            self._collector.forget(crash.name)
            again = ", and was started again" if crash.restarted else ""
            self.say(f"{crash.name} has died ({crash.how}){again}")

    def _keep(self, kept: Keep[FreeMessage], wall_ns: int) -> None:
        self.refused += refusals_in(kept)
        self._write(kept.message, kept.data, wall_ns)

    def _write(self, message: FreeMessage, data: bytes, wall_ns: int) -> None:
        self._level = max(self._level, level_of(message))
        at = wall_ns if self.plan.log_time == "wall" else self._level
        self.writer.write(free_topic(message), data, round_number=at, wall_ns=wall_ns)
