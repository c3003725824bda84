"""When each site can be on or off, and in which rounds each move can be made, between two states.

Part of `cubepath verify`: nothing here is shared with the code that makes proofs. The definitions
are those of docs/proofs.md: the earliest time of each literal, forwards from the start and
backwards from the goal, among the moves whose windows are not empty.

A *literal* is ``2 * site + value``. A *directed move* is ``2 * action + end``: the action, used
from its local state `end`.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled

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

        Where there is one, there is no schedule of so many rounds.
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
    """Fill in the times: layer by layer, each move as soon as the last that it needs is reached.

    A guard needs that its first site can be off or that its second can be on.
    """
    starts, sites, says, guard_starts, guards = table
    actions = len(starts) - 1
    # By literal the places that wait for it: moves, or guards of moves with a mark.
    waiting_at = np.zeros(len(literals) + 1, dtype=np.int64)
    for action in range(actions):
        for end in range(2):
            if not usable[2 * action + end]:
                continue
            for at in range(starts[action], starts[action + 1]):
                if not says[at] & IS_FREE:
                    waiting_at[2 * sites[at] + (says[at] >> end & 1) + 1] += 1
            for at in range(guard_starts[action], guard_starts[action + 1]):
                waiting_at[2 * guards[at, 0] + 1] += 1
                waiting_at[2 * guards[at, 1] + 2] += 1
    for literal in range(len(literals)):
        waiting_at[literal + 1] += waiting_at[literal]
    fill = waiting_at[:-1].copy()
    waiting = np.empty(waiting_at[-1], dtype=np.int32)
    guard = np.empty(waiting_at[-1], dtype=np.int32)
    missing = np.zeros(2 * actions, dtype=np.int32)
    for action in range(actions):
        for end in range(2):
            move = 2 * action + end
            if not usable[move]:
                continue
            for at in range(starts[action], starts[action + 1]):
                if not says[at] & IS_FREE:
                    literal = 2 * sites[at] + (says[at] >> end & 1)
                    waiting[fill[literal]] = move
                    guard[fill[literal]] = -1
                    fill[literal] += 1
                    missing[move] += 1
            for at in range(guard_starts[action], guard_starts[action + 1]):
                for literal in (2 * guards[at, 0], 2 * guards[at, 1] + 1):
                    waiting[fill[literal]] = move
                    guard[fill[literal]] = 2 * at + end
                    fill[literal] += 1
                missing[move] += 1
    held = np.zeros(2 * len(guards), dtype=np.bool_)
    queue = np.empty(len(literals), dtype=np.int32)
    tail = 0
    for literal in range(len(literals)):
        if literals[literal] == 0:
            queue[tail] = literal
            tail += 1
    reached = np.empty(2 * actions, dtype=np.int32)
    for move in range(2 * actions):
        if usable[move] and missing[move] == 0:
            moves[move] = 1
    # Moves that need nothing come first, in the place of a literal that is reached at time 0.
    head = -1
    while head < tail:
        count, now = 0, 0
        if head < 0:
            for move in range(2 * actions):
                if moves[move] == 1:
                    reached[count] = move
                    count += 1
        else:
            literal = queue[head]
            now = literals[literal]
            for at in range(waiting_at[literal], waiting_at[literal + 1]):
                if guard[at] >= 0:
                    if held[guard[at]]:
                        continue
                    held[guard[at]] = True
                move = waiting[at]
                missing[move] -= 1
                if missing[move] == 0:
                    moves[move] = now + 1
                    reached[count] = move
                    count += 1
        head += 1
        for place in range(count):
            move = reached[place]
            action, end = move >> 1, move & 1
            for at in range(starts[action], starts[action + 1]):
                before = says[at] >> end & 1
                after = says[at] >> (1 - end) & 1
                if before != after and literals[2 * sites[at] + after] == NEVER:
                    literals[2 * sites[at] + after] = now + 1
                    queue[tail] = 2 * sites[at] + after
                    tail += 1
