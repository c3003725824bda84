"""What others published on the systems of a sweep, kept in its file for the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import msgspec

from cubepath.protocol.core.errors import InputError

PUBLISHED = " (published)"
"""What stands after the name of a program whose results are published."""


class PublishedResults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Results of one source; each is the mean of this many `runs`.

    A result is the system as a report names it, the program, the share of runs that reached the
    goal, and mean rounds, where other runs count as their limit. `source` tells a reader the rest.
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
