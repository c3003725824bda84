"""The rounds of a recording one after another, in the order of the run.

Room: coordinator. Messages stand in the order of arrival, and in batches as modules were dealt out
to processes; a round holds what each module said in it, once, whoever carried it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import Any

from cubepath.coordinator.verification.choices import Moment
from cubepath.coordinator.verification.transcript import Round, Sorting, Transcript, site_in
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.recording import Recording

ODD_MAX = 3
"""So many lines on what is odd with a recording are kept."""


class Contradiction(Exception):  # noqa: N818 - a state of affairs, not an error
    """A recording says two things that cannot both be; the text says where."""


class Reading:
    """Reads a recording round by round, of which it holds those in progress."""

    def __init__(self, recording: Recording, *, in_order: bool) -> None:
        """Begin before the first message; without `in_order` all rounds are kept to the end."""
        self.recording = recording
        self.odd: list[str] = []
        """What is odd, without anything being derived: the first lines."""
        self.cut_off: str | None = None
        """Why the end of the run is not on record, None if it is."""
        self._in_order = in_order
        self._sorting = Sorting(recording, self._fail)

    @property
    def transcript(self) -> Transcript:
        """What stands beside the rounds, as far as it was read."""
        return self._sorting.found

    def _fail(self, check: str, why: str) -> None:
        if check == "complete":
            self.cut_off = self.cut_off or why
        elif len(self.odd) < ODD_MAX:
            self.odd.append(why)

    def rounds(self) -> Iterator[tuple[int, Round]]:
        """Yield the rounds that all modules have reported, from the first on.

        OutOfOrder if a message stands where its round is over, and rounds are not kept.
        """
        blocks = self.recording.blocks() if self._in_order else [(self.recording.records, inf)]
        for records, least in blocks:
            self._sorting.take(records)
            yield from self._sorting.close(least)
        self._sorting.end()


def moments(reading: Reading) -> Iterator[Moment]:
    """Yield each round as derived from the moves before it, from the start on.

    Contradiction where a move on record is none from where its module stands, or a module says that
    it stands elsewhere.
    """
    scene = reading.recording.scene
    sites = list(scene.start)
    for number, said in reading.rounds():
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
