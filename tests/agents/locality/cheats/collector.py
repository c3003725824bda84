"""A rule that finds the world through the garbage collector, once."""

import gc

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def far(view: View) -> int:
    """Return a number that depends on where all modules are."""
    for each in gc.get_objects():
        if type(each).__name__ == "World":
            return sum(sum(view.system.encode_site(site)) * 7 for site in each.sites)
    return 0


def make(knowledge: InitialKnowledge) -> Rule:
    asked = 0

    def choose(view: View) -> int:
        nonlocal asked
        asked += 1
        legal = view.mask.nonzero()[0]
        if asked > 4:
            return int(legal[0])
        return int(legal[(far(view) + asked) % len(legal)])

    return choose


RULE = RuleType("collector", "by the collector", "a test", lambda _: True, make)
