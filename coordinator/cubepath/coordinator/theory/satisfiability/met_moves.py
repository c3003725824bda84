"""Moves that a short path between two states could use, as arrays, found from both ends.

A move in round t of k has its local state before within t - 1 rounds of the start, and the one
after within k - t rounds of the goal. So one of the two lies within half of the rounds, and moves
are looked for only there: the lattice may be infinite. Rounds are counted as if moves never stood
in each other's way, which leaves out nothing that a path can do.

Of some groups of sites at most one, or exactly one, is on in every state: a vehicle is at one
vertex. Solvers do not see this from one round; it holds because it holds at the start and no move
breaks it. Groups are proposed by labels and places, and kept only if that is so.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from copy import copy
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability import literal_windows
from cubepath.coordinator.theory.satisfiability.literal_windows import (
    FREE,
    IN_TRACE,
    LiteralWindows,
    MoveArrays,
    windows_of,
)
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


_MOVES_A_STEP = 64


def window_bound(
    met: MetMoves, least: int, most: int, *, raised: Callable[[int], object] | None = None
) -> int:
    """Return the least number of rounds from `least` to `most` that the windows do not refute.

    No path between the ends of `met` has fewer cubes, if none has fewer than `least`. `raised` is
    called with each number that is refuted; what `met` spends may end this.

    Proof. A value is possible at a time only if the start reaches it by then, and the goal is
    reached from it in the rounds that are left, each as if moves never stood in each other's way.
    On a path every site has a value at every time, so where neither is possible there is no path.
    What fits into fewer rounds fits into more, by waiting first or last; so where all moves are
    known, and looking at many rounds finds no more of them, the least number is found by halving.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> window_bound(MetMoves(scene.system, (), scene.start_state, scene.goal), 0, 9)
    3
    """

    def refuted(rounds: int) -> bool:
        met.reach(rounds)
        met.spend(len(met.actions) // _MOVES_A_STEP)
        found = windows_of(met.arrays(), met.on(0), met.on(1), rounds, met.spend).refuted()
        if found and raised is not None:
            raised(rounds)
        return found

    stride, open_from = 1, most
    while least < open_from:
        rounds = min(least + stride - 1, open_from - 1)
        if refuted(rounds):
            least = rounds + 1
            stride *= 2 if met.complete and open_from == most else 1
        else:
            open_from = rounds
        if met.complete and open_from < most:
            stride = max(1, (open_from - least + 1) // 2)
    return least


class SiteGroup(NamedTuple):
    """Sites, by number, of which at most one is on, or with `exactly` one."""

    exactly: bool
    sites: tuple[int, ...]


def groups_of(met: MetMoves, moves: MoveArrays, windows: LiteralWindows) -> tuple[SiteGroup, ...]:
    """Return the groups that are proposed for the system and hold."""
    found: list[SiteGroup] = []
    on, able = met.on(0), windows.first <= windows.last
    for sites in met.proposed_groups():
        if len(sites) > 1:
            exactly = _kept(sites, moves, able)
            count = int(on[list(sites)].sum())
            if exactly is not None and count <= 1:
                found.append(SiteGroup(exactly and count == 1, sites))
    return tuple(found)


def _kept(sites: tuple[int, ...], moves: MoveArrays, able: NDArray[np.bool_]) -> bool | None:
    """Return whether moves keep the number of sites that are on; None if it could exceed one."""
    inside = np.zeros(int(moves.sites.max(initial=0)) + 1, dtype=np.bool_)
    inside[[site for site in sites if site < len(inside)]] = True
    places = np.flatnonzero(inside[moves.sites])
    action = np.searchsorted(moves.starts, places, side="right") - 1
    codes = moves.codes[places]
    count = len(moves.starts) - 1
    size = np.bincount(action, minlength=count)
    free = np.bincount(action, (codes & FREE) != 0, count) > 0
    keeps = True
    for way in (0, 1):
        some = able[way::2] & (size > 0)
        old = np.bincount(action, (codes >> way) & 1, count)
        new = np.bincount(action, (codes >> (1 - way)) & 1, count)
        if (some & (free | (new > 1))).any():
            return None
        fewer = new < old
        # None was on among those that it reads, which must be all of them.
        first = (new > old) & (old == 0) & (size == len(sites))
        if (some & ~((new == old) | fewer | first)).any():
            return None
        keeps = keeps and not (some & (new != old)).any()
    return keeps
