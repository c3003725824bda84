"""Claims and messages of a recorded run, as data of a page.

It reads recordings.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.tools.viewing.worlds import World
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report

Columns: TypeAlias = dict[str, NDArray[Any]]
DELIVERIES_MAX = 1_000_000
"""With more deliveries than this a page has none, and says so: it would not open any more."""
_OUTCOMES = {"lost": 0, "granted": 1, "": 2}
Entry: TypeAlias = tuple[int, int, int]


def claim_entry(
    world: World, module: int, generator: str, at: Site, site: Site, *, outcome: str
) -> Entry | None:
    """Return a claim as (module, row, won); None if no module at the site could propose it.

    The outcome is "lost", "granted", or "" where that is not known.
    """
    row = world.proposed(generator, at, site)
    return None if row is None else (module, row, _OUTCOMES[outcome])


def delivery_entries(report: Report, kinds: dict[str, int]) -> Iterable[Entry]:
    """Yield what a module was delivered as (kind, sender, receiver); new kinds get numbers."""
    for kind, sender in report.deliveries():
        yield kinds.setdefault(kind, len(kinds)), sender, report.module


def claims_document(world: World, recording: Recording, steps: int) -> dict[str, Any]:
    """Return the claims of a run, step by step: who claimed which row, and what came of it.

    ``ends`` has the number of claims up to the end of each step; ``won`` is 1 for a claim that was
    granted, 0 for one that was lost, and 2 where that is not on record. A claim of a run without
    rounds stands one level above the greatest that was on record when it was said.
    """
    found = recording.claims()
    rounds = _levels(recording, found) if recording.clock == "free" else found["round"]
    listed: list[list[Entry]] = [[] for _ in range(steps)]
    for number, module, generator, at, site, outcome in zip(
        rounds.tolist(),
        *(found[name].tolist() for name in ("module", "generator", "at", "site", "outcome")),
        strict=True,
    ):
        if 1 <= number <= steps:  # a round that is not complete has no step
            entry = claim_entry(world, module, generator, at, site, outcome=outcome)
            if entry is not None:
                listed[number - 1].append(entry)
    flat = [each for one in listed for each in one]
    modules, rows, won = np.array(flat, np.int64).reshape(-1, 3).T
    return {
        "ends": np.cumsum([len(one) for one in listed], dtype=np.int64),
        "module": modules,
        "row": rows,
        "won": won,
    }


def _levels(recording: Recording, claims: Columns) -> NDArray[np.int64]:
    """Return for each claim one more than the greatest level of the moves reported before it."""
    moves = recording.moves()
    order = np.argsort(moves["wall_ns"], kind="stable")
    greatest = np.maximum.accumulate(np.append(0, moves["round"][order]))
    before = np.searchsorted(moves["wall_ns"][order], claims["wall_ns"])
    found: NDArray[np.int64] = greatest[before] + 1
    return found


def heard_document(recording: Recording, rounds: int) -> dict[str, Any]:
    """Return who was delivered what in each round: the kind, the sender and the receiver.

    ``ends`` has the number of deliveries up to the end of each round, ``kind`` numbers of
    ``kinds``. Of a run with more deliveries than a page can hold there is ``left_out`` alone, their
    number.
    """
    kinds: dict[str, int] = {}
    found: list[list[Entry]] = [[] for _ in range(rounds)]
    total = 0
    for logged in recording.messages("report"):
        report = logged.message
        if not 1 <= report.round <= rounds:
            continue
        entries = list(delivery_entries(report, kinds))
        total += len(entries)
        if total <= DELIVERIES_MAX:
            found[report.round - 1] += entries
    if total > DELIVERIES_MAX:
        return {"left_out": total}
    flat = [each for one in found for each in sorted(one)]
    kind, sender, receiver = np.array(flat, np.int64).reshape(-1, 3).T
    return {
        "kinds": list(kinds),
        "ends": np.cumsum([len(one) for one in found]),
        "kind": kind,
        "from": sender,
        "to": receiver,
    }
