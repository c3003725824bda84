"""A rule that draws from numpy's shared generator."""

import numpy as np

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        return int(np.random.choice(view.mask.nonzero()[0]))

    return choose


RULE = RuleType("numpy-random", "at random", "a test", lambda _: True, make)
