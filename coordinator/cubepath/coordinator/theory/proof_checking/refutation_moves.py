"""The moves that a refutation is about, found again from the system or the listed actions.

Part of `cubepath verify`; nothing is shared with the code that makes proofs. A proof names moves,
and here all moves are found that any schedule could use, by asking the system layer by layer from
both ends. Of each action only numbers are kept, so that millions of them fit into memory. The
windows are those of docs/proofs.md: the earliest time of each literal, forwards from the start and
backwards from the goal, among the moves whose windows are not empty.

A *literal* is ``2 * site + value``. A *directed move* is ``2 * action + end``: the action, used
from its local state `end`.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.sites import Ordinals, Site, in_order, site_text
from cubepath.protocol.core.system import System


class Moves:
    """All actions that any schedule of this many rounds could use, and the windows of their moves.

    `sites` has the numbers of sites, and `numbered` those of the actions that have a name in the
    proof, by their positions there: -1 for what was not found.
    """

    def __init__(
        self,
        start: frozenset[Site],
        goal: frozenset[Site],
        listed: Sequence[GeneratorPlacement | Action],
    ) -> None:
        """Begin without moves, between two states; `listed` are the moves of the proof."""
        self.sites = Ordinals[Site]()
        self.start, self.goal = start, goal
        for site in in_order(start | goal):
            _ = self.sites[site]
        self._places = {
            (move.generator, move.at): place
            for place, move in enumerate(listed)
            if isinstance(move, GeneratorPlacement)
        }
        self.numbered = [-1] * len(listed)
        # By the bytes of its row in the table; equal actions have equal rows.
        self._rows: dict[bytes, int] = {}
        self._starts, self._guard_starts = array("q", [0]), array("q", [0])
        self._sites, self._guards, self._says = array("i"), array("i"), array("b")

    def take(self, action: Action) -> int:
        """Return the number of an action, which is the next one if it is not known yet."""
        sites, says, guards = self._row(action, self.sites.__getitem__)
        known = len(self._rows)
        number = self._rows.setdefault(_key(sites, says, guards), known)
        if number == known:
            self._sites.extend(sites)
            self._says.extend(says)
            self._guards.extend(guards)
            self._starts.append(len(self._sites))
            self._guard_starts.append(len(self._guards) // 2)
        return number

    def number(self, action: Action) -> int:
        """Return the number of an action, -1 if it was not found."""
        if not self.sites.keys() >= action.support:
            return -1
        return self._rows.get(_key(*self._row(action, self.sites.__getitem__)), -1)

    @staticmethod
    def _row(
        action: Action, number: Callable[[Site], int]
    ) -> tuple[list[int], list[int], list[int]]:
        """Return the support of an action and what it says of each site, and its guards."""
        support, (first, second) = in_order(action.support), action.ends
        says = [
            (site in first)
            | (site in second) << 1
            | (IN_TRACE if site in action.trace else IS_FREE if site in action.free else 0)
            for site in support
        ]
        sites = [number(site) for site in support]
        pairs = sorted((number(one), number(other)) for one, other in action.guards)
        return sites, says, [site for pair in pairs for site in pair]

    @property
    def table(self) -> SupportTable:
        """The supports of all actions so far."""
        return SupportTable(
            np.array(self._starts, dtype=np.int64),
            np.array(self._sites, dtype=np.int32),
            np.array(self._says, dtype=np.int8),
            np.array(self._guard_starts, dtype=np.int64),
            np.array(self._guards, dtype=np.int32).reshape(-1, 2),
        )

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
        table, every = self.table, np.ones(2 * len(self._rows), dtype=np.bool_)
        _, ahead = earliest_times(table, self._flags(self.start), every)
        _, behind = earliest_times(table, self._flags(self.goal), every)
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
            every = np.ones(2 * len(self._rows), dtype=np.bool_)
            literals, _ = earliest_times(self.table, self._flags(state), every)
            names = list(self.sites)
            near = [names[site] for site in np.flatnonzero(literals[1::2] <= layer).tolist()]
            fresh = [site for site in near if site not in asked]
            asked.update(fresh)
            for site in fresh:
                for move in ask(site):
                    number = self.take(move.action)
                    place = self._places.get((move.generator, move.at))
                    if place is not None:
                        self.numbered[place] = number
            if tell is not None:
                tell(len(fresh))

    def _flags(self, state: frozenset[Site]) -> Flags:
        """Return of each site whether it is on in a state."""
        return np.fromiter((site in state for site in self.sites), np.bool_, len(self.sites))

    def windows(self, table: SupportTable, rounds: int, usable: Flags) -> ProofWindows:
        """Return the windows of the moves of a table; `usable` is by directed move."""
        return windows_of(table, self._flags(self.start), self._flags(self.goal), rounds, usable)

    def move_text(self, move: int) -> str:
        """Return a directed move in words."""
        action, end = move >> 1, move & 1
        names, part = list(self.sites), slice(*self._starts[action : action + 2])
        support = [names[site] for site in self._sites[part]]
        says = list(zip(support, self._says[part], strict=True))
        gone = in_order(site for site, bits in says if bits & 3 == 1 << end)
        come = in_order(site for site, bits in says if bits & 3 == 2 >> end)
        trace = in_order(site for site, bits in says if bits & IN_TRACE)
        return f"{site_text(trace)} (off: {site_text(gone)}, on: {site_text(come)})"


def _key(sites: list[int], says: list[int], guards: list[int]) -> bytes:
    return array("i", (len(sites), *sites, *says, *guards)).tobytes()


Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Flags = NDArray[np.bool_]
_Kind = TypeVar("_Kind", bound=np.generic)

NEVER = 1 << 29
"""The earliest time of what never happens."""
IN_TRACE, IS_FREE = 4, 8
"""Of a site in a support, beside bits 1 and 2: whether it is on in local state 0 and 1."""


class SupportTable(NamedTuple):
    """The supports of actions, by numbers of sites.

    The support of action ``a`` is ``sites[starts[a]:starts[a + 1]]``, `says` has the bits of each
    site in it, and ``guards[guard_starts[a]:guard_starts[a + 1]]`` are its guards, as pairs.
    """

    starts: Longs
    sites: Ints
    says: NDArray[np.int8]
    guard_starts: Longs
    guards: Ints


class ProofWindows(NamedTuple):
    """Between two states in `rounds` rounds: times of literals and rounds of directed moves.

    `ahead` and `behind` are the earliest times forwards from the start and backwards from the goal,
    by literal. `first` and `last` are the first and the last round of each directed move; a move
    that cannot be made has ``first > last``.
    """

    rounds: int
    ahead: Ints
    behind: Ints
    first: Ints
    last: Ints

    def refuting_site(self) -> int | None:
        """Return a site that can have neither value at some time, None if there is none.

        Where there is one, there is no schedule of this many rounds.
        """
        begin = self.ahead.reshape(-1, 2)
        end = self.rounds - self.behind.reshape(-1, 2)
        possible = begin <= end
        both = (
            (begin.min(axis=1) == 0)
            & (end.max(axis=1) == self.rounds)
            & (begin.max(axis=1) <= end.min(axis=1) + 1)
        )
        whole = ((begin == 0) & (end == self.rounds)).any(axis=1)
        bare = np.flatnonzero(~np.where(possible.all(axis=1), both, whole))
        return int(bare[0]) if len(bare) else None


def windows_of(
    table: SupportTable, start: Flags, goal: Flags, rounds: int, usable: Flags
) -> ProofWindows:
    """Return the windows of the greatest set of `usable` moves whose windows are not empty.

    `start` and `goal` say of each site whether it is on; `usable` is by directed move.
    """
    while True:
        ahead, first = earliest_times(table, start, usable)
        behind, back = earliest_times(table, goal, turned(usable))
        last = (rounds + 1 - turned(back)).astype(np.int32)
        left = usable & (first <= last)
        if (left == usable).all():
            first[~usable], last[~usable] = NEVER, -NEVER
            return ProofWindows(rounds, ahead, behind, first, last)
        usable = left


def turned(by_move: NDArray[_Kind]) -> NDArray[_Kind]:
    """Return the values of the moves the other way round."""
    return by_move.reshape(-1, 2)[:, ::-1].ravel()


def earliest_times(table: SupportTable, state: Flags, usable: Flags) -> tuple[Ints, Ints]:
    """Return the earliest time of each literal and the earliest round of each directed move."""
    literals = np.full(2 * len(state), NEVER, dtype=np.int32)
    literals[2 * np.arange(len(state)) + state] = 0
    moves = np.full(len(usable), NEVER, dtype=np.int32)
    _earliest(table, usable, literals, moves)
    return literals, moves


@compiled
def _earliest(table: SupportTable, usable: Flags, literals: Ints, moves: Ints) -> None:
    """Fill in the times, round by round: a move is made as soon as all that it needs is possible.

    A guard needs that its first site can be off or that its second can be on.
    """
    starts, sites, says, guard_starts, guards = table
    left = np.flatnonzero(usable)
    count, now, more = len(left), 0, True
    while more:
        now += 1
        more, waiting = False, 0
        for place in range(count):
            move = left[place]
            action, end = move >> 1, move & 1
            ready = True
            for at in range(starts[action], starts[action + 1]):
                before = says[at] >> end & 1
                if not says[at] & IS_FREE and literals[2 * sites[at] + before] >= now:
                    ready = False
                    break
            for at in range(guard_starts[action], guard_starts[action + 1]):
                if literals[2 * guards[at, 0]] >= now and literals[2 * guards[at, 1] + 1] >= now:
                    ready = False
            if not ready:
                left[waiting] = move
                waiting += 1
                continue
            moves[move] = now
            for at in range(starts[action], starts[action + 1]):
                before, after = says[at] >> end & 1, says[at] >> (1 - end) & 1
                if before != after and literals[2 * sites[at] + after] == NEVER:
                    literals[2 * sites[at] + after] = now
                    more = True
        count = waiting
