"""The levels of a run without rounds, from moves in any order that they allow."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable

import msgspec

from cubepath.coordinator.runs.commits import Released
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.core.system import System

_encode = msgspec.json.Encoder().encode


class Levels:
    """Moves by level, in a level by generator and place, as recordings have them."""

    def __init__(self, system: System) -> None:
        """Begin with none."""
        self._system = system
        self._levels: list[list[tuple[str, bytes]]] = []
        self._actions: dict[tuple[str, bytes], Action] = {}
        self._changed: int | None = None

    def __len__(self) -> int:
        """Return the greatest level."""
        return len(self._levels)

    def add(self, moves: Iterable[Released]) -> None:
        """Take further moves; InputError for one that the system does not have."""
        for move in moves:
            if not 1 <= move.level <= len(self._levels) + 1:
                raise InputError(f"level {move.level}: expected 1 to {len(self._levels) + 1}")
            if move.level > len(self._levels):
                self._levels.append([])
            insort(self._levels[move.level - 1], self._named(move))
            self._change(move.level)

    def put(self, level: int, moves: Iterable[Released]) -> None:
        """Say what a level has, in the place of what was known of it."""
        while len(self._levels) < level:
            self._levels.append([])
        found = sorted(map(self._named, moves))
        if found != self._levels[level - 1]:
            self._levels[level - 1] = found
            self._change(level)

    def _named(self, move: Released) -> tuple[str, bytes]:
        key = move.generator, _encode(move.at)
        if key not in self._actions:
            self._actions[key] = self._system.action(move.generator, site_from_json(move.at))
        return key

    def _change(self, level: int) -> None:
        self._changed = level if self._changed is None else min(self._changed, level)

    def changed(self) -> tuple[int, list[tuple[Action, ...]]] | None:
        """Return the levels from the first on that has changed, and its place from 0."""
        if self._changed is None:
            return None
        place, self._changed = self._changed - 1, None
        return place, [tuple(self._actions[key] for key in level) for level in self._levels[place:]]
