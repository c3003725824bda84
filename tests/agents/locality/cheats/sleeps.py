"""A rule that never answers."""

import threading

from cubepath.agents import InitialKnowledge, Rule, RuleType


def make(knowledge: InitialKnowledge) -> Rule:
    threading.Event().wait()
    raise AssertionError(knowledge.module)


RULE = RuleType("sleeps", "never answers", "a test", lambda _: True, make)
