"""The rules by name, those that come with the project and those of other distributions.

Room: agents.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from cubepath.agents.arm_rule import WORD
from cubepath.agents.chain_rule import CHAIN
from cubepath.agents.pibt_rule import PIBT
from cubepath.agents.random_rule import RANDOM
from cubepath.agents.rule import RuleType
from cubepath.agents.tswap_rule import TSWAP
from cubepath.protocol.errors import InputError
from cubepath.protocol.systems import System

GROUP = "cubepath.rules"


@cache
def rules() -> dict[str, RuleType]:
    """Return all rules by name; a name that stands twice is refused."""
    found = {rule.name: rule for rule in (RANDOM, CHAIN, TSWAP, PIBT, WORD)}
    for entry in entry_points(group=GROUP):
        rule = entry.load()
        if not isinstance(rule, RuleType):
            raise InputError(f"entry point {entry.name} of {GROUP}: {rule!r} is no RuleType")
        if rule.name in found:
            raise InputError(f"entry point {entry.name} of {GROUP}: rule {rule.name!r} exists")
        found[rule.name] = rule
    return found


def rule_named(name: str, system: System) -> RuleType:
    """Return the rule of that name if it is one for this system; InputError otherwise."""
    found = rules().get(name)
    fitting = ", ".join(rule.name for rule in rules().values() if rule.fits(system))
    if found is None:
        raise InputError(f"unknown rule {name!r}, expected one of {fitting}")
    if not found.fits(system):
        raise InputError(f"rule {name!r} is not for this system, expected one of {fitting}")
    return found
