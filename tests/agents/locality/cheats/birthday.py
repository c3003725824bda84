"""A rule that goes by when its file was loaded."""

from datetime import datetime

from cubepath.agents import InitialKnowledge, Rule, RuleType, View

BORN = datetime.now().microsecond // 1000


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[BORN % len(legal)])

    return choose


RULE = RuleType("birthday", "by a date", "a test", lambda _: True, make)
