"""Recordings whose messages are batches: what the modules of a process say, by phase and region."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, cast

from msgspec.structs import replace

from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.recording import Record, Recording, topic_on_record
from cubepath.protocol.wire.keys import addressees
from cubepath.protocol.wire.messages import (
    Claim,
    Here,
    Note,
    Part,
    Report,
    Reports,
    Said,
    Verdict,
    decode,
    encode,
    kind_of,
)
from recordings import with_records

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
        for region in {system.region(place): None for place in addressees(system, part) or ()}:
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


def batched(recording: Recording) -> Recording:
    """Return the recording with what modules say in batches, before the edges of the round."""
    records: list[Record] = []
    waiting: dict[int, list[Part | Report]] = {}

    def flush(number: int, wall_ns: int) -> None:
        parts = waiting.pop(number, None)
        records.extend(
            Record(topic_on_record(message), encode(message), number, wall_ns, 0)
            for message in (batches(recording.scene.system, parts) if parts else ())
        )

    for record in recording.records:
        if record.kind in (*PHASE, "report"):
            message = decode(record.data)
            assert isinstance(message, Here | Note | Claim | Verdict | Report)
            waiting.setdefault(record.round, []).append(message)
            continue
        if record.kind == "edges":
            flush(record.round, record.wall_ns)
        records.append(record)
    for number in sorted(waiting):
        flush(number, 0)
    return with_records(recording, records)


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
