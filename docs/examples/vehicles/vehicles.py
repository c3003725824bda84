"""A rule for vehicles: who can come nearer to its target does, and who waits steps aside at times.

It does not always arrive; nobody can know what it will do from its name, so it has tests.
"""

from cubepath.agents import InitialKnowledge, Rule, RuleType, View

HASTE = 0.7
"""How probable it is that a vehicle moves although it comes no nearer."""


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one vehicle."""
    random = knowledge.random

    def choose(view: View) -> int:
        legal = [action for action, _ in view.legal()]
        if not legal or random.random() > HASTE:
            return 0
        return int(random.choice(legal))

    return choose


WANDER = RuleType(
    name="wander",
    summary="any move, with a rest now and then",
    source="none needed",
    fits=lambda system: True,
    make=make,
)
