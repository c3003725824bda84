"""A rule that is for no scene, as it says when it is made."""

from cubepath.agents import InitialKnowledge, Rule, RuleType
from cubepath.protocol import InputError


def make(knowledge: InitialKnowledge) -> Rule:
    raise InputError(f"wants more than {knowledge.modules} modules")


RULE = RuleType("unfit", "for no scene", "a test", lambda _: True, make)
