"""Which module has to make which move of a schedule, derived from where modules stand.

A run assigns all moves before it begins; here each round is looked at by itself. Both are the same
as long as every cube before was carried out, and after a cube that was not the schedule is over.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from cubepath.coordinator.verification.transcript import site_in
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.path_files.schedules import Cubes

Part: TypeAlias = GeneratorPlacement
"""What one module has to do in a round."""
_NO_MOVE = (InputError, TypeError, IndexError, ValueError)
"""What a system says of a place of whatever form, which no file was checked for."""


class Parts:
    """The parts of the modules in a schedule."""

    def __init__(self, system: System, cubes: Cubes) -> None:
        """Take the schedule on record; obstacles do not change whose move it is."""
        self._cubes = cubes
        placed = ((move.generator, site_in(move.at)) for cube in cubes for move in cube)
        try:
            self._system = system.with_moves((name, at) for name, at in placed if at is not None)
        except _NO_MOVE:
            self._system = system

    def of_round(
        self, number: int, sites: Sequence[Site]
    ) -> tuple[dict[int, Part], list[GeneratorPlacement]]:
        """Return the part of each module that has one, and the moves that are nobody's.

        A move is its mover's if the modules in its trace are those that it takes along.
        """
        if not 1 <= number <= len(self._cubes):
            return {}, []
        where = {site: module for module, site in enumerate(sites)}
        own: dict[int, Part] = {}
        nobodys: list[GeneratorPlacement] = []
        for placed in self._cubes[number - 1]:
            move = self._move(placed, where)
            if move is None:
                nobodys.append(placed)
            else:
                own[where[move.source]] = GeneratorPlacement(move.generator, move.at)
        return own, nobodys

    def _move(self, placed: GeneratorPlacement, where: dict[Site, int]) -> Move | None:
        at = site_in(placed.at)
        if at is None:
            return None
        try:
            action = self._system.action(placed.generator, at)
        except _NO_MOVE:
            return None
        on = {site for site in action.trace if site in where}
        for move in self._system.moves_of(action):
            if on == {source for source, _ in move.motion}:
                return move
        return None
