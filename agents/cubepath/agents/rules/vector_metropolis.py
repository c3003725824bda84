"""The rule `metropolis` for all modules of many environments at once, with the same choices."""

from collections.abc import Iterable
from math import exp

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.random_streams import RandomStream, Streams, draws
from cubepath.agents.rules.potential import OwnPotential
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.core.system import CLOSED, EMPTY

_FAR = np.iinfo(np.int32).max
_BYTES_MAX = 1 << 28
"""Beyond this the rows are forgotten, and made again where modules still are."""
_ROOM = 64
"""The least number of rows for which there is room."""


def vector_metropolis(temperature: float, cooling: float, knowledge: VectorKnowledge) -> VectorRule:
    """Return the rule of all modules, each of which draws from its own stream."""
    table, streams = _SiteTable(knowledge), knowledge.streams()
    size = knowledge.system.site_size
    now = temperature / cooling

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        nonlocal now
        now *= cooling
        actions, chances = _drawn(seen, streams)
        rows = table.rows(seen.observation[..., :size])
        taken = _taken(seen.observation[..., size + 1 :: 2], table.slots[rows], table.goals)
        further = _nearest(table.far[rows, actions], taken) - _nearest(table.far[rows, 0], taken)
        most = int(further.max(initial=0))
        shares = [exp(-steps / now) if now > 0 else 0.0 for steps in range(1, most + 1)]
        accepted = chances < np.array([1.0, *shares])[np.maximum(further, 0)]
        chosen.actions[...] = np.where(accepted & seen.playing[:, None], actions, 0)
        return ()

    return choose


def _drawn(seen: VectorView, streams: Streams) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Draw a legal action and a number from 0 to below 1 for each module that plays."""
    legal = seen.action_mask[..., 1:] != 0
    playing = seen.playing[:, None]
    number = draws(streams, playing) >> np.uint64(32)
    count = legal.sum(axis=2)
    index = ((number * (count + 1).astype(np.uint64)) >> np.uint64(32)).astype(np.int64)
    # The legal action of this index; the one past the last is to stay.
    reached = legal.cumsum(axis=2) == (index + 1)[..., None]
    actions = np.where(index < count, reached.argmax(axis=2) + 1, 0)
    chances = (draws(streams, playing) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return actions, chances


def _taken(codes: NDArray[np.int32], slots: NDArray[np.int32], goals: int) -> NDArray[np.bool_]:
    """Return which goals each module sees occupied, shape (E, n, goals)."""
    found = np.zeros((*codes.shape[:2], goals), np.bool_)
    where = np.nonzero((codes != EMPTY) & (codes != CLOSED) & (slots >= 0))
    found[where[0], where[1], slots[where]] = True
    return found


def _nearest(far: NDArray[np.int32], taken: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return how far the nearest goal is that is not taken, or any if all are; 0 if none is."""
    free = np.where(taken & ~taken.all(axis=2, keepdims=True), _FAR, far).min(axis=2)
    return np.where(free == _FAR, 0, free).astype(np.int32)


class _SiteTable:
    """For each site and group of modules with the same goals a row, made when it is first met.

    A row has how far the site and the targets of its moves are from each goal, `_FAR` if there is
    no way or no move, and which goal each sensed slot is, -1 if none.
    """

    def __init__(self, knowledge: VectorKnowledge) -> None:
        self._system = system = knowledge.system
        groups: dict[object, int] = {}
        self._potentials: list[OwnPotential] = []
        self._groups: list[int] = []
        for module, (start, goals) in enumerate(
            zip(knowledge.starts, knowledge.goals, strict=True)
        ):
            own = InitialKnowledge(system, module, knowledge.modules, start, goals, RandomStream(0))
            group = groups.setdefault((goals, own.label), len(groups))
            if group == len(self._potentials):
                self._potentials.append(OwnPotential(own))
            self._groups.append(group)
        self._labels = [system.label_of(start) for start in knowledge.starts]
        self.goals = max(1, *(len(each.goals) for each in self._potentials))
        self._forget()

    def _forget(self) -> None:
        self._rows: dict[tuple[int, ...], int] = {}
        self.far = np.zeros((0, self._system.move_slots + 1, self.goals), np.int32)
        self.slots = np.zeros((0, self._system.sense_slots), np.int32)

    def rows(self, sites: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the row of each module, shape (E, n), from the numbers of their sites."""
        if self.far.nbytes > _BYTES_MAX:
            self._forget()
        found: list[int] = []
        for environment in sites.tolist():
            for module, numbers in enumerate(environment):
                key = (self._groups[module], *numbers)
                if key not in self._rows:
                    self._add(key, module)
                found.append(self._rows[key])
        return np.array(found, np.int64).reshape(sites.shape[:2])

    def _add(self, key: tuple[int, ...], module: int) -> None:
        system, goals = self._system, self._potentials[key[0]].goals
        row = self._rows[key] = len(self._rows)
        if row == len(self.far):
            room = ((0, row + _ROOM), (0, 0))
            self.far = np.pad(self.far, (*room, (0, 0)), constant_values=_FAR)
            self.slots = np.pad(self.slots, room, constant_values=-1)
        site = system.decode_site(key[1:], self._labels[module])
        targets = [site, *(move and move.target for move in system.moves(site))]
        for number, (_, far) in enumerate(goals):
            for slot, target in enumerate(targets):
                steps = None if target is None else far(target)
                self.far[row, slot, number] = _FAR if steps is None or steps < 0 else steps
        places = {place: number for number, (place, _) in enumerate(goals) if place is not None}
        near = system.sensed(system.place_of(site))
        self.slots[row, : len(near)] = [places.get(place, -1) for place in near]
