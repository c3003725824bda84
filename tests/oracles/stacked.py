"""Environments of one scene with their actors, and what their modules see stacked in arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import Note, Observation
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.rule import Choice, RuleType
from cubepath.agents.rules.vector_actors import vector_actors_for
from cubepath.protocol.core.system import Scene

Table = list[list[Observation]]
"""What each module of each environment sees."""


def stacked(seen: Table, name: str) -> NDArray[Any]:
    """Return one of the arrays that modules see, of all modules of all environments."""
    return np.array([[each[name] for each in row] for row in seen])


class Side:
    """Plays a rule in some environments by actors, and compares what vectorised ones choose."""

    def __init__(
        self, scene: Scene, rule: RuleType, seeds: Sequence[int], hesitate: float = 0.0
    ) -> None:
        self.scene = scene
        self.modules = len(scene.start)
        self.note_length = rule.length(self.modules)
        self.worlds = [World(scene, seed=each, note_length=self.note_length) for each in seeds]
        self.actors = [actors_for(scene, rule, seed=each, hesitate=hesitate) for each in seeds]
        self.playing = np.ones(len(seeds), np.bool_)
        self.spoken: list[dict[int, Note]] = [{} for _ in seeds]
        vector = vector_actors_for(scene, rule, seeds=seeds, hesitate=hesitate)
        assert vector is not None
        self.vector = vector
        self.out = np.zeros((len(seeds), self.modules), np.int32)

    def views(self) -> Table:
        """Return what the modules see."""
        return [[world.observe(each) for each in range(self.modules)] for world in self.worlds]

    def choose(self, seen: Table) -> list[dict[int, Choice]]:
        """Ask both; return what the actors chose, of environments that are playing."""
        notes = stacked(seen, "notes") if self.note_length else None
        self.vector.act(
            stacked(seen, "observation"),
            stacked(seen, "action_mask"),
            notes,
            self.out,
            playing=self.playing,
        )
        found = []
        for environment in range(len(self.worlds)):
            actors = self.actors[environment] if self.playing[environment] else {}
            choices = {m: each.act(seen[environment][m]) for m, each in actors.items()}
            self._compare(environment, choices)
            found.append(choices)
        return found

    def _compare(self, environment: int, choices: dict[int, Choice]) -> None:
        """Compare actions, who gave up first, and the last notes."""
        told = self.spoken[environment]
        told |= {m: each.note for m, each in choices.items() if each.note is not None}
        actions = [choices[m].action if m in choices else 0 for m in range(self.modules)]
        assert self.out[environment].tolist() == actions
        gave_up = [f"module_{m}: {each.failed}" for m, each in choices.items() if each.failed]
        assert self.vector.failed.get(environment) == (gave_up[0] if gave_up else None)
        silence = (0,) * self.note_length
        said = [tuple(each) for each in self.vector.notes[environment].tolist()]
        assert said == [told.get(m, silence) for m in range(self.modules)]

    def play(self, rounds: int) -> int:
        """Play until all have reached the goal; return how many rounds the environments made."""
        made = 0
        for _ in range(rounds):
            self.playing = np.array([not self.scene.reached(each.sites) for each in self.worlds])
            if not self.playing.any():
                break
            for environment, choices in enumerate(self.choose(self.views())):
                if self.playing[environment]:
                    actions = {module: each.action for module, each in choices.items()}
                    self.worlds[environment].step(actions, self.spoken[environment])
                    made += 1
        return made
