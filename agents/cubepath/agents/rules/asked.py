"""What a caller asks for by name: a scene, and the rule that its modules follow."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import BUILT_IN, rule_named, rules_for
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.given import real_number, whole_number
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec

_TRIED = 16
"""For so many modules a rule is made to see whether it refuses a scene."""


def own_rule(scene: Scene) -> str:
    """Return the name of the rule that reaches the goal of the scene's family; else ``random``."""
    family = sound_family(scene.family)
    return (family.rule if family is not None else None) or "random"


def rule_for(name: str, scene: Scene, clock: str = "lockstep") -> RuleType:
    """Return the rule of that name, or of the form FILE.py:NAME.

    InputError if there is none, or it is not for the system, this scene of it, or the clock.
    """
    found = rule_named(name, scene.system, clock)
    why = misfit(found, scene, clock)
    if why is not None:
        fitting = ", ".join(fitting_rules(scene, clock))
        raise InputError(f"not for this scene: {why}, expected one of {fitting}")
    return found


def misfit(
    rule: RuleType, scene: Scene, clock: str = "lockstep", *, foreign: bool = False
) -> str | None:
    """Return why a rule that is for the system refuses this scene of it; None if it does not.

    It is made for the modules, or some where there are many. An error of another kind is that of a
    run, and no refusal. A rule from elsewhere is made only if you want `foreign` ones to be: it may
    end its process, which is to be one of its own.
    """
    if not foreign and BUILT_IN.get(rule.name) is not rule:
        return None
    last = len(scene.start) - 1
    tried = range(last + 1)
    if last >= _TRIED:
        tried = range(0, last + 1, last // (_TRIED - 1))
    try:
        actors_for(scene, rule, seed=0, hesitate=0.0, modules=list(tried), clock=clock)
    except InputError as error:
        return str(error)
    except RuleError:
        pass
    return None


def fitting_rules(scene: Scene, clock: str = "lockstep", *, foreign: bool = False) -> list[str]:
    """Return the names of the rules that are for a scene under a clock; see `misfit`."""
    return [
        rule.name
        for rule in rules_for(scene.system)
        if clock in rule.clocks and misfit(rule, scene, clock, foreign=foreign) is None
    ]


def scene_and_rule(
    system: str | Path | Scene, rule: str | RuleType | None, clock: str = "lockstep"
) -> tuple[Scene, RuleType]:
    """Return a scene and a rule that were given by name, or are what they should be already.

    InputError if there are none of these names, or a rule of that name does not fit the system or
    hold under the clock.
    """
    if not isinstance(system, str | Path | Scene):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"system={system!r}: expected a name, a file or a scene")
    scene = system if isinstance(system, Scene) else scene_from_spec(str(system))
    if isinstance(rule, RuleType):
        return scene, rule
    return scene, rule_named(own_rule(scene) if rule is None else rule, scene.system, clock)


def check_seeds(seeds: object, hesitate: object) -> None:
    """Check seeds, and with which probability modules skip a round; InputError as for a run."""
    if not isinstance(seeds, Iterable):
        raise InputError(f"seeds={seeds!r}: expected several seeds")
    for seed in seeds:
        whole_number("seed", seed, 0)
    if not 0.0 <= real_number("hesitate", hesitate) < 1.0:
        raise InputError(f"hesitate={hesitate}: expected at least 0 and less than 1")
