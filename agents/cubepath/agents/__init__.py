"""Agents: one module's view and choice, the module process, and the PettingZoo environments.

Room: agents; knows its neighbourhood only, imports the protocol only. Names are loaded when they
are asked for, so that a module process does not import PettingZoo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cubepath.agents.environment import CubepathEnv, env, parallel_env, raw_env
    from cubepath.agents.rule import Birth, Choice, Rule, RuleType
    from cubepath.agents.view import View

_HOME = {
    "CubepathEnv": "environment",
    "env": "environment",
    "parallel_env": "environment",
    "raw_env": "environment",
    "Birth": "rule",
    "Choice": "rule",
    "Rule": "rule",
    "RuleType": "rule",
    "View": "view",
}

__all__ = [
    "Birth",
    "Choice",
    "CubepathEnv",
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
