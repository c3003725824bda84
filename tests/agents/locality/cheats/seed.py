"""A rule that takes the seed of the run from its generator, to know what others draw."""

from typing import Any

import numpy as np

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    kept: Any = knowledge.random.bit_generator.seed_seq
    seed = kept.entropy
    others = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 0)))

    def choose(view: View) -> int:
        return int(others.choice(view.mask.nonzero()[0]))

    return choose


RULE = RuleType("seed", "by the seed", "a test", lambda _: True, make)
