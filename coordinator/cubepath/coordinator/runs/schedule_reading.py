"""Reading a schedule, and giving each module its own part of it.

Before the run begins, the modules are followed through the cubes from the start of the scene, using
only the traces of the moves. This determines which module makes each move, and each module receives
only its own moves.

Without rounds, units are counted along the cubes from the start, so each module also receives, with
its own moves, how often their units have been written and read before.
"""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cubepath.agents.free.config import OwnMove
from cubepath.agents.keepers.attempts import support_units
from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.coordinator.runs.schedule import Assignment
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.input_files import InputFile, opened
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.file_forms import form_of
from cubepath.protocol.path_files.durations import Cubes, by_generator
from cubepath.protocol.path_files.moves import read_cubes
from cubepath.protocol.recordings.recording import read_undamaged
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import Stopped


@dataclass(frozen=True, slots=True)
class Schedule:
    """A schedule as read; from a recording, also its scene and where its modules ended."""

    path: Path
    cubes: Cubes
    scene: Scene | None = None
    ends: tuple[Site, ...] | None = None


def read_schedule(path: Path) -> Schedule:
    """Read the schedule in a cubes file or a recording; the kind is found from the content.

    The schedule of a recording is the normal cube path of its run. InputError if the file cannot be
    read or is damaged, or if a move is named by an id; CheckError if reports of a recording
    contradict each other.
    """
    with opened(path) as file:
        if form_of(file).name != "recording":
            return Schedule(file.path, _cubes(file))
        recording = read_undamaged(file)
    gatherer = gathered_in_full(recording)
    return Schedule(recording.path, gatherer.schedule(), recording.scene, tuple(gatherer.sites))


def _cubes(file: InputFile) -> Cubes:
    try:
        return tuple(by_generator(n, cube) for n, cube in enumerate(read_cubes(file), 1))
    except InputError as error:
        where = "" if str(error).startswith(f"{file.path}:") else f"{file.path}: "
        raise InputError(f"{where}{error}") from None


def assignment_of(schedule: Schedule, scene: Scene) -> Assignment:
    """Follow the modules of the scene through the cubes; return which module makes which move.

    InputError if the system has no such move, or the moves of a cube do not commute.
    """
    where: dict[Site, int] = {site: module for module, site in enumerate(scene.start)}
    own: dict[int, dict[int, GeneratorPlacement]] = {}
    cubes: list[tuple[GeneratorPlacement, ...]] = []
    stop: Stopped | None = None
    system = _open_system(schedule, scene)
    for number, cube in enumerate(schedule.cubes, 1):
        actions = _actions(schedule, scene, system, number)
        found = [_move(system, where, *each) for each in zip(cube, actions, strict=True)]
        lacking = [each for each in zip(cube, found, strict=True) if isinstance(each[1], str)]
        if stop is None and lacking:
            placed, why = lacking[0]
            stop = Stopped(number, None, placed, str(why))
        if stop is not None:
            cubes.append(cube)  # checked only for moves that do not exist
            continue
        made = [move for move in found if isinstance(move, Move)]
        _follow(made, where, own, number)
        cubes.append(tuple(GeneratorPlacement(move.generator, move.at) for move in made))
    by_module = {module: site for site, module in where.items()}
    ends = tuple(by_module[module] for module in range(len(scene.start)))
    return Assignment(tuple(cubes), own, ends, stop)


def _open_system(schedule: Schedule, scene: Scene) -> System:
    """Return a system that has the moves of the schedule, whatever is in their way now.

    For a recording it is the recorded system. For a cubes file it is the system of the scene, with
    the moves that it would have without obstacles and bounds.
    """
    if schedule.scene is not None:
        return schedule.scene.system
    placed = ((move.generator, move.at) for cube in schedule.cubes for move in cube)
    try:
        return scene.system.with_moves(placed)
    except InputError as error:
        raise InputError(f"{schedule.path}: {error}") from None


def _actions(
    schedule: Schedule, scene: Scene, open_system: System, number: int
) -> list[Action | str]:
    """Return the action of each move of a cube, or why it has none; InputError if it is no cube."""
    found: list[Action | str] = []
    for placed in schedule.cubes[number - 1]:
        try:
            at = placed.at
            with contextlib.suppress(ExcludedError):
                scene.system.action(placed.generator, at)  # its module finds out what is in its way
            found.append(open_system.action(placed.generator, at))
        except ExcludedError as error:
            found.append(str(error))
        except InputError as error:
            raise InputError(f"{schedule.path}: cube {number}: {error}") from None
    if not is_cube([action for action in found if isinstance(action, Action)]):
        raise InputError(f"{schedule.path}: cube {number}: its moves do not commute")
    return found


def _move(
    system: System, where: dict[Site, int], placed: GeneratorPlacement, action: Action | str
) -> Move | str:
    """Return the move with the module that makes it, or say why no module can."""
    if isinstance(action, str):
        return action
    on = frozenset(site for site in action.trace if site in where)
    for move in system.moves_of(action):
        if on == frozenset(source for source, _ in move.motion):
            return move
    text = site_text(placed.at)
    return f"{placed.generator} at {text}: {_nobody(action, on)}"


def _nobody(action: Action, on: frozenset[Site]) -> str:
    ends = [end & action.trace for end in action.ends]
    missing = [in_order(end - on)[0] for end in ends if end - on]
    if len(missing) == len(ends):
        return f"no module stands at {' or '.join(map(site_text, dict.fromkeys(missing)))}"
    taken = in_order({site for end in ends if end <= on for site in on - end})
    if not taken:
        return "no module there makes it, or takes all along whom it moves"
    return f"somebody stands at {' and '.join(map(site_text, taken))}"


def _follow(
    moves: Iterable[Move],
    where: dict[Site, int],
    own: dict[int, dict[int, GeneratorPlacement]],
    number: int,
) -> None:
    arrived: dict[Site, int] = {}
    for move in moves:
        own.setdefault(where[move.source], {})[number] = GeneratorPlacement(move.generator, move.at)
        for source, target in move.motion:
            arrived[target] = where.pop(source)
    where.update(arrived)


def with_end(scene: Scene, schedule: Schedule, assignment: Assignment) -> Scene:
    """Return the scene with the end of the schedule as its goal.

    For a recording, that is where its modules ended, as far as they are in the scene; for a cubes
    file, where the schedule ends. If this is not known, or not a state of the scene, the scene
    keeps its own goal.
    """
    ends = _ends_of(schedule, scene, assignment)
    if ends is None or (frozenset(ends) == scene.goal and scene.goals):
        return scene
    try:
        return replace(scene, goal=frozenset(ends), goals=_known_goals(scene, ends))
    except InputError:
        return scene


def _ends_of(schedule: Schedule, scene: Scene, assignment: Assignment) -> tuple[Site, ...] | None:
    if schedule.scene is None or schedule.ends is None:
        return assignment.ends if assignment.stop is None else None
    if len(schedule.ends) == len(scene.start):
        return schedule.ends
    of_start = dict(zip(schedule.scene.start, schedule.ends, strict=True))
    if of_start.keys() >= set(scene.start):
        return tuple(of_start[site] for site in scene.start)
    return None


def _known_goals(scene: Scene, ends: Sequence[Site]) -> tuple[tuple[Site, ...], ...]:
    """Return for each module the only end that it knows, its own."""
    system = scene.system
    if system.labels is None:
        return tuple((end,) for end in ends)
    by_code = {system.code_of(end): system.place_of(end) for end in ends}
    try:
        return tuple((by_code[system.code_of(site)],) for site in scene.start)
    except KeyError:
        raise InputError("the modules have other labels") from None


def own_moves(scene: Scene, assignment: Assignment) -> dict[int, list[OwnMove]]:
    """Return the moves of each module in their order, each with what it must find."""
    system, tiles = scene.system, Tiles(scene.system, 1)
    owners = {
        (number, placed.generator, placed.at): module
        for module, moves in assignment.own.items()
        for number, placed in moves.items()
    }
    versions: dict[Site, tuple[int, int]] = {}
    found: dict[int, list[OwnMove]] = {}
    for number, cube in enumerate(assignment.cubes, 1):
        for placed in cube:
            at = placed.at
            module = owners.get((number, placed.generator, at))
            if module is None:
                continue  # no module can make it: the schedule stops there
            move = system.moves_of(system.action(placed.generator, at))[0]
            reads, writes = support_units(system, tiles, move)
            after: list[tuple[Site, int, int | None]] = [
                (unit, *versions.get(unit, (0, 0))) for unit in in_order(writes)
            ]
            after += [(unit, versions.get(unit, (0, 0))[0], None) for unit in in_order(reads)]
            found.setdefault(module, []).append(OwnMove(placed, after))
            for unit in reads:
                version, times = versions.get(unit, (0, 0))
                versions[unit] = version, times + 1
            for unit in writes:
                versions[unit] = versions.get(unit, (0, 0))[0] + 1, 0
    return found
