"""The steps of a path from a file, with a scene to draw them in: moves, or cubes as given.

Self-contained moves are drawn too, if they have "before" and "after" and their sites are cells of a
lattice in the plane.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.shortening.normal_path import Shortened, shortened
from cubepath.coordinator.shortening.path_input import PathInput, read_input
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import InputFile, Source
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.file_forms import NO_HINTS, PlanHints, form_of
from cubepath.protocol.path_files.certificates import Certificate, read_certificate
from cubepath.protocol.path_files.moves import CubeName
from cubepath.protocol.path_files.numbered import Progress
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.listed import TabledSystem


@dataclass(frozen=True, eq=False)
class PathSteps:
    """A path in admissible steps from the start of a scene, and its schedule.

    `step_name` says what a step is. `cubes` is the normal cube path, or the schedule of a
    certificate, of which `chain` has the moves that prove it: places in the cubes one after
    another, from 0. `normal_form` says what becomes of each move, in order. `unsolved` is one line
    on how a plan's end differs from what its instance asks for, or None.
    """

    source: Path
    scene: Scene
    step_name: Literal["move", "cube", "round", "level"]
    steps: Sequence[Sequence[Action]]
    cubes: Sequence[Sequence[Action]]
    normal_form: NormalForm
    unsolved: str | None = None
    chain: Sequence[int] | None = None
    recording: Recording | None = None


def read_steps(
    file: InputFile,
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Progress | None = None,
) -> PathSteps:
    """Read the steps of a moves file, a cubes file, a scenario or another program's plan.

    The kind of file is found from its content. InputError if the file cannot be read or drawn: as
    for `read_input`, if the moves of a cube do not commute or are not admissible, and if nothing
    says where modules are.
    """
    form = form_of(file)
    if form.name in {"cubes", "binary cubes"}:
        return _of_cubes(file.path, form.read(file), system, hints)
    return steps_of(shortened(read_input(file, system, hints, progress)))


def steps_of(found: Shortened) -> PathSteps:
    """Return the steps of a shortened path; InputError if nothing says where modules are."""
    given = found.given
    scene = given.scene or _own_scene(given)
    return PathSteps(
        given.source,
        scene,
        given.step_name,
        _steps(given),
        found.cube_path,
        found.normal_form,
        given.unsolved,
    )


def _steps(given: PathInput) -> list[Sequence[Action]]:
    actions = given.actions
    sizes = (1,) * len(actions) if given.step_sizes is None else given.step_sizes
    return [actions[one:other] for one, other in pairwise(np.cumsum((0, *sizes)).tolist())]


def steps_gathered(source: Path, found: Gathered, *, free: bool) -> PathSteps:
    """Return the steps of a run that was gathered: its rounds, or its levels."""
    heap, steps = found.heap, [step.actions for step in found.steps]
    cubes, fates = heap.cube_path(), heap.normal_form()
    return PathSteps(source, found.scene, "level" if free else "round", steps, cubes, fates)


def certified_steps(
    proof: InputFile,
    of: Source,
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Progress | None = None,
) -> PathSteps:
    """Read a certificate and its path; its schedule stands where the normal cube path does.

    InputError if a file cannot be read or drawn, as for `read_steps`; CheckError if the certificate
    does not prove what it says.
    """
    certificate = read_certificate(proof)
    given = read_input(of, system, hints, progress)
    checks = check_certificate(certificate, given.actions, given.start)
    wrong = next(((name, why) for name, why in checks.items() if why is not None), None)
    if wrong is not None:
        raise CheckError(f"{proof.path}: check {wrong[0]!r} failed: {wrong[1]}")
    actions = given.actions
    order = {move: place for place, move in enumerate(chain.from_iterable(certificate.cubes))}
    return PathSteps(
        proof.path,
        given.scene or _own_scene(given),
        given.step_name,
        _steps(given),
        [[actions[move - 1] for move in cube] for cube in certificate.cubes],
        _fates(certificate),
        given.unsolved,
        [order[move] for move in certificate.chain],
    )


def _fates(certificate: Certificate) -> NormalForm:
    """Return the cube of each move, or the move that it cancels with."""
    levels = np.zeros(certificate.moves, np.int32)
    partners = np.full(certificate.moves, -1, np.int32)
    for number, cube in enumerate(certificate.cubes, 1):
        levels[np.array(cube) - 1] = number
    for earlier, later in certificate.cancelled:
        partners[earlier - 1], partners[later - 1] = later - 1, earlier - 1
    return NormalForm(levels, partners)


def _of_cubes(
    path: Path, cubes: Iterable[tuple[CubeName, ...]], system: str | None, hints: PlanHints
) -> PathSteps:
    if hints.format is not None or hints.companions:
        raise InputError(f"{path}: a cubes file, expected neither --format nor --with")
    if system is None:
        raise InputError(
            f"{path}: a cubes file, which does not say where modules start: expected --system"
        )
    scene = local_only(scene_from_spec(system), "schedules")
    steps = list(_checked(path, cubes, scene))
    heap = FastHeap(telling=True)
    heap.extend(action for step in steps for action in step)
    return PathSteps(path, scene, "cube", steps, heap.cube_path(), heap.normal_form())


def _checked(
    path: Path, cubes: Iterable[tuple[CubeName, ...]], scene: Scene
) -> Iterator[list[Action]]:
    """Yield the actions of each cube; InputError names the first that cannot be made."""
    state = set(scene.start_state)
    for number, names in enumerate(cubes, 1):
        try:
            step = _cube(scene, names)
            for action in step:
                apply_in_place(action, state)
        except InputError as error:
            raise InputError(f"{path}: cube {number}: {error}") from None
        yield step


def _cube(scene: Scene, names: Iterable[CubeName]) -> list[Action]:
    found = [_action(scene, name) for name in names]
    if not is_cube(found):
        raise InputError("its moves do not commute")
    return found


def _action(scene: Scene, name: CubeName) -> Action:
    if not isinstance(name, GeneratorPlacement):
        raise InputError(
            f"move {msgspec.json.encode(name).decode()} is named by an id, expected generator and"
            " place, which say where modules go"
        )
    return scene.system.read_action(name)


def _own_scene(given: PathInput) -> Scene:
    """Return a scene for self-contained moves, drawn as cells that moves join."""
    path, start = given.source, given.start
    if not given.moves:
        raise InputError(f"{path}: no moves and no --system: nothing says what there is to draw")
    if start is None:
        raise InputError(
            f"{path}: moves without before and after do not say where modules are, expected these"
            " or generators with --system SYSTEM"
        )
    listed: dict[Action, Move] = {}
    positions: dict[Site, tuple[float, float]] = {}
    for number, move in enumerate(given.moves, 1):
        for site in in_order(move.action.support):
            positions[site] = _position(path, number, site)
        if move.action not in listed:
            before, after = (in_order(end & move.action.trace) for end in move.action.ends)
            if len(before) != len(after) or not before:
                raise InputError(
                    f"{path}: move {number}: {len(before)} modules before and {len(after)} after,"
                    " expected as many, and at least one, to be followable"
                )
            motion = tuple(zip(before, after, strict=True))
            listed[move.action] = Move(move.action, "move", number, motion)
    system = TabledSystem(listed.values(), drawing="graph", positions=positions)
    return Scene(str(path), "", system, in_order(start))


def _position(path: Path, number: int, site: Site) -> tuple[float, float]:
    match site:
        case (int(x), int(y)):
            return float(x), float(y)
        case _:
            raise InputError(
                f"{path}: move {number}: site {site_text(site)} is no cell [x, y] of a lattice,"
                " expected such cells, or generators with --system SYSTEM"
            )
