"""The PettingZoo environments, in one process and over zenoh, and playing a rule in them.

Room: agents. It imports all other rooms of the agents, and the protocol. It is for outside users;
in the project only the simulator imports it, to compare its runs with `play`, and `locality`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.environments.environment import CubepathEnv, env, parallel_env, raw_env
    from cubepath.agents.environments.free_environment import FreeEnv
    from cubepath.agents.environments.free_rollout import FreePlayed, play_free
    from cubepath.agents.environments.free_world import FreeWorld
    from cubepath.agents.environments.rollout import Played, play
    from cubepath.agents.environments.world import World
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "environment": "CubepathEnv env parallel_env raw_env",
            "free_environment": "FreeEnv",
            "free_rollout": "FreePlayed play_free",
            "free_world": "FreeWorld",
            "rollout": "Played play",
            "world": "World",
        },
    )

__all__ = [
    "CubepathEnv",
    "FreeEnv",
    "FreePlayed",
    "FreeWorld",
    "Played",
    "World",
    "env",
    "parallel_env",
    "play",
    "play_free",
    "raw_env",
]
