"""A rule that finds the world in the frames of its callers."""

import sys

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    asked = 0

    def choose(view: View) -> int:
        nonlocal asked
        asked += 1
        frame = sys._getframe(1)
        while frame.f_back is not None and frame.f_locals.get("world") is None:
            frame = frame.f_back
        world = frame.f_locals.get("world")
        sites = () if world is None else world.sites
        far = sum(number for site in sites for number in view.system.encode_site(site))
        legal = view.mask.nonzero()[0]
        return int(legal[(far + asked) % len(legal)])

    return choose


RULE = RuleType("frames", "by frames", "a test", lambda _: True, make)
