"""What is gathered of a replay, a segment at a time: from its start, or from where it jumped to.

A recording that begins on the way, or has a hole, is gathered from the first whole round that is
there: its reports say where modules stood.
"""

from __future__ import annotations

from dataclasses import replace

from msgspec.structs import replace as with_fields

from cubepath.coordinator.playback.comparing import rounds_compared
from cubepath.coordinator.playback.extent import Extent
from cubepath.coordinator.playback.states import StateAt
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.keys import topic_in_key
from cubepath.protocol.wire.messages import Report, decode, parts_of

_OF_KEEPERS = ("moved/", "tail/", "turns/")


class Segments:
    """Gathers what arrives, and compares it with the record whenever a segment is over."""

    def __init__(self, recording: Recording, extent: Extent) -> None:
        """Begin at the start of the run; InputError if the recording does not say of how many."""
        self._recording = recording
        self._extent = extent
        self.rounds: set[int] = set()
        """The rounds, or levels, whose moves were compared with those on record."""
        self._differences: dict[str, None] = {}
        self._begin()

    def _begin(self) -> None:
        self._free: FreeGatherer | None = None
        self._lockstep: Gatherer | None = None
        self.gathered: Gathered
        if self._recording.clock == "free":
            keepers = keepers_in(self._recording)
            self.gathered = self._free = FreeGatherer(self._recording.scene, keepers)
        else:
            self.gathered = self._lockstep = Gatherer(self._recording.scene)
        self._base = 0
        self.after = 0
        """After which round that counts which is `gathered`."""
        self.jumped = False
        """Whether it has jumped since the start."""
        self.resumed = False
        """Whether it was gathered anew where rounds are missing."""

    def take(self, key: str, data: bytes) -> None:
        """Take a message that has arrived; CheckError if it contradicts another."""
        try:
            self._take(topic_in_key(key), data)
        except CheckError as error:
            lockstep, where = self._lockstep, ""
            if lockstep is not None:
                where = f"round {self._base + lockstep.rounds + 1}: "
            raise CheckError(f"{self._recording.path}: {where}{error}") from None

    def _take(self, topic: str, data: bytes) -> None:
        if self._lockstep is not None:
            if topic.startswith("reports/"):
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
        if self._extent.lacking:
            self._resume(gatherer)

    def _resume(self, gatherer: Gatherer) -> None:
        """Gather anew from the first round that is whole, if the one before it is not."""
        first = gatherer.ahead
        if first is None:
            return
        waiting = [each for each in gatherer.waiting() if each.round >= first]
        begun = sorted((each.module, each.before) for each in waiting if each.round == first)
        start = tuple(site_from_json(site) for _, site in begun)
        self.end()
        self.resumed = True
        base, self._base = self._base, self._base + first - 1
        try:
            self._lockstep = Gatherer(replace(self._recording.scene, start=start))
        except InputError:  # where nobody can stand
            self._lockstep = None
            return
        self.gathered, self.after = self._lockstep, self._base
        for report in waiting:
            self._receive(self._lockstep, with_fields(report, round=report.round + base))

    def restart(self) -> None:
        """End the segment, and gather the run from its start again."""
        self.end()
        self._begin()

    def jump(self, state: StateAt) -> None:
        """End the segment, and begin another where modules stand like this."""
        self.end()
        self.jumped = True
        self._base = state.step
        self._free = None  # the versions of units are not known in the middle
        if self._recording.clock == "free":
            return
        try:
            self._lockstep = Gatherer(replace(self._recording.scene, start=state.sites))
        except InputError:  # a damaged recording can lack what led here
            self._lockstep = None
            return
        self.gathered, self.after = self._lockstep, self._base
        for report in state.reports:
            self._receive(self._lockstep, report)

    def end(self) -> None:
        """Compare the rounds of the segment that are whole."""
        if self._lockstep is not None and self._lockstep.rounds:
            found = rounds_compared(
                self._recording, self._lockstep, self._base, lacking=bool(self._extent.lacking)
            )
            self._differences |= dict.fromkeys(found.differences)
            self.rounds |= found.rounds

    def compared(self) -> tuple[str, ...]:
        """Return what differs from the record in the rounds of all segments so far."""
        self.end()
        return tuple(self._differences)
