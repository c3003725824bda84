"""A rule that finds in a global where modules are whom it does not sense."""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View

FAR: dict[int, int] = {}


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        FAR[knowledge.module] = sum(view.system.encode_site(view.site))
        legal = view.mask.nonzero()[0]
        return int(legal[sum(FAR.values()) % len(legal)])

    return choose


RULE = RuleType("far-positions", "by where all are", "a test", lambda _: True, make)
