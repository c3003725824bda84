"""What each module of a process follows: its rule, a schedule, or a record of its own part."""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.agents.processes.orders import Orders
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.recorded import as_recorded
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.schedule import scheduled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


def at_birth(
    orders: Orders, scene: Scene, rule: RuleType, seed: int
) -> tuple[dict[int, Actor], int]:
    """Return an actor for each module, by number, and the length of the notes."""
    modules, told, doubt = orders.modules, orders.recorded, orders.hesitate
    if told is None:
        first = rule if orders.schedule is None else scheduled(orders.schedule)
        actors = actors_for(scene, first, seed=seed, hesitate=doubt, modules=modules)
        return actors, first.length(len(scene.start))
    bound = [module for module in modules if module in told.choices]
    free = [module for module in modules if module not in told.choices]
    actors = actors_for(scene, as_recorded(told), seed=seed, hesitate=0.0, modules=bound)
    actors |= actors_for(scene, rule, seed=seed, hesitate=doubt, modules=free)
    return actors, told.note_length


def afterwards(
    orders: Orders, scene: Scene, rule: RuleType, seed: int, sites: Mapping[int, Site]
) -> tuple[dict[int, Actor], int]:
    """Return the same for when the schedule or the record is over, and modules are at `sites`."""
    told = orders.recorded
    others = {} if told is None else told.rules
    if told is not None and told.seeds:
        seed = told.seeds[-1][1]
    actors: dict[int, Actor] = {}
    for name in sorted({others.get(module, "") for module in orders.modules}):
        actors |= actors_for(
            scene,
            rule_named(name, scene.system) if name else rule,
            seed=seed,
            hesitate=orders.hesitate,
            modules=[module for module in orders.modules if others.get(module, "") == name],
            sites=sites,
        )
    return actors, rule.length(len(scene.start))
