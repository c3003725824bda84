"""The random rule, for every system: any of the legal actions, including stay.

Without rounds every move is still legal: its support is checked when it is committed.
"""

from __future__ import annotations

from cubepath.agents.local.observation import View
from cubepath.agents.rules import vector_random
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType


def make(knowledge: InitialKnowledge) -> Rule:
    """Return a rule that picks uniformly among the legal actions from the module's own stream."""

    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[knowledge.stream.below(len(legal))])

    return choose


RANDOM = RuleType(
    name="random",
    summary="any legal action with equal probability, stay among them",
    source="none needed",
    fits=lambda _: True,
    make=make,
    free=FreeRule(why="every commit is a legal move, and nothing more is promised"),
    vectorised=vector_random.make,
)
