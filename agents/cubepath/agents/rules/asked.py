"""What a caller asks for by name: a scene, and the rule that its modules follow.

Room: agents.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.given import real_number, whole_number
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec


def own_rule(scene: Scene) -> str:
    """Return the name of the rule that reaches the goal of the scene's family; else ``random``."""
    family = sound_family(scene.family)
    return (family.rule if family is not None else None) or "random"


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
