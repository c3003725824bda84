"""What a coordinator does with its messages: it gathers, ends the run, and states the outcome.

It is pure, like the nodes: messages come in, and messages for the recording come out. A run over
zenoh and a simulated one use the same conductor.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.runs.edge_path import Gathered, Step
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.schedule import Assignment, ScheduleExecution, stop_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire import messages as wire

Ended: TypeAlias = Literal["goal", "max-rounds", "failed", "interrupted"]


@dataclass(frozen=True, slots=True)
class RunEnd:
    """How a run ended, with one line on why if it failed."""

    ended: Ended
    error: str | None = None


class Conductor:
    """Follows one run from its start to its end."""

    def __init__(
        self,
        scene: Scene,
        *,
        max_rounds: int,
        record: Callable[[wire.Message], object],
        assignment: Assignment | None = None,
        repair: bool = False,
        recorded_rounds: int | None = None,
    ) -> None:
        """Begin at the start of the scene; `record` is given the coordinator's own results.

        With an `assignment` the modules carry out a schedule; with `repair` they continue with a
        rule where it stops. With `recorded_rounds` they follow rules after this many rounds.
        """
        self.gatherer = Gatherer(scene, self._step)
        self.refused = 0
        """How many messages were refused so far."""
        self._scene = scene
        self._max_rounds = max_rounds
        self._record = record
        self._assignment = assignment
        self._repair = repair
        self._recorded_rounds = recorded_rounds
        self._execution = None if assignment is None else ScheduleExecution(assignment)

    def hear(self, message: wire.Message) -> None:
        """Take a message that belongs on record; CheckError if reports contradict each other."""
        match message:
            case wire.Reports(parts=reports):
                for report in reports:
                    self.gatherer.receive(report)
            case wire.Refused(count=count):
                self.refused += count
            case _:
                pass

    def _step(self, step: Step) -> None:
        self._record(wire.Edges(step.round, list(step.executed)))

    @property
    def stopped(self) -> wire.Stopped | None:
        """Return where the schedule stopped, None if it did not or there is none."""
        return None if self._execution is None else self._execution.stopped

    @property
    def schedule_cubes(self) -> int | None:
        """Return the number of cubes of the schedule, None if there is none."""
        return None if self._assignment is None else len(self._assignment.cubes)

    def before(self) -> RunEnd | None:
        """Return how the run has ended before anything was started, None if there is work to do."""
        assignment = self._assignment
        if self.gatherer.reached and (assignment is None or not assignment.cubes):
            return RunEnd("goal")
        return None

    def between(self, round_number: int, end_schedule: Callable[[], object]) -> RunEnd | None:
        """Return how the run has ended after a round (0: before the first), None if it continues.

        `end_schedule` is called if modules are to follow their rule from now on, after a schedule
        or what was recorded.
        """
        if self.gatherer.rounds != round_number:
            why = f"round {round_number} ended, but not all modules have reported it"
            return RunEnd("failed", why)
        ending = self._ended(end_schedule) or (
            RunEnd("max-rounds") if round_number >= self._max_rounds else None
        )
        if ending is None and round_number == self._recorded_rounds:
            end_schedule()
        return ending

    def _ended(self, end_schedule: Callable[[], object]) -> RunEnd | None:
        gatherer, execution = self.gatherer, self._execution
        if execution is not None and not execution.over:
            execution.look(gatherer)
            if not execution.over:
                return None  # even if it passes the goal on its way
            if execution.stopped is not None and not self._repair:
                return RunEnd("failed", stop_text(execution.stopped))
            if not gatherer.reached and self._repair:
                end_schedule()
                return None
        elif gatherer.failed is not None:
            return self.failed(gatherer.failed)
        return RunEnd("goal") if gatherer.reached else None

    def failed(self, error: str) -> RunEnd:
        """Return the end of a run that failed, with where its schedule had stopped before."""
        stopped = self.stopped
        return RunEnd("failed", error if stopped is None else f"{stop_text(stopped)}; then {error}")

    def results(self, ending: RunEnd) -> Iterator[wire.Cube | wire.Certified | wire.Summary]:
        """Yield the results of the run: its cubes, their certificate and the summary."""
        return results_of(
            self.gatherer,
            ending,
            refused=self.refused,
            schedule_cubes=self.schedule_cubes,
            schedule_stopped=self.stopped,
        )


def results_of(
    gatherer: Gathered,
    ending: RunEnd,
    *,
    refused: int,
    schedule_cubes: int | None = None,
    schedule_stopped: wire.Stopped | None = None,
) -> Iterator[wire.Cube | wire.Certified | wire.Summary]:
    """Yield the results of a run: its cubes, their certificate and the summary.

    All is found before the first is yielded, so that none waits for another that takes long.
    """
    rounds, found = gatherer.rounds, gatherer.heap.normal_form()
    proof = certificate_of(
        gatherer.numbered, start=gatherer.scene.start_state, found=found, as_text=True
    )
    summary = wire.Summary(
        round=rounds,
        ended=ending.ended,
        error=ending.error,
        **gatherer.figures,
        schedule_cubes=schedule_cubes,
        schedule_stopped=schedule_stopped,
        refused=refused,
    )
    for index, cube in enumerate(gatherer.cubes(), 1):
        yield wire.Cube(rounds, index, list(cube))
    yield wire.Certified(rounds, proof)
    yield summary
