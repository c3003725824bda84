"""A rule that draws from Python's shared generator."""

import random

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        return int(random.choice(view.mask.nonzero()[0].tolist()))

    return choose


RULE = RuleType("global-random", "at random", "a test", lambda _: True, make)
