"""A schedule in progress: which module makes which move, and where it ends or stops.

The module itself finds out whether a move is admissible when its round comes, or whether an
obstacle is in its way. During the run the coordinator reads the reports, and begins no further
round once a module has given up.
"""

from dataclasses import dataclass

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.durations import Cubes
from cubepath.protocol.wire.messages import Stopped


@dataclass(frozen=True, slots=True)
class Assignment:
    """Which module makes which move of a schedule in a scene.

    `cubes` are the cubes of the schedule, with the system's names of moves. `own` holds the moves
    of each module, by round. `stop` is the first cube with a move that no module can make; no moves
    are assigned from that cube on. `ends` is where the modules are then, or after the last cube.
    """

    cubes: Cubes
    own: dict[int, dict[int, GeneratorPlacement]]
    ends: tuple[Site, ...]
    stop: Stopped | None


class ScheduleExecution:
    """A schedule in progress: whether it is over, and whether it has stopped."""

    def __init__(self, assignment: Assignment) -> None:
        self.assignment = assignment
        self.stopped: Stopped | None = None
        self.over = False
        """True once the schedule is done or has stopped, even while the rule continues."""

    def look(self, gatherer: Gathered) -> None:
        """Look at the reports of the last round; before the first round there are none."""
        if self.over:
            return
        number, assignment = gatherer.rounds, self.assignment
        failures = gatherer.steps[-1].failures if number else ()
        if failures:
            module, reason = failures[0]
            self.stopped = Stopped(number, module, assignment.own[module][number], reason)
        elif assignment.stop is not None and number == assignment.stop.round - 1:
            self.stopped = assignment.stop
        self.over = self.stopped is not None or number == len(assignment.cubes)


def stop_text(stopped: Stopped) -> str:
    """Return one line on where a schedule stopped, and why."""
    module = "" if stopped.module is None else f"module_{stopped.module}: "
    return f"the schedule stopped at round {stopped.round}: {module}{stopped.reason}"
