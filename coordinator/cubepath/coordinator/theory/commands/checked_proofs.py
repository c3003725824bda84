"""What ``cubepath verify FILE.proof`` tells of a proof, and writes of it for other checkers."""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

CLAUSES, LOG = ".cnf", ".drat"
"""The suffixes of what other checkers read."""
_TEXT_MAX = 60
"""Longest text of a state, in characters, that is printed rather than its digest."""


class CheckedProof(NamedTuple):
    """A proof that was checked: whether it proves what it says, and how that is told."""

    proved: bool
    rows: list[tuple[str, str]]
    document: dict[str, Any]


class ClaimedProof(NamedTuple):
    """A proof that is yet to be checked: its clauses as DIMACS, its log, and what checks it."""

    cnf: Callable[[], Iterable[bytes]]
    log: Iterable[bytes]
    checked: Callable[[], CheckedProof]
    """Raises CheckError for what does not hold."""


def digest(value: object) -> str:
    """Return the SHA-256, in hexadecimal, of a value as compact JSON with sorted keys."""
    return hashlib.sha256(_json(value).encode()).hexdigest()


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def state_text(sites: list[Any], what: str) -> str:
    """Return sites, given in JSON form, as JSON, or where that is long their number and digest."""
    text = _json(sites)
    return text if len(text) <= _TEXT_MAX else f"{len(sites)} {what}, SHA-256 {digest(sites)}"


def write_others(options: argparse.Namespace, claimed: ClaimedProof) -> None:
    """Write the clauses and the log for other checkers to the files that are asked for."""
    from cubepath.protocol.core.output_files import written_whole  # noqa: PLC0415

    for path in options.out:
        with written_whole(path) as stream:
            for piece in claimed.cnf() if path.suffix.lower() == CLAUSES else claimed.log:
                stream.write(piece)
