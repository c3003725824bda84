"""A rule that draws random bytes where no trap is."""

import posix

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[int.from_bytes(posix.urandom(8)) % len(legal)])

    return choose


RULE = RuleType("out-of-sight", "at random", "a test", lambda _: True, make)
