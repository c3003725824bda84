"""Play a rule in the environment, in one process: the reference for every run on the wire.

Room: agents.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cubepath.agents.arrays.warming import is_due
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.world import Round
from cubepath.agents.local.observation import Note
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

_ROUNDS = 20
"""A run is taken to have so many rounds, to tell whether compiled code pays."""


@dataclass(frozen=True, slots=True)
class Played:
    """A finished run: its rounds in order, the final sites, and why a rule gave up, if one did."""

    rounds: tuple[Round, ...]
    sites: tuple[Site, ...]
    reached: bool
    failed: str | None = None


def play(
    scene: Scene,
    rule: RuleType,
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    max_rounds: int = 1000,
    watch: Callable[[Round], None] | None = None,
) -> Played:
    """Play until the goal is reached, a rule gives up, or `max_rounds` are over.

    A rule that has a vectorised form is played in compiled code once that is ready.
    """
    if watch is None and rule.vectorised is not None and is_due(_ROUNDS * len(scene.start)):
        from cubepath.agents.environments.rollouts import play_many  # noqa: PLC0415 - a circle

        runs = play_many(
            scene, rule, [seed], hesitate=hesitate, max_rounds=max_rounds, keep_rounds=True
        )
        played = () if runs.played is None else runs.played[0]
        return Played(played, runs.sites[0], bool(runs.reached[0]), runs.failed.get(0))
    return play_in_python(
        scene, rule, seed=seed, hesitate=hesitate, max_rounds=max_rounds, watch=watch
    )


def play_in_python(
    scene: Scene,
    rule: RuleType,
    *,
    seed: int,
    hesitate: float,
    max_rounds: int,
    watch: Callable[[Round], None] | None = None,
) -> Played:
    """Play as `play` does, with the rule in plain Python."""
    note_length = rule.note_length(len(scene.start))
    env = CubepathEnv(scene, max_cycles=max_rounds, note_length=note_length)
    actors = actors_for(scene, rule, seed=seed, hesitate=hesitate)
    observations, _ = env.reset(seed=seed)
    spoken: dict[str, Note] = {}
    rounds: list[Round] = []
    failed: str | None = None
    while env.agents and failed is None and not scene.reached(env.sites):
        actions = {}
        for number, name in enumerate(env.possible_agents):
            choice = actors[number].act(observations[name])
            actions[name] = choice.action
            if choice.note is not None:
                spoken[name] = choice.note
            if choice.failed is not None and failed is None:
                failed = f"{name}: {choice.failed}"
        observations, *_ = env.step(actions, spoken)
        played = env.last_round
        if played is None:  # step has just set it
            raise AssertionError("a step without a round")
        rounds.append(played)
        if watch is not None:
            watch(played)
    return Played(tuple(rounds), env.sites, scene.reached(env.sites), failed)
