"""Intervals and tests for results of experiments: exact where possible, else by resampling.

Resampling is seeded, so the same numbers give the same answer.
"""

from collections.abc import Callable, Sequence
from math import comb, exp, lgamma, log, log1p, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95
"""How often an interval holds what it is for."""
RESAMPLES = 2000
WILCOXON_MAX = 200
"""With more differences that are not 0 the sign test is made, whose distribution is a binomial."""
SIZES_MIN = 4
"""A power law is fitted to means of this many sizes or more."""
_SEED = 20_260_000
_STEPS = 80
_BLOCK = 1 << 20
"""This many numbers are drawn at a time, or those of one resample."""
_TERMS, _EXACT = 100_000, 1e-15
"""How far a continued fraction is worked out: this many terms, or until they change so little."""


class Interval(NamedTuple):
    """An estimate and the ends of its interval; the ends are None where there is none."""

    estimate: float
    low: float | None
    high: float | None


class Test(NamedTuple):
    """The exact two-sided p of a test, and its name."""

    p: float
    name: str


class PowerLaw(NamedTuple):
    """A power law ``size ** exponent``, with how much of the variance of the logarithms it has."""

    exponent: Interval
    factor: float
    r_squared: float


def mean_interval(numbers: Sequence[float]) -> Interval:
    """Return the mean with the percentile interval of 2,000 seeded bootstrap resamples.

    One number, or equal ones, have no spread to resample: the interval is the number itself.

    >>> mean_interval([2.0, 2.0])
    Interval(estimate=2.0, low=2.0, high=2.0)
    """
    values = np.array(numbers, np.float64)
    mean = float(values.mean())
    if float(np.ptp(values)) == 0.0:
        return Interval(mean, mean, mean)
    random, means = np.random.default_rng(_SEED), np.zeros(RESAMPLES)
    together = max(1, _BLOCK // len(values))
    for first in range(0, RESAMPLES, together):
        block = means[first : first + together]
        drawn = random.integers(len(values), size=(len(block), len(values)))
        block[:] = values[drawn].mean(axis=1)
    tail = 100 * (1 - LEVEL) / 2
    low, high = np.percentile(means, [tail, 100 - tail]).tolist()
    return Interval(mean, low, high)


def geometric_mean_interval(numbers: Sequence[float]) -> Interval:
    """Return the geometric mean of positive numbers, with the interval of the mean logarithm.

    >>> [round(float(each or 0), 6) for each in geometric_mean_interval([0.5, 0.5])]
    [0.5, 0.5, 0.5]
    """
    mean, low, high = mean_interval([log(number) for number in numbers])
    return Interval(exp(mean), *(None if each is None else exp(each) for each in (low, high)))


def share_interval(hits: int, of: int) -> Interval:
    """Return a share with its exact interval (Clopper and Pearson 1934).

    >>> [round(float(each or 0), 4) for each in share_interval(0, 10)]
    [0.0, 0.0, 0.3085]
    """
    tail = (1 - LEVEL) / 2
    low = 0.0 if hits == 0 else _root(lambda p: _beta_below(p, hits, of - hits + 1) - tail)
    high = 1.0 if hits == of else _root(lambda p: tail - 1 + _beta_below(p, hits + 1, of - hits))
    return Interval(hits / of, low, high)


def _beta_below(p: float, a: float, b: float) -> float:
    """Return the regularised incomplete beta function, with an error of some 1e-11.

    For whole `a` and `b` it is how probable `a` hits or more are in `a + b - 1` trials, each with
    probability `p`. By its continued fraction (DLMF 8.17.22), which takes terms as the square root
    of `a + b`, and Lentz's algorithm.
    """
    if p <= 0.0 or p >= 1.0:
        return float(p >= 1.0)
    if p > (a + 1) / (a + b + 2):
        return 1 - _beta_below(1 - p, b, a)
    logs = lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(p) + b * log1p(-p)
    c, d = 1.0, 1 / (1 - (a + b) * p / (a + 1))
    value = d
    for m in range(1, _TERMS):
        even = m * (b - m) * p / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * p / ((a + 2 * m) * (a + 2 * m + 1))
        change = 1.0
        for part in (even, odd):
            d, c = 1 / (1 + part * d), 1 + part / c
            change = c * d
            value *= change
        if abs(change - 1) < _EXACT:
            break
    return exp(logs) / a * value


def _root(rising: Callable[[float], float], low: float = 0.0, high: float = 1.0) -> float:
    """Return where a rising function is 0, by bisection."""
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if rising(middle) > 0 else (middle, high)
    return (low + high) / 2


def sign_test(fewer: int, more: int) -> float:
    """Return the exact two-sided p of this many negative and positive differences.

    >>> sign_test(0, 5), sign_test(3, 3)
    (0.0625, 1.0)
    """
    of, least = fewer + more, min(fewer, more)
    below = sum(comb(of, k) for k in range(least + 1))
    return float(min(1.0, 2 * below / (1 << of)))


def paired_test(differences: Sequence[float]) -> Test:
    """Return the exact signed-rank test (Wilcoxon 1945) of paired differences, or the sign test.

    Differences of 0 are left out, and equal ones share their ranks; all signs are then equally
    probable. With more than 200 differences the sign test is made.

    >>> paired_test([1.0, 2.0, 3.0, 4.0, 5.0])
    Test(p=0.0625, name='Wilcoxon')
    """
    values = np.array([each for each in differences if each], np.float64)
    if len(values) > WILCOXON_MAX or not len(values):
        return Test(sign_test(int((values < 0).sum()), int((values > 0).sum())), "sign")
    sizes, inverse, counts = np.unique(np.abs(values), return_inverse=True, return_counts=True)
    del sizes
    # Twice the mean rank, which is a whole number also where ranks are shared.
    doubled = (2 * np.cumsum(counts) - counts + 1)[inverse].astype(np.int64)
    chances = np.ones(1)
    for rank in doubled.tolist():
        longer = np.zeros(len(chances) + rank)
        longer[: len(chances)] += chances / 2
        longer[rank:] += chances / 2
        chances = longer
    positive = int(doubled[values > 0].sum())
    least = min(positive, int(doubled.sum()) - positive)
    return Test(min(1.0, 2 * float(chances[: least + 1].sum())), "Wilcoxon")


def power_law(sizes: Sequence[float], means: Sequence[float]) -> PowerLaw | None:
    """Return the least-squares line through the logarithms, a point for each size.

    The interval of the exponent is Student's, from how far the points lie off the line. None with
    fewer than four sizes, or if a mean is not positive.

    >>> fit = power_law([4, 8, 16, 32], [8.0, 16.0, 32.0, 64.0])
    >>> fit is not None and round(fit.exponent.estimate, 6)
    1.0
    """
    if len(set(sizes)) < SIZES_MIN or min(means) <= 0:
        return None
    x, y = np.log(np.array(sizes, float)), np.log(np.array(means, float))
    spread = float(((x - x.mean()) ** 2).sum())
    slope = float(((x - x.mean()) * (y - y.mean())).sum()) / spread
    factor = float(y.mean() - slope * x.mean())
    left: NDArray[np.float64] = y - factor - slope * x
    total = float(((y - y.mean()) ** 2).sum())
    r_squared = 1.0 if total == 0 else 1 - float((left**2).sum()) / total
    freedom = len(x) - 2
    half = student(freedom) * sqrt(float((left**2).sum()) / freedom / spread)
    return PowerLaw(Interval(slope, slope - half, slope + half), exp(factor), r_squared)


def student(freedom: int) -> float:
    """Return how far Student's interval reaches, in standard errors.

    >>> [round(student(freedom), 3) for freedom in (1, 2, 10)]
    [12.706, 4.303, 2.228]
    """
    return _root(lambda t: _student_within(t, freedom) - LEVEL, 0.0, 100.0)


def _student_within(t: float, freedom: int) -> float:
    """Return how probable it is that Student's t lies between -t and t (Abramowitz, 26.7.3-4)."""
    angle = np.arctan2(t, sqrt(freedom))
    cosine, sine = float(np.cos(angle)), float(np.sin(angle))
    if freedom == 1:
        return float(2 * angle / np.pi)
    term, total = 1.0, 1.0
    first = 1 if freedom % 2 == 0 else 2
    for k in range(first, freedom - 2, 2):
        term *= k / (k + 1) * cosine**2
        total += term
    if freedom % 2 == 0:
        return sine * total
    return float(2 / np.pi * (angle + sine * cosine * total))
