"""The rounds of a recording one after another, in the order of the run.

Messages stand in the order of arrival, and in batches as modules were dealt out to processes; a
round holds what each module said in it, once, whoever carried it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import Any

from cubepath.coordinator.verification.choices import Moment
from cubepath.coordinator.verification.round_spans import Span, add_to_spans
from cubepath.coordinator.verification.transcript import (
    RECOVERED,
    RecordedRound,
    Sorting,
    Transcript,
    is_cut_off,
    site_in,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.cutting import FILTERED, SPLIT, whole_of
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report, decode

ODD_MAX = 3
"""So many lines on what is odd with a recording are kept."""


class Contradiction(Exception):  # noqa: N818 - a state of affairs, not an error
    """A recording says two things that cannot both be; the text says where."""


class Reading:
    """Reads a recording round by round, of which it holds those in progress."""

    def __init__(self, recording: Recording, *, in_order: bool, first: int | None = None) -> None:
        """Begin before the first message; without `in_order` all rounds are kept to the end.

        `first` is the first whole round, None if that is not known yet.
        """
        self.recording = recording
        self.cut = cut_text(recording)
        """What it was cut from, in words; None if it was not cut."""
        self.partial = (
            self.cut is not None
            or bool(recording.problems)
            or is_cut_off(recording)
            or ATTACHED in recording.parameters
        )
        """Whether rounds, or messages, can be missing that the run had."""
        self.first = _first_whole(recording, self.partial) if first is None else first
        self.spans: list[Span] = []
        """The whole rounds, as far as it was read."""
        told = recording.parameters
        self.by_kind = any(word in told.get(FILTERED, "") for word in ("topics", "without")) or any(
            key in told for key in LEFT_OUT
        )
        """Whether messages of some kinds were left out."""
        self.odd: list[str] = []
        """What is odd, without anything being derived: the first lines."""
        self.cut_off: str | None = None
        """Why the end of the run is not on record, None if it is."""
        self._in_order = in_order
        self._sorting = Sorting(recording, self._fail, first=self.first, gaps=True)

    @property
    def transcript(self) -> Transcript:
        """What stands beside the rounds, as far as it was read."""
        return self._sorting.found

    def _fail(self, check: str, why: str) -> None:
        if check == "complete":
            self.cut_off = self.cut_off or why
        elif self.partial and why.endswith(": no report"):
            pass  # that messages are missing is told as a whole
        elif len(self.odd) < ODD_MAX:
            self.odd.append(why)

    def rounds(self) -> Iterator[tuple[int, RecordedRound]]:
        """Yield the rounds that all modules have reported, in order; others are gaps between them.

        OutOfOrder if a message stands where its round is over, and rounds are not kept.
        """
        blocks = self.recording.blocks() if self._in_order else [(self.recording.records, inf)]
        for records, least in blocks:
            self._sorting.take(records)
            for number, said in self._sorting.close(least):
                add_to_spans(self.spans, number)
                yield number, said
        self._sorting.end()

    def lacks(self, number: int) -> bool:
        """Return whether messages of a whole round can be missing though they were said."""
        damaged = bool(self.recording.problems) or RECOVERED in self.recording.parameters
        if self.by_kind or damaged:
            return True
        # What was cut by rounds or in between has all of the others.
        return self.partial and number == self.first

    @property
    def ended(self) -> bool:
        """Whether the last round that was read is the last that the run had."""
        found = self.transcript
        return found.summary is not None and found.summary.rounds == found.complete_rounds


def start_of(reading: Reading, number: int, said: RecordedRound) -> tuple[Site, ...]:
    """Return where modules stand when a round begins: at the start, or else by their own word."""
    scene = reading.recording.scene
    if number == 1:
        return scene.start
    told = (site_in(said.reports[module].before) for module in range(len(scene.start)))
    return tuple(
        there if site is None else site for site, there in zip(told, scene.start, strict=True)
    )


def cut_text(recording: Recording) -> str | None:
    """Return in words which messages a recording has of a run; None if none were left out."""
    told, whole = recording.parameters, whole_of(recording)
    how = [f"filtered: {told[FILTERED]}"] if FILTERED in told else []
    how += [f"part {told[SPLIT]}"] if SPLIT in told else []
    left = [f"{key} {told[key]}" for key in LEFT_OUT if key in told]
    if whole is None and not left:
        return None
    what = "not all" if whole is None else f"{len(recording.records)} of {whole}"
    return f"{what} messages ({'; '.join([*left, *how]) or 'cut'})"


def _first_whole(recording: Recording, partial: bool) -> int:  # noqa: FBT001 - one argument
    """Return the first round that every module has reported; 1 if there is none."""
    if not partial:
        return 1
    everyone = len(recording.scene.start)
    known: dict[int, set[int]] = {}
    for record in recording.of_kind("report"):
        try:
            report = decode(record.data)
        except InputError:
            continue
        if isinstance(report, Report):
            known.setdefault(report.round, set()).add(report.module)
            if len(known.get(1, ())) == everyone:
                return 1
    return min((number for number, who in known.items() if len(who) == everyone), default=1)


def moments(reading: Reading) -> Iterator[Moment]:
    """Yield each whole round as derived from the moves before it, back to the last gap.

    Contradiction where a move on record is none from where its module stands, or a module says that
    it stands elsewhere.
    """
    scene = reading.recording.scene
    sites = list(scene.start)
    due = 0
    for number, said in reading.rounds():
        if number != due:
            sites = list(start_of(reading, number, said))
        due = number + 1
        where = f"round {number}, module_"
        motion: dict[Site, Site] = {}
        for module, report in said.reports.items():
            if site_in(report.before) != sites[module]:
                stood = site_text(sites[module])
                raise Contradiction(f"{where}{module}: its moves lead to {stood}, not to its word")
            if report.move is None:
                continue
            at = site_in(report.move.at)
            move = None
            if at is not None:
                move = scene.system.move_named(sites[module], report.move.generator, at)
            if move is None:
                raise Contradiction(f"{where}{module}: its move is none from where it stands")
            motion.update(move.motion)
        yield Moment(number, tuple(sites), frozenset(sites) | scene.system.filled, said)
        sites = [motion.get(site, site) for site in sites]


def action_text(generator: str, at: Any) -> str:
    """Return a move in words."""
    place = site_in(at)
    return f"{generator} at {at if place is None else site_text(place)}"
