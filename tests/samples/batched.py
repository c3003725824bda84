"""Batches by phase and region, made of what modules say, and found in recordings."""

from collections.abc import Iterator, Sequence
from typing import Literal, cast

from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.keys import addressees
from cubepath.protocol.wire.messages import Bundle, Part, Report, Reports, decode, kind_of

Phase = Literal["sense", "claim", "settle"]
PHASE: dict[str, Phase] = {
    "presence": "sense",
    "note": "sense",
    "claim": "claim",
    "verdict": "settle",
}
PROCESSES = 3


def batches(system: System, parts: Sequence[Part | Report]) -> Iterator[Bundle | Reports]:
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
        yield Bundle(number, phase, process, region, 0, some)
    for process, some_reports in sorted(reports.items()):
        yield Reports(number, process, some_reports)


def first_batch(
    recording: Recording, kind: str, round_number: int = 1
) -> tuple[int, Bundle | Reports]:
    """Return the place and the message of the first batch that holds parts of a kind in a round."""
    for place, record in enumerate(recording.records):
        if record.kind in ("bundle", "reports") and record.round == round_number:
            message = decode(record.data)
            if any(kind_of(part) == kind for part in cast("Bundle | Reports", message).parts):
                return place, cast("Bundle | Reports", message)
    raise AssertionError(f"no {kind} in round {round_number}")
