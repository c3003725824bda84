"""The lockstep world of one environment in compiled code, with what PettingZoo asks for.

It gives what `World` gives, for all modules at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch, RelativeArrays
from cubepath.agents.arrays.state import GRANTED, ILLEGAL, LOST
from cubepath.agents.arrays.tables import Tables
from cubepath.agents.environments.world import Round, World
from cubepath.agents.local.observation import Note, Observation
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

Infos = dict[str, dict[str, Any]]


class ArrayWorld:
    """All modules of a scene in one batch of one environment."""

    def __init__(
        self, scene: Scene, *, seed: int, note_length: int = 0, relative: bool = False
    ) -> None:
        """Put every module at its start; `UntabledError` if the system does not fit into tables."""
        self.scene = scene
        self.note_length = note_length
        self.batch = Batch(scene, note_length=note_length)
        self._relative = RelativeArrays(self.batch) if relative else None
        modules = len(scene.start)
        self._speaks = np.zeros((1, modules), np.bool_)
        self._told = np.zeros((1, modules, note_length), np.int32)
        self.reset(seed)

    @classmethod
    def after(cls, world: World, *, relative: bool) -> ArrayWorld:
        """Return a world in the state of a plain one, from which it goes on."""
        found = cls(world.scene, seed=world.seed, note_length=world.note_length, relative=relative)
        found.batch.put(0, world.sites, world.round, world.spoken())
        return found

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        self.seed = seed
        self.batch.reset([seed])
        self.batch.observe()

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    @property
    def round(self) -> int:
        """Return how many rounds have been played."""
        return int(self.batch.round[0])

    @property
    def sites(self) -> list[Site]:
        """Return the site of each module, by number."""
        return self.batch.sites()

    @property
    def at_goal(self) -> int:
        """Return how many modules are on sites of the goal."""
        return int(self.batch.at_goal[0])

    @property
    def reached(self) -> bool:
        """Return whether the goal is reached."""
        return bool(self.batch.reached[0])

    def observations(self, names: Sequence[str], *, copy: bool) -> dict[str, Observation]:
        """Return what all modules observe: copies, or the arrays that every step overwrites."""
        observed = self.batch.observed
        seen: NDArray[Any] = self._seen()
        masks = observed.mask[0]
        if copy:
            seen, masks = seen.copy(), masks.copy()
        if not self.note_length:
            return {
                name: {"observation": one, "action_mask": mask}
                for name, one, mask in zip(names, seen, masks, strict=True)
            }
        notes = observed.notes[0].copy() if copy else observed.notes[0]
        return {
            name: {"observation": one, "action_mask": mask, "notes": heard}
            for name, one, mask, heard in zip(names, seen, masks, notes, strict=True)
        }

    def _seen(self) -> NDArray[Any]:
        if self._relative is None:
            own: NDArray[Any] = self.batch.observed.observation[0]
        else:
            own = self._relative.update()[0]
        return own

    def refresh(self) -> None:
        """Overwrite the arrays that were returned without a copy."""
        self._seen()

    def places(self) -> NDArray[np.int32]:
        """Return the encoded sites of all modules, shape (modules, site_size)."""
        return self.batch.observed.observation[0, :, : self.scene.system.site_size].copy()

    def step(self, actions: NDArray[np.int64], notes: Mapping[int, Note]) -> ArrayRound:
        """Play a round with an action for each module, and notes for some."""
        told = None
        if notes:
            self._speaks[:] = False
            for module, note in notes.items():
                self._speaks[0, module] = True
                self._told[0, module] = note
            told = self._speaks, self._told
        before = self.batch.standing()
        tables = self.batch.tables
        outcomes = self.batch.step(actions[None], told=told)[0]
        return ArrayRound(tables, self.round, actions, outcomes.copy(), before)


class ArrayRound:
    """What a round did; the moves are looked up when they are asked for."""

    def __init__(
        self,
        tables: Tables,
        number: int,
        actions: NDArray[np.int64],
        outcomes: NDArray[np.int8],
        before: tuple[NDArray[np.int32], NDArray[np.int32]],
    ) -> None:
        self.number = number
        self._tables, self._actions, self._before = tables, actions, before
        self._outcomes = outcomes

    def illegal(self) -> NDArray[np.intp]:
        """Return the modules whose actions were not admissible."""
        return np.flatnonzero(self._outcomes == ILLEGAL)

    def round(self) -> Round:
        """Return the round as the plain world gives it."""
        tables, system = self._tables, self._tables.scene.system
        places, codes = self._before
        moves = {}
        for module in np.flatnonzero(self._outcomes == GRANTED).tolist():
            site = tables.site(int(places[module]), int(codes[module]))
            move = system.moves(site)[int(self._actions[module]) - 1]
            if move is None:
                raise AssertionError(f"module_{module} made no move from {site!r}")
            moves[module] = move
        lost = tuple(np.flatnonzero(self._outcomes == LOST).tolist())
        return Round(self.number, moves, lost)
