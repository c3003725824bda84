"""Ranks in compiled code are those of the plain world."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings, strategies as st

from cubepath.agents.arrays.ranks import HASHING_WORDS, rank_claims
from cubepath.agents.local.arbitration import priority


@settings(max_examples=60, deadline=None)
@given(
    seed=st.one_of(st.integers(0, 1 << 64), st.integers(0, 10**400)),
    round_number=st.integers(0, 1 << 62),
    modules=st.lists(st.integers(0, (1 << 31) - 1), max_size=20),
    room=st.integers(0, 130),
)
def test_the_digests_are_those_of_the_library(
    seed: int, round_number: int, modules: list[int], room: int
) -> None:
    """For texts of one block and of several, and where they end in different blocks."""
    seed = seed * 10 ** (room // 2)
    prefix = f"{seed}/{round_number}/".encode()
    text = np.zeros(len(prefix) + 20, np.uint8)
    text[: len(prefix)] = list(prefix)
    claimants = np.array([0, *modules], np.int32)
    chosen = np.arange(len(modules), 0, -1, dtype=np.int32)
    words, ranks = np.zeros(HASHING_WORDS, np.uint64), np.zeros(len(claimants), np.uint64)
    rank_claims(text, len(prefix), claimants, chosen, len(chosen), words, ranks)
    found = zip(ranks[1:].tolist(), modules, strict=True)
    assert list(found) == [priority(seed, round_number, module) for module in modules]
