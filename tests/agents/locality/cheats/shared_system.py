"""A rule that counts on the system, which all modules of a process share."""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View
from cubepath.protocol import Site


def make(knowledge: InitialKnowledge) -> Rule:
    asked: list[Site] = vars(knowledge.system).setdefault("asked", [])

    rounds = 0

    def choose(view: View) -> int:
        nonlocal rounds
        rounds += 1
        asked.append(view.site)
        legal = view.mask.nonzero()[0]
        return int(legal[(len(asked) + rounds) % len(legal)])

    return choose


RULE = RuleType("shared-system", "by the system", "a test", lambda _: True, make)
