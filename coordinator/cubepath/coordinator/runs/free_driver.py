"""A run without rounds: keepers and modules in processes, gathered and recorded.

It starts the fleet and listens; nothing in the run waits for it. The run ends when the modules are
at their goal, at a given level, or when no module has made progress for a given time.
"""

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from cubepath.agents.free.config import HALT_S
from cubepath.agents.free.fleet import FreeFleet, Handover
from cubepath.coordinator.runs.asking import Release
from cubepath.coordinator.runs.collector import Collector, refusals_in
from cubepath.coordinator.runs.conductor import RunEnd, results_of
from cubepath.coordinator.runs.driver import INTERRUPTED, Driver, RunContext
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.runs.outcome import CrashReport
from cubepath.coordinator.runs.resuming import check_logs, is_on_wire, keeper_logs, locked_logs
from cubepath.coordinator.runs.schedule_reading import own_moves
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.output_files import unwritable
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire import free_messages
from cubepath.protocol.wire.credentials import keeper_name
from cubepath.protocol.wire.messages import Edges, Go, encode
from cubepath.protocol.wire.nodes import Keep, Put
from cubepath.protocol.wire.shell import Shell

BEHIND_MAX, BEHIND_MIN = 8000, 500
"""Modules halt while this many messages wait to be put in the recording, until so few do."""
_STEP_S = 0.05
_LOOK_S = 0.2
_SETTLE_S_MAX = 5.0
"""How long the end of a run waits for what is under way, since anything new was heard of."""
_SETTLE_S_IN_ALL = 120.0
_INTERRUPT_S_MAX, _INTERRUPT_S_IN_ALL = 2.0, 10.0
"""The same if the user asked for it: a host that was cut off may have much to tell."""


class FreeDriver(Driver[FreeFleet]):
    """A run in progress: messages are recorded as they arrive, and gathered by their versions."""

    def __init__(self, context: RunContext) -> None:
        """Open the recording, and start nothing."""
        self._logs_lock: BinaryIO | None = None
        """Held for the keepers' logs until the run has ended."""
        super().__init__(context)
        self._gatherer = FreeGatherer(self.task.scene, self.plan.keepers)
        self._held_back = 0.0
        """For how many seconds modules were halted, since more was sent than could be recorded."""
        self._crashes: list[CrashReport] = []
        self._check: Callable[[], None] = lambda: None
        self._shell: Shell | None = None
        self._begun = False
        self._past_goal = False
        """Whether the modules were at their goal, and had left it when all was known."""
        self._complete = False
        """Whether all modules rest, and everything that was committed is on record."""
        self._level = 0
        self._looked = 0.0
        self._halted: float | None = None
        """Since when modules halt so that the record can keep up."""
        self._said_over = 0.0
        self._watched = 0.0
        self._heard = 0.0
        """When anything was last committed."""

    def _open(self, log: Path) -> RecordingWriter:
        plan = self.plan
        if plan.resume is None:
            if os.path.lexists(keeper_logs(log)):
                raise InputError(
                    f"{keeper_logs(log)}: exists already, expected no logs of another run"
                )
            return super()._open(log)
        lock = self._logs_lock = locked_logs(keeper_logs(plan.resume))
        try:
            if self._before is not None:
                check_logs(keeper_logs(plan.resume), self._before, plan.keepers)
            return super()._open(log)
        except BaseException:
            lock.close()
            raise

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far."""
        return self._gatherer

    @property
    def _release(self) -> Release:
        return self._gatherer.released

    def _start(self, check: Callable[[], None]) -> RunEnd | None:
        self._check = check
        plan, task = self.plan, self.task
        self._take_up()
        if self.gathered.reached and task.assignment is None:
            return RunEnd("goal")
        if not task.max_rounds and plan.resume is None:
            return RunEnd("max-rounds")
        path = self.writer.path
        logs = keeper_logs(path) if path.is_file() else None  # beside a device there is no room
        if plan.resume is not None and logs is not None:
            try:
                keeper_logs(plan.resume).rename(logs)  # this run may be cut off in its turn
            except OSError as error:
                raise unwritable(logs, error) from None
        elif logs is not None:
            logs.mkdir(exist_ok=True)
            self._logs_lock = locked_logs(logs)
        fleet = self._fleet = FreeFleet(
            task.scene,
            task.rule,
            seed=plan.seed,
            hesitate=plan.hesitate,
            processes=plan.processes,
            keepers=plan.keepers,
            speeds=plan.speeds,
            jitter=plan.jitter,
            on_crash=plan.on_crash,
            schedule=None if task.assignment is None else own_moves(task.scene, task.assignment),
            logs=logs,
            lock=self._logs_lock,
            known=self._gatherer.known,
            patience_s=plan.patience,
            network=plan.network,
            check=check,
            say=self._say,
            way=self._way,
            opened=self._answer_from,
        )
        self._resources.enter_context(fleet)
        if plan.wait_for:
            self._processes = len(fleet.modules_of)
        collector = self._collector = Collector(
            fleet.run, self._gatherer, plan.keepers, fleet.modules_of
        )
        credentials = fleet.credentials()
        shell = self._shell = self._resources.enter_context(
            Shell(collector, fleet.endpoint, self._keep, credentials=credentials)
        )
        shell.start()
        self._wait_for_keepers(shell, fleet)
        fleet.begin()
        self._begun = True
        self._heard = time.monotonic()
        return None

    def _find_results(self, ending: RunEnd) -> Sequence[free_messages.FreeMessage]:
        assignment = self.task.assignment
        return (
            *(Edges(step.round, list(step.executed)) for step in self.gathered.steps),
            *results_of(
                self.gathered,
                ending,
                refused=self._refused,
                schedule_cubes=None if assignment is None else len(assignment.cubes),
            ),
        )

    def _publish(self, message: free_messages.FreeMessage) -> None:
        if self._shell is not None:
            key = free_messages.free_key(self.fleet.run, message)
            self._shell.carry_out([Put(key, encode(message))])

    def _stop(self) -> None:
        shell, self._shell = self._shell, None
        if shell is not None:
            shell.carry_out(self._collector.say(Go(self._collector.level, "stop")))

    def _interrupted(self) -> RunEnd:
        """Let what is under way come to its end, for a short while."""
        if self._shell is not None and self._begun:
            self._check = lambda: None
            with contextlib.suppress(CubepathError):
                self._settle(self._shell, self.fleet, _INTERRUPT_S_MAX)
        return RunEnd("goal") if self._is_over else INTERRUPTED

    def _failed(self, error: str) -> RunEnd:
        return RunEnd("goal") if self._is_over else RunEnd("failed", error)

    @property
    def _is_over(self) -> bool:
        """Return whether all modules rest where they had to go, and everything is known."""
        if not self._begun or self.gathered.failed is not None or not self._has_arrived:
            return False
        collector = self._collector
        everybody = set(range(self._processes))
        return (
            collector.contradiction is None and everybody <= collector.resting and collector.settled
        )

    @property
    def _has_arrived(self) -> bool:
        if self.task.assignment is not None:
            return self.gathered.moves >= sum(map(len, self.task.assignment.cubes))
        return self.gathered.reached

    def _record(self, message: free_messages.FreeMessage) -> None:
        self._write(message, encode(message), time.time_ns())

    def _tidy(self, ending: RunEnd) -> None:
        """Take away the keepers' logs, unless the run can be taken up again.

        One that was interrupted can, if its record is not complete.
        """
        logs = keeper_logs(self.writer.path)
        lacks = self._begun and ending.ended == "interrupted" and not self._complete
        if lacks:
            self._say(f"not all moves are on record: those in {logs} are taken up by --from")
        elif ending.ended != "failed" or self.gathered.failed is not None:
            shutil.rmtree(logs, ignore_errors=True)
        if self._logs_lock is not None:
            self._logs_lock.close()

    def _figures(self) -> dict[str, Any]:
        return {
            "keepers": self.plan.keepers,
            "crashes": tuple(self._crashes),
            "held_back_seconds": round(self._held_back, 3),
        }

    def _take_up(self) -> None:
        """Take up what is recorded already."""
        for record in self._before.records if self._before is not None else ():
            if not is_on_wire(record.kind):
                continue
            self.writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
            if record.kind in ("commit", "commits", "turns"):
                message = free_messages.decode_free(record.data)
                self._gatherer.take(message)
                self._level = max(self._level, free_messages.level_of(message))
        self.writer.flush()  # to start the fleet may take seconds, and to end it

    def _wait_for_keepers(self, shell: Shell, fleet: FreeFleet) -> None:
        """Wait until all keepers have answered: from then on everything is recorded."""
        collector = self._collector
        asked = time.monotonic()
        until = asked + self.plan.patience
        while missing := set(range(self.plan.keepers)) - collector.tails.keys():
            now = time.monotonic()
            if now > until:
                raise CubepathError(f"keeper_{min(missing)} did not answer in time")
            if now - asked > _LOOK_S:
                asked = now
                shell.carry_out(collector.fetch())
            shell.step(_STEP_S)
            self._check()
            self._look_after(fleet)

    def _next(self) -> RunEnd | None:
        """Take what comes next."""
        fleet, shell = self.fleet, self._shell
        if shell is None:  # it comes and goes with the fleet
            raise AssertionError("a fleet without a shell")
        collector = self._collector
        moves = self.gathered.moves
        came = shell.step(_STEP_S)
        self._check()
        self._look_after(fleet)
        self._keep_up(shell)
        if self.gathered.moves > moves:
            self._heard = time.monotonic()
            self._goes_on()
            if self._heard - self._watched > _LOOK_S:
                self._watched = self._heard
                self._watch()
        elif came and not self._past_goal:
            return None
        self._past_goal = False
        ending = self._ended()
        if ending is None:
            return None
        self._settle(shell, fleet)
        if self._is_over:
            return RunEnd("goal")
        if ending.ended != "goal" or self.gathered.reached:
            return ending
        self._complete = False
        shell.carry_out(collector.resume())  # it only came past it
        self._past_goal = True
        return None

    def _keep_up(self, shell: Shell) -> None:
        """Halt the modules while more is sent than can be recorded.

        Otherwise messages would be lost here, and the recording would be full of gaps.
        """
        now, collector = time.monotonic(), self._collector
        waiting = shell.waiting
        if self._halted is None:
            if waiting > BEHIND_MAX:
                self._halted = self._said_over = now
                shell.carry_out(collector.halt())
        elif waiting < BEHIND_MIN:
            self._held_back += now - self._halted
            self._halted = None
            shell.carry_out(collector.resume())
        elif now - self._said_over > HALT_S / 5:
            self._said_over = now
            shell.carry_out(collector.repeat_order())

    def _goes_on(self) -> None:
        """Note how long nothing was committed after a process had died."""
        after = self._heard - self._began
        for crash in self._crashes:
            if crash.idle_seconds is None:
                crash.idle_seconds = round(after - crash.seconds, 3)

    def _ended(self) -> RunEnd | None:
        gathered, collector, plan = self.gathered, self._collector, self.plan
        if gathered.failed is not None:
            return RunEnd("failed", gathered.failed)
        if self._has_arrived:
            return RunEnd("goal")
        if collector.level >= self.task.max_rounds:
            return RunEnd("max-rounds")
        if time.monotonic() - self._heard > plan.patience:
            return RunEnd("failed", self._stuck())
        return None

    def _stuck(self) -> str:
        dead = sorted({crash.name for crash in self._crashes if not crash.restarted})
        details = f"; {', '.join(dead)} had died" if dead else ""
        silent = [
            name for each in self._collector.silent if (name := keeper_name(each)) not in dead
        ]
        details += f"; {', '.join(silent)} did not answer" if silent else ""
        if self._shell is not None and not self._shell.connected:
            details += f"; no zenoh router at {self.fleet.endpoint} any more"
        return f"nothing was committed for {self.plan.patience:g} s{details}"

    def _settle(self, shell: Shell, fleet: FreeFleet, seconds: float = _SETTLE_S_MAX) -> None:
        """Halt the modules, and wait until everything that was committed is known."""
        collector = self._collector
        until = time.monotonic() + seconds
        at_most = until + (_SETTLE_S_IN_ALL if seconds == _SETTLE_S_MAX else _INTERRUPT_S_IN_ALL)
        known = self._known()
        shell.carry_out(collector.halt())
        asked, halted = 0.0, time.monotonic()
        self._complete = rested = False
        while not self._complete and time.monotonic() < until:
            self._check()
            self._look_after(fleet)
            all_rest = fleet.processes_alive() <= collector.resting
            if all_rest and not rested:
                collector.tails.clear()  # who rests commits nothing: what is told now is the end
                asked = 0.0
            rested = all_rest
            self._complete = rested and collector.settled
            now = time.monotonic()
            if not self._complete and now - asked > _LOOK_S:
                asked = now
                if all_rest:
                    shell.carry_out(collector.fetch())
                if not all_rest or now - halted > HALT_S / 5:  # told once, they halt for a while
                    halted = now
                    shell.carry_out(collector.repeat_order())
            shell.step(_STEP_S)
            if known != (known := self._known()):  # in a large run there may be much to catch up
                until = min(time.monotonic() + seconds, at_most)

    def _known(self) -> tuple[int, ...]:
        """Return what changes while the record of the run is being completed."""
        collector = self._collector
        commits = sum(map(self._gatherer.known, range(self.plan.keepers)))
        return commits, self.gathered.moves, collector.lacking, len(collector.resting)

    def _look_after(self, fleet: FreeFleet) -> None:
        self.writer.flush_if_due()
        now = time.monotonic()
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        if self._shell is not None:
            self._shell.carry_out(self._collector.record(self.writer.flush))
        for crash in fleet.look():
            self._collector.forget(crash.name)
            if isinstance(crash, Handover):
                self._say(f"{crash.name} {crash.how}")
                continue
            known = [each for each in self._crashes if each.name == crash.name]
            if crash.restarted and known and not known[-1].restarted:
                known[-1].restarted = True
                self._say(f"{crash.name} is back")
                continue
            after = round(now - self._began, 3)
            self._crashes.append(CrashReport(crash.name, crash.how, crash.restarted, after))
            again = ", and was started again" if crash.restarted else ""
            self._say(f"{crash.name} has died ({crash.how}){again}")

    def _keep(self, kept: Keep[free_messages.FreeMessage], wall_ns: int) -> None:
        self._refused += refusals_in(kept)
        self._write(kept.message, kept.data, wall_ns)
        if self._collector.contradiction is not None:
            raise self._collector.contradiction

    def _write(self, message: free_messages.FreeMessage, data: bytes, wall_ns: int) -> None:
        self._level = max(self._level, free_messages.level_of(message))
        at = wall_ns if self.plan.log_time == "wall" else self._level
        self.writer.write(free_messages.free_topic(message), data, round_number=at, wall_ns=wall_ns)
        self._listeners.hear(message, wall_ns)
