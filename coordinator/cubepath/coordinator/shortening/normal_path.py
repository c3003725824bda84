"""Shortening a path from a file: a recording, a moves file, a scenario, or another program's plan.

Room: coordinator. What the file says is checked as far as it can be before anything is made of
it; the normal cube path itself is `cubepath.coordinator.normal_form.array_heap`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cubepath.coordinator.normal_form.admissibility import first_misfit
from cubepath.coordinator.normal_form.array_heap import NumberedHeap
from cubepath.coordinator.normal_form.compiled_heap import Numbering, in_cubes
from cubepath.coordinator.runs.gatherer import gathered
from cubepath.protocol.core.actions import Action, State, apply_in_place, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.path_files.moves import MoveName, PathMove, read_moves
from cubepath.protocol.path_files.npz import NumberedCubes, is_npz, read_moves_npz
from cubepath.protocol.path_files.numbered import (
    IrregularError,
    NumberedPath,
    Progress,
    number_moves,
    read_path,
)
from cubepath.protocol.plans.formats import NO_HINTS, PlanHints, read_plan
from cubepath.protocol.plans.imported import Imported
from cubepath.protocol.plans.scenario import is_scenario, read_scenario
from cubepath.protocol.recordings.recording import is_recording, read_undamaged
from cubepath.protocol.scenes.specs import scene_from_spec

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Shortened:
    """The normal cube path of a path, and the figures that ``cubepath shorten --json`` gives.

    `path` is the path that came in, and `left` are its moves that are left, cube by cube.
    `planner_rounds` is how many rounds the planner of a plan counts itself, None where nobody says.
    """

    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    seconds: float
    path: NumberedPath
    left: NumberedCubes
    planner_rounds: int | None = None

    @cached_property
    def cube_path(self) -> tuple[tuple[Action, ...], ...]:
        """The cubes as actions."""
        actions, numbers = self.path.actions, self.path.numbers[self.left.moves]
        return self._cubes([actions[number] for number in numbers.tolist()])

    @cached_property
    def named(self) -> tuple[tuple[MoveName, ...], ...]:
        """The cubes with each move as a cubes file has it: as the input names it."""
        return self._cubes([self.path.name(move) for move in self.left.moves.tolist()])

    def _cubes(self, each: Sequence[_T]) -> tuple[tuple[_T, ...], ...]:
        starts = self.left.starts.tolist()
        return tuple(tuple(each[begin:end]) for begin, end in pairwise(starts))

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = (
            "moves",
            "reduced_moves",
            "cubes",
            "max_cube_dimension",
            "planner_rounds",
            "seconds",
        )
        return {key: getattr(self, key) for key in keys}


def shorten(
    path: Path,
    *,
    system: str | None = None,
    progress: Progress | None = None,
    hints: PlanHints = NO_HINTS,
) -> Shortened:
    """Return the normal cube path of the path in a file; what the file is, its content tells.

    A recording begins with the magic of MCAP, a binary moves file with that of .npz, a scenario is
    a JSON object with "starts"; plans of other programs are told by `said`, or by what
    `cubepath.protocol.plans.formats` looks for. All else is a moves file, whose generators are
    those of `system`. An empty file is a path of no moves, and that a path of no cubes.

    InputError where the file cannot be read, is damaged, or holds a move that is not admissible;
    CheckError where the reports of a recording contradict each other.
    """
    began = time.perf_counter()
    plan = plan_of(path, system, hints)
    found = path_of(path, system, progress) if plan is None else number_moves(plan.moves, progress)
    table = Numbering(found.actions).table()
    heap = NumberedHeap()
    if table is not None:
        heap.add_actions(table)
        heap.append(found.numbers)
    pieces, starts = in_cubes(heap.pieces(), found.actions)
    return Shortened(
        moves=heap.moves,
        reduced_moves=heap.reduced_moves,
        cubes=heap.cubes,
        max_cube_dimension=heap.max_cube_dimension,
        seconds=round(time.perf_counter() - began, 3),
        path=found,
        left=NumberedCubes(starts, pieces.moves.astype(np.int64)),
        planner_rounds=None if plan is None else plan.rounds,
    )


def plan_of(path: Path, system: str | None, hints: PlanHints) -> Imported | None:
    """Return the plan in a file, a scenario's too; None for recordings and moves files.

    InputError as `shorten`; also where a plan's files are named beside what is none.
    """
    if (
        path.suffix.lower() in {".json", ".mcap", ".npz"}
        and path.is_file()
        and not path.stat().st_size
    ):
        raise InputError(f"{path}: empty file, expected what its name says")
    kind = _content(path)
    if kind not in {"recording", "arrays"} or hints.format is not None:
        found = read_plan(path, hints.format, companions=hints.companions, system=system)
        if found is not None:
            return found
    if hints.companions:
        what = "binary moves file" if kind == "arrays" else kind.replace("moves", "moves file")
        raise InputError(f"{path}: a {what}, which needs no other file: expected no --with")
    if _kind(path, system) != "scenario":
        return None
    with opened(path) as file:
        return read_scenario(file)


def path_of(
    path: Path,
    system: str | None = None,
    progress: Progress | None = None,
    hints: PlanHints = NO_HINTS,
) -> NumberedPath:
    """Return the path in a file, every move of it checked; `shorten` says what is refused."""
    plan = plan_of(path, system, hints)
    if plan is not None:
        return number_moves(plan.moves, progress)
    kind = _kind(path, system)
    if kind == "recording":
        return number_moves(_recorded(path), progress)
    scene = _scene(system)
    start = None if scene is None else scene.start_state
    if kind == "arrays":
        found = _arrays(path, start)
        if progress is not None:
            progress(len(found.numbers))
        return found
    told = 0

    def tell(count: int) -> None:
        nonlocal told
        told += count
        if progress is not None:
            progress(count)

    try:
        found = read_path(path, scene, tell)
    except IrregularError:
        pass
    else:
        if first_misfit(found, start) is None:
            return found
    # Read line by line, it says what is wrong and where; or nothing is, and it is unusual.
    found = number_moves(read_moves(path, scene))
    tell(len(found.numbers) - told)
    return found


def moves_of(
    path: Path, system: str | None = None, hints: PlanHints = NO_HINTS
) -> tuple[str, Iterator[PathMove]]:
    """Return what a file is, "recording", "plan" or "moves", and its moves in order.

    Each move is checked when its turn comes; `shorten` says what is refused.
    """
    plan = plan_of(path, system, hints)
    if plan is not None:
        return "plan", plan.moves
    kind = _kind(path, system)
    if kind == "recording":
        return kind, _recorded(path)
    scene = _scene(system)
    if kind == "arrays":
        return "moves", _arrays(path, None if scene is None else scene.start_state).moves()
    return kind, read_moves(path, scene)


def _scene(system: str | None) -> Scene | None:
    return None if system is None else local_only(scene_from_spec(system), "shortening")


def _arrays(path: Path, start: State | None) -> NumberedPath:
    """Return the path in a binary moves file; InputError names the first bad move."""
    found = read_moves_npz(path)
    wrong = first_misfit(found, start)
    if wrong is not None:
        reason = why_inadmissible(found.actions[found.numbers[wrong.move]], wrong.state)
        raise InputError(f"{path}: moves[{wrong.move}]: {reason}")
    return found


def _kind(path: Path, system: str | None) -> str:
    """Return what a file is; InputError where it says what its system is and one is given."""
    kind = _content(path)
    if system is not None and kind in {"recording", "scenario"}:
        raise InputError(
            f"{path}: a {kind}, which says itself what its system is: expected no --system"
        )
    return kind


def _content(path: Path) -> str:
    """Return "recording", "arrays", "scenario" or "moves", by content."""
    with opened(path) as file:
        if is_npz(file):
            return "arrays"
        if is_recording(file):
            return "recording"
        return "scenario" if is_scenario(file) else "moves"


def _recorded(path: Path) -> Iterator[PathMove]:
    """Yield the moves of the complete rounds of a recording, from its reports."""
    recording = read_undamaged(path)
    gatherer = gathered(recording)
    if gatherer.begun > gatherer.rounds + 1:
        raise InputError(
            f"{path}: round {gatherer.rounds + 1} is not complete, but there are reports of"
            f" round {gatherer.begun}: expected all rounds up to the last"
        )
    state = set(recording.scene.start_state)
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
