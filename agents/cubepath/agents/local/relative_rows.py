"""The relative observations of many modules at once, from their absolute ones.

They are those of `RelativeObserver`, to the last bit: what depends on the own site alone is asked
of it once for each site and goals, and what is sensed is looked up for all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.relative import relative_layout, relative_observer
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

_KNOWN_MAX = 1 << 18
"""So many sites are remembered at most, each with goals: then all are asked again."""


class RelativeRows:
    """Makes the relative observations of the modules of one scene in many environments."""

    def __init__(self, system: System, goals: Sequence[tuple[Site, ...]]) -> None:
        """Take in each module's goals, by number."""
        self.layout = relative_layout(system)
        found = [relative_observer(system, each) for each in goals]
        self._observers = list({id(each): each for each in found}.values())
        place = {id(each): number for number, each in enumerate(self._observers)}
        self._who = [place[id(each)] for each in found]
        self._size = system.site_size
        self._forget()

    def _forget(self) -> None:
        self._known: list[dict[bytes, int]] = [{} for _ in self._observers]
        self._count = 0
        self._heads = np.zeros((64, self.layout.parts["sensed"].start), np.float32)

    def of(self, numbers: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return float32 of shape (E, n, `layout.length`), from int32 of shape (E, n, ...).

        `numbers` has what `observe` gives each module as ``observation``; it is left as it is.
        """
        size, sensed = self._size, self.layout.parts["sensed"]
        found = np.zeros((*numbers.shape[:2], self.layout.length), np.float32)
        if not found.size:
            return found
        if self._count > _KNOWN_MAX:
            self._forget()
        own = np.ascontiguousarray(numbers[:, :, : size + 1])
        keys = own.view(f"V{own.itemsize * (size + 1)}")[:, :, 0].tolist()
        rows: list[int] = []
        for environment, each in enumerate(keys):
            for module, (who, key) in enumerate(zip(self._who, each, strict=True)):
                row = self._known[who].get(key)
                if row is None:
                    row = self._learn(who, key, numbers[environment, module])
                rows.append(row)
        heads = self._heads.take(rows, axis=0)
        found[:, :, : sensed.start] = heads.reshape(*numbers.shape[:2], -1)
        looks = 2 * numbers[:, :, size + 1 :: 2] + numbers[:, :, size + 2 :: 2]
        shown = self.layout.looks.take(looks, axis=0)
        found[:, :, sensed] = shown.reshape(*looks.shape[:2], -1)
        return found

    def _learn(self, who: int, key: bytes, numbers: NDArray[np.int32]) -> int:
        """Return the row of a site that is new to modules with these goals."""
        row = self._known[who][key] = self._count
        self._count += 1
        if row == len(self._heads):
            self._heads = np.concatenate([self._heads, np.zeros_like(self._heads)])
        self._heads[row] = self._observers[who].of(numbers)[: self._heads.shape[1]]
        return row
