"""What the paper says, held against what is computed: the rows of `cubepath paper`.

A claim is a function without arguments that computes; its text and what comes of it stand in one
row. The claims themselves are in `examples`, `topology`, `curvature` and `geodesics_and_time`;
`claims` has them together, in the order of the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
