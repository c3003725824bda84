"""A transcript: the messages of a recording by round and speaker, before any of it is checked.

Room: coordinator. Part of `cubepath verify`: it shares only the decoding of messages with a run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.names import Json
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.recordings.recording import Record, Recording
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Certified,
    Claim,
    Cube,
    Edges,
    Here,
    Message,
    Note,
    Report,
    Summary,
    Verdict,
    decode,
    kind_of,
    parts_of,
)

ModuleMessage: TypeAlias = Here | Note | Claim | Verdict
"""The messages that a module sends to its neighbours."""
RECOVERED = "recovered"
"""The parameter that says what a recording was recovered from."""
Fail = Callable[[str, str], None]
"""Called with the name of a check that fails, and one line on where and why."""


@dataclass(slots=True)
class Round:
    """The messages of modules in a round, by kind and speaker, and their reports at its end.

    Both are in the order of their keys.
    """

    said: dict[tuple[str, int], ModuleMessage] = field(default_factory=dict)
    reports: dict[int, Report] = field(default_factory=dict)


@dataclass(slots=True)
class Transcript:
    """Everything in a recording that counts for its result."""

    rounds: dict[int, Round] = field(default_factory=dict)
    edges: dict[int, Edges] = field(default_factory=dict)
    cubes: dict[int, Cube] = field(default_factory=dict)
    certificate: Certificate | None = None
    summary: Summary | None = None
    complete_rounds: int = 0
    """The number of rounds, from the first on, that every module has reported."""

    @property
    def result(self) -> tuple[Cube, ...]:
        """Return the cubes in order of their index."""
        return tuple(self.cubes[index] for index in sorted(self.cubes))


def transcript_of(recording: Recording, fail: Fail) -> Transcript:
    """Sort the messages of a recording; `fail` is called for what is wrong without any derivation.

    That is `messages` (each decodes, and stands under its own topic and round), messages that come
    twice and differ (`said`, `reports`, `edges`, `certificate`), missing reports, and `complete`.
    """
    found = Transcript()
    for record in recording.records:
        message = _message(record, fail)
        for part in () if message is None else parts_of(message):
            _sort(found, part, len(recording.scene.start), fail)
    for this in found.rounds.values():
        # What is said of them is the same whatever the order of arrival.
        this.said = dict(sorted(this.said.items()))
        this.reports = dict(sorted(this.reports.items()))
    modules = set(range(len(recording.scene.start)))
    while found.rounds.get(found.complete_rounds + 1, Round()).reports.keys() == modules:
        found.complete_rounds += 1
    _check_reports(found, len(modules), fail)
    _check_complete(found, fail, cut_off=RECOVERED in recording.parameters)
    return found


def site_in(value: Json) -> Site | None:
    """Return the site in a message, or None, which is never a site, if it is malformed."""
    try:
        return site_from_json(value)
    except InputError:
        return None


def _message(record: Record, fail: Fail) -> Message | None:
    try:
        message = decode(record.data)
    except InputError as error:
        fail("messages", f"message {record.sequence} ({record.topic}): {error}")
        return None
    topic = topic_of(message)
    if topic != record.topic or message.round != record.round:
        where = f"message {record.sequence} ({record.topic}, round {record.round})"
        fail("messages", f"{where} is {topic} of round {message.round}")
    return message


def _sort(found: Transcript, message: Message, modules: int, fail: Fail) -> None:
    match message:
        case Here() | Note() | Claim() | Verdict() | Report():
            _sort_said(found, message, modules, fail)
        case Edges(round=number):
            if found.edges.setdefault(number, message) != message:
                fail("edges", f"round {number}: its edges come twice, and differ")
        case Cube(index=index):
            if found.cubes.setdefault(index, message) != message:
                fail("complete", f"cube {index} comes twice, and differs")
        case Certified(certificate=certificate):
            if found.certificate not in (None, certificate):
                fail("certificate", "the certificate comes twice, and differs")
            found.certificate = certificate
        case Summary():
            if found.summary not in (None, message):
                fail("complete", "the summary comes twice, and differs")
            found.summary = message
        case _:
            pass


def _sort_said(
    found: Transcript, message: ModuleMessage | Report, modules: int, fail: Fail
) -> None:
    check = "reports" if isinstance(message, Report) else "said"
    if not 0 <= message.module < modules:
        fail(check, f"{named(message)}: there is no such module in this run")
        return
    this = found.rounds.setdefault(message.round, Round())
    known: ModuleMessage | Report
    if isinstance(message, Report):
        known = this.reports.setdefault(message.module, message)
    else:
        known = this.said.setdefault((kind_of(message), message.module), message)
    # The same message delivered twice counts once.
    if known != message:
        fail(check, f"{named(message)} comes twice, and differs")


def named(message: ModuleMessage | Report) -> str:
    """Return the name of a module's message in error messages."""
    return f"round {message.round}, module_{message.module}: {kind_of(message)}"


def _check_reports(found: Transcript, modules: int, fail: Fail) -> None:
    reported = [number for number, each in found.rounds.items() if each.reports]
    after = found.complete_rounds + 1
    last = max(reported, default=0)
    # A run that was interrupted may stop between two reports of its last round.
    ended_well = found.summary is not None and found.summary.ended in ("goal", "max-rounds")
    if last > after or (last == after and ended_well):
        known = found.rounds.get(after, Round()).reports
        absent = next(module for module in range(modules) if module not in known)
        fail("reports", f"round {after}, module_{absent}: no report")
    if min(reported, default=1) < 1:
        fail("reports", f"round {min(reported)}: rounds count from 1")


def _check_complete(found: Transcript, fail: Fail, *, cut_off: bool) -> None:
    summary = found.summary
    if summary is None:
        if cut_off:
            return  # the recording says so itself, and is fine as far as it goes
        fail(
            "complete",
            f"no summary: the run did not end, or its end is lost after round"
            f" {found.complete_rounds}",
        )
        return
    # One by one: the number is whatever the file says.
    absent = next((n for n in range(1, summary.cubes + 1) if n not in found.cubes), None)
    if absent is not None:
        fail("complete", f"cube {absent} of {summary.cubes} is missing")
    stray = [index for index in sorted(found.cubes) if not 1 <= index <= summary.cubes]
    if stray:
        fail("complete", f"cube {stray[0]}: the summary counts {summary.cubes}")
