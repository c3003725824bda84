"""When a site can have a value, and when a move can be made, on a path of a given length.

A value is possible from some round after the start on, and up to some round before the goal: what
can be can stay. A move needs its local state before at the round's begin, which is possible only
then, and leads to the other, from which the goal must still be reached. Moves that fit nowhere are
left out, and everything is computed again, until nothing changes: the greatest fixpoint, which is
the same whatever the order. docs/proofs.md has the definition; Graphplan's levels (Blum and Furst
1997) are the forward half of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner

IN_TRACE, FREE = 4, 8
"""Flags of a site in a support; the two lowest bits are its values in the two local states."""


class MoveArrays(NamedTuple):
    """The supports of actions, one after another.

    The sites of action ``a`` are ``sites[starts[a]:starts[a + 1]]``, with their `codes`: bit 0 and
    bit 1 hold the values in its two local states, `IN_TRACE` and `FREE` say the rest. Its guards
    ``(p, q)``, if p is on then q is on, are rows of `guards`.
    """

    starts: Numbers
    sites: Numbers
    codes: Numbers
    guard_starts: Numbers
    guards: Numbers


Numbers = NDArray[np.int32]
NEVER = 1 << 30
"""Later than any round."""


class LiteralWindows(NamedTuple):
    """The windows of all values and directed moves on paths of `rounds` rounds.

    ``after[s, v]`` is the first time at which site s can have value v, and ``before[s, v]`` how
    many rounds before the end that is possible for the last time; `NEVER` if it is not. Directed
    move ``2 a + d``, action a from its local state d to the other, can be made in the rounds from
    `first` to `last`; it cannot be made at all if the first is greater.
    """

    rounds: int
    after: Numbers
    before: Numbers
    first: Numbers
    last: Numbers

    def value_possible(self) -> NDArray[np.bool_]:
        """Return whether each site can have each value at each time; shape (sites, 2, times)."""
        times = np.arange(self.rounds + 1)
        early = self.after[:, :, None] <= times
        return early & (times <= self.rounds - self.before[:, :, None])

    def refuted(self) -> bool:
        """Return whether some site is left without a value at some time: then there is no path."""
        begins, ends = self.after, self.rounds - self.before
        some = begins <= ends
        whole = some & (begins <= 0) & (ends >= self.rounds)
        for one in (0, 1):
            two = 1 - one
            joined = (begins[:, one] <= 0) & (begins[:, two] <= ends[:, one] + 1)
            whole[:, 0] |= some.all(axis=1) & joined & (ends[:, two] >= self.rounds)
        return not bool(whole.any(axis=1).all())


def first_times(moves: MoveArrays, on: NDArray[np.bool_], rounds: int) -> Numbers:
    """Return the first time up to `rounds` at which each value is possible; shape (sites, 2)."""
    count = 2 * (len(moves.starts) - 1)
    found = _at_end(on)
    _spread(*moves, np.ones(count, dtype=np.bool_), rounds, found, np.empty(count, dtype=np.int32))
    return found


def windows_of(
    moves: MoveArrays,
    start: NDArray[np.bool_],
    goal: NDArray[np.bool_],
    rounds: int,
    spend: Callable[[int], object] = lambda _steps: None,
) -> LiteralWindows:
    """Return the windows of a path of `rounds` rounds; `start` and `goal` have shape (sites,).

    `spend` is called with 0 whenever all moves were looked at; what it raises ends this.
    """
    count = 2 * (len(moves.starts) - 1)
    alive = np.ones(count, dtype=np.bool_)
    first, last = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    while True:
        after, before = _at_end(start), _at_end(goal)
        _spread(*moves, alive, rounds, after, first)
        spend(0)
        # Backwards every move is made from its local state after to the one before.
        flipped = np.ascontiguousarray(alive.reshape(-1, 2)[:, ::-1]).ravel()
        _spread(*moves, flipped, rounds, before, last)
        spend(0)
        last = rounds + 1 - last.reshape(-1, 2)[:, ::-1].ravel()
        left = alive & (first <= last)
        if np.array_equal(left, alive):
            return LiteralWindows(rounds, after, before, first, last)
        alive = left


def _at_end(on: NDArray[np.bool_]) -> Numbers:
    found = np.full((len(on), 2), NEVER, dtype=np.int32)
    found[np.arange(len(on)), on.astype(np.int32)] = 0
    return found


@compiled
def _spread(
    starts: Numbers,
    sites: Numbers,
    codes: Numbers,
    guard_starts: Numbers,
    guards: Numbers,
    alive: NDArray[np.bool_],
    rounds: int,
    found: Numbers,
    first: Numbers,
) -> None:
    """Fill in when values become possible, and the round from which each directed move is.

    `found` has the values of the end from which this begins. Layer by layer: in the first, all
    moves are looked at; later those at whose sites a value became possible in the layer before.
    """
    first[:] = NEVER
    users, by_site = _users(starts, sites, guard_starts, guards, len(found))
    waiting = np.empty(len(first), dtype=np.int32)
    count = 0
    for move in range(len(first)):
        if alive[move]:
            waiting[count] = move
            count += 1
    looked = np.zeros(len(first), dtype=np.int32)
    changed = np.empty(2 * len(found), dtype=np.int32)
    for layer in range(1, rounds + 1):
        changes = 0
        for index in range(count):
            move = waiting[index]
            action, way = move // 2, move % 2
            ready = True
            for place in range(starts[action], starts[action + 1]):
                code = codes[place]
                if not code & FREE and found[sites[place], (code >> way) & 1] >= layer:
                    ready = False
                    break
            if ready:
                for place in range(guard_starts[action], guard_starts[action + 1]):
                    if found[guards[place, 0], 0] >= layer and found[guards[place, 1], 1] >= layer:
                        ready = False
                        break
            if not ready:
                continue
            first[move] = layer
            for place in range(starts[action], starts[action + 1]):
                code = codes[place]
                value = (code >> (1 - way)) & 1
                if not code & FREE and found[sites[place], value] > layer:
                    found[sites[place], value] = layer
                    changed[changes] = sites[place]
                    changes += 1
        count = 0
        for index in range(changes):
            site = changed[index]
            for place in range(users[site], users[site + 1]):
                for move in (2 * by_site[place], 2 * by_site[place] + 1):
                    if alive[move] and first[move] == NEVER and looked[move] < layer:
                        looked[move] = layer
                        waiting[count] = move
                        count += 1
        if not count:
            break


@inner
def _users(
    starts: Numbers, sites: Numbers, guard_starts: Numbers, guards: Numbers, count: int
) -> tuple[Numbers, Numbers]:
    """Return the actions with a site in their support or guards: of site s, users[s:s + 1]."""
    users = np.zeros(count + 1, dtype=np.int32)
    for site in sites:
        users[site + 1] += 1
    for one, other in guards:
        users[one + 1] += 1
        users[other + 1] += 1
    for site in range(count):
        users[site + 1] += users[site]
    free = users[:-1].copy()
    by_site = np.empty(users[count], dtype=np.int32)
    for action in range(len(starts) - 1):
        for place in range(starts[action], starts[action + 1]):
            by_site[free[sites[place]]] = action
            free[sites[place]] += 1
        for place in range(guard_starts[action], guard_starts[action + 1]):
            for site in guards[place]:
                by_site[free[site]] = action
                free[site] += 1
    return users, by_site
