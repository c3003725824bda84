"""The rules by name, of the project and of other distributions."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING

from cubepath.agents.rules.chain import CHAIN
from cubepath.agents.rules.pibt import PIBT
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.rule_files import is_in_file, rule_in_file
from cubepath.agents.rules.tswap import TSWAP
from cubepath.agents.rules.uniform import RANDOM
from cubepath.agents.rules.word import WORD
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.suggestions import did_you_mean
from cubepath.protocol.core.system import System

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "cubepath.rules"
CLOCKS = ("lockstep", "free")

BUILT_IN = {rule.name: rule for rule in (RANDOM, CHAIN, TSWAP, PIBT, WORD)}


@cache
def rules() -> dict[str, RuleType]:
    """Return all rules by name; InputError names an entry point with none, or with one twice."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - takes long, and is rarely needed

    found = dict(BUILT_IN)
    for entry in entry_points(group=GROUP):
        rule = _loaded(entry)
        if rule.name in found:
            raise InputError(f"{_where(entry)}: rule {rule.name!r} exists")
        found[rule.name] = rule
    return found


def _where(entry: EntryPoint) -> str:
    by = f" ({entry.dist.name})" if entry.dist is not None else ""
    return f"entry point {entry.name} of {GROUP}{by}"


def _loaded(entry: EntryPoint) -> RuleType:
    try:
        rule = entry.load()
    except Exception as error:
        raise InputError(f"{_where(entry)}: {type(error).__name__}: {error}") from error
    if not isinstance(rule, RuleType):
        raise InputError(f"{_where(entry)}: {rule!r} is no RuleType")
    return rule


def _by_entry(name: str) -> RuleType | None:
    """Return the rule of the entry point of this name, without loading any others."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - as above

    for entry in entry_points(group=GROUP, name=name):
        rule = _loaded(entry)
        if rule.name == name:
            return rule
    return None


def find_rule(name: str) -> RuleType | None:
    """Return the rule of that name, or of the form FILE.py:NAME; None if there is none.

    Other distributions are searched only for names that are not built in. InputError says what is
    wrong with a file, or with an entry point.
    """
    if is_in_file(name):
        return rule_in_file(name)
    return BUILT_IN.get(name) or _by_entry(name) or rules().get(name)


def unknown_rule(name: str) -> InputError:
    """Return the error for a name that no rule has."""
    near = _near(name)
    return InputError(f"unknown rule {name!r}{near}, expected one of {', '.join(rules())}")


def _near(name: str) -> str:
    """Return what may be meant by a name that no rule has, in brackets; "" for nothing."""
    if name.endswith(".py"):
        return " (a rule in a file is FILE.py:NAME)"
    return did_you_mean(name, rules())


def rules_for(system: System) -> list[RuleType]:
    """Return the rules that fit a system, without those that cannot tell."""
    found: list[RuleType] = []
    for rule in rules().values():
        with suppress(InputError):
            found += [rule] if rule.is_for(system) else []
    return found


def rule_named(name: str, system: System, clock: str = "lockstep") -> RuleType:
    """Return the rule that `find_rule` finds; InputError if none, or it does not fit the system.

    It must hold under the clock, too.
    """
    if clock not in CLOCKS:
        near = did_you_mean(str(clock), CLOCKS)
        raise InputError(f"clock={clock}{near}: expected one of {', '.join(CLOCKS)}")
    if not isinstance(name, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"rule={name!r}: expected the name of a rule, or FILE.py:NAME")
    found = find_rule(name)
    if found is not None and clock not in found.clocks:
        fitting = ", ".join(rule.name for rule in rules_for(system) if clock in rule.clocks)
        raise InputError(f"not for the {clock} clock: rule {name!r}, expected one of {fitting}")
    if found is None or not found.is_for(system):
        fitting = ", ".join(rule.name for rule in rules_for(system))
        what = "unknown rule" if found is None else "not for this system: rule"
        near = _near(name) if found is None else ""
        raise InputError(f"{what} {name!r}{near}, expected one of {fitting}")
    return found
