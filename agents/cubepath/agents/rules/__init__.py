"""Rules: what a module chooses from what it sees, built in or from other distributions.

Room: agents. A rule sees a `View` and returns a `Choice`; an `Actor` asks one for one module. It
imports `local` and the protocol. Module processes and environments let rules act; the coordinator
asks for them by name.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.rules.actor import Actor, actors_for
    from cubepath.agents.rules.registry import rule_named, rules
    from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
    from cubepath.agents.rules.schedule import SCHEDULE, scheduled
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "actor": "Actor actors_for",
            "registry": "rule_named rules",
            "rule": "Choice InitialKnowledge Rule RuleType",
            "schedule": "SCHEDULE scheduled",
        },
    )

__all__ = [
    "SCHEDULE",
    "Actor",
    "Choice",
    "InitialKnowledge",
    "Rule",
    "RuleType",
    "actors_for",
    "rule_named",
    "rules",
    "scheduled",
]
