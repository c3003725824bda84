"""Whether what was counted is what chance would give: Pearson's chi-square test."""

from collections.abc import Iterable
from math import sqrt

_DEVIATES = 3.719
"""The standard normal quantile of 0.9999."""


def as_chance_has_it(counts: Iterable[int], expected: float) -> bool:
    """Return whether these counts, all with this expectation, are neither too uneven nor too even.

    The chi-square sum lies between its quantiles of 0.01% and 99.99% (Wilson and Hilferty 1931).
    """
    each = list(counts)
    free = len(each) - 1
    low, high = (
        free * (1 - 2 / (9 * free) + sign * _DEVIATES * sqrt(2 / (9 * free))) ** 3
        for sign in (-1, 1)
    )
    return low < sum((count - expected) ** 2 / expected for count in each) < high
