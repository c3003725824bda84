"""What others published on the systems of a sweep, kept in its file for the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import msgspec

from cubepath.protocol.core.errors import InputError


class PublishedResults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Results of one source; each is the mean of this many `runs`.

    A result has the system as a report names it, the program's name, the share of runs that reached
    the goal, and their mean rounds, in which a run without the goal counts as the limit. `source`
    says where they stand, and what else a reader must know to compare.
    """

    source: str
    runs: Annotated[int, msgspec.Meta(ge=1)]
    results: tuple[tuple[str, str, Annotated[float, msgspec.Meta(ge=0, le=1)], float], ...]


@dataclass(frozen=True, slots=True)
class ReportNotes:
    """What a sweep's file says about its report: keys to pool, and what others published."""

    pool: tuple[str, ...] = ()
    published: tuple[PublishedResults, ...] = ()


def published_in(value: object) -> tuple[PublishedResults, ...]:
    """Return published results from the tables of a file; InputError says what is wrong."""
    try:
        return msgspec.convert(value, tuple[PublishedResults, ...])
    except msgspec.ValidationError as error:
        raise InputError(f"published: {error}") from None
