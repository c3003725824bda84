"""The rule `leader`: a module is elected, hears where all stand, and orders the way to the goal.

Source: own. Kostitsyna, Liedtke and Scheideler (Distributed rhombus formation of sliding squares,
SSS 2025, arXiv 2508.09638) move squares by a leader with constant memory. There one square turns
round a corner, and so they reach a rhombus from every shape. Here only two in a row can, and the
algorithm does not carry over: nothing leads out of a straight line, and a hole that is closed at
its corners stays one. By enumeration, the shapes of 3 to 9 squares that are no straight line and
have no such hole all reach one another, if shapes that differ by a translation count as one. So the
leader here searches, and its memory is not constant.

*Hearing.* At first every module says where it and all others stand, and the least rank, as far as
it has heard. No module moves before the first order, so what it says stays true.
*Electing.* A module that knows all places has heard all ranks. By `Election`, the module of the
least one is the leader, and no other gives orders, even while modules that have not heard of it see
others move.
*Searching.* The leader looks for a path of single moves to the goal by `TwoSidedSearch`,
`EXPANDED` states a round, guided by `shape_estimate`.
*Ordering.* It says the next moves of the path as a batch of `Orders`, which others repeat. A module
makes its move once it knows that all earlier moves of the batch which do not commute with it are
done, and says then that it is done. When the leader has heard that all are, it says the next batch.

It senses only whether a move is legal. Notes have 36 numbers, two for each module, and one for 31.
A module remembers one note; the leader also the states that it has met, and the path.

Guarantee. If the modules stay connected by reach, as those of catalogues that keep the topology do,
and finitely many states can be reached, as in a box, then the leader finds a path if there is one
and `PATIENCE` suffices, and the modules follow it, under hesitation and lost claims. For while a
move is due, all that are made commute with it. So it stays legal until it is made, its mover stands
at the target only then, no claim is lost, and in a round without hesitation a move is made or news
goes one hop further: where D hops cross the shape, L moves take at most (1 + D) L rounds, D for
each batch, and those of the search. The path need not be the shortest.

Failure. The leader gives up when one side of the search has met all it can, so there is no path,
or after `PATIENCE` rounds in which it heard nothing new; so does a module that has heard of no
lesser rank. In open hexagonal space only the latter may end the search.

*Without rounds* a note is a register. A module writes first what it has heard, and makes a move in
one commit with the note that it is done. Registers stay true, so late views only delay; a module
that is started again finds all it needs there, and a leader repeats its search. There it only gives
up while it searches, since others may be slow.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.orders import (
    MOST_ORDERS,
    DueMove,
    OrderBatch,
    Orders,
    moved,
    note_length,
)
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, RuleType
from cubepath.agents.rules.two_sided_search import TwoSidedSearch
from cubepath.agents.rules.waves import Election
from cubepath.protocol.core.actions import State, apply
from cubepath.protocol.core.catalogue import HEXAGONS, SQUARES, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System

EXPANDED = 32
"""The most states that the leader expands in a round."""
PATIENCE = 1000
"""After this many rounds without progress the leader gives up."""


def shape_estimate(goal: State) -> Callable[[State], int]:
    """Return how far shapes of as many cells seem to be from the goal, in half moves.

    This is 2 for each step in the cheapest way to take the coordinates of the cells to those of the
    goal, for each axis alone, and 8 for each cell of the goal that is free.

    >>> estimate = shape_estimate({(0, 0), (1, 0)})
    >>> estimate({(0, 0), (1, 0)}), estimate({(0, 0), (0, 1)})
    (0, 12)
    """

    def along(cells: State) -> list[list[int]]:
        return [sorted(axis) for axis in zip(*cells, strict=True)]

    wanted = along(goal)

    def estimate(cells: State) -> int:
        steps = sum(
            abs(one - other)
            for axis, wanted_axis in zip(along(cells), wanted, strict=True)
            for one, other in zip(axis, wanted_axis, strict=True)
        )
        return 2 * steps + 8 * len(goal - cells)

    return estimate


class _Leader:
    """Searches for the way to the goal; its states hold the obstacles that are on, too."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        self._system = knowledge.system
        self._goal = frozenset(knowledge.goals) | self._system.filled
        self._search: TwoSidedSearch[frozenset[Site]] | None = None
        self._thoughts = 0

    def next_orders(self, orders: Orders, batch: OrderBatch) -> Orders | None:
        """Return the orders after those that are complete; None if there is no way, or too far."""
        state = frozenset(batch.cells) | self._system.filled
        if self._search is None:
            ends = state, self._goal
            self._search = TwoSidedSearch(*ends, near=self._near, estimate=shape_estimate)
        self._thoughts += self._search.path is None
        if not self._search.expand(EXPANDED):
            return orders if self._thoughts < PATIENCE else None
        path = self._search.path
        if path is None:
            return None
        here = path.index(state)
        cells, moves = batch.cells, list[tuple[int, int]]()
        for state, following in pairwise(path[here : here + MOST_ORDERS + 1]):
            action, move = self._near(state)[following]
            moves.append(([cell == move.source for cell in cells].index(True), action))
            cells = moved(cells, move)
        if not moves:
            return orders
        number, before = orders.number + 1, tuple(batch.cells)
        return Orders(number, 0, tuple(moves), before, orders.election)

    def _near(self, state: State) -> dict[frozenset[Site], tuple[int, Move]]:
        """Return the states one move away, with the mover's action and the move."""
        return {
            apply(move.action, state): (action, move)
            for cell in in_order(state - self._system.filled)
            for action, move in enumerate(self._system.moves(cell), 1)
            if move is not None and move.possible(state)
        }


class _Module:
    """Repeats what it hears, and makes its moves when they are due."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        count, goals = knowledge.modules, len(knowledge.goals)
        if goals != count:
            needs = f"a goal of {count} cells that every module knows"
            raise InputError(f"rule 'leader' needs {needs}, found {goals}")
        self._knowledge = knowledge
        self._leader = _Leader(knowledge)
        self._known = Orders.unknown(count, Election.begin(knowledge))
        self._batch: tuple[int, OrderBatch] | None = None
        self._waited = 0

    def __call__(self, view: View) -> Choice:
        """Choose in a round: a move that was due, and was made since the last round, is done."""
        before = self._known
        orders = self._heard(before, view)
        due = self._due(orders)
        if due is not None and due.move.target == view.site:
            orders = orders.with_done(due.order)
        following = self._led(orders, before)
        if following is None or (self._leads(orders) and self._waited == PATIENCE):
            return self._given_up()
        self._known = following
        note = None if following == before else following.note()
        return Choice(_action(view, self._due(following)), note)

    def choose_free(self, view: View) -> Choice:
        """Choose at any time: first write what is known, then make a move and write that."""
        register = view.register
        before = Orders.of(register, self._knowledge.modules) if register else self._known
        orders = self._led(self._heard(before, view), before)
        if orders is None:
            return self._given_up()
        if register is None or orders != before:
            return Choice(note=orders.note())
        due = self._due(orders)
        action = _action(view, due)
        if due is None or action == STAY:
            return Choice()
        return Choice(action, orders.with_done(due.order).note())

    def _given_up(self) -> Choice:
        return Choice(failed=f"gave up after {counted(self._waited, 'round')} without progress")

    def _heard(self, orders: Orders, view: View) -> Orders:
        """Return what is known with what others say and, before the first order, the own place."""
        if orders.number == 0:
            orders = orders.standing(self._knowledge.module, SQUARES.check(view.site))
        for note in view.notes.values():
            orders = orders.merged(Orders.of(note, self._knowledge.modules))
        return orders

    def _leads(self, orders: Orders) -> bool:
        """Return whether this is the leader, if all is known."""
        return orders.election.leader == self._knowledge.module

    def _led(self, orders: Orders, before: Orders) -> Orders | None:
        """Return the next orders if this is the leader and all is done; None if it gives up."""
        following: Orders | None = orders
        if orders.complete and self._leads(orders):
            following = self._leader.next_orders(orders, self._batch_of(orders))
        self._waited = self._waited + 1 if following in (None, before) else 0
        return following

    def _due(self, orders: Orders) -> DueMove | None:
        module = self._knowledge.module
        return self._batch_of(orders).due(module, orders.done) if orders.moves else None

    def _batch_of(self, orders: Orders) -> OrderBatch:
        if self._batch is None or self._batch[0] != orders.number:
            self._batch = orders.number, OrderBatch(self._knowledge.system, orders)
        return self._batch[1]


def _action(view: View, due: DueMove | None) -> int:
    """Return the action of a move that is due; `STAY` if there is none, or it is not legal."""
    if due is None or due.move.source != view.site or not view.mask[due.action]:
        return STAY
    return due.action


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    return system.local and catalogue is not None and catalogue.lattice in (SQUARES, HEXAGONS)


LEADER = RuleType(
    name="leader",
    summary="an elected module hears where all stand, finds a way to the goal, and orders it",
    source="own, after Kostitsyna, Liedtke and Scheideler, see cubepath.agents.rules.leader",
    fits=_fits,
    make=_Module,
    note_length=note_length,
    free=FreeRule(
        why="what modules know only grows, and a move is made once all that it waits for is done",
        make=lambda knowledge: _Module(knowledge).choose_free,
        note_length=note_length,
    ),
)
