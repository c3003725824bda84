"""The moves that a refutation is about, found again from the system or the listed actions.

Room: coordinator; touches nothing. Part of `cubepath verify`: a proof names moves, and here all
moves are found that any schedule could use, by asking the system layer by layer from both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain

import numpy as np

from cubepath.coordinator.verification.refutation_windows import (
    IN_TRACE,
    IS_FREE,
    Flags,
    Longs,
    Table,
    Windows,
    earliest_times,
    turned,
    windows_of,
)
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.ordinals import Ordinals
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import System


class Moves:
    """All actions that any schedule of so many rounds could use, and the windows of their moves.

    `sites` and `actions` have their numbers, and `table` the supports.
    """

    def __init__(self, start: frozenset[Site], goal: frozenset[Site]) -> None:
        """Begin without moves; `start` and `goal` are complete states."""
        self.actions = Ordinals[Action]()
        self.sites = Ordinals[Site]()
        self.start, self.goal = start, goal
        for site in in_order(start | goal):
            _ = self.sites[site]
        self._listed: list[Action] = []
        self.table = _table([], self.sites)

    def take(self, actions: Iterable[Action]) -> None:
        """Take actions that are not known yet."""
        fresh: list[Action] = []
        for action in actions:
            known = len(self.actions)
            if self.actions[action] == known:
                fresh.append(action)
        if fresh:
            self._listed += fresh
            self.table = _joined(self.table, _table(fresh, self.sites))

    def action(self, number: int) -> Action:
        """Return an action by its number."""
        return self._listed[number]

    def find(
        self, system: System, rounds: int, tell: Callable[[int], object] | None = None
    ) -> Flags:
        """Find the moves that can be met within half of the rounds from either end.

        Return which directed moves were. A move that can be made in round t of a schedule is met
        within t layers from the start and within ``rounds + 1 - t`` layers from the goal. One of
        these is in the half that is explored from there.
        """
        halves = (rounds + 1) // 2, rounds // 2
        ask: Callable[[Site], Iterable[Move]] = system.discovery() or system.moves_at
        asked: set[Site] = set()
        for state, half in zip((self.start, self.goal), halves, strict=True):
            self._explore(state, half, asked, ask, tell)
        every = np.ones(2 * len(self._listed), dtype=np.bool_)
        _, ahead = earliest_times(self.table, self._flags(self.start), every)
        _, behind = earliest_times(self.table, self._flags(self.goal), every)
        return (ahead <= halves[0]) | turned(behind <= halves[1])

    def _explore(
        self,
        state: frozenset[Site],
        layers: int,
        asked: set[Site],
        ask: Callable[[Site], Iterable[Move]],
        tell: Callable[[int], object] | None,
    ) -> None:
        for layer in range(layers):
            every = np.ones(2 * len(self._listed), dtype=np.bool_)
            literals, _ = earliest_times(self.table, self._flags(state), every)
            names = list(self.sites)
            near = [names[site] for site in np.flatnonzero(literals[1::2] <= layer).tolist()]
            fresh = [site for site in near if site not in asked]
            asked.update(fresh)
            self.take(move.action for site in fresh for move in ask(site))
            if tell is not None:
                tell(len(fresh))

    def _flags(self, state: frozenset[Site]) -> Flags:
        """Return of each site whether it is on in a state."""
        return np.fromiter((site in state for site in self.sites), np.bool_, len(self.sites))

    def windows(self, rounds: int, usable: Flags) -> Windows:
        """Return the windows of these moves; `usable` is by directed move."""
        return windows_of(
            self.table, self._flags(self.start), self._flags(self.goal), rounds, usable
        )

    def move_text(self, move: int) -> str:
        """Return a directed move in words."""
        action, end = self._listed[move >> 1], move & 1
        gone = in_order(action.ends[end] - action.ends[1 - end])
        come = in_order(action.ends[1 - end] - action.ends[end])
        name = action.label or site_text(in_order(action.trace))
        return f"{name} (off: {site_text(gone)}, on: {site_text(come)})"


def _table(actions: list[Action], numbers: Ordinals[Site]) -> Table:
    """Return the supports of actions; sites that are new get numbers, in canonical order."""
    fresh = set(chain.from_iterable(action.support for action in actions)) - numbers.keys()
    for site in in_order(fresh):
        _ = numbers[site]
    count = len(numbers)

    def keys(parts: list[frozenset[Site]]) -> Longs:
        """Return ``action * count + site`` for each site of each part, in order."""
        sizes = np.fromiter(map(len, parts), np.int64, len(parts))
        flat = np.fromiter(map(numbers.__getitem__, chain.from_iterable(parts)), np.int64)
        return np.sort(np.repeat(np.arange(len(parts)), sizes) * count + flat)

    support = keys([action.support for action in actions])
    says = np.zeros(len(support), dtype=np.int8)
    for bit, part in (
        (1, keys([action.ends[0] for action in actions])),
        (2, keys([action.ends[1] for action in actions])),
        (IN_TRACE, keys([action.trace for action in actions])),
        (IS_FREE, keys([action.free for action in actions])),
    ):
        says[np.searchsorted(support, part)] |= bit
    guards = [sorted((numbers[a], numbers[b]) for a, b in action.guards) for action in actions]
    pairs = list(chain.from_iterable(guards))
    return Table(
        _starts([len(action.support) for action in actions]),
        (support % max(count, 1)).astype(np.int32),
        says,
        _starts([len(each) for each in guards]),
        np.array(pairs, dtype=np.int32).reshape(-1, 2),
    )


def _starts(sizes: list[int]) -> Longs:
    return np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(sizes, dtype=np.int64)))


def _joined(one: Table, other: Table) -> Table:
    """Return the actions of one table and then those of the other."""
    return Table(
        np.concatenate((one.starts, other.starts[1:] + one.starts[-1])),
        np.concatenate((one.sites, other.sites)),
        np.concatenate((one.says, other.says)),
        np.concatenate((one.guard_starts, other.guard_starts[1:] + one.guard_starts[-1])),
        np.concatenate((one.guards, other.guards)),
    )
