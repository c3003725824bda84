"""What others published on the systems of a sweep, kept in its file for the report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from cubepath.coordinator.experiments.statistics import Interval, share_interval
from cubepath.protocol.core.errors import InputError


class PublishedResults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Results of one source; each is the mean of this many `runs`.

    A result has the system as a report names it, the program's name, the share of runs that reached
    the goal, and their mean rounds, in which a run without the goal counts as the limit. `source`
    says where they stand, and what else a reader must know to compare.
    """

    source: str
    runs: int
    results: tuple[tuple[str, str, float, float], ...]

    def rows(self) -> Iterator[tuple[str, str, int, Interval, float]]:
        """Yield each result as a report's table begins, the share with its interval."""
        for system, program, share, rounds in self.results:
            reached = share_interval(round(share * self.runs), self.runs)
            yield system, f"{program} (published)", self.runs, reached, rounds


@dataclass(frozen=True, slots=True)
class ReportNotes:
    """What a sweep's file says about its report: keys to pool, and what others published."""

    pool: tuple[str, ...] = ()
    published: tuple[PublishedResults, ...] = ()


def published_in(value: object) -> tuple[PublishedResults, ...]:
    """Return published results from the tables of a file; InputError says what is wrong."""
    try:
        found = msgspec.convert(value, tuple[PublishedResults, ...])
    except msgspec.ValidationError as error:
        raise InputError(f"published: {error}") from None
    for each in found:
        if each.runs < 1 or not all(0 <= result[2] <= 1 for result in each.results):
            raise InputError("published: expected one run or more, and shares of 0 to 1")
    return found
