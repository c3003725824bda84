"""What remains of a recording that may have lost its scene or its parameters.

The messages of every whole chunk are there. What the file no longer says about itself, you supply
when you recover it; otherwise it stays lost.
"""

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.recordings import description
from cubepath.protocol.recordings.mcap_file import checksum
from cubepath.protocol.recordings.recording import FileContents, Recording, read
from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.messages import KINDS


def remains_of(source: Source) -> Recording:
    """Return what remains of a recording, damaged or not: maybe without scene or parameters.

    InputError if there is no message in any chunk that is whole, or if the file is none of ours.

    >>> found = remains_of("logs/golden/hex-5.mcap")
    >>> len(found.records), found.problems
    (578, ())
    """
    found = read(source)
    problems = list(found.problems)
    written_as, parameters = _described(found, problems)
    if not len(found.records):
        why = f" ({problems[0]})" if problems else ""
        raise InputError(f"{found.path}: nothing to recover: no chunk with messages is whole{why}")
    scene = None
    try:
        if written_as != description.KEYS_FORMAT:
            scene = description.scene_in(found.path, found.salvage)
    except InputError:
        problems.append("its scene is lost")
    return found.recording(written_as, parameters, scene, problems)


def _described(found: FileContents, problems: list[str]) -> tuple[str, dict[str, str]]:
    """Return the format and the parameters, as far as both are left."""
    try:
        return description.parameters_in(found.path, found.salvage, problems)
    except InputError:
        written_as = _format_of(found) if found.problems and len(found.records) else None
        if written_as is None:
            raise
    for each in found.salvage.metadata:
        values = description.without_format(each.metadata)
        if each.name == description.METADATA and each.metadata.get("checksum") == checksum(values):
            problems.append(f"its format is lost, and by its messages it is {written_as}")
            return written_as, values
    problems.append("its parameters are lost")
    return written_as, {}


def _format_of(found: FileContents) -> str | None:
    """Return the format that the messages are in; None if they are not those of a run."""
    kinds = {record.kind for record in found.records}
    of_rounds = {*KINDS}.difference(*description.BATCHES.values())
    if kinds <= of_rounds:
        return description.FORMAT
    return description.FREE_FORMAT if kinds <= of_rounds | FREE_KINDS.keys() else None
