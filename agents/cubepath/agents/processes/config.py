"""The configuration of a module process, which the fleet and the simulator give alike.

What each module of a process follows: its rule, a schedule, or a record of its own part.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.schedule import Recorded, as_recorded, scheduled
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.credentials import GUEST, Credentials

OUTSIDE = "outside"
"""Instead of a rule's name: the modules are driven from outside, by `Acts` messages."""


class ProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The configuration of a module process."""

    endpoint: str
    run: str
    process: int
    modules: list[int]
    processes: list[list[int]]
    """The modules of every process: who speaks for whom."""
    scene: str
    """The scene as TOML text: processes share no files."""
    rule: str
    seed: int
    hesitate: float
    note_length: int
    schedule: dict[int, dict[int, GeneratorPlacement]] | None = None
    """By module its own moves of a schedule, by round; the rule follows when that is over."""
    recorded: Recorded | None = None
    """What its modules chose in a run on record, and choose again until that is over."""
    credentials: Credentials = GUEST
    """By what it shows who it is; a process elsewhere has its own."""


def at_birth(
    config: ProcessConfig, scene: Scene, rule: RuleType, seed: int
) -> tuple[dict[int, Actor], int]:
    """Return an actor for each module, by number, and the length of the notes."""
    modules, told, doubt = config.modules, config.recorded, config.hesitate
    if told is None:
        first = rule if config.schedule is None else scheduled(config.schedule)
        actors = actors_for(scene, first, seed=seed, hesitate=doubt, modules=modules)
        return actors, first.length(len(scene.start))
    bound = [module for module in modules if module in told.choices]
    free = [module for module in modules if module not in told.choices]
    actors = actors_for(scene, as_recorded(told), seed=seed, hesitate=0.0, modules=bound)
    actors |= actors_for(scene, rule, seed=seed, hesitate=doubt, modules=free)
    return actors, told.note_length


def afterwards(
    config: ProcessConfig, scene: Scene, rule: RuleType, seed: int, sites: Mapping[int, Site]
) -> tuple[dict[int, Actor], int]:
    """Return the same for when the schedule or the record is over, and modules are at `sites`."""
    told = config.recorded
    others = {} if told is None else told.rules
    if told is not None and told.seeds:
        seed = told.seeds[-1][1]
    actors: dict[int, Actor] = {}
    for name in sorted({others.get(module, "") for module in config.modules}):
        actors |= actors_for(
            scene,
            rule_named(name, scene.system) if name else rule,
            seed=seed,
            hesitate=config.hesitate,
            modules=[module for module in config.modules if others.get(module, "") == name],
            sites=sites,
        )
    return actors, rule.length(len(scene.start))
