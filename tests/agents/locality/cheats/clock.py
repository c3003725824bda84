"""A rule that goes by the time of day."""

import time

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[time.time_ns() // 1_000_000 % len(legal)])

    return choose


RULE = RuleType("clock", "by the clock", "a test", lambda _: True, make)
