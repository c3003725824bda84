"""A module a hundred times slower than its neighbours gets its turn, in virtual time."""

import pytest

from samples.slow_module import measured


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_slow_module_moves_within_five_of_its_thinking_times(seed: int) -> None:
    """From when it first wants to; its neighbours go on meanwhile."""
    found = measured("agv:graph=C6,n=3", "random", 1, seed, 15.0)
    assert found.own >= 3
    assert found.longest < 5
    assert found.others > 50
