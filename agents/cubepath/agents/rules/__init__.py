"""Rules: what a module chooses from what it sees, built in or from other distributions.

Room: agents. A rule sees a `View` and returns a `Choice`; an `Actor` asks one for one module, and
`VectorActors` for all modules of many environments, if the rule has such a form. It imports
`local`, the protocol, and of `keepers` what an attempt takes. Module processes and environments let
rules act; the coordinator asks for them by name.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.rules.actor import Actor, actors_for
    from cubepath.agents.rules.asked import (
        check_seeds,
        fitting_rules,
        misfit,
        own_rule,
        rule_for,
        scene_and_rule,
    )
    from cubepath.agents.rules.attempting import attempt_of
    from cubepath.agents.rules.network import (
        ACTIVATIONS,
        FORMAT,
        Layer,
        Network,
        network_rule,
        read_network,
    )
    from cubepath.agents.rules.policy import policy_rule
    from cubepath.agents.rules.recorded import (
        RECORDED,
        Recorded,
        RecordedChoice,
        as_recorded,
    )
    from cubepath.agents.rules.registry import (
        BUILT_IN,
        CLOCKS,
        find_rule,
        rule_named,
        rules,
        unknown_rule,
    )
    from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
    from cubepath.agents.rules.rule_files import (
        RULE_MODULE,
        check_rule_file,
        forget_rule_files,
        is_in_file,
        permitted_rule,
        stands_for,
    )
    from cubepath.agents.rules.schedule import SCHEDULE, scheduled
    from cubepath.agents.rules.streams import HESITATE, RULE, NoSeed, stream, stream_at
    from cubepath.agents.rules.vector_actors import VectorActors, vector_actors_for
    from cubepath.agents.rules.vector_rule import (
        Chosen,
        GaveUp,
        Seen,
        VectorKnowledge,
        VectorRule,
    )
    from cubepath.agents.rules.vector_streams import draw_below, draw_fraction
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "actor": "Actor actors_for",
            "asked": "check_seeds fitting_rules misfit own_rule rule_for scene_and_rule",
            "attempting": "attempt_of",
            "network": ("ACTIVATIONS FORMAT Layer Network network_rule read_network"),
            "policy": "policy_rule",
            "recorded": "RECORDED Recorded RecordedChoice as_recorded",
            "registry": "CLOCKS BUILT_IN find_rule rule_named rules unknown_rule",
            "rule": "Choice FreeRule InitialKnowledge Rule RuleType",
            "rule_files": (
                "RULE_MODULE check_rule_file forget_rule_files is_in_file permitted_rule stands_for"
            ),
            "schedule": "SCHEDULE scheduled",
            "streams": "HESITATE NoSeed RULE stream stream_at",
            "vector_actors": "VectorActors vector_actors_for",
            "vector_rule": "Chosen GaveUp Seen VectorKnowledge VectorRule",
            "vector_streams": "draw_below draw_fraction",
        },
    )

__all__ = [
    "ACTIVATIONS",
    "BUILT_IN",
    "CLOCKS",
    "FORMAT",
    "HESITATE",
    "RECORDED",
    "RULE",
    "RULE_MODULE",
    "SCHEDULE",
    "Actor",
    "Choice",
    "Chosen",
    "FreeRule",
    "GaveUp",
    "InitialKnowledge",
    "Layer",
    "Network",
    "NoSeed",
    "Recorded",
    "RecordedChoice",
    "Rule",
    "RuleType",
    "Seen",
    "VectorActors",
    "VectorKnowledge",
    "VectorRule",
    "actors_for",
    "as_recorded",
    "attempt_of",
    "check_rule_file",
    "check_seeds",
    "draw_below",
    "draw_fraction",
    "find_rule",
    "fitting_rules",
    "forget_rule_files",
    "is_in_file",
    "misfit",
    "network_rule",
    "own_rule",
    "permitted_rule",
    "policy_rule",
    "read_network",
    "rule_for",
    "rule_named",
    "rules",
    "scene_and_rule",
    "scheduled",
    "stands_for",
    "stream",
    "stream_at",
    "unknown_rule",
    "vector_actors_for",
]
