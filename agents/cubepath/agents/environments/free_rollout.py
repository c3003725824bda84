"""Play a rule without rounds, in one process."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.agents.environments.free_world import Acted, FreeWorld
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import check_seeds, scene_and_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.given import function, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Moved

Watch: TypeAlias = Callable[[FreeWorld, Acted], None]
"""Is told of a turn, with the world after it."""


@dataclass(frozen=True, slots=True)
class FreePlayed:
    """A finished run: what was committed, in order, the turns, and how it ended."""

    scene: Scene = field(compare=False, repr=False)
    commits: tuple[Moved, ...]
    """Those without a generator wrote registers alone."""
    turns: int
    refused: int
    """Attempts that were refused."""
    sites: tuple[Site, ...]
    reached: bool
    failed: str | None = None
    time: float = 0.0
    """When the last turn began; a module of speed factor 1 takes 1 for a turn."""

    @property
    def moves(self) -> tuple[Moved, ...]:
        """Return the commits that moved modules."""
        return tuple(commit for commit in self.commits if commit.generator is not None)

    @property
    def path(self) -> tuple[Action, ...]:
        """The edge path, in the order of the commits."""
        system = self.scene.system
        return tuple(system.read_action(each) for each in self.placed)

    @property
    def placed(self) -> tuple[GeneratorPlacement, ...]:
        """The edge path, each move as a generator and a place."""
        return tuple(
            GeneratorPlacement(each.generator, each.at)
            for each in self.commits
            if each.generator is not None
        )


def play_free(
    system: str | Path | Scene = "hex",
    rule: str | RuleType | None = None,
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    max_cycles: int = 2000,
    scheduler: str = "random",
    speeds: Mapping[int, int] | None = None,
    jitter: float = 0.5,
    lag: int = 0,
    restarts: Mapping[int, Collection[int]] | None = None,
    watch: Watch | None = None,
) -> FreePlayed:
    """Play until the goal is reached, a rule gives up, or after `max_cycles` turns a module.

    `system` is a scene or its name, and `rule` a rule or its name, as for `play`. The arguments
    from `scheduler` to `lag` are those of `FreeEnv`. `restarts` has the modules that lose all they
    know before a turn, by its number from 1. `watch` is told of each turn. InputError as for
    `play`, or if `max_cycles` is negative.

    >>> played = play_free("hex:n=4", seed=1)
    >>> played.reached, len(played.path)
    (True, 18)
    """
    whole_number("max_cycles", max_cycles, 0)
    _check_restarts(restarts)
    if watch is not None:
        function("watch", watch)
    scene, rule = scene_and_rule(system, rule, "free")
    check_seeds([seed], hesitate)
    env = FreeEnv(
        scene,
        max_cycles=max_cycles,
        note_length=rule.length(len(scene.start), "free"),
        scheduler=scheduler,
        speeds=speeds,
        jitter=jitter,
        lag=lag,
    )
    actors = actors_for(scene, rule, seed=seed, hesitate=hesitate, clock="free")
    env.reset(seed=seed)
    world = env.world
    commits: list[Moved] = []
    refused = 0
    failed: str | None = None
    turns = max_cycles * len(scene.start)
    while world.turns < turns and failed is None and not scene.reached(world.sites):
        for module in (restarts or {}).get(world.turns + 1, ()):
            world.restart(module)
            sites = {module: world.sites[module]}
            actors |= actors_for(
                scene,
                rule,
                seed=seed,
                hesitate=hesitate,
                modules=[module],
                sites=sites,
                clock="free",
            )
        name = env.agent_selection
        choice = actors[env.possible_agents.index(name)].act(env.observe(name))
        if choice.failed is not None:
            failed = f"{name}: {choice.failed}"
        acted = env.act(choice)
        refused += bool(acted.why)
        if acted.moved is not None:
            commits.append(acted.moved)
        if watch is not None:
            watch(world, acted)
    reached = scene.reached(world.sites)
    return FreePlayed(
        scene, tuple(commits), world.turns, refused, env.sites, reached, failed, env.time
    )


def _check_restarts(found: object) -> None:
    """Check who restarts when; InputError if it is of another type."""
    given: Any = found
    try:
        for turn, modules in (given or {}).items():
            for number in (turn, *modules):
                operator.index(number)
    except (AttributeError, TypeError):
        raise InputError(
            f"restarts={found!r}: expected turns with modules, as in {{12: [0]}}"
        ) from None
