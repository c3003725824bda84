"""The outcome of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.runs.conductor import Ended, RunEnd
from cubepath.coordinator.runs.edge_path import Gathered, Step
from cubepath.coordinator.runs.plan import Plan, RunTask
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.system import Bound, Scene
from cubepath.protocol.displays import Displayed
from cubepath.protocol.path_files.durations import Cubes
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.messages import Stopped

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording


@dataclass(slots=True)
class CrashReport:
    """A process that died: how, whether it was started again, and when that was noticed.

    `seconds` are from the start of the run, and `idle_seconds` from then until the next commit of
    anyone; None if there was none.
    """

    name: str
    how: str
    restarted: bool
    seconds: float
    idle_seconds: float | None = None


@dataclass(frozen=True, slots=True)
class Outcome(Displayed):
    """The outcome of a run; the first fourteen fields are the keys of ``cubepath run --json``.

    So is `refused`, how many messages were refused. `error` is a key too if there is one. If a
    schedule was carried out, there are two more: how many cubes it has, and where it stopped, None
    if it did not. A run without rounds has the key `levels` for `rounds`, and three more keys: how
    many keepers it had, which processes died, and for how long modules were held back for the
    record.

    Beside these figures it has the path itself, its cubes and a bound:

    >>> outcome = run("hex:n=4", processes=0, log="logs/outcome.mcap")
    >>> outcome.rounds, len(outcome.path), len(outcome.schedule), outcome.bound.cubes
    (14, 18, 14, 3)
    >>> outcome.steps[0].executed[0]
    Executed(module=0, generator='pivot-2-right', at=(1, -1))
    """

    log: str
    system: str
    rule: str
    seed: int
    modules: int
    processes: int
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    goal_reached: bool
    path_digest: str
    seconds: float
    ended: Ended
    error: str | None
    messages: int
    gathered: Gathered = field(repr=False, compare=False)
    """What was gathered, round by round: the source of all that follows."""
    refused: int = 0
    schedule_cubes: int | None = None
    schedule_stopped: Stopped | None = None
    keepers: int | None = None
    crashes: tuple[CrashReport, ...] = ()
    held_back_seconds: float = 0.0

    @property
    def steps(self) -> Sequence[Step]:
        """The edge path by rounds, or by levels: who made which moves."""
        return self.gathered.steps

    @property
    def path(self) -> Sequence[Action]:
        """The edge path as one sequence of actions, in canonical order."""
        return self.gathered.path

    @property
    def scene(self) -> Scene:
        """The scene that was run."""
        return self.gathered.scene

    @property
    def placed(self) -> Sequence[GeneratorPlacement]:
        """The edge path, each move as a generator and a place."""
        return self.gathered.placed

    @property
    def schedule(self) -> Cubes:
        """The normal cube path: for each cube its moves, each as a generator and a place."""
        return self.gathered.schedule()

    @property
    def bound(self) -> Bound:
        """How many cubes any path from the start to where the run ended has at least, and why.

        The cheap bounds of `cubepath.coordinator.lower_bound`; `beyond` knows better ones.
        """
        scene = self.scene
        end = scene.start_state - set(scene.start) | set(self.gathered.sites)
        found: Bound = plugin("lower_bound")(
            scene.system, scene.start_state, end, within=self.cubes
        )
        return found

    def recording(self) -> Recording:
        """Open the recording; errors as for `read_recording`."""
        from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415 - no run reads

        return read_recording(Path(self.log))

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        extra = {"ended", "error", "messages", "gathered"}
        if self.error is not None:
            extra -= {"error"}
        if self.schedule_cubes is None:
            extra |= {"schedule_cubes", "schedule_stopped"}
        names = {} if self.keepers is None else {"rounds": "levels"}
        if self.keepers is None:
            extra |= {"keepers", "crashes", "held_back_seconds"}
        found: dict[str, Any] = msgspec.to_builtins(
            {names.get(key, key): getattr(self, key) for key in self.__slots__ if key not in extra}
        )
        return found


def outcome_of(
    plan: Plan,
    task: RunTask,
    gathered: Gathered,
    ending: RunEnd,
    writer: RecordingWriter,
    **more: Any,
) -> Outcome:
    """Return the outcome of a run that has ended, with what its clock has to add."""
    return Outcome(
        log=str(writer.path),
        system=task.scene.spec,
        rule=task.name,
        seed=plan.seed,
        modules=len(task.scene.start),
        **gathered.figures,
        ended=ending.ended,
        error=ending.error,
        messages=writer.messages,
        gathered=gathered,
        **more,
    )
