"""Agents: one module's view and choice, the module process, and the PettingZoo environments.

Room: agents; each module knows its neighbourhood only. It imports the protocol. This face offers
what users need: to write a rule, to observe, to play in an environment, and to draw a state. Inside
the project, names are imported from the modules that define them.

| room | holds | may import |
|---|---|---|
| `local` | what a module senses, and how it and its competitors decide | none |
| `keepers` | the sites themselves, of runs without rounds | none |
| `arrays` | lockstep worlds as arrays, in compiled code | `local` |
| `rules` | what a module chooses from what it sees | `local`, `keepers` |
| `processes` | module processes and the fleet that starts and paces them | `rules`, `local` |
| `rendering` | scenes as text, pixels and on axes | none |
| `environments` | the PettingZoo environments, and playing a rule in them | all of these |
| `locality` | whether a rule is local, found by playing it | `environments` and what these use |
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.environments import (
        CubepathEnv,
        CubepathVectorEnv,
        FreeEnv,
        FreePlayed,
        Played,
        PlayedMany,
        env,
        parallel_env,
        play,
        play_free,
        play_many,
        raw_env,
        sb3_env,
        sb3_rule,
        sb3_save,
        vector_env,
    )
    from cubepath.agents.local import Note, Observation, View, observe
    from cubepath.agents.locality import Checked, Finding, check_rule
    from cubepath.agents.rendering import draw_pixels, draw_text
    from cubepath.agents.rules import (
        Choice,
        Chosen,
        FreeRule,
        GaveUp,
        InitialKnowledge,
        Rule,
        RuleType,
        Seen,
        VectorActors,
        VectorKnowledge,
        VectorRule,
        draw_below,
        draw_fraction,
        policy_rule,
        rule_named,
        vector_actors_for,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "environments": (
                "CubepathEnv CubepathVectorEnv FreeEnv FreePlayed Played PlayedMany env"
                " parallel_env play play_free play_many raw_env sb3_env sb3_rule sb3_save "
                "vector_env"
            ),
            "local": "Note Observation View observe",
            "locality": "Checked Finding check_rule",
            "rendering": "draw_pixels draw_text",
            "rules": (
                "Choice Chosen FreeRule GaveUp InitialKnowledge Rule RuleType Seen "
                "VectorActors VectorKnowledge VectorRule draw_below draw_fraction policy_rule "
                "rule_named vector_actors_for"
            ),
        },
    )

__all__ = [
    "Checked",
    "Choice",
    "Chosen",
    "CubepathEnv",
    "CubepathVectorEnv",
    "Finding",
    "FreeEnv",
    "FreePlayed",
    "FreeRule",
    "GaveUp",
    "InitialKnowledge",
    "Note",
    "Observation",
    "Played",
    "PlayedMany",
    "Rule",
    "RuleType",
    "Seen",
    "VectorActors",
    "VectorKnowledge",
    "VectorRule",
    "View",
    "check_rule",
    "draw_below",
    "draw_fraction",
    "draw_pixels",
    "draw_text",
    "env",
    "observe",
    "parallel_env",
    "play",
    "play_free",
    "play_many",
    "policy_rule",
    "raw_env",
    "rule_named",
    "sb3_env",
    "sb3_rule",
    "sb3_save",
    "vector_actors_for",
    "vector_env",
]
