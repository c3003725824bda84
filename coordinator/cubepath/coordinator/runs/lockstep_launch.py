"""A run with rounds: modules in processes, paced round by round, gathered and on record.

It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.processes.network import Way
from cubepath.coordinator.runs.conductor import Conductor, Ending
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.plan import Plan, Task
from cubepath.protocol.core.errors import CheckError, CubepathError
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Message, encode
from cubepath.protocol.wire.nodes import Keep


class LockstepRun:
    """A run in progress: wire messages are recorded as they arrive, edges round by round.

    Cubes, certificate and summary, the coordinator's own results, are written at the end.
    """

    def __init__(
        self,
        plan: Plan,
        task: Task,
        writer: RecordingWriter,
        *,
        say: Callable[[str], None],
        watch: Callable[[Gathered], None],
        hear: Callable[[Message, int], None],
        way: Way,
        pace: Callable[[], float],
        opened: Callable[[Fleet], None],
    ) -> None:
        """Begin with nothing started; `hear` is told of each message, and the wall time in ns.

        `opened` is called when the router is there, before anyone joins.
        """
        self._plan = plan
        self._task = task
        self._writer = writer
        self._say = say
        self._watch = watch
        self._hear = hear
        self._way = way
        self._opened = opened
        self._pace = pace
        self._results: tuple[Message, ...] | None = None
        self._refused_then = 0
        """How many messages had been refused when the results were told."""
        self._processes = min(plan.processes, len(task.scene.start))
        self._conductor = Conductor(
            task.scene,
            max_rounds=task.max_rounds,
            record=self._record,
            assignment=task.assignment,
            repair=plan.repair,
            recorded_rounds=None if task.branch is None else task.branch.rounds,
        )
        self._fleet: Fleet | None = None
        self._resources = ExitStack()
        self._behind: list[tuple[Message, int]] | None = None

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far."""
        return self._conductor.gatherer

    @property
    def fleet(self) -> Fleet:
        """Return the processes; CheckError if there are none, or no more."""
        if self._fleet is None:
            raise CheckError("the run has no processes: expected one that is under way")
        return self._fleet

    def begin(self, check: Callable[[], None]) -> Ending | None:
        """Start the processes; return how the run has ended if there is nothing to do.

        `check` is called while waiting, now and later, and may raise to end the run between two
        messages.
        """
        plan, task, conductor = self._plan, self._task, self._conductor
        branch = task.branch
        ending = conductor.before()
        if ending is not None:
            return ending

        def between_messages() -> None:
            check()
            self._writer.flush_if_due()

        fleet = Fleet(
            task.scene,
            task.rule,
            seed=plan.seed,
            hesitate=plan.hesitate,
            processes=plan.processes,
            schedule=None if task.assignment is None else task.assignment.own,
            recorded=None if branch is None else branch.recorded,
            patience_s=plan.patience,
            network=plan.network,
            sink=self._wire,
            check=between_messages,
            say=self._say,
            plausible=conductor.check,
            way=self._way,
            opened=lambda: self._opened(fleet),
        )
        self._fleet = self._resources.enter_context(fleet)
        later_seeds = () if branch is None else branch.recorded.seeds
        conductor.know(self._fleet.modules_of, plan.seed, later_seeds)
        if plan.wait_for:
            self._processes = len(self._fleet.modules_of)
        return conductor.between(0, self._fleet.end_schedule)

    def advance(self) -> Ending | None:
        """Play a round; return how the run has ended, None if it goes on."""
        fleet, conductor = self.fleet, self._conductor
        fleet.rest(self._pace)
        number = fleet.play_round()
        self._writer.flush()  # before anyone hears that it is over, or begins the next
        if conductor.gatherer.rounds == number:
            self._watch(conductor.gatherer)
        return conductor.between(number, fleet.end_schedule)

    def interrupted(self) -> Ending:
        """Do nothing: the round that was interrupted is left as it is."""
        return Ending("interrupted", "interrupted")

    def announce(self, ending: Ending) -> None:
        """Tell whoever listens what came of the run, while the router is there."""
        if self._fleet is None:
            return
        results = tuple(self._conductor.results(ending))
        for message in results:
            self._fleet.tell(message)
        self._results, self._refused_then = results, self._conductor.refused

    def end(self) -> None:
        """End the processes, and leave nothing running."""
        # That may take seconds. What cannot be written is told by the results.
        with contextlib.suppress(CubepathError):
            self._writer.flush()
        self._fleet = None
        self._resources.close()

    def failed(self, error: str) -> Ending:
        """Return the end of a run that failed."""
        return self._conductor.failed(error)

    def conclude(self, ending: Ending) -> None:
        """Write what came of the run."""
        # What was refused while the processes ended is on record, and has to be counted.
        late = self._conductor.refused != self._refused_then
        results = None if late else self._results
        for message in self._conductor.results(ending) if results is None else results:
            self._record(message)
        self._writer.close()

    def tidy(self, ending: Ending) -> None:
        """Do nothing: there is the recording alone."""

    def figures(self) -> Mapping[str, Any]:
        """Return what the outcome says beside what all outcomes say."""
        return {
            "processes": self._processes,
            "refused": self._conductor.refused,
            "schedule_cubes": self._conductor.schedule_cubes,
            "schedule_stopped": self._conductor.stopped,
        }

    def _wire(self, kept: Keep[Message], wall_ns: int) -> None:
        message = kept.message
        self._writer.write(
            topic_of(message), kept.data, round_number=message.round, wall_ns=wall_ns
        )
        behind: list[tuple[Message, int]] = []
        self._behind = behind  # what it records is on record behind the message: heard so, too
        try:
            self._conductor.hear(message)
        finally:
            self._behind = None
        self._hear(message, wall_ns)
        for each in behind:
            self._hear(*each)

    def _record(self, message: Message) -> None:
        """Put on record what the coordinator says of the run, and tell whoever listens."""
        wall_ns = time.time_ns()
        if self._fleet is not None:
            self._fleet.tell(message)
        self._writer.write(
            topic_of(message), encode(message), round_number=message.round, wall_ns=wall_ns
        )
        if self._behind is None:
            self._hear(message, wall_ns)
        else:
            self._behind.append((message, wall_ns))
