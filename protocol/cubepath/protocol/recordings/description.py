"""What a recording says of itself: its format, its parameters, and the scene of the run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.mcap_file import checksum
from cubepath.protocol.scenes.toml import scene_from_toml

if TYPE_CHECKING:
    from cubepath.protocol.recordings.salvaging import Salvage

FORMAT = "cubepath-recording-2"
"""The format of runs with rounds: modules say messages in batches, `said` and `reports`."""
FREE_FORMAT = "cubepath-recording-3"
"""The format of runs without rounds, which have keepers, versions and levels."""
FORMATS = (FORMAT, FREE_FORMAT)
"""The formats that are read."""
Clock: TypeAlias = Literal["lockstep", "free"]
METADATA = "cubepath"
"""The name of the metadata record with the parameters."""
ATTACHED = "attached"
"""The parameter of a recording from outside: the first round, or level, that is whole in it."""
PART = "part"
"""The parameter that numbers the files of one recorder from 0."""
LEFT_OUT = ("topics", "exclude")
"""The parameters that tell which topics were recorded, and which were not."""
SCENE = "scene.toml"
SCHEDULE = "schedule.jsonl"


def format_of(parameters: Mapping[str, str]) -> str:
    """Return the format that a new recording has, by the clock of its run."""
    return FREE_FORMAT if parameters.get("clock") == "free" else FORMAT


def clock_of(written_as: str) -> Clock:
    """Return the clock of the runs that a format is for."""
    return "free" if written_as == FREE_FORMAT else "lockstep"


def has_wall_times(written_as: str, parameters: Mapping[str, str]) -> bool:
    """Return whether log times are the wall clock, though the run has rounds.

    Then the round of a message is the one that it tells itself.
    """
    return clock_of(written_as) == "lockstep" and parameters.get("log_time") == "wall"


def wall_times_in(found: Salvage) -> bool:
    """Return whether a file says of itself that it `has_wall_times`, whatever else it says."""
    told = (record.metadata for record in found.metadata if record.name == METADATA)
    return any(has_wall_times(each.get("format", ""), each) for each in told)


def metadata_of(parameters: Mapping[str, str], written_as: str) -> dict[str, str]:
    """Return the metadata record of a new recording in a format."""
    return {**parameters, "format": written_as, "checksum": checksum(parameters)}


def parameters_in(path: Path, found: Salvage, problems: list[str]) -> tuple[str, dict[str, str]]:
    """Return the format and the parameters; InputError if there are none in a known format."""
    named = [record.metadata for record in found.metadata if record.name == METADATA]
    ours = [values for values in named if values.get("format") in FORMATS]
    if not ours:
        shown = repr(named[0].get("format")) if named else "none"
        detail = f" ({problems[0]})" if problems else ""
        expected = " or ".join(map(repr, FORMATS))
        raise InputError(
            f"{path}: no cubepath recording: format {shown}, expected {expected}{detail}"
        )
    read = [(told, without_format(told)) for told in ours]
    right = [each for each in read if each[0].get("checksum") == checksum(each[1])]
    if not right:
        problems.append("corrupt: the parameters are not those of their checksum")
    told, values = (right or read)[0]
    return told["format"], values


def without_format(told: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters that a metadata record tells."""
    return {key: value for key, value in told.items() if key not in ("format", "checksum")}


def scene_in(path: Path, found: Salvage) -> Scene:
    """Return the scene; InputError if it is lost or none."""
    for attachment in found.attachments:
        if attachment.name == SCENE:
            where = f"{path} ({SCENE})"
            try:
                text = attachment.data.decode()
            except UnicodeDecodeError as error:
                raise InputError(f"{where}: not UTF-8 text (byte {error.start})") from None
            return scene_from_toml(text, where)
    raise InputError(f"{path}: the attachment {SCENE} is lost, so nothing can be checked")
