"""A rule whose modules make generators that nobody seeds."""

import random

import numpy as np

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    numbers, more = np.random.default_rng(), random.Random()

    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[(numbers.integers(12) + more.randrange(12)) % len(legal)])

    return choose


RULE = RuleType("fresh-generator", "at random", "a test", lambda _: True, make)
