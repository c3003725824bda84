"""Gathering a recording again, of a run with rounds or without."""

from fnmatch import fnmatchcase
from typing import NoReturn

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.recordings.cutting import is_beginning, left_out
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.messages import Report, decode

_NEEDED = {"lockstep": ("reports",), "free": ("commit", "turns", "commits")}
"""The kinds of messages from which a run is gathered."""


def gathered(recording: Recording) -> Gathered:
    """Gather what modules or keepers of a recording reported.

    Incomplete rounds are left out, and commits that depend on others which are not recorded.
    InputError as for `check_from_the_start`, or if a message in the recording is malformed;
    CheckError as for `Gatherer.receive` and `FreeGatherer.receive`.

    >>> from pathlib import Path
    >>> from cubepath.protocol import read_recording
    >>> path = gathered(read_recording(Path("logs/golden/hex-5.mcap")))
    >>> path.rounds, len(path.path), path.reached
    (29, 28, True)
    """
    check_from_the_start(recording)
    return _free(recording) if recording.clock == "free" else _lockstep(recording)


def gathered_in_full(recording: Recording) -> Gathered:
    """Gather what was reported, of a recording that lacks none of it in between.

    As `gathered`; InputError as well for what was cut from a longer recording if that left out
    messages from which moves are gathered: its moves would be those of a shorter run.

    >>> from pathlib import Path
    >>> from cubepath.protocol import read_recording
    >>> gathered_in_full(read_recording(Path("logs/golden/hex-5.mcap"))).rounds
    29
    """
    found = gathered(recording)
    if left_out(recording) and not is_beginning(recording):
        kinds = _NEEDED[recording.clock]
        why = found.unfinished
        if why is None and next(recording.of_kind("report", *kinds), None) is None:
            why = f"no {' or '.join(kinds)} on record"
        if why is not None:
            there = len(recording.records)
            raise InputError(
                f"{recording.path}: {why}; it holds {there} of the {there + left_out(recording)}"
                " messages of a longer recording ('cubepath log merge' puts parts together)"
            )
    return found


def check_from_the_start(recording: Recording) -> None:
    """Raise InputError if a recording was not made from the start on, with all that was reported.

    Then nobody knows where modules stood.
    """
    parameters = recording.parameters
    attached = parameters.get(ATTACHED, "1")
    if attached not in {"0", "1"}:
        _refuse(recording, attached)
    taken, without = (parameters.get(key, "").split() for key in LEFT_OUT)
    for kind in _NEEDED[recording.clock]:
        whole = not taken or any(_matches(kind, each, "*") for each in taken)
        if not whole or any(_matches(kind, each) for each in without):
            left = ", ".join(f"{key} {parameters[key]}" for key in LEFT_OUT if key in parameters)
            raise InputError(
                f"{recording.path}: messages were left out when it was recorded ({left}), expected"
                f" all of {' and '.join(_NEEDED[recording.clock])}"
            )


def _matches(kind: str, glob: str, senders: str | None = None) -> bool:
    """Return whether a glob is for messages of a kind, of some senders or of these."""
    named, _, of = glob.partition("/")
    return fnmatchcase(kind, named) and (senders is None or of in {"", senders})


def _refuse(recording: Recording, begins: object) -> NoReturn:
    what = "level" if recording.clock == "free" else "round"
    raise InputError(
        f"{recording.path}: begins in {what} {begins}, expected a recording from the start of the"
        " run"
    )


def _lockstep(recording: Recording) -> Gatherer:
    gatherer = Gatherer(recording.scene)
    least: int | None = None
    for record in recording.of_kind("report"):
        least = record.round if least is None else min(least, record.round)
        where = f"{recording.path}: report {record.sequence} ({record.topic})"
        try:
            report = decode(record.data)
            if not isinstance(report, Report):
                raise InputError("another kind of message, expected a report")
            gatherer.receive(report)
        except CubepathError as error:
            raise type(error)(f"{where}: {error}") from None
    if least is not None and least > 1:
        _refuse(recording, least)
    return gatherer


def _free(recording: Recording) -> FreeGatherer:
    gatherer = FreeGatherer(recording.scene, keepers_in(recording))
    for record in recording.of_kind("commit", "commits", "turns"):
        where = f"{recording.path}: message {record.sequence} ({record.topic})"
        try:
            gatherer.take(decode_free(record.data))
        except CubepathError as error:
            raise type(error)(f"{where}: {error}") from None
    return gatherer
