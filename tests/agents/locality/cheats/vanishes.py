"""A rule that ends its process."""

import os

from cubepath.agents import InitialKnowledge, Rule, RuleType


def make(knowledge: InitialKnowledge) -> Rule:
    os._exit(0)


RULE = RuleType("vanishes", "ends its process", "a test", lambda _: True, make)
