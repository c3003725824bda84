"""What is gathered of a replay, a segment at a time: from its start, or from where it jumped to.

Room: coordinator.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from msgspec.structs import replace as with_fields

from cubepath.coordinator.playback.comparing import Comparison, rounds_that_differ
from cubepath.coordinator.playback.states import StateAt
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.keys import topic_in_key
from cubepath.protocol.wire.messages import Report, decode, parts_of

_REPORTS = ("reports/", "report/")
_OF_KEEPERS = ("moved/", "tail/", "turns/")


class Segments:
    """Gathers what arrives, and compares it with the record whenever a segment is over."""

    def __init__(self, recording: Recording) -> None:
        """Begin at the start of the run; InputError if the recording does not say of how many."""
        self._recording = recording
        self._free: FreeGatherer | None = None
        self._lockstep: Gatherer | None = None
        if recording.clock == "free":
            self._free = FreeGatherer(recording.scene, keepers_in(recording))
        else:
            self._lockstep = Gatherer(recording.scene)
        self.gathered: Gathered = self._free or Gatherer(recording.scene)
        if self._lockstep is not None:
            self.gathered = self._lockstep
        self._base = 0
        self.jumps = 0
        self.rounds: set[int] = set()
        """The rounds that were compared one by one."""
        self._differences: dict[str, None] = {}

    def take(self, key: str, data: bytes) -> None:
        """Take a message that has arrived; CheckError if it contradicts another."""
        topic = topic_in_key(key)
        if self._lockstep is not None:
            if topic.startswith(_REPORTS):
                for part in parts_of(decode(data)):
                    if isinstance(part, Report):
                        self._receive(self._lockstep, part)
        elif self._free is not None and topic.startswith(_OF_KEEPERS):
            self._free.take(decode_free(data))

    def _receive(self, gatherer: Gatherer, report: Report) -> None:
        if not self._base:
            gatherer.receive(report)
        elif report.round > self._base:
            gatherer.receive(with_fields(report, round=report.round - self._base))

    def jump(self, state: StateAt) -> None:
        """End the segment, and begin another where modules stand like this."""
        self.end()
        self.jumps += 1
        self._base = state.step
        self._free = None  # the versions of units are not known in the middle
        if self._recording.clock == "free":
            return
        try:
            self._lockstep = Gatherer(replace(self._recording.scene, start=state.sites))
        except InputError:  # a damaged recording can lack what led here
            self._lockstep = None
            return
        self.gathered = self._lockstep
        for report in state.reports:
            self._receive(self._lockstep, report)

    def end(self) -> None:
        """Compare the rounds of the segment that are whole."""
        if self._lockstep is not None and self._lockstep.rounds:
            for line in rounds_that_differ(self._recording, self._lockstep, self._base):
                self._differences[line] = None
            self.rounds.update(range(self._base + 1, self._base + self._lockstep.rounds + 1))

    def differences(self, *, whole: bool) -> Iterator[str]:
        """Yield what differs from the record: in all of it, or in the segments so far."""
        if whole:
            yield from Comparison(self._recording, self.gathered).differences()
        else:
            self.end()
            yield from self._differences


def spans(numbers: set[int], last: int) -> str:
    """Return the numbers from 1 to the last one that are missing: "1 to 3, 7", "" for none."""
    missing = [number for number in range(1, last + 1) if number not in numbers]
    found: list[tuple[int, int]] = []
    for number in missing:
        if found and found[-1][1] == number - 1:
            found[-1] = found[-1][0], number
        else:
            found.append((number, number))
    shown = [f"{low}" if low == high else f"{low} to {high}" for low, high in found[:4]]
    return ", ".join(shown) + (", ..." if len(found) > 4 else "")
