"""Recovering what can be read of a damaged recording, even one that has lost its scene.

Part of `cubepath log recover -o`. What cannot be true is found at the first message that
contradicts it; `verify` judges the rest.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cubepath.coordinator.verification.partial import whole_rounds
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.cutting import is_beginning
from cubepath.protocol.recordings.description import LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.remains import remains_of
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.scenes.specs import files_in, scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.free_messages import Commit, CommitLog
from cubepath.protocol.wire.messages import Report


@dataclass(frozen=True, slots=True)
class Recovered:
    """The readable part of a damaged recording, written to a new file."""

    out: Path
    messages: int
    rounds: int
    """The number of rounds that every module has reported, or of levels with commits."""
    problems: tuple[str, ...]


def recover(
    source: Recording | Source, out: Path | str, *, scene: Scene | None = None
) -> Recovered:
    """Write what can be read of a recording, or was read already, as a whole recording to `out`.

    Its parameter `recovered` says what it comes from. `scene` is that of the run, for a recording
    that has lost its scene; without one, the messages are written alone, which other tools can
    read, and which is a recording again when it is recovered with the scene. InputError if no
    message can be read, if they cannot be of the scene, if `out` is the recording itself, or if it
    cannot be written.

    >>> found = recover("logs/golden/hex-5.mcap", "copy.mcap")
    >>> found.rounds, found.problems, verify("copy.mcap").ok
    (29, (), True)
    """
    given = source if isinstance(source, Recording) else remains_of(source)
    given = given if scene is None else with_told_scene(given, scene)
    out = Path(out)
    rounds = 0 if given.stored_scene is None else whole_rounds(given)
    count = len(given.records)
    last = max((record.sequence for record in given.records), default=-1)
    gap = max(0, last + 1 - count)
    problems = "; ".join(given.problems) or "no problems"
    lost = f"; at least {gap} more are missing" if gap else ""
    note = f"{count} messages of {given.path.name}: {problems}{lost}"
    messages = copy_recording(given, out, {RECOVERED: note})
    return Recovered(out, messages, rounds, given.problems)


def with_told_scene(remains: Recording, scene: Scene) -> Recording:
    """Return what remains of a recording, with the scene that you supply.

    InputError in one line if the recording has another scene, names another system, or has a
    message that cannot be of this one.
    """
    if remains.stored_scene is not None:
        if not _equal(remains.stored_scene, scene):
            raise InputError(
                f"system={scene.spec}: the scene of {remains.path} is not lost, and it is that of"
                f" {remains.stored_scene.spec}"
            )
        return remains
    named = remains.parameters.get("system", scene.spec)
    if named != scene.spec and not _may_be(named, scene):
        raise InputError(f"system={scene.spec}: the parameters of {remains.path} name {named}")
    found = replace(remains, stored_scene=scene)
    why = next(_contradictions(found), None)
    if why is not None:
        raise InputError(f"system={scene.spec}: {remains.path}: {why}")
    return found


def _equal(one: Scene, other: Scene) -> bool:
    return one.start == other.start and scene_to_toml(one) == scene_to_toml(other)


def _may_be(named: str, scene: Scene) -> bool:
    """Return whether a scene may be the one of a name in a recording, which opens no file."""
    try:
        return bool(files_in(named)) or _equal(scene_from_spec(named), scene)
    except InputError:
        return True


def _contradictions(recording: Recording) -> Iterator[str]:
    """Yield in a line each what of a recording cannot be of its scene."""
    kinds = ("commit", "commits") if recording.clock == "free" else ("report",)
    reported: dict[int, set[int]] = {}
    for logged in recording.messages(kinds):
        match logged.message:
            case Report() as report:
                reported.setdefault(report.round, set()).add(report.module)
                begins = report.before if report.round == 1 else None
                yield from _report(recording, f"round {report.round}", report.module, begins)
                yield from _move(recording, f"round {report.round}", report.move)
            case Commit() | CommitLog() as message:
                for moved in message.parts if isinstance(message, CommitLog) else (message,):
                    where = f"level {moved.level}"
                    for module, before, _, version in moved.motion:
                        begins = before if version == 1 else None
                        yield from _report(recording, where, module, begins)
                    if moved.generator is not None:
                        placed = GeneratorPlacement(moved.generator, moved.at)
                        yield from _move(recording, where, placed)
            case _:
                pass
    yield from _silent(recording, reported)


def _silent(recording: Recording, reported: Mapping[int, set[int]]) -> Iterator[str]:
    """Yield who of the system reports nothing, though no message before the last is missing.

    A round is begun when all modules have reported the one before.
    """
    if len(reported) < 2 or not recording.parameters.keys().isdisjoint(LEFT_OUT):
        return
    modules = len(recording.scene.start)
    silent = set(range(modules)).difference(*reported.values())
    if silent and is_beginning(recording):
        name, rounds = f"module_{min(silent)}", len(reported)
        yield f"{name}: no report in {rounds} rounds; the system has {modules} modules"


def _report(recording: Recording, where: str, module: int, begins: Site | None) -> Iterator[str]:
    start = recording.scene.start
    if module >= len(start):
        yield f"{where}, module_{module}: the system has {len(start)} modules"
        return
    found: Site | None = begins
    if found is not None and found != start[module]:
        yield (
            f"{where}, module_{module}: begins at {site_text(found)}, in the system at"
            f" {site_text(start[module])}"
        )


def _move(recording: Recording, where: str, move: GeneratorPlacement | None) -> Iterator[str]:
    if move is None:
        return
    try:
        recording.scene.system.read_action(move)
    except InputError as error:
        yield f"{where}: {error}"
