"""Ranks in compiled code are those of the plain world."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cubepath.agents.arrays.ranks import digits, rank
from cubepath.agents.local.arbitration import priority


@settings(max_examples=60, deadline=None)
@given(
    seed=st.one_of(st.integers(0, 1 << 64), st.integers(0, 10**400)),
    round_number=st.integers(0, 1 << 62),
    module=st.integers(0, 1 << 31),
)
def test_the_digest_is_that_of_the_library(seed: int, round_number: int, module: int) -> None:
    """For texts of one block and of several."""
    text = np.zeros(640, np.uint8)
    start = f"{seed}/".encode()
    text[: len(start)] = list(start)
    end = digits(round_number, text, len(start))
    text[end] = ord("/")
    end = digits(module, text, end + 1)
    found = rank(text, end, np.zeros(8, np.uint64), np.zeros(16, np.uint64))
    assert (int(found), module) == priority(seed, round_number, module)
