"""Agents: one module's view and choice, the module process, and the PettingZoo environments.

Room: agents; knows its neighbourhood only, imports the protocol only. Names are loaded when they
are asked for, so that a module process does not import PettingZoo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cubepath.agents.environments.environment import CubepathEnv, env, parallel_env, raw_env
    from cubepath.agents.local.observation import View
    from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType

_HOME = {
    "CubepathEnv": "environments.environment",
    "env": "environments.environment",
    "parallel_env": "environments.environment",
    "raw_env": "environments.environment",
    "InitialKnowledge": "rules.rule",
    "Choice": "rules.rule",
    "Rule": "rules.rule",
    "RuleType": "rules.rule",
    "View": "local.observation",
}

__all__ = [
    "Choice",
    "CubepathEnv",
    "InitialKnowledge",
    "Rule",
    "RuleType",
    "View",
    "env",
    "parallel_env",
    "raw_env",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    from importlib import import_module  # noqa: PLC0415 - nothing is imported before it is needed

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
