"""Random streams in arrays draw what numpy's generators draw, compiled and in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.rules.actor import HESITATE, RULE, stream, stream_at
from cubepath.agents.rules.vector_rule import Streams
from cubepath.agents.rules.vector_streams import draw_below, draw_fraction, streams_of
from cubepath.protocol.core.errors import InputError
from oracles.plain_steps import COMPILED, PLAIN, plain_steps

MOST = 2**32 - 1
SEEDS = st.one_of(st.integers(0, 2**16), st.integers(0, 2**260))
BOUNDS = st.one_of(
    st.integers(1, 20), st.integers(1, MOST), st.sampled_from([2**31, 2**31 + 1, MOST])
)
"""Just above 2^31 half of what is drawn has to be drawn again."""


def state_of(row: Any) -> dict[str, Any]:
    """Return a row as numpy tells the state of a PCG64."""
    high, low, increment_high, increment_low, keeps, kept = map(int, row)
    return {
        "bit_generator": "PCG64",
        "state": {"state": high << 64 | low, "inc": increment_high << 64 | increment_low},
        "has_uint32": keeps,
        "uinteger": kept,
    }


def row_of(random: np.random.Generator) -> Streams:
    """Return the state of a generator as the row of the only module of one environment."""
    known: Any = random.bit_generator.state
    state, increment = known["state"]["state"], known["state"]["inc"]
    halves = [state >> 64, state % 2**64, increment >> 64, increment % 2**64]
    return np.array([[[*halves, known["has_uint32"], known["uinteger"]]]], np.uint64)


@pytest.mark.parametrize("left", [PLAIN, COMPILED])
@given(
    st.lists(SEEDS, min_size=1, max_size=4), st.integers(1, 3), st.sampled_from([RULE, HESITATE])
)
def test_streams_begin_as_those_of_one_module(
    left: int, seeds: list[int], modules: int, purpose: int
) -> None:
    """Of any seeds, long ones as well, in any order, for either purpose."""
    with plain_steps(left):
        found = streams_of(seeds, modules, purpose)
    for environment, seed in enumerate(seeds):
        for module in range(modules):
            known = stream(seed, module, purpose).bit_generator.state
            assert state_of(found[environment, module]) == known


@pytest.mark.parametrize("left", [PLAIN, COMPILED])
@given(
    st.integers(0, 2**128 - 1),
    st.integers(0, 2**127 - 1),
    st.lists(st.one_of(st.none(), BOUNDS), max_size=30),
)
def test_draws_are_those_of_numpy(
    left: int, state: int, increment: int, bounds: list[int | None]
) -> None:
    """From any state, integers below any bounds and fractions (None) in any order."""
    start = {
        "bit_generator": "PCG64",
        "state": {"state": state, "inc": 2 * increment + 1},
        "has_uint32": 0,
        "uinteger": 0,
    }
    known = stream_at(start)
    mine = row_of(known)
    with plain_steps(left):
        below = draw_below.for_work(1, by_entries=True)
        fraction = draw_fraction.for_work(1, by_entries=True)
    for bound in bounds:
        if bound is None:
            assert fraction(mine, 0, 0) == known.random()
        else:
            assert below(mine, 0, 0, bound) == known.integers(bound)
        assert state_of(mine[0, 0]) == known.bit_generator.state


def test_half_a_draw_is_kept_across_a_fraction() -> None:
    """A fraction takes a whole draw, and the half that is kept is used for the next integer."""
    known = stream(7, 3, RULE)
    mine = row_of(known)
    known.integers(5)
    draw_below.plain_by_entries(mine, 0, 0, 5)
    assert mine[0, 0, 4] == 1
    kept = int(mine[0, 0, 5])
    assert draw_fraction.plain_by_entries(mine, 0, 0) == known.random()
    assert draw_below.plain_by_entries(mine, 0, 0, 2**16) == kept >> 16 == known.integers(2**16)


def test_a_choice_of_one_draws_nothing() -> None:
    """The stream is as before, as with numpy."""
    mine = streams_of([1], 2, RULE)
    before = mine.copy()
    assert draw_below.plain_by_entries(mine, 0, 1, 1) == 0
    assert (mine == before).all()


def test_a_negative_seed_is_refused() -> None:
    """It is said which one it is."""
    with pytest.raises(InputError, match="seed=-3: expected 0 or more"):
        streams_of([1, -3], 2, RULE)
