from cubepath.agents.environments.free_environment import (
    env as env,
    parallel_env as parallel_env,
    raw_env as raw_env,
)
from cubepath.agents.environments.rollouts import (
    play as play,
    play_free as play_free,
    play_many as play_many,
)
from cubepath.agents.environments.sb3 import (
    sb3_env as sb3_env,
    sb3_rule as sb3_rule,
    sb3_save as sb3_save,
)
from cubepath.agents.environments.vector_environment import vector_env as vector_env
from cubepath.agents.local.observation import (
    Observation as Observation,
    View as View,
    observe as observe,
)
from cubepath.agents.local.random_streams import (
    draw_below as draw_below,
    draw_fraction as draw_fraction,
)
from cubepath.agents.locality.check import check_rule as check_rule
from cubepath.agents.rendering.pictures import draw_text as draw_text
from cubepath.agents.rules.policy import policy_rule as policy_rule
from cubepath.agents.rules.potential import SiteDistances as SiteDistances
from cubepath.agents.rules.registry import rule_named as rule_named
from cubepath.agents.rules.rule import (
    Choice as Choice,
    FreeRule as FreeRule,
    InitialKnowledge as InitialKnowledge,
    Rule as Rule,
    RuleType as RuleType,
)
from cubepath.agents.rules.vector_actors import vector_actors_for as vector_actors_for
from cubepath.agents.rules.vector_rule import (
    RuleFailure as RuleFailure,
    VectorChoice as VectorChoice,
    VectorKnowledge as VectorKnowledge,
    VectorRule as VectorRule,
    VectorView as VectorView,
)
from cubepath.agents.rules.waves import Election as Election, Gradient as Gradient, Token as Token
