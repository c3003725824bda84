"""What a seed stands for: every system and rule comes, small as asked, and always the same."""

from collections import Counter

import pytest

from cubepath.agents.rules.registry import BUILT_IN, fitting_rules
from cubepath.coordinator.simulation.scenarios import INSTANCES, ScenarioOptions, built, scenario_of
from samples.local_families import LOCAL_FAMILIES


def test_every_local_family_has_instances() -> None:
    """A family that is added is simulated too."""
    assert set(INSTANCES) == set(LOCAL_FAMILIES)


@pytest.mark.thorough
def test_every_system_with_every_rule_that_fits_is_drawn() -> None:
    """Of 1,000 seeds; one in twenty is large, and all others have few modules."""
    scenarios = [scenario_of(seed) for seed in range(1000)]
    drawn = {(each.system.partition(":")[0], each.rule) for each in scenarios}
    assert drawn == {
        (name, rule.name)
        for name in INSTANCES
        for rule in BUILT_IN.values()
        if rule.fits(built(name).system)
    }
    sizes = Counter(len(each.scene.start) for each in scenarios)
    large = sum(count for size, count in sizes.items() if size > 9)
    assert 20 <= large <= 80
    assert min(sizes) >= 2
    assert not [each for each in scenarios if each.scene.reached(each.scene.start)]
    assert {each.processes for each in scenarios} == {1, 2, 3, 4, 5, 6}
    assert {each.hesitate > 0 for each in scenarios} == {True, False}


@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_a_rule_that_refuses_the_scene_is_not_drawn(clock: str) -> None:
    """The goal of a random shape is no chain, though its moves are those of chains."""
    assert fitting_rules(built("hex-shapes:n=5"), clock) == ["random", "metropolis", "leader"]
    own = ["random", "metropolis", "chain", "chains", "leader"]
    assert fitting_rules(built("hex:n=5"), clock) == own
    if clock == "lockstep":  # without rounds, chain refuses it only once it sees the start
        own.remove("chain")
    assert fitting_rules(built("hex:n=5,aside=1"), clock) == own


def test_the_same_seed_is_the_same_run() -> None:
    """Whatever was asked for before."""
    first = scenario_of(17)
    scenario_of(18, ScenarioOptions("hex"))
    assert scenario_of(17) == first


def test_what_is_asked_for_holds_for_all_seeds() -> None:
    """A family, a whole spec, a rule, a number of modules; the rest is drawn."""
    for seed in range(12):
        assert scenario_of(seed, ScenarioOptions("hex")).system.startswith("hex:n=")
        assert scenario_of(seed, ScenarioOptions("agv:graph=K5,n=3")).system == "agv:graph=K5,n=3"
        assert scenario_of(seed, ScenarioOptions(rule="tswap")).system.startswith("agv:")
        assert len(scenario_of(seed, ScenarioOptions("arm", modules=7)).scene.start) == 7


def test_smaller_scenarios_have_fewer_modules_or_processes() -> None:
    """None is as large as the scenario itself, and the smallest come first."""
    scenario = scenario_of(5, ScenarioOptions("hex:n=5"))
    sizes = [(len(each.scene.start), each.processes) for each in scenario.smaller()]
    assert sizes
    assert all(size < (5, scenario.processes) for size in sizes)
    assert [size for size, _ in sizes] == sorted(size for size, _ in sizes)
