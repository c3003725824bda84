"""Reading a path from a file: a recording, a moves file, a scenario or another program's plan.

The file is opened once and checked as far as possible before it is used. Every part of a command
takes what is read here, and none goes back to the file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from cubepath.coordinator.normal_form.admissibility import InadmissibleMove, carried_out
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.protocol.core.actions import Action, apply_in_place, why_inadmissible
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, Source, check_not_empty, opened
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.path_files.following import is_following
from cubepath.protocol.path_files.following_proofs import is_following_proof
from cubepath.protocol.path_files.moves import PathMove, read_moves
from cubepath.protocol.path_files.npz import is_npz, read_moves_npz
from cubepath.protocol.path_files.numbered import (
    IrregularError,
    NumberedPath,
    Progress,
    number_moves,
    read_path,
)
from cubepath.protocol.path_files.optimality_proofs import is_proof
from cubepath.protocol.plans.formats import NO_HINTS, PlanHints, read_plan
from cubepath.protocol.plans.imported import ImportedPath
from cubepath.protocol.plans.scenario import is_scenario, read_scenario
from cubepath.protocol.recordings.recording import is_recording, read_undamaged
from cubepath.protocol.scenes.specs import scene_from_spec

Form = Literal["recording", "moves", "binary moves", "scenario", "plan", "path"]
"""The kinds of file; a path is in memory, and in none."""


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

    `source` is the file and `form` its kind. `numbered` holds the moves, the table of their actions
    and their names. `given_scene` is the scene of the recording, or of the system that was named
    with the file; `plan_scene` builds the scene of a plan, which can take long. `planner_rounds` is
    the number of rounds that the planner itself counts, None if the plan does not say. With
    `labelled_goals` the vehicles of a plan have no labels, but each must end where the plan takes
    it. `unsolved` is one line on how the end of a plan differs from what its instance asks for, or
    None. `seconds` is how long reading took. `step_name` says what its steps are, and `step_sizes`
    how many moves each step of a recording has; of other files each move is a step.

    >>> given = shorten("logs/golden/hex-5.mcap").given
    >>> given.form, len(given.moves)
    ('recording', 28)
    """

    source: Path
    form: Form
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
            return self.numbered.told_start()
        return self.given_scene.start_state

    @property
    def actions(self) -> Sequence[Action]:
        """The action of each move, in order; of self-contained moves it is built when asked for."""
        return self.numbered.each_action

    @cached_property
    def moves(self) -> tuple[PathMove, ...]:
        """The moves in order."""
        return tuple(self.numbered.moves())


def read_input(
    source: Source,
    system: str | Scene | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Progress | None = None,
) -> PathInput:
    """Read the path in a file, whose kind is found from its content.

    A recording begins with the magic of MCAP, a binary moves file with that of .npz, a scenario is
    a JSON object with "starts"; plans of other programs are recognised by `hints`, or as in
    `cubepath.protocol.plans.formats`. Anything else is a moves file, whose generators are those of
    `system`. An empty file is a path of no moves.

    InputError if the file cannot be read, is damaged, or holds a move that is not admissible, and
    if a system or other files are named that it has no use for; CheckError if the reports of a
    recording contradict each other.
    """
    with opened(source) as file:
        check_not_empty(file)
        return _Reading(file, system, hints, progress).read()


def input_of(played: HasPath, progress: Progress | None = None) -> PathInput:
    """Return the path of what was played; InputError if a move of it is not admissible."""
    began = time.perf_counter()
    source = Path(played.scene.spec)
    numbered = number_moves(_played(source, played), progress)
    return PathInput(source, "path", numbered, time.perf_counter() - began, played.scene)


def _played(source: Path, played: HasPath) -> Iterator[PathMove]:
    state, system = set(played.scene.start_state), played.scene.system
    for number, placed in enumerate(played.placed):
        action = system.action(placed.generator, site_from_json(placed.at))
        before = action.support & state
        try:
            apply_in_place(action, state)
        except InputError as error:
            raise InputError(f"{source}: path[{number}]: {error}") from None
        yield PathMove(action, placed, before)


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

    def read(self) -> PathInput:
        file, system, hints = self._file, self._system, self._hints
        if is_following(file):
            raise InputError(
                f"{file.path}: a timetable of vehicles that follow one another, whose moves do not"
                " commute: expected the path that it is of"
            )
        if is_proof(file) or is_following_proof(file):
            raise InputError(
                f"{file.path}: a proof of optimality, expected a path;"
                " 'cubepath verify' checks proofs"
            )
        form = _form_of(file)
        if form not in {"recording", "binary moves"} or hints.format is not None:
            named = None if isinstance(system, Scene) else system
            plan = read_plan(file, hints.format, companions=hints.companions, system=named)
            if plan is not None:
                return self._of_plan("plan", plan)
        if hints.companions:
            what = f"{form} file" if form.endswith("moves") else form
            raise InputError(
                f"{file.path}: a {what}, which needs no other file: expected no --with"
            )
        if system is not None and form in {"recording", "scenario"}:
            raise InputError(
                f"{file.path}: a {form}, which says itself what its system is: expected no --system"
            )
        if form == "scenario":
            return self._of_plan(form, read_scenario(file))
        if form == "recording":
            return self._of_recording()
        scene = scene_from_spec(system) if isinstance(system, str) else system
        scene = None if scene is None else local_only(scene, "shortening")
        numbered = self._binary(scene) if form == "binary moves" else self._lines(scene)
        return PathInput(file.path, form, numbered, self._seconds, scene)

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._began

    def _of_plan(self, form: Form, plan: ImportedPath) -> PathInput:
        numbered = number_moves(plan.moves, self._progress)
        return PathInput(
            self._file.path,
            form,
            numbered,
            self._seconds,
            # A system that was named is the system of the plan.
            given_scene=None if self._system is None else plan.scene(),
            plan_scene=plan.scene,
            planner_rounds=plan.rounds,
            labelled_goals=plan.labelled_goals,
            unsolved=plan.unsolved(),
        )

    def _of_recording(self) -> PathInput:
        recording = read_undamaged(self._file)
        gatherer = gathered_in_full(recording)
        path = self._file.path
        if gatherer.unfinished is not None:
            raise InputError(f"{path}: {gatherer.unfinished}")
        numbered = number_moves(_recorded(path, gatherer), self._progress)
        sizes = tuple(len(step.actions) for step in gatherer.steps)
        return PathInput(
            path,
            "recording",
            numbered,
            self._seconds,
            recording.scene,
            step_name="level" if recording.clock == "free" else "round",
            step_sizes=sizes,
        )

    def _binary(self, scene: Scene | None) -> NumberedPath:
        found = read_moves_npz(self._file)
        checked = carried_out(found, None if scene is None else scene.start_state)
        if isinstance(checked, InadmissibleMove):
            reason = why_inadmissible(found.actions[found.numbers[checked.move]], checked.state)
            raise InputError(f"{self._file.path}: moves[{checked.move}]: {reason}")
        if self._progress is not None:
            self._progress(len(checked.numbers))
        return checked

    def _lines(self, scene: Scene | None) -> NumberedPath:
        told = 0

        def tell(count: int) -> None:
            nonlocal told
            told += count
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
        tell(len(found.numbers) - told)
        return found


def _form_of(file: InputFile) -> Form:
    """Return the kind of a file by its content; plans of other programs still count as moves."""
    if is_npz(file):
        return "binary moves"
    if is_recording(file):
        return "recording"
    return "scenario" if is_scenario(file) else "moves"


def _recorded(path: Path, gatherer: Gathered) -> Iterator[PathMove]:
    """Yield the moves of the complete rounds of a recording, from its reports."""
    state = set(gatherer.scene.start_state)
    for step in gatherer.steps:
        for executed, action in zip(step.executed, step.actions, strict=True):
            before = action.support & state
            try:
                apply_in_place(action, state)
            except InputError as error:
                raise InputError(
                    f"{path}: round {step.round}, module_{executed.module}: {error}"
                ) from None
            yield PathMove(action, GeneratorPlacement(executed.generator, executed.at), before)
