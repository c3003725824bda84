"""Verifying a recording that damage has left with a hole: what stands before it as ever.

Part of `cubepath verify`. Messages are numbered in the order of writing, and what is recovered
keeps its numbers. What modules remember, and where they stand, follows from all that was said
before, so after the hole each message is checked by itself, and what would have to be derived is
said not to be checked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import overload

from cubepath.coordinator.verification.findings import Check, Failures, Missing, Verification
from cubepath.coordinator.verification.partial import WholeRounds, parts_checked, why_partial
from cubepath.coordinator.verification.results import NO_END
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.recordings.cuts import whole_of
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.records import Record

_AHEAD_MAX = 10_000
"""Messages that may stand before one with a lower number: recorders that were merged do so."""
Blocks = Iterable[tuple[Iterable[Record], float]]
"""Messages some at a time, each time with the least round of those to come."""


@dataclass(frozen=True, slots=True)
class Hole:
    """Where messages are missing for the first time that were on record once."""

    begins: int
    """The number of the first that is missing."""
    messages: int
    """How many are missing, in this hole and in later ones."""

    def __str__(self) -> str:
        """Return in words what is missing."""
        are = "message is" if self.messages == 1 else "messages are"
        return f"{self.messages} {are} missing from message {self.begins} on"


def hole_in(recording: Recording) -> Hole | None:
    """Return the first hole that damage has left in a recording; None if there is none.

    That is in one that is damaged, or was recovered from one that is. What was left out on purpose
    is no hole, nor what is missing at the end.
    """
    if not recording.problems and RECOVERED not in recording.parameters:
        return None
    due = 0
    ahead: set[int] = set()
    last = -1
    for record in recording.records:
        last = max(last, record.sequence)
        if record.sequence != due:
            if len(ahead) < _AHEAD_MAX:
                ahead.add(record.sequence)
            continue
        due += 1
        while due in ahead:
            ahead.remove(due)
            due += 1
    missing = last + 1 - len(recording.records)
    return Hole(due, missing) if ahead and missing > 0 else None


def lacks(recording: Recording) -> bool:
    """Return whether messages of the run are known not to be in its recording.

    Of a whole recording nothing is read for it.
    """
    if whole_of(recording) is not None or why_partial(recording) is not None:
        return True
    return hole_in(recording) is not None


class _Before(Sequence[Record]):
    """The messages of a recording with numbers below some, read whenever they are asked for."""

    def __init__(self, records: Sequence[Record], end: int) -> None:
        self._records = records
        self._end = end

    def __iter__(self) -> Iterator[Record]:
        return (record for record in self._records if record.sequence < self._end)

    def __len__(self) -> int:
        return self._end

    @overload
    def __getitem__(self, index: int) -> Record: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Record, ...]: ...

    def __getitem__(self, index: int | slice) -> Record | tuple[Record, ...]:
        return tuple(self)[index]


def before(recording: Recording, hole: Hole) -> Recording:
    """Return what stands before a hole, as a recording that says that it was cut off there."""
    return replace(
        recording,
        records=_Before(recording.records, hole.begins),
        parameters={RECOVERED: str(hole), **recording.parameters},
        problems=(),
    )


def blocks_before(recording: Recording, hole: Hole) -> Blocks:
    """Yield the messages before a hole, as `Recording.blocks` does."""
    for records, least in recording.blocks():
        yield [record for record in records if record.sequence < hole.begins], least
    yield (), inf


def verify_with_hole(
    recording: Recording, hole: Hole, verified: Callable[[Recording], Verification]
) -> Verification:
    """Verify what stands before a hole by `verified`, and the messages behind it one by one.

    Moves, rounds and cubes are derived, and so are those before the hole.
    """
    found = verified(before(recording, hole))
    failures = Failures(check.name for check in found.checks)
    fail = failures.stage(0)
    for problem in recording.problems:
        fail("readable", problem)
    whole = WholeRounds(recording)
    for record in recording.records:
        for part in parts_checked(recording, record, fail):
            whole.take(part)
    what = "level" if recording.clock == "free" else "round"
    why = f"not checked{f' after {what} {found.rounds}' if found.rounds else ''}: {hole}"
    again = {check.name: check for check in failures.checks({})}
    checks = tuple(_joined(check, again[check.name], why) for check in found.checks)
    begun = 0 if recording.clock == "free" else whole.last - whole.count
    return replace(
        found,
        ok=all(check.ok for check in checks),
        complete=False,
        missing=Missing(max(begun, 0), found.missing.messages + hole.messages),
        checks=checks,
    )


def _joined(before: Check, message_by_message: Check, why: str) -> Check:
    """Return a check of the whole recording."""
    if not before.ok or not message_by_message.ok:
        return message_by_message if before.ok else before
    if before.name in ("readable", "parameters", "messages"):
        return before
    told = before.detail.removeprefix("not checked: ")
    # What is said at the end may stand behind the hole.
    details = [why] if before.checked or before.detail == NO_END else [why, told]
    return Check(before.name, ok=True, detail="; ".join(filter(None, details)), checked=False)
