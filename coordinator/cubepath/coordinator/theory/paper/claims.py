"""All claims of the paper together, and computing them one after another.

Of the outside world it uses only the clock.
"""

from collections.abc import Callable, Iterable
from time import perf_counter

from cubepath.coordinator.theory.paper import curvature, examples, geodesics_and_time, topology
from cubepath.coordinator.theory.paper.examples import ClaimResult, PaperClaim


def all_claims() -> tuple[PaperClaim, ...]:
    """Return all claims in the order of the paper.

    >>> claim = all_claims()[0]
    >>> claim.item, claim.expected
    ('2, definition of an action', True)
    """
    found = (*examples.CLAIMS, *topology.CLAIMS, *curvature.CLAIMS, *geodesics_and_time.CLAIMS)
    # By section; the appendix, a letter, comes last.
    return tuple(sorted(found, key=lambda each: each.item[0]))


def compute_claims(
    claims: Iterable[PaperClaim], progress: Callable[[ClaimResult], object] | None = None
) -> list[ClaimResult]:
    """Compute the claims one after another; `progress` is called with each row when it is done.

    >>> for row in compute_claims(all_claims()[:1]):
    ...     print(row.item, row.agrees)
    2, definition of an action True
    """
    rows = []
    for each in claims:
        began = perf_counter()
        computed, agrees = each.compute()
        seconds = perf_counter() - began
        row = ClaimResult(each.item, each.claim, computed, agrees, agrees is each.expected, seconds)
        rows.append(row)
        if progress is not None:
            progress(row)
    return rows
