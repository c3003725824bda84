"""The claims of the paper, compared with computed results: the rows of `cubepath paper`.

A claim is a function without arguments that does the computation; a row has its text and its
result. The claims themselves are in `examples`, `topology`, `curvature` and `geodesics_and_time`;
`claims` has them together, in the order of the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Outcome = tuple[str, bool | None]
"""The computed result in words, and whether it agrees; None if the paper leaves it open."""


@dataclass(frozen=True, slots=True)
class PaperClaim:
    """One claim of the paper, and how to compute it.

    `expected` is the known result: True for most claims, False if the printed text falls short,
    None if it could not be reproduced. Any other result is a bug in this program.
    """

    item: str
    claim: str
    compute: Callable[[], Outcome]
    expected: bool | None = True


@dataclass(frozen=True, slots=True)
class ClaimResult:
    """One claim with its computed result, and how long the computation took."""

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
    claims: list[PaperClaim], item: str, text: str, *, expected: bool | None = True
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    """Add the decorated function to a list of claims."""

    def add(compute: Callable[[], Outcome]) -> Callable[[], Outcome]:
        claims.append(PaperClaim(item, text, compute, expected))
        return compute

    return add
