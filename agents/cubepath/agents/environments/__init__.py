"""The PettingZoo environments, in one process and over zenoh, and playing a rule in them.

Room: agents. It imports all other rooms of the agents, and the protocol. It is for outside users;
in the project only the simulator imports it, to compare its runs with `play`, `locality`, and
experiments, which play runs in it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.environments.environment import CubepathEnv
    from cubepath.agents.environments.free_environment import FreeEnv
    from cubepath.agents.environments.free_rollout import FreePlayed, play_free
    from cubepath.agents.environments.made_moves import MadeMoves, made_in
    from cubepath.agents.environments.making import env, parallel_env, raw_env
    from cubepath.agents.environments.playing import play
    from cubepath.agents.environments.rollout import Played, play_in_python
    from cubepath.agents.environments.rollouts import PlayedMany, play_many
    from cubepath.agents.environments.sb3 import sb3_env, sb3_rule, sb3_save
    from cubepath.agents.environments.vector_environment import CubepathVectorEnv, vector_env
    from cubepath.agents.environments.world import World
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "environment": "CubepathEnv",
            "free_environment": "FreeEnv",
            "free_rollout": "FreePlayed play_free",
            "made_moves": "MadeMoves made_in",
            "making": "env parallel_env raw_env",
            "playing": "play",
            "rollout": "Played play_in_python",
            "rollouts": "PlayedMany play_many",
            "sb3": "sb3_env sb3_rule sb3_save",
            "vector_environment": "CubepathVectorEnv vector_env",
            "world": "World",
        },
    )

__all__ = [
    "CubepathEnv",
    "CubepathVectorEnv",
    "FreeEnv",
    "FreePlayed",
    "MadeMoves",
    "Played",
    "PlayedMany",
    "World",
    "env",
    "made_in",
    "parallel_env",
    "play",
    "play_free",
    "play_in_python",
    "play_many",
    "raw_env",
    "sb3_env",
    "sb3_rule",
    "sb3_save",
    "vector_env",
]
