"""The relative observations of all modules of a batch at once.

They are those of `RelativeObserver`, to the last bit: what depends on the own site alone is looked
up once for each stand, the rest is arithmetic on arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch
from cubepath.agents.arrays.tables import Growing
from cubepath.agents.local.observation import observation_length
from cubepath.agents.local.relative import relative_layout, relative_observer
from cubepath.protocol.core.sites import Site

Floats = NDArray[np.float32]


class RelativeArrays:
    """Makes the relative observations of a batch; `array` is overwritten each time."""

    def __init__(self, batch: Batch) -> None:
        """Take in what modules know from birth."""
        scene = batch.scene
        system = scene.system
        self._batch, self._system = batch, system
        self.layout = relative_layout(system)
        goals = scene.goals or ((),) * len(scene.start)
        found = [relative_observer(system, each) for each in goals]
        distinct = list({id(each): each for each in found}.values())
        number = {id(each): place for place, each in enumerate(distinct)}
        self._kept = distinct  # observers are shared only while somebody has them
        self._who = np.array([number[id(each)] for each in found], np.intp)
        aims = np.zeros((len(distinct), system.dimension))
        for place, each in enumerate(distinct):
            aims[place] = each.total or 0.0
        self._totals = aims[self._who]
        self._counts = np.array([len(each) for each in goals], np.float64)[:, None]
        hops = [each.hops for each in distinct if each.hops is not None]
        self._hops = np.stack(hops) if hops else None
        self._forgotten = batch.forgotten
        self._stands = self._no_stands()
        self.array: Floats = np.zeros(
            (batch.environments, batch.modules, self.layout.length), np.float32
        )

    def _no_stands(self) -> tuple[Growing, ...]:
        kind = self.layout.parts["kind"]
        system = self._system
        return (
            Growing(0, np.bool_),
            Growing(0, np.float64, system.dimension),
            Growing(0, np.float32, kind.stop - kind.start),
            Growing(0, np.intp),
            Growing(0, np.intp, system.move_slots),
        )

    def update(self) -> Floats:
        """Return the relative observations of the present state, shape (..., modules, length)."""
        batch, layout, found = self._batch, self.layout, self.array
        seen, size = batch.observed.observation, self._system.site_size
        stands = batch.stands()
        self._learn(stands)
        _, spots, kinds, own, targets = [each.array for each in self._stands]
        found[:, :, 0] = seen[:, :, size]
        found[:, :, layout.parts["kind"]] = kinds[stands]
        if self._totals.shape[1] and self._counts.any():
            counts = np.maximum(self._counts, 1)
            way = (self._totals - counts * spots[stands]) / counts
            way[:, self._counts[:, 0] == 0] = 0
            far = 1 + np.abs(way).max(axis=2, keepdims=True)
            found[:, :, layout.parts["way"]] = way / far
        if self._hops is not None:
            who = self._who[None, :]
            here = self._hops[who, own[stands]][:, :, None]
            there = self._hops[who[:, :, None], targets[stands]]
            nearer = found[:, :, layout.parts["nearer"]]
            np.subtract(there < here, there > here, nearer, dtype=np.float32)
        looks = 2 * seen[:, :, size + 1 :: 2] + seen[:, :, size + 2 :: 2]
        shown = layout.looks.take(looks, axis=0)
        found[:, :, layout.parts["sensed"]] = shown.reshape(*looks.shape[:2], -1)
        return found

    def _learn(self, stands: NDArray[np.intp]) -> None:
        if self._forgotten != self._batch.forgotten:
            self._forgotten, self._stands = self._batch.forgotten, self._no_stands()
        for each in self._stands:
            each.room(int(stands.max()) + 1)
        known = self._stands[0].array
        if known[stands].all():
            return
        for stand in np.unique(stands[~known[stands]]).tolist():
            self._learn_of(stand, self._batch.site_of(stand))

    def _learn_of(self, stand: int, site: Site) -> None:
        system, layout = self._system, self.layout
        known, spots, kinds, own, targets = [each.array for each in self._stands]
        numbers = np.zeros(observation_length(system), np.int32)
        numbers[: system.site_size] = system.encode_site(site)
        kinds[stand] = self._kept[0].of(numbers)[layout.parts["kind"]]
        if system.dimension:
            spots[stand] = system.coordinates(system.place_of(site))
        if layout.sites is not None:
            own[stand], targets[stand] = layout.sites.targets(system, site)
        known[stand] = True
