"""The page on policies says what environments show, take and reward."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from cubepath.agents import env as in_turns, parallel_env, vector_env
from cubepath.agents.local.relative import relative_layout
from cubepath.protocol import Scene, scene_from_spec
from processes.command_line import ROOT

SPECS = ["hex:n=4", "agv-labelled:graph=grid3x3,n=3", "arm", "words", "triangulation:n=6"]


PAGE = (ROOT / "docs" / "policies.md").read_text()


def rows() -> dict[str, str]:
    """Return the second column of each row of the page by the name in the first."""
    found = re.findall(r"^\| `?([\w()]+)`? \| (.+?) \| .+ \|$", PAGE, re.MULTILINE)
    table: dict[str, str] = {}
    for name, told in found:
        table.setdefault(name, told)
    return table


def shapes(scene: Scene, notes: int) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return the shapes and kinds of numbers of the table, by name."""
    system = scene.system
    names = {
        "S": system.site_size,
        "V": system.sense_slots,
        "M": system.move_slots,
        "R": system.reach_slots,
        "K": notes,
        "n": len(scene.start),
    }
    found = {}
    for name in ("observation", "action_mask", "notes", "register", "state()"):
        shape, kind = rows()[name].rsplit(", ", 1)
        found[name] = eval(shape.strip("`"), names), kind  # noqa: S307 - our own page
    return found


@pytest.mark.parametrize("spec", SPECS)
def test_arrays_have_the_shapes_of_the_table(spec: str) -> None:
    """Under both clocks, for one environment and many, and no other arrays are there."""
    scene = scene_from_spec(spec)
    told = shapes(scene, notes=2)
    state = told.pop("state()")
    free: Any = in_turns(spec, note_length=2, clock="free")
    free.reset(seed=0)
    seen = {name: (array.shape, str(array.dtype)) for name, array in free.last()[0].items()}
    assert seen == told
    del told["register"]
    one = parallel_env(spec, note_length=2)
    observations, infos = one.reset(seed=0)
    assert (one.state().shape, str(one.state().dtype)) == state
    for name in scene.modules:
        assert {key: (a.shape, str(a.dtype)) for key, a in observations[name].items()} == told
        assert set(infos[name]) == {"action_mask", "illegal"}
        assert "Actions are `Discrete(M + 1)`" in PAGE
        assert one.action_space(name) == spaces.Discrete(scene.system.move_slots + 1)
    if spec in SPECS[:2]:
        many, _ = vector_env(spec, num_envs=2, note_length=2).reset(seed=0)
        stacked = {key: (a.shape[2:], str(a.dtype)) for key, a in many.items()}
        assert stacked == told


def test_parts_of_relative_observations_stand_in_their_order() -> None:
    """With as many entries as the table says."""
    system = scene_from_spec("agv-labelled:graph=grid3x3,n=3").system
    layout = relative_layout(system)
    assert [name for name in rows() if name in layout.parts] == list(layout.parts)
    lengths = [part.stop - part.start for part in layout.parts.values()]
    assert lengths == [1, 0, 2, system.move_slots, 5 * system.sense_slots]


@pytest.mark.parametrize("spec", ["hex:n=4", "agv-labelled:graph=grid4x4,n=4"])
def test_the_shared_reward_is_that_of_the_table(spec: str) -> None:
    """In rounds, and in turns under the free clock."""
    assert (
        "`(on(after) - on(before)) / n`, where `on` counts the modules on sites of the goal" in PAGE
    )
    random = np.random.default_rng(0)
    one, free = parallel_env(spec), in_turns(spec, clock="free")
    goal, modules = one.scene.goal or frozenset(), one.possible_agents

    def drawn(seen: Any) -> int:
        return int(random.choice(np.flatnonzero(seen["action_mask"])))

    def on(env: Any) -> int:
        return sum(site in goal for site in env.unwrapped.sites)

    seen, _ = one.reset(seed=1)
    free.reset(seed=1)
    rewards = set()
    for _ in range(100):
        before = on(one)
        seen, found, *_ = one.step({name: drawn(each) for name, each in seen.items()})
        rewards.add(found[modules[0]])
        assert found == dict.fromkeys(modules, pytest.approx((on(one) - before) / len(modules)))
        before, shown = on(free), free.last()[0]
        free.step(drawn(shown))
        expected = pytest.approx((on(free) - before) / len(modules))
        assert free.rewards == dict.fromkeys(modules, expected)
    assert len(rewards) > 1
