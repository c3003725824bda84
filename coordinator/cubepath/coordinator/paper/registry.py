"""What the paper says, held against what is computed: the rows of `cubepath paper`.

A claim is a function without arguments that computes; its text and what comes of it stand in one
row. The claims themselves are in `claims_examples`, `claims_topology`, `claims_geometry` and
`claims_paths`, in the order of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

Outcome = tuple[str, bool | None]
"""What was computed, in words, and whether it agrees; None where the paper leaves it open."""


@dataclass(frozen=True, slots=True)
class Claim:
    """One thing that the paper says, and how to compute it.

    `expected` is what is known to come out: True for most, False where the printed text falls
    short, None where it was not to be reproduced. Anything else is an error of this program.
    """

    item: str
    claim: str
    compute: Callable[[], Outcome]
    expected: bool | None = True


@dataclass(frozen=True, slots=True)
class Row:
    """One claim with what was computed, and how long it took."""

    item: str
    claim: str
    computed: str
    agrees: bool | None
    as_expected: bool
    seconds: float

    def document(self) -> dict[str, Any]:
        """Return the row as JSON."""
        return {
            "item": self.item,
            "claim": self.claim,
            "computed": self.computed,
            "agrees": self.agrees,
            "seconds": round(self.seconds, 3),
        }


def claim(
    claims: list[Claim], item: str, text: str, *, expected: bool | None = True
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    """Add the decorated function to a list of claims."""

    def add(compute: Callable[[], Outcome]) -> Callable[[], Outcome]:
        claims.append(Claim(item, text, compute, expected))
        return compute

    return add


def all_claims() -> tuple[Claim, ...]:
    """Return all claims in the order of the paper."""
    from cubepath.coordinator.paper import (  # noqa: PLC0415 - these import this module
        curvature,
        examples,
        geodesics_and_time,
        topology,
    )

    found = (
        *examples.CLAIMS,
        *topology.CLAIMS,
        *curvature.CLAIMS,
        *geodesics_and_time.CLAIMS,
    )
    # By section; the appendix, a letter, comes last.
    return tuple(sorted(found, key=lambda each: each.item[0]))


def compute(claims: Iterable[Claim], progress: Callable[[Row], object] | None = None) -> list[Row]:
    """Compute the claims one after the other; `progress` is told each row when it is there."""
    rows = []
    for each in claims:
        began = perf_counter()
        computed, agrees = each.compute()
        seconds = perf_counter() - began
        row = Row(each.item, each.claim, computed, agrees, agrees is each.expected, seconds)
        rows.append(row)
        if progress is not None:
            progress(row)
    return rows
