"""Moves that a short path between two states could use, as arrays, found from both ends.

A move in round t of k has its local state before within t - 1 rounds of the start, and the one
after within k - t rounds of the goal. So one of the two lies within half of the rounds, and moves
are looked for only there: the lattice may be infinite. Rounds are counted as if moves never stood
in each other's way, which leaves out nothing that a path can do.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from copy import copy
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability import literal_windows
from cubepath.coordinator.theory.satisfiability.move_arrays import FREE, IN_TRACE, MoveArrays
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import System

Numbers = NDArray[np.int32]


class MetMoves:
    """Sites and actions by number, as many as paths of a given length could use.

    `sites` and `actions` hold them, `names` what the system calls each action (None without one).
    """

    def __init__(
        self,
        system: System | None,
        listed: Iterable[Action],
        start: State,
        goal: State,
        *,
        spend: Callable[[int], object] = lambda _steps: None,
    ) -> None:
        """Take the moves of `system`, or without one the `listed` actions.

        `spend` is called with the number of sites or actions looked at; what it raises ends that.
        """
        self.spend = spend
        self.sites: list[Site] = []
        self.actions: list[Action] = []
        self.names: list[GeneratorPlacement | None] = []
        self._place: dict[Site, int] = {}
        self._number: dict[Action, int] = {}
        self._starts, self._guard_starts = array("i", [0]), array("i", [0])
        self._sites, self._codes, self._guards = array("i"), array("i"), array("i")
        self._system = system
        self._ask = None if system is None else system.discovery() or system.moves_at
        self._asked: set[int] = set()
        self._depth = 0
        self.ends = tuple(tuple(map(self._site, in_order(state))) for state in (start, goal))
        if system is None:
            for action in dict.fromkeys(listed):
                self.spend(1)
                self._add(action, None)

    def between(
        self, start: State, goal: State, *, spend: Callable[[int], object] = lambda _steps: None
    ) -> Self:
        """Return the moves of paths between two other states.

        What one of them learns of sites and moves, all know, so that it is learned once.
        """
        found = copy(self)
        found.spend, found._depth = spend, 0  # noqa: SLF001 - of this class
        found.ends = tuple(tuple(map(self._site, in_order(state))) for state in (start, goal))
        return found

    @property
    def complete(self) -> bool:
        """Return whether all moves are known, however many rounds a path has."""
        return self._ask is None

    def name_of(self, action: Action) -> GeneratorPlacement | None:
        """Return what the system calls an action, None if it was not met."""
        number = self._number.get(action)
        return None if number is None else self.names[number]

    def reach(self, rounds: int) -> None:
        """Find all moves that paths of up to so many rounds could use."""
        half = -(-rounds // 2)
        if self._ask is None or half <= self._depth:
            return
        for end in (0, 1):
            for layer in range(half):
                self._ask_about(end, layer, self._ask)
        self._depth = half

    def _ask_about(self, end: int, layer: int, moves_at: Callable[[Site], Iterable[Move]]) -> None:
        """Learn the moves at all sites that may be on so many rounds from one end."""
        first = literal_windows.first_times(self.arrays(), self.on(end), layer)
        self.spend(0)
        for site in np.flatnonzero(first[:, 1] <= layer).tolist():
            if site in self._asked:
                continue
            self.spend(1)
            for move in moves_at(self.sites[site]):
                self._add(move.action, GeneratorPlacement(move.generator, move.at))
            # Not before: if it ends in between, the site is asked about once more.
            self._asked.add(site)

    def on(self, end: int) -> NDArray[np.bool_]:
        """Return which sites are on at the start (0) or the goal (1); shape (sites,)."""
        found = np.zeros(len(self.sites), dtype=np.bool_)
        found[list(self.ends[end])] = True
        return found

    def arrays(self) -> MoveArrays:
        """Return the supports of all actions that are known."""
        return MoveArrays(
            np.array(self._starts, dtype=np.int32),
            np.array(self._sites, dtype=np.int32),
            np.array(self._codes, dtype=np.int32),
            np.array(self._guard_starts, dtype=np.int32),
            np.array(self._guards, dtype=np.int32).reshape(-1, 2),
        )

    def _site(self, site: Site) -> int:
        found = self._place.setdefault(site, len(self.sites))
        if found == len(self.sites):
            self.sites.append(site)
        return found

    def _add(self, action: Action, name: GeneratorPlacement | None) -> None:
        if action in self._number:
            return
        self._number[action] = len(self.actions)
        self.actions.append(action)
        self.names.append(name)
        first, second = action.ends
        for site in in_order(action.support):
            code = (site in first) | (site in second) << 1
            if site in action.trace:
                code |= IN_TRACE
            elif site in action.free:
                code |= FREE
            self._sites.append(self._site(site))
            self._codes.append(code)
        self._starts.append(len(self._sites))
        for one, other in sorted(action.guards, key=site_text):
            self._guards.extend((self._site(one), self._site(other)))
        self._guard_starts.append(len(self._guards) // 2)

    def proposed_groups(self) -> list[tuple[int, ...]]:
        """Return groups of sites of which one at most may be on: those of a label, or a place."""
        system = self._system
        if system is None or system.labels is None:
            return []
        found: dict[tuple[str, Site], list[int]] = {}
        for number, site in enumerate(self.sites):
            found.setdefault(("label", system.label_of(site)), []).append(number)
            found.setdefault(("place", system.place_of(site)), []).append(number)
        return [tuple(group) for group in found.values()]
