"""A rule whose modules tell one another where they are, in a global."""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View
from cubepath.protocol import Site

WHERE: dict[int, Site] = {}


def make(knowledge: InitialKnowledge) -> Rule:
    rounds = 0

    def choose(view: View) -> int:
        nonlocal rounds
        rounds += 1
        WHERE[knowledge.module] = view.site
        legal = view.mask.nonzero()[0]
        return int(legal[(len(WHERE) + rounds) % len(legal)])

    return choose


RULE = RuleType("module-globals", "by a global", "a test", lambda _: True, make)
