"""A rule that fails in the third round."""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    asked = 0

    def choose(view: View) -> int:
        nonlocal asked
        asked += 1
        if asked > 2:
            raise KeyError("left")
        return 0

    return choose


RULE = RuleType("raises", "fails", "a test", lambda _: True, make)
