"""The streams of modules: the draws of numpy's seeded generators, and no way to the seed."""

from __future__ import annotations

import copy
import gc
import pickle
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.environments.world import World
from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import View
from cubepath.agents.rules.actor import HESITATE, RULE, Actor, NoSeed, actors_for, stream, stream_at
from cubepath.agents.rules.rule import InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.local_families import LOCAL_FAMILIES

SEED = 918_273_645_546_372_819


@given(st.integers(0, 2**128), st.integers(0, 2**31), st.sampled_from([RULE, HESITATE]))
def test_draws_are_those_of_a_seeded_generator(seed: int, module: int, purpose: int) -> None:
    """Whatever is drawn, it is what numpy draws from a sequence with this seed and key."""
    mine = stream(seed, module, purpose)
    known = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(module, purpose)))
    for draw in (mine, known):
        draw.integers(5)  # half of a number is kept for the next
    assert mine.bit_generator.state == known.bit_generator.state
    assert mine.integers(1000, size=9).tolist() == known.integers(1000, size=9).tolist()
    assert mine.random() == known.random()
    assert mine.permutation(9).tolist() == known.permutation(9).tolist()


def test_a_stream_goes_on_from_a_state() -> None:
    """In another process as well: pickled or copied, it draws what it would have drawn."""
    mine = stream(SEED, 3, RULE)
    mine.random(size=7)
    others = [stream_at(mine.bit_generator.state), copy.deepcopy(mine)]
    others.append(pickle.loads(pickle.dumps(mine)))  # noqa: S301 - our own
    wanted = mine.random()
    assert [each.random() for each in others] == [wanted] * 3
    assert all(isinstance(each.bit_generator.seed_seq, NoSeed) for each in others)


def test_a_stream_tells_no_seed_and_spawns_nothing() -> None:
    """What numpy keeps of the seed is the same for all seeds, and is empty; spawning fails."""
    one, other = stream(SEED, 3, RULE), stream(1, 0, RULE)
    for each in (one, other):
        kept: Any = each.bit_generator.seed_seq
        assert not vars(kept)
        assert not kept.generate_state(8).any()
        with pytest.raises(AttributeError):
            _ = kept.entropy
        for spawn in (each.spawn, each.bit_generator.spawn, kept.spawn):
            with pytest.raises(TypeError, match="a module has the one that it draws"):
                spawn(1)


def reached(found: object, most: int = 200_000) -> list[Any]:
    """Return what can be reached from an object: attributes, items, closures, bound methods.

    Not through modules and classes, which hold the same in every run.
    """
    known: dict[int, object] = {}
    queue = [found]
    while queue and len(known) < most:
        each = queue.pop()
        if id(each) in known or isinstance(each, ModuleType | type | BuiltinFunctionType):
            continue
        known[id(each)] = each
        if isinstance(each, FunctionType):
            cells = each.__closure__ or ()
            queue += [cell.cell_contents for cell in cells]
            queue += [each.__defaults__, each.__kwdefaults__, vars(each)]
        elif isinstance(each, MethodType):
            queue += [each.__func__, each.__self__]
        else:
            queue += gc.get_referents(each)
            if isinstance(each, np.random.Generator):
                queue += [each.bit_generator, each.bit_generator.seed_seq]
    assert len(known) < most
    return list(known.values())


@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_a_rule_reaches_nothing_of_the_run(spec: str) -> None:
    """From its knowledge and its view: its own generator, no scene, no actor, no seed."""
    scene = scene_from_spec(spec)
    given: list[InitialKnowledge | View] = []

    def make(knowledge: InitialKnowledge) -> Rule:
        given.append(knowledge)

        def choose(view: View) -> int:
            given.append(view)
            return 0

        return choose

    rule = RuleType("nosy", "keeps all that it is given", "a test", lambda _: True, make)
    world = World(scene, seed=SEED)
    actors = actors_for(scene, rule, seed=SEED, hesitate=0.5, modules=[0])
    actors[0].act(world.observe(0))
    assert len(given) == 2
    found = reached(given)
    assert not [each for each in found if isinstance(each, Scene | World | Actor | ModuleCore)]
    assert not [each for each in found if isinstance(each, np.random.SeedSequence)]
    assert len([each for each in found if isinstance(each, np.random.Generator)]) == 1
    assert SEED not in [each for each in found if type(each) is int]
