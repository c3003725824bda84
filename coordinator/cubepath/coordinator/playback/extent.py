"""How much of its run a recording holds, and so what a replay can be compared with."""

from __future__ import annotations

from dataclasses import dataclass

from cubepath.coordinator.verification.holes import hole_in
from cubepath.coordinator.verification.partial import why_partial
from cubepath.coordinator.verification.transcript import is_cut_off
from cubepath.protocol.recordings.recording import Recording


@dataclass(frozen=True, slots=True)
class Extent:
    """What is missing of a run in its recording."""

    cut_off: bool
    """Whether its end may be missing, as the recording says, or since it is damaged."""
    lacking: str | None
    """Why messages are missing at the start or in between, in a line; None if none are."""


def extent_of(recording: Recording) -> Extent:
    """Return how much of its run a recording holds."""
    lacking = why_partial(recording)
    if lacking is None and (hole := hole_in(recording)) is not None:
        lacking = str(hole)
    cut_off = lacking is not None or bool(recording.problems) or is_cut_off(recording)
    return Extent(cut_off, lacking)
