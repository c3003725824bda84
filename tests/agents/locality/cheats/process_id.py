"""A rule that goes by the number of its process."""

import os

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[os.getpid() % len(legal)])

    return choose


RULE = RuleType("process-id", "by the process", "a test", lambda _: True, make)
