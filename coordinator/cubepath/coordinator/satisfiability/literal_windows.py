"""When a site can have a value, and when a move can be made, on a path of a given length.

A value is possible from some round after the start on, and up to some round before the goal: what
can be can stay. A move needs its local state before at the round's begin, which is possible only
then, and leads to the other, from which the goal must still be reached. Moves that fit nowhere are
left out, and everything is computed again, until nothing changes: the greatest fixpoint, which is
the same whatever the order. docs/proofs.md has the definition; Graphplan's levels (Blum and Furst
1997) are the forward half of it.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.satisfiability.move_arrays import FREE, MoveArrays
from cubepath.protocol.compiled import compiled

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


def first_times(moves: MoveArrays, on: NDArray[np.bool_], rounds: int) -> Numbers:
    """Return the first time up to `rounds` at which each value is possible; shape (sites, 2)."""
    count = 2 * (len(moves.starts) - 1)
    found = _at_end(on)
    _spread(*moves, np.ones(count, dtype=np.bool_), rounds, found, np.empty(count, dtype=np.int32))
    return found


def windows_of(
    moves: MoveArrays, start: NDArray[np.bool_], goal: NDArray[np.bool_], rounds: int
) -> LiteralWindows:
    """Return the windows of a path of `rounds` rounds; `start` and `goal` have shape (sites,)."""
    count = 2 * (len(moves.starts) - 1)
    alive = np.ones(count, dtype=np.bool_)
    first, last = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    while True:
        after, before = _at_end(start), _at_end(goal)
        _spread(*moves, alive, rounds, after, first)
        # Backwards every move is made from its local state after to the one before.
        flipped = np.ascontiguousarray(alive.reshape(-1, 2)[:, ::-1]).ravel()
        _spread(*moves, flipped, rounds, before, last)
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

    `found` has the values of the end from which this begins. Layer by layer: in each, all moves
    whose local state before was possible in an earlier one.
    """
    first[:] = NEVER
    waiting = np.empty(len(first), dtype=np.int32)
    count = 0
    for move in range(len(first)):
        if alive[move]:
            waiting[count] = move
            count += 1
    for layer in range(1, rounds + 1):
        left = 0
        changed = False
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
                waiting[left] = move
                left += 1
                continue
            first[move] = layer
            for place in range(starts[action], starts[action + 1]):
                code = codes[place]
                value = (code >> (1 - way)) & 1
                if not code & FREE and found[sites[place], value] > layer:
                    found[sites[place], value] = layer
                    changed = True
        count = left
        if not changed:
            break
