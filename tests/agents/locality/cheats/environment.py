"""A rule that goes by who runs it, and where."""

import os

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[len(os.environ["USER"] + os.getcwd()) % len(legal)])

    return choose


RULE = RuleType("environment", "by its folder", "a test", lambda _: True, make)
