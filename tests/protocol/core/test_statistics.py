"""Intervals and tests against tables, and against counting everything."""

import tracemalloc
from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.statistics import (
    RESAMPLES,
    mean_interval,
    paired_test,
    power_law,
    share_interval,
    sign_test,
    student,
)


@given(st.lists(st.integers(-4, 4), min_size=1, max_size=9))
def test_the_signed_rank_test_is_that_of_all_signs(differences: list[int]) -> None:
    """Counted over all ways to put signs before the ranks, with ties and zeros."""
    values = [each for each in differences if each]
    found = paired_test(differences)
    if not values:
        assert found == (1.0, "sign")
        return
    sizes = sorted(map(abs, values))
    ranks = [
        sum(place for place, size in enumerate(sizes, 1) if size == abs(each))
        / sizes.count(abs(each))
        for each in values
    ]
    sums = [
        sum(rank for rank, sign in zip(ranks, signs, strict=True) if sign)
        for signs in product((0, 1), repeat=len(ranks))
    ]
    positive = sum(rank for rank, each in zip(ranks, values, strict=True) if each > 0)
    least = min(positive, sum(ranks) - positive)
    expected = min(1.0, 2 * sum(each <= least for each in sums) / len(sums))
    assert found.p == pytest.approx(expected)


def test_many_differences_are_tested_by_their_signs() -> None:
    """With the exact binomial, which is symmetric."""
    assert paired_test([1.0] * 150 + [-1.0] * 100) == (sign_test(100, 150), "sign")
    assert sign_test(100, 150) == pytest.approx(0.0018, abs=2e-4)


@pytest.mark.parametrize(
    ("hits", "of", "low", "high"),
    [(5, 10, 0.1871, 0.8129), (1, 20, 0.0013, 0.2487), (10, 10, 0.6915, 1.0), (0, 1, 0.0, 0.975)],
)
def test_shares_have_the_intervals_of_the_tables(
    hits: int, of: int, low: float, high: float
) -> None:
    """Those of Clopper and Pearson."""
    found = share_interval(hits, of)
    assert found.low == pytest.approx(low, abs=1e-4)
    assert found.high == pytest.approx(high, abs=1e-4)


@given(st.integers(1, 60), st.data())
def test_shares_leave_equal_tails(of: int, data: st.DataObject) -> None:
    """At its ends what was seen, or more of it, has a probability of 2.5%, added up exactly."""
    hits = data.draw(st.integers(0, of))
    found = share_interval(hits, of)

    def within(p: float | None, numbers: range) -> float:
        assert p is not None
        return sum(comb(of, k) * p**k * (1 - p) ** (of - k) for k in numbers)

    assert found.low == 0 or within(found.low, range(hits, of + 1)) == pytest.approx(0.025)
    assert found.high == 1 or within(found.high, range(hits + 1)) == pytest.approx(0.025)


def test_shares_of_very_many_runs() -> None:
    """Near those of the normal distribution."""
    found = share_interval(500_000, 1_000_000)
    assert found.low == pytest.approx(0.5 - 1.959964 * 0.0005, abs=1e-6)
    assert found.high == pytest.approx(0.5 + 1.959964 * 0.0005, abs=1e-6)


def test_resamples_are_drawn_in_blocks() -> None:
    """They are those that one draw has, and take little room at a time."""
    numbers = (np.arange(3001) ** 2 % 1009).astype(float)
    drawn = np.random.default_rng(20_260_000).integers(3001, size=(RESAMPLES, 3001))
    low, high = np.percentile(numbers[drawn].mean(axis=1), [2.5, 97.5])
    del drawn
    tracemalloc.start()
    try:
        found = mean_interval(numbers.tolist())
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found[1:] == pytest.approx((low, high), abs=1e-12)
    assert most < 30_000_000


@pytest.mark.parametrize(
    ("freedom", "expected"), [(1, 12.706), (2, 4.303), (3, 3.182), (5, 2.571), (30, 2.042)]
)
def test_students_quantiles_are_those_of_the_tables(freedom: int, expected: float) -> None:
    """Odd and even degrees of freedom."""
    assert student(freedom) == pytest.approx(expected, abs=1e-3)


@given(st.floats(-3, 3), st.floats(0.1, 50), st.integers(4, 8))
def test_a_power_law_is_found_again(exponent: float, factor: float, count: int) -> None:
    """Its exponent and factor, with nothing left over."""
    sizes = [2.0**k for k in range(count)]
    fit = power_law(sizes, [factor * size**exponent for size in sizes])
    assert fit is not None
    assert fit.exponent.estimate == pytest.approx(exponent, abs=1e-6)
    assert fit.factor == pytest.approx(factor)
    assert fit.exponent.low == pytest.approx(exponent, abs=1e-6)


def test_three_sizes_have_no_growth() -> None:
    """Nor have means of 0."""
    assert power_law([4, 8, 16, 16], [1.0, 2.0, 4.0, 4.0]) is None
    assert power_law([4, 8, 16, 32], [1.0, 0.0, 1.0, 1.0]) is None


def test_an_interval_of_means_holds_the_mean_about_as_often_as_it_says() -> None:
    """And is the same each time."""
    random = np.random.default_rng(1)
    draws = random.exponential(size=(100, 30))
    found = [mean_interval(row.tolist()) for row in draws]
    held = sum((each.low or 0) <= 1.0 <= (each.high or 0) for each in found)
    assert 85 <= held <= 99
    assert mean_interval(draws[0].tolist()) == found[0]
