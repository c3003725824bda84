"""Recordings of both forms: batches by phase and region, and messages one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace as with_fields
from typing import Literal, cast

from msgspec.structs import replace

from cubepath.protocol.core.names import Json
from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.wire.keys import addressees, topic_of
from cubepath.protocol.wire.messages import (
    Heard,
    Part,
    Report,
    Reports,
    Said,
    decode,
    encode,
    kind_of,
)
from recordings import parts, with_records

Phase = Literal["sense", "claim", "settle"]
PHASE: dict[str, Phase] = {"here": "sense", "note": "sense", "claim": "claim", "verdict": "settle"}
PROCESSES = 3


def batches(system: System, parts: Sequence[Part | Report]) -> Iterator[Said | Reports]:
    """Yield the batches of a round: what is said by phase, process and region, then reports.

    Modules are dealt out to the processes. A part is in the batch of each region that it goes to;
    a verdict that goes to nobody has none.
    """
    number = parts[0].round
    said: dict[tuple[Phase, int, str], list[Part]] = {}
    reports: dict[int, list[Report]] = {}
    for part in parts:
        process = part.module % PROCESSES
        if isinstance(part, Report):
            reports.setdefault(process, []).append(part)
            continue
        for region in {system.region(place): None for place in addressees(system, part)}:
            said.setdefault((PHASE[kind_of(part)], process, region), []).append(part)
    for (phase, process, region), some in said.items():
        yield Said(number, phase, process, region, 0, some)
    for process, some_reports in sorted(reports.items()):
        yield Reports(number, process, some_reports)


def counted(report: Report) -> Report:
    """Return a report of format 1 as one of format 2."""
    heard: dict[str, list[int]] = {}
    for kind, module, _ in sorted(report.deliveries(), key=lambda each: each[:2]):
        heard.setdefault(kind, []).append(module)
    return replace(report, heard=heard)


def singles(recording: Recording) -> Recording:
    """Return the recording as one of format 1, in which each part is a message of its own.

    A part that was said to several regions is said once, and reports tell from where they heard.
    """
    records: list[Record] = []
    stood = {(report.round, report.module): report.before for report in parts(recording, "report")}
    known: set[bytes] = set()
    for record in recording.records:
        message = decode(record.data)
        if not isinstance(message, Said | Reports):
            records.append(record)
            continue
        for part in message.parts:
            said = told_from(part, stood) if isinstance(part, Report) else part
            data = encode(said)
            if isinstance(part, Report) or data not in known:
                known.add(data)
                records.append(Record(topic_of(said), data, record.round, record.wall_ns, 0))
    return with_fields(with_records(recording, records), format="cubepath-recording-1")


def told_from(report: Report, stood: Mapping[tuple[int, int], Json]) -> Report:
    """Return a report of format 2 as one of format 1."""
    heard = [
        Heard(kind, module, stood.get((report.round, module)) if site is None else site)
        for kind, module, site in report.deliveries()
    ]
    return replace(report, heard=heard)


def first_batch(
    recording: Recording, kind: str, round_number: int = 1
) -> tuple[int, Said | Reports]:
    """Return the place and the message of the first batch that holds parts of a kind in a round."""
    for place, record in enumerate(recording.records):
        if record.kind in ("said", "reports") and record.round == round_number:
            message = decode(record.data)
            if any(kind_of(part) == kind for part in cast("Said | Reports", message).parts):
                return place, cast("Said | Reports", message)
    raise AssertionError(f"no {kind} in round {round_number}")
