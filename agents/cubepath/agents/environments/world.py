"""The lockstep world in one process: where modules are, what each observes, one round.

Room: agents. It holds what on the wire is spread over the modules; each module is shown only what
`observe` looks up for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cubepath.agents.local.arbitration import settled
from cubepath.agents.local.observation import Note, Observation, observe
from cubepath.protocol.core.actions import apply_in_place
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


@dataclass(frozen=True, slots=True)
class Round:
    """What a round did: the executed moves by module in increasing order, and the lost claims."""

    number: int
    moves: Mapping[int, Move]
    lost: tuple[int, ...]


class World:
    """All modules of a scene, stepped in lockstep; round numbers count from 1."""

    def __init__(self, scene: Scene, *, seed: int, note_length: int = 0) -> None:
        """Put every module at its start."""
        self.scene = scene
        self.note_length = note_length
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        scene, note_length = self.scene, self.note_length
        self.seed = seed
        self.round = 0
        self.sites: list[Site] = list(scene.start)
        system = scene.system
        self._occupants: dict[Site, Site] = {system.place_of(s): s for s in scene.start}
        self._module_at = {site: number for number, site in enumerate(scene.start)}
        self._state: set[Site] = set(scene.start_state)
        self._said: list[Note] = [(0,) * note_length] * len(self.sites)
        self._notes: dict[Site, Note] = {}
        goals = [frozenset(known) for known in scene.goals] or [frozenset[Site]()] * len(self.sites)
        self._goals = goals

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    def observe(self, module: int) -> Observation:
        """Return the observation of one module."""
        return observe(
            self.scene.system,
            self.sites[module],
            self._occupants,
            goals=self._goals[module],
            notes=self._notes,
            note_length=self.note_length,
        )

    def step(self, actions: Mapping[int, int], notes: Mapping[int, Note] | None = None) -> Round:
        """Settle the claims that the actions make and execute the winners.

        An action that is not admissible makes no claim. What a module said last is heard in the
        next round, from the place where it then stands.
        """
        self.round += 1
        system = self.scene.system
        claims: dict[int, Move] = {}
        for module, action in actions.items():
            move = system.moves(self.sites[module])[action - 1] if action else None
            if move is not None and move.possible(self._state):
                claims[module] = move
        winners = settled(
            {module: move.action for module, move in claims.items()}, self.seed, self.round
        )
        executed = {module: claims[module] for module in winners}
        for move in executed.values():
            self._execute(move)
        if self.note_length:
            for module, note in (notes or {}).items():
                self._said[module] = note
            self._notes = {
                system.place_of(site): note
                for site, note in zip(self.sites, self._said, strict=True)
            }
        lost = tuple(sorted(set(claims) - set(winners)))
        return Round(self.round, executed, lost)

    def _execute(self, move: Move) -> None:
        apply_in_place(move.action, self._state)
        place_of = self.scene.system.place_of
        moved = []
        for source, target in move.motion:
            module = self._module_at.pop(source)
            del self._occupants[place_of(source)]
            moved.append((module, target))
        for module, target in moved:
            self.sites[module] = target
            self._module_at[target] = module
            self._occupants[place_of(target)] = target
