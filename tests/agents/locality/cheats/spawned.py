"""A rule that wants more streams of its generator."""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    (more,) = knowledge.random.spawn(1)

    def choose(view: View) -> int:
        return int(more.choice(view.mask.nonzero()[0]))

    return choose


RULE = RuleType("spawned", "by a child", "a test", lambda _: True, make)
