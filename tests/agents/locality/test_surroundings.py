"""Other worlds that look the same to one module: it sees in them what it saw, and they differ."""

from functools import cache
from random import Random

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.world import World
from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import goal_sets
from cubepath.agents.locality.check import SCENES, all_scenes
from cubepath.agents.locality.plays import (
    ChangedWorlds,
    ModuleLife,
    Surroundings,
    surrounding_scene,
    within_reach,
)
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import addressees
from samples.local_families import LOCAL_FAMILIES

SPECS = [
    "hex:n=12",
    "hex-tunnel",
    "sliding:p=6,q=2,n=8",
    "agv:graph=grid6x6,n=9",
    "agv-labelled:graph=grid6x6,n=8",
    "arm:n=12",
    "arm-free:n=8",
    "triangulation:n=9",
    "words:word=abcabcabcabc,relations=ab~ba+bc~cb+ac~ca",
]
ROUNDS = 6


@cache
def run_of(spec: str) -> tuple[Scene, list[list[dict[str, list[int]]]], list[tuple[Site, ...]]]:
    """Return a scene, what each module observes in each round, and the sites before each."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=5)
    actors = actors_for(scene, RANDOM, seed=5, hesitate=0.0)
    seen, sites = [], [tuple(world.sites)]
    for _ in range(ROUNDS):
        now = [world.observe(module) for module in actors]
        seen.append([{key: array.tolist() for key, array in each.items()} for each in now])
        world.step({m: actor.act(now[m]).action for m, actor in actors.items()})
        sites.append(tuple(world.sites))
    return scene, seen, sites


def life_of(module: int) -> ModuleLife:
    # What counts here is how many rounds it saw, and which.
    before = list(range(ROUNDS))
    return ModuleLife(module, 0, [{} for _ in before], before=before)


def made(spec: str, module: int, seed: int) -> list[Surroundings]:
    scene, _, sites = run_of(spec)
    changes = ChangedWorlds(scene, life_of(module), sites, Random(seed))  # noqa: S311 - a test's own
    return [changes.elsewhere(), changes.fewer_and_more()]


@pytest.mark.slow
@settings(max_examples=20)
@given(st.sampled_from(SPECS), st.integers(0, 100), st.integers(0, 1 << 16))
def test_a_module_sees_in_its_surroundings_what_it_saw(spec: str, module: int, seed: int) -> None:
    """Whoever is moved, gone, new or has another number: observation and mask are the same."""
    scene, seen, sites = run_of(spec)
    module %= len(scene.start)
    for around in made(spec, module, seed):
        assert len(around.settings) == 1 + ROUNDS
        for number, setting in enumerate(around.settings[1:]):
            there = surrounding_scene(scene, setting, around.goals)
            world = World(there, seed=around.seed)
            index = sorted(setting).index(module)
            here = world.observe(index)
            assert {key: array.tolist() for key, array in here.items()} == seen[number][module]
            assert setting[module] == sites[number][module]


@pytest.mark.slow
@settings(max_examples=20)
@given(st.sampled_from(SPECS), st.integers(0, 100), st.integers(0, 1 << 16))
def test_nothing_that_is_said_beyond_reach_arrives(spec: str, module: int, seed: int) -> None:
    """What modules say in another world reaches a module only from where it may be heard.

    So its machine is given the same and observes the same; and whoever it does not hear claims
    nothing that conflicts with a move of its own.
    """
    scene, seen, _ = run_of(spec)
    module %= len(scene.start)
    goals = goal_sets(scene)[module]
    for around in made(spec, module, seed):
        setting = around.settings[1]
        core = ModuleCore(
            scene.system, module=module, site=setting[module], goals=goals, seed=1, note_length=0
        )
        core.sense(1)
        near = within_reach(scene.system, core.place)
        for number, site in setting.items():
            if number == module:
                continue
            other = ModuleCore(
                scene.system, module=number, site=site, goals=(), seed=2, note_length=0
            )
            for part in other.sense(1):
                if core.place in (addressees(scene.system, part) or ()):
                    assert other.place in near
                    core.hear(part)
        here = core.observation()
        assert {key: array.tolist() for key, array in here.items()} == seen[0][module]
        legal = [
            move
            for move, fits in zip(
                scene.system.moves(core.site), here["action_mask"].tolist()[1:], strict=True
            )
            if move is not None and fits
        ]
        state = set(setting.values()) | scene.system.filled
        for site in setting.values():
            if scene.system.place_of(site) not in near:
                claims = [move for move in scene.system.moves(site) if move is not None]
                for claim in claims:
                    if claim.possible(state):
                        assert all(commute(claim.action, own.action) for own in legal)


@pytest.mark.slow
@pytest.mark.parametrize("spec", sorted(set(SPECS) - {"sliding:p=6,q=2,n=8", "triangulation:n=9"}))
def test_worlds_do_differ(spec: str) -> None:
    """Some module has others beyond its reach, and they stand elsewhere, are gone, or are new."""
    scene, _, sites = run_of(spec)
    differ = [0, 0]
    for module in range(0, len(scene.start), 3):
        for kind, around in enumerate(made(spec, module, 1)):
            for setting, row in zip(around.settings[1:], sites, strict=False):
                differ[kind] += set(setting.values()) != set(row)
    assert differ[0] > 0
    assert (differ[1] > 0) != spec.startswith("words")  # every place of a word has a letter


def test_every_local_family_has_a_scene() -> None:
    """Those of the project by name."""
    assert set(SCENES) == {*LOCAL_FAMILIES, "compression"}
    assert {spec.partition(":")[0] for spec in all_scenes()} >= set(LOCAL_FAMILIES)
