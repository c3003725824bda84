"""A run with rounds: modules in processes, paced round by round, gathered and recorded.

It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.coordinator.runs.conductor import Conductor, RunEnd
from cubepath.coordinator.runs.driver import Driver, RunContext
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Message, encode
from cubepath.protocol.wire.nodes import Keep


class LockstepDriver(Driver[LockstepFleet]):
    """A run in progress: wire messages are recorded as they arrive, edges round by round.

    Cubes, certificate and summary, the coordinator's own results, are written at the end.
    """

    def __init__(self, context: RunContext) -> None:
        """Open the recording, and start nothing."""
        super().__init__(context)
        plan, task = self.plan, self.task
        self._conductor = Conductor(
            task.scene,
            max_rounds=task.max_rounds,
            record=self._record,
            assignment=task.assignment,
            repair=plan.repair,
            recorded_rounds=None if task.branch is None else task.branch.rounds,
        )
        self._behind: list[tuple[Message, int]] | None = None

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far."""
        return self._conductor.gatherer

    def _start(self, check: Callable[[], None]) -> RunEnd | None:
        plan, task, conductor = self.plan, self.task, self._conductor
        branch = task.branch
        ending = conductor.before()
        if ending is not None:
            return ending

        def between_messages() -> None:
            check()
            self.writer.flush_if_due()

        fleet = self._fleet = LockstepFleet(
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
            plausible=conductor.gatherer.plausibility.check,
            way=self._way,
            opened=self._answer_from,
        )
        self._resources.enter_context(fleet)
        later_seeds = () if branch is None else branch.recorded.seeds
        conductor.gatherer.plausibility.know(fleet.modules_of, plan.seed, later_seeds)
        if plan.wait_for:
            self._processes = len(fleet.modules_of)
        return conductor.between(0, fleet.end_schedule)

    def _next(self) -> RunEnd | None:
        """Play a round."""
        fleet, conductor = self.fleet, self._conductor
        fleet.rest(self._pace)
        number = fleet.play_round()
        self.writer.flush()  # before anyone hears that it is over, or begins the next
        if conductor.gatherer.rounds == number:
            self._watch()
        return conductor.between(number, fleet.end_schedule)

    def _failed(self, error: str) -> RunEnd:
        return self._conductor.failed(error)

    def _find_results(self, ending: RunEnd) -> Sequence[Message]:
        return tuple(self._conductor.results(ending))

    def _figures(self) -> dict[str, Any]:
        return {"schedule_stopped": self._conductor.stopped}

    def _wire(self, kept: Keep[Message], wall_ns: int) -> None:
        message = kept.message
        self.writer.write(topic_of(message), kept.data, round_number=message.round, wall_ns=wall_ns)
        behind: list[tuple[Message, int]] = []
        self._behind = behind  # what it records is on record behind the message: heard so, too
        try:
            self._conductor.hear(message)
        finally:
            self._behind = None
        self._refused = self._conductor.refused
        self._listeners.hear(message, wall_ns)
        for each in behind:
            self._listeners.hear(*each)

    def _publish(self, message: Message) -> None:
        if self._fleet is not None:
            self._fleet.tell(message)

    def _record(self, message: Message) -> None:
        wall_ns = time.time_ns()
        self._publish(message)
        self.writer.write(
            topic_of(message), encode(message), round_number=message.round, wall_ns=wall_ns
        )
        if self._behind is None:
            self._listeners.hear(message, wall_ns)
        else:
            self._behind.append((message, wall_ns))
