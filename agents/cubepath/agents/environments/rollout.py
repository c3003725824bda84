"""Play a rule in plain Python, in one process: the reference for every run on the wire."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.world import Round
from cubepath.agents.local.observation import Note
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.given import whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


@dataclass(frozen=True, slots=True)
class Played:
    """A finished run: its rounds in order, the final sites, and why a rule gave up, if one did."""

    scene: Scene = field(compare=False, repr=False)
    rounds: tuple[Round, ...]
    sites: tuple[Site, ...]
    reached: bool
    failed: str | None = None

    @property
    def path(self) -> tuple[Action, ...]:
        """The edge path: the moves of each round, in increasing order of their movers."""
        return tuple(move.action for each in self.rounds for move in each.moves.values())

    @property
    def steps(self) -> tuple[tuple[Action, ...], ...]:
        """The edge path round by round, as pictures and films take it."""
        return tuple(tuple(move.action for move in each.moves.values()) for each in self.rounds)

    @property
    def placed(self) -> tuple[GeneratorPlacement, ...]:
        """The edge path, each move as a generator and a place."""
        return tuple(
            GeneratorPlacement(move.generator, move.at)
            for each in self.rounds
            for move in each.moves.values()
        )


def check_max_rounds(max_rounds: object) -> None:
    """Raise InputError if a run is to have less than no rounds, or no number of them."""
    whole_number("max_rounds", max_rounds, 0)


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
    while (
        len(rounds) < max_rounds and env.agents and failed is None and not scene.reached(env.sites)
    ):
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
    return Played(scene, tuple(rounds), env.sites, scene.reached(env.sites), failed)
