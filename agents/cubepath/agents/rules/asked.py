"""What a caller asks for by name: a scene, and the rule that its modules follow.

Room: agents.
"""

from __future__ import annotations

from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec


def own_rule(scene: Scene) -> str:
    """Return the name of the rule that reaches the goal of the scene's family; else ``random``."""
    family = sound_family(scene.family)
    return (family.rule if family is not None else None) or "random"


def scene_and_rule(
    system: str | Scene, rule: str | RuleType | None, clock: str = "lockstep"
) -> tuple[Scene, RuleType]:
    """Return a scene and a rule that were given by name, or are what they should be already.

    InputError if there are none of these names, or a rule of that name does not fit the system or
    hold under the clock.
    """
    scene = scene_from_spec(system) if isinstance(system, str) else system
    if isinstance(rule, RuleType):
        return scene, rule
    return scene, rule_named(own_rule(scene) if rule is None else rule, scene.system, clock)
