"""Orders of a leader as notes: where modules stand, what they do next, and what is done.

Modules repeat what they hear, so orders reach all modules that are connected by reach, and what is
done comes back. Whatever a module knows only grows: a later batch replaces an earlier one, and of
two notes about the same batch a module keeps all that either says. So notes may be late, come twice
or skip rounds, and the order in which they come does not matter. Before the first batch they elect
the leader by the same notes.

A batch is carried out in parallel: a move is due once the earlier moves of the batch that do not
commute with it are done. Moves that are due at the same time commute, so none is in the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from cubepath.agents.local.observation import SILENT, Note
from cubepath.agents.rules.waves import Election
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import SQUARES, Cell, Move
from cubepath.protocol.core.system import System

MOST_ORDERS = 16
"""The most moves of a batch."""
_UNKNOWN = SILENT + 1
"""Fills a note where a module's place is not known, or where there is no order."""


class Orders(NamedTuple):
    """What a module knows of the leader's orders.

    >>> one = Orders.unknown(2, Election(9, 0, 0b01)).standing(0, (5, 0))
    >>> two = Orders.unknown(2, Election(4, 1, 0b10)).standing(1, (6, 0))
    >>> both = one.merged(two)
    >>> one.complete, both.complete, both.cells, both.election.leader
    (False, True, ((5, 0), (6, 0)), 1)
    >>> ordered = both._replace(number=1, moves=((1, 3),))
    >>> ordered.merged(one) == ordered == Orders.of(ordered.note(), 2)
    True
    >>> ordered.complete, ordered.with_done(0).complete
    (False, True)
    """

    number: int
    """Of the batch; 0 while modules hear who leads, and where all stand."""
    done: int
    """Bit i is 1 if move i of the batch is done."""
    moves: tuple[tuple[int, int], ...]
    """The mover of each move, and its action where it stands then."""
    cells: tuple[Cell | None, ...]
    """Where each module stands before the batch, None if that is not known yet."""
    election: Election

    @classmethod
    def unknown(cls, modules: int, election: Election) -> Orders:
        """Return what a module knows at first."""
        return cls(0, 0, (), (None,) * modules, election)

    @classmethod
    @lru_cache(maxsize=1024)  # the same note is heard again and again
    def of(cls, note: Note, modules: int) -> Orders:
        """Read a note back."""
        elected = Election.note_length(modules)
        number, done, *rest = note[elected:]
        pairs = [
            None if pair[0] == _UNKNOWN else pair
            for pair in zip(rest[::2], rest[1::2], strict=True)
        ]
        moves = tuple(pair for pair in pairs[:MOST_ORDERS] if pair is not None)
        return cls(number, done, moves, tuple(pairs[MOST_ORDERS:]), Election.of(note[:elected]))

    def note(self) -> Note:
        """Return it as a note of `note_length` numbers."""
        none = (None,) * (MOST_ORDERS - len(self.moves))
        pairs = [pair or (_UNKNOWN, _UNKNOWN) for pair in (*self.moves, *none, *self.cells)]
        elected = self.election.note(len(self.cells))
        return (*elected, self.number, self.done, *(number for pair in pairs for number in pair))

    @property
    def complete(self) -> bool:
        """Return whether the leader and all places are known, and all moves are done."""
        settled = self.election.settled(len(self.cells))
        return settled and self.done == (1 << len(self.moves)) - 1

    def standing(self, module: int, cell: Cell) -> Orders:
        """Return it with the place of a module."""
        return self._replace(cells=(*self.cells[:module], cell, *self.cells[module + 1 :]))

    def with_done(self, order: int) -> Orders:
        """Return it with a move done."""
        return self._replace(done=self.done | 1 << order)

    def merged(self, other: Orders) -> Orders:
        """Return what both together know."""
        election = self.election.merged(other.election)
        if self.number != other.number:
            return max(self, other, key=lambda each: each.number)._replace(election=election)
        cells = (mine or its for mine, its in zip(self.cells, other.cells, strict=True))
        done = self.done | other.done
        return self._replace(done=done, cells=tuple(cells), election=election)


def note_length(modules: int) -> int:
    """Return the length of the notes of `Orders` from the number of modules."""
    return Election.note_length(modules) + 2 + 2 * MOST_ORDERS + 2 * modules


class DueMove(NamedTuple):
    """A move that is due: its place in the batch from 0, the mover's action, and the move."""

    order: int
    action: int
    move: Move


class OrderBatch:
    """The moves of a batch, which of them wait for which, and the `cells` that they lead to."""

    def __init__(self, system: System, orders: Orders) -> None:
        """Follow the moves one by one; the places of all modules are known."""
        self.cells = [cell for cell in orders.cells if cell is not None]
        self._orders = orders.moves
        self._moves: list[Move] = []
        self._waits: list[int] = []
        for mover, action in orders.moves:
            move = system.moves(self.cells[mover])[action - 1]
            if move is None:
                raise AssertionError(f"an order of no move: {mover}, {action}")
            waits = [not commute(earlier.action, move.action) for earlier in self._moves]
            self._waits.append(sum(waiting << index for index, waiting in enumerate(waits)))
            self._moves.append(move)
            self.cells = moved(self.cells, move)

    def due(self, module: int, done: int) -> DueMove | None:
        """Return the move that a module has to make, given those that are done; None if none."""
        for index, (mover, action) in enumerate(self._orders):
            if mover == module and not done >> index & 1:
                ready = not self._waits[index] & ~done
                return DueMove(index, action, self._moves[index]) if ready else None
        return None


def moved(cells: Sequence[Cell], move: Move) -> list[Cell]:
    """Return where modules stand after a move, in their order."""
    goes = {source: SQUARES.check(target) for source, target in move.motion}  # two numbers
    return [goes.get(cell, cell) for cell in cells]
