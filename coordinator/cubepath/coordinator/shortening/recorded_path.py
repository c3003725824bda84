"""The path of a recording, in numbers: what its modules or keepers reported."""

from __future__ import annotations

from typing import Literal, NamedTuple

from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.numbered import NumberedPath
from cubepath.protocol.recordings.recording import Recording


class RecordedPath(NamedTuple):
    """The path of a recording, its scene, and how many moves each of its rounds or levels has."""

    numbered: NumberedPath
    scene: Scene
    step_name: Literal["round", "level"]
    step_sizes: tuple[int, ...]


def recorded_path(recording: Recording) -> RecordedPath:
    """Return the path of a recording; errors as for `gathered_in_full`.

    InputError as well if a round in the middle is missing, or a move is not admissible.
    """
    found = gathered_in_full(recording)
    if found.unfinished is not None:
        raise InputError(f"{recording.path}: {found.unfinished}")
    try:
        path = found.checked_path()
    except InputError as error:
        raise InputError(f"{recording.path}: {error}") from None
    step: Literal["round", "level"] = "level" if recording.clock == "free" else "round"
    return RecordedPath(path, recording.scene, step, found.sizes)
