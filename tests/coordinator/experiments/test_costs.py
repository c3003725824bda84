"""The sum of costs: the rounds up to each module's last move, the same however a run is played."""

import pytest

from cubepath.agents import play
from cubepath.coordinator.experiments.sweeping import sweep


@pytest.mark.parametrize("core", ["compiled", pytest.param("simulated", marks=pytest.mark.slow)])
def test_each_module_costs_the_round_of_its_last_move(core: str) -> None:
    """It is counted from the rounds of the same run as it is played without a sweep."""
    spec = "agv-labelled:graph=grid4x4,n=5,seed=2"
    (row,) = sweep(spec, rules="pibt", seeds=[3], core=core).rows
    last: dict[int, int] = {}
    for number, made in enumerate(play(spec, "pibt", seed=3).rounds, 1):
        last |= dict.fromkeys(made.moves, number)
    assert row["costs"] == sum(last.values()) >= row["rounds"] > 0
