from cubepath.agents.environments.environment import CubepathEnv as CubepathEnv
from cubepath.agents.environments.free_environment import FreeEnv as FreeEnv
from cubepath.agents.environments.free_rollout import (
    FreePlayed as FreePlayed,
)
from cubepath.agents.environments.free_rollout import (
    play_free as play_free,
)
from cubepath.agents.environments.making import (
    env as env,
)
from cubepath.agents.environments.making import (
    parallel_env as parallel_env,
)
from cubepath.agents.environments.making import (
    raw_env as raw_env,
)
from cubepath.agents.environments.playing import play as play
from cubepath.agents.environments.rollout import Played as Played
from cubepath.agents.environments.rollouts import PlayedMany as PlayedMany
from cubepath.agents.environments.rollouts import play_many as play_many
from cubepath.agents.environments.sb3 import (
    sb3_env as sb3_env,
)
from cubepath.agents.environments.sb3 import (
    sb3_rule as sb3_rule,
)
from cubepath.agents.environments.sb3 import (
    sb3_save as sb3_save,
)
from cubepath.agents.environments.vector_environment import (
    CubepathVectorEnv as CubepathVectorEnv,
)
from cubepath.agents.environments.vector_environment import (
    vector_env as vector_env,
)
from cubepath.agents.local.observation import (
    Note as Note,
)
from cubepath.agents.local.observation import (
    Observation as Observation,
)
from cubepath.agents.local.observation import (
    View as View,
)
from cubepath.agents.local.observation import (
    observe as observe,
)
from cubepath.agents.locality.check import Checked as Checked
from cubepath.agents.locality.check import Finding as Finding
from cubepath.agents.locality.check import check_rule as check_rule
from cubepath.agents.rendering.pictures import draw_pixels as draw_pixels
from cubepath.agents.rendering.styles import draw_text as draw_text
from cubepath.agents.rules.policy import policy_rule as policy_rule
from cubepath.agents.rules.registry import rule_named as rule_named
from cubepath.agents.rules.rule import (
    Choice as Choice,
)
from cubepath.agents.rules.rule import (
    FreeRule as FreeRule,
)
from cubepath.agents.rules.rule import (
    InitialKnowledge as InitialKnowledge,
)
from cubepath.agents.rules.rule import (
    Rule as Rule,
)
from cubepath.agents.rules.rule import (
    RuleType as RuleType,
)
from cubepath.agents.rules.vector_actors import (
    VectorActors as VectorActors,
)
from cubepath.agents.rules.vector_actors import (
    vector_actors_for as vector_actors_for,
)
from cubepath.agents.rules.vector_rule import (
    Chosen as Chosen,
)
from cubepath.agents.rules.vector_rule import (
    GaveUp as GaveUp,
)
from cubepath.agents.rules.vector_rule import (
    Seen as Seen,
)
from cubepath.agents.rules.vector_rule import (
    VectorKnowledge as VectorKnowledge,
)
from cubepath.agents.rules.vector_rule import (
    VectorRule as VectorRule,
)
from cubepath.agents.rules.vector_streams import (
    draw_below as draw_below,
)
from cubepath.agents.rules.vector_streams import (
    draw_fraction as draw_fraction,
)
