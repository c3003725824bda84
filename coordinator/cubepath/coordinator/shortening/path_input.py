"""Reading a path from a file: a recording, a moves file, a scenario or another program's plan.

The file is opened once and checked as far as possible before it is used. All parts of a command
share what is read here, and none goes back to the file.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

from cubepath.coordinator.normal_form.admissibility import InadmissibleMove, carried_out
from cubepath.protocol.core.actions import Action, why_inadmissible
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.garbage import collector_paused
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.file_forms import NO_HINTS, FileForm, PlanHints, form_of, read_plan
from cubepath.protocol.path_files.moves import PathMove, read_moves
from cubepath.protocol.path_files.numbered import (
    IrregularError,
    NumberedPath,
    Progress,
    number_moves,
    number_placements,
    read_path,
)
from cubepath.protocol.scenes.specs import scene_from_spec

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording


@runtime_checkable
class HasPath(Protocol):
    """What has played a path: an `Outcome`, or what `play` returns."""

    @property
    def scene(self) -> Scene:
        """The scene that was played."""
        ...

    @property
    def placed(self) -> Iterable[GeneratorPlacement]:
        """Its moves in order, each as a generator and a place."""
        ...


@dataclass(frozen=True, eq=False)
class PathInput:
    """A path as read from its file, every move checked.

    `source` is the file and `form` its form, by its name in `cubepath.protocol.file_forms`, or
    "path" for one in memory. `numbered` holds the moves, the table of their actions and their
    names. `given_scene` is the scene of the recording, or of the system that was named with the
    file; `plan_scene` builds the scene of a plan, which can take long. `planner_rounds` is the
    number of rounds that the planner itself counts, None if the plan does not say. With
    `labelled_goals` the vehicles of a plan have no labels, but each must end where the plan takes
    it. `unsolved` is one line on how the end of a plan differs from what its instance asks for, or
    None. `seconds` is how long reading took. `step_name` says what its steps are, and `step_sizes`
    how many moves each step of a recording, or each round of a planner, has; of other files each
    move is a step.

    >>> given = shorten("logs/golden/hex-5.mcap").given
    >>> given.form, len(given.moves)
    ('recording', 28)
    """

    source: Path
    form: str
    numbered: NumberedPath
    seconds: float
    given_scene: Scene | None = None
    plan_scene: Callable[[], Scene] | None = None
    planner_rounds: int | None = None
    labelled_goals: bool = False
    unsolved: str | None = None
    step_name: Literal["move", "round", "level"] = "move"
    step_sizes: tuple[int, ...] | None = None

    @cached_property
    def scene(self) -> Scene | None:
        """The scene, None for self-contained moves; building a plan's may raise `InputError`."""
        if self.given_scene is None and self.plan_scene is not None:
            return self.plan_scene()
        return self.given_scene

    @cached_property
    def start(self) -> frozenset[Site] | None:
        """The sites that are on at the start, None if they are not known.

        For a plan, or a moves file without a system, only sites of the moves are known.
        """
        if self.given_scene is None:
            return self.numbered.stated_start()
        return self.given_scene.start_state

    @property
    def actions(self) -> Sequence[Action]:
        """The action of each move, in order; of self-contained moves it is built when asked for."""
        return self.numbered.each_action

    @cached_property
    def moves(self) -> tuple[PathMove, ...]:
        """The moves in order."""
        return tuple(self.numbered.moves())

    @cached_property
    def touched(self) -> frozenset[Site]:
        """The sites of the supports of all moves."""
        return frozenset[Site]().union(*(action.support for action in self.numbered.actions))


def read_input(
    source: Source,
    system: str | Scene | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Progress | None = None,
) -> PathInput:
    """Read the path in a file, whose form is found from its content.

    The forms are those of `cubepath.protocol.file_forms`; `hints` may say what plan it is. The
    generators of a moves file are those of `system`. An empty file is a path of no moves.

    InputError if the file cannot be read, is damaged, or holds a move that is not admissible, and
    if a system or other files are named that it has no use for; CheckError if the reports of a
    recording contradict each other.
    """
    with opened(source) as file:
        return _Reading(file, system, hints, progress).read()


def hints_for_each(
    sources: Sequence[Source | None], system: str | None, hints: PlanHints
) -> list[tuple[str | None, PlanHints]]:
    """Return what is said of several files for each of them, as far as it has a use for it.

    None is a recording that has been read. What none of them has a use for is said of all, to be
    refused.
    """
    found: list[tuple[str | None, PlanHints]] = []
    for source in sources:
        if source is None:
            found.append((None, NO_HINTS))
            continue
        with opened(source) as file:
            form = form_of(file)
            plan = form.plan or (hints.format is not None and not form.holds(file))
        own = form.name == "recording" or (plan and "plain" not in {form.name, hints.format})
        found.append((None if own else system, hints if plan else NO_HINTS))
    useless = all(given is None for given, _ in found), all(given is NO_HINTS for _, given in found)
    return [(system if useless[0] else one, hints if useless[1] else two) for one, two in found]


def input_of(played: HasPath, progress: Progress | None = None) -> PathInput:
    """Return the path of what was played; InputError if a move of it is not admissible."""
    began = time.perf_counter()
    source = Path(played.scene.spec)
    path = number_placements(played.scene.system, played.placed)
    numbered = _admissible(path, played.scene, f"{source}: path")
    if progress is not None:
        progress(len(numbered.numbers))
    return PathInput(source, "path", numbered, time.perf_counter() - began, played.scene)


def starts_to_compare(
    one: PathInput, other: PathInput
) -> tuple[frozenset[Site] | None, frozenset[Site] | None]:
    """Return the starts of two paths, as far as both paths tell of the same sites.

    Without a scene only of sites that moves of both touch is it known whether they are on.
    """
    first, second = one.start, other.start
    if first is None or second is None:
        return None, None
    if one.given_scene is not None and other.given_scene is not None:
        return first, second
    common = one.touched & other.touched
    return first & common, second & common


def _admissible(path: NumberedPath, scene: Scene | None, name: str) -> NumberedPath:
    """Return the path carried out from the start; InputError names the first misfit."""
    found = carried_out(path, None if scene is None else scene.start_state)
    if isinstance(found, InadmissibleMove):
        why = why_inadmissible(path.each_action[found.move], found.state)
        raise InputError(f"{name}[{found.move}]: {why}")
    return found


class _Reading:
    """One reading of one file."""

    def __init__(
        self,
        file: InputFile,
        system: str | Scene | None,
        hints: PlanHints,
        progress: Progress | None,
    ) -> None:
        self._file = file
        self._system = system
        self._hints = hints
        self._progress = progress
        self._began = time.perf_counter()

    @collector_paused()
    def read(self) -> PathInput:
        file, system, hints = self._file, self._system, self._hints
        if hints.format is not None:
            return self._of_plan(hints.format)
        form = form_of(file)
        form.check_path(file.path)
        if form.plan:
            return self._of_plan(form.name)
        if hints.companions:
            raise InputError(
                f"{file.path}: {form.what}, which needs no other file: expected no --with"
            )
        if form.name == "recording":
            return self._of_recording(form)
        scene = scene_from_spec(system) if isinstance(system, str) else system
        scene = None if scene is None else local_only(scene, "shortening")
        numbered = self._lines(scene) if form.name == "moves" else self._binary(form, scene)
        return PathInput(file.path, form.name, numbered, self._seconds, scene)

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._began

    def _of_plan(self, spec: str) -> PathInput:
        companions, system = self._hints.companions, self._system
        named = None if isinstance(system, Scene) else system
        plan = read_plan(self._file, spec, companions=companions, system=named)
        numbered = number_moves(plan.moves, self._progress)
        sizes = tuple(plan.round_sizes())
        in_rounds = any(size != 1 for size in sizes)
        return PathInput(
            self._file.path,
            spec.partition(":")[0],
            numbered,
            self._seconds,
            # A system that was named is the system of the plan.
            given_scene=None if self._system is None else plan.scene(),
            plan_scene=plan.scene,
            planner_rounds=plan.rounds,
            labelled_goals=plan.labelled_goals,
            unsolved=plan.unsolved(),
            step_name="round" if in_rounds else "move",
            step_sizes=sizes if in_rounds else None,
        )

    def _of_recording(self, form: FileForm) -> PathInput:
        from cubepath.coordinator.runs.gathering import gathered_in_full  # noqa: PLC0415

        path = self._file.path
        if self._system is not None:
            raise InputError(
                f"{path}: a recording, which says itself what its system is: expected no --system"
            )
        recording: Recording = form.read(self._file)
        found = gathered_in_full(recording)
        if found.unfinished is not None:
            raise InputError(f"{path}: {found.unfinished}")
        try:
            numbered = found.checked_path()
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if self._progress is not None:
            self._progress(len(numbered.numbers))
        return PathInput(
            path,
            form.name,
            numbered,
            self._seconds,
            recording.scene,
            step_name="level" if recording.clock == "free" else "round",
            step_sizes=found.sizes,
        )

    def _binary(self, form: FileForm, scene: Scene | None) -> NumberedPath:
        checked = _admissible(form.read(self._file), scene, f"{self._file.path}: moves")
        if self._progress is not None:
            self._progress(len(checked.numbers))
        return checked

    def _lines(self, scene: Scene | None) -> NumberedPath:
        reported = 0

        def tell(count: int) -> None:
            nonlocal reported
            reported += count
            if self._progress is not None:
                self._progress(count)

        try:
            found = read_path(self._file, scene, tell)
        except IrregularError:
            pass
        else:
            checked = carried_out(found, None if scene is None else scene.start_state)
            if not isinstance(checked, InadmissibleMove):
                return checked
        # Reading line by line finds what is wrong and where, or that the form is only unusual.
        found = number_moves(read_moves(self._file, scene))
        tell(len(found.numbers) - reported)
        return found
