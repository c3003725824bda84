"""The rule `leader`: one module learns where all stand, searches, and orders moves by notes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.orders import MOST_ORDERS, Batch, Orders, moved, note_length
from cubepath.agents.rules.real_time_search import RealTimeSearch
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.actions import State, apply
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System

LEADER_MODULE = 0
"""The number of the module that leads."""
PATIENCE = 10_000
"""After this many rounds in which the shape comes no nearer to the goal, the leader gives up."""
_MISPLACED = 4
"""How much a cell of the goal that is free adds to the estimate, in moves of one cell."""


def shape_estimate(goal: State) -> Callable[[State], int]:
    """Return how far a shape may be from the goal, a set of as many cells.

    It is the least sum of steps, along each axis alone, that takes the coordinates of the cells to
    those of the goal, and `_MISPLACED` for each cell of the goal that is free.

    >>> estimate = shape_estimate({(0, 0), (1, 0)})
    >>> estimate({(0, 0), (1, 0)}), estimate({(0, 0), (0, 1)})
    (0, 6)
    """

    def along(cells: State) -> list[list[int]]:
        return [sorted(axis) for axis in zip(*cells, strict=True)]

    wanted = along(goal)

    def estimate(cells: State) -> int:
        steps = sum(
            abs(one - other)
            for axis, other_axis in zip(along(cells), wanted, strict=True)
            for one, other in zip(axis, other_axis, strict=True)
        )
        return steps + _MISPLACED * len(goal - cells)

    return estimate


class _Leader:
    """Orders the next batch of moves when the last one is complete."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        self._system = knowledge.system
        self._estimate = shape_estimate(frozenset(knowledge.goals) | self._system.filled)
        self._search = RealTimeSearch(self._near, self._estimate)
        self._nearest: int | None = None
        self._rounds = 0

    def next_orders(self, number: int, batch: Batch) -> Orders | None:
        """Return the orders after a batch that is complete; None if nothing leads to the goal."""
        state = frozenset(batch.cells) | self._system.filled
        seems = self._estimate(state)
        if self._nearest is None or seems < self._nearest:
            self._nearest, self._rounds = seems, 0
        steps = self._search.walk(state, MOST_ORDERS)
        if steps is None:
            return None
        cells, moves = batch.cells, list[tuple[int, int]]()
        for action, move in steps:
            moves.append((cells.index(move.source), action))
            cells = moved(cells, move)
        return Orders(number + 1, 0, tuple(moves), tuple(batch.cells))

    def is_patient(self) -> bool:
        """Count a round; return whether the shape has come nearer within the last `PATIENCE`."""
        self._rounds += 1
        return self._rounds <= PATIENCE

    def _near(self, state: State) -> list[tuple[tuple[int, Move], State]]:
        return [
            ((action, move), apply(move.action, state))
            for cell in in_order(state - self._system.filled)
            for action, move in enumerate(self._system.moves(cell), 1)
            if move is not None and move.possible(state)
        ]


class _Module:
    """Repeats what it hears, and makes its moves when they are due."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        count = knowledge.modules
        if len(knowledge.goals) != count:
            raise InputError(
                f"rule 'leader' needs a goal of {count} cells that every module knows, found"
                f" {len(knowledge.goals)}"
            )
        catalogue = knowledge.system.catalogue
        if catalogue is None:
            raise InputError("rule 'leader' is for cells of a lattice")
        self._lattice = catalogue.lattice
        self._knowledge = knowledge
        self._leader = _Leader(knowledge) if knowledge.module == LEADER_MODULE else None
        self._known = Orders.unknown(count)
        self._batch: tuple[int, Batch] | None = None

    def __call__(self, view: View) -> Choice:
        """Choose in a round: a move that was due, and was made since the last round, is done."""
        before = self._known
        orders = self._heard(before, view)
        due = self._due(orders)
        if due is not None and due[1].target == view.site:
            orders = orders.with_done(due[0])
        self._known, failed = self._led(orders)
        if self._leader is not None and not self._leader.is_patient():
            failed = f"gave up after {PATIENCE} rounds without progress"
        note = None if self._known == before else self._known.note()
        return Choice(_action(view, self._due(self._known)), note, failed)

    def choose_free(self, view: View) -> Choice:
        """Choose at any time: first write what is known, then make a move and write that."""
        before = Orders.unknown(self._knowledge.modules)
        if view.register is not None:
            before = Orders.of(view.register)
        orders, failed = self._led(self._heard(before, view))
        if view.register is None or orders != before:
            return Choice(note=orders.note(), failed=failed)
        due = self._due(orders)
        action = _action(view, due)
        if due is None or action == STAY:
            return Choice(failed=failed)
        return Choice(action, orders.with_done(due[0]).note())

    def _heard(self, orders: Orders, view: View) -> Orders:
        """Return what is known with what others say and, before the first order, the own place."""
        if orders.number == 0:
            orders = orders.standing(self._knowledge.module, self._lattice.check(view.site))
        for note in view.notes.values():
            orders = orders.merged(Orders.of(note))
        return orders

    def _led(self, orders: Orders) -> tuple[Orders, str | None]:
        """Return the next orders if this is the leader and all is done; why it gives up, if so."""
        if self._leader is None or not orders.complete:
            return orders, None
        following = self._leader.next_orders(orders.number, self._batch_of(orders))
        if following is None:
            return orders, "no moves lead to the goal from here"
        return (following if following.moves else orders), None

    def _due(self, orders: Orders) -> tuple[int, Move] | None:
        """Return the move that the module has to make now, with its index in the batch."""
        if not orders.moves:
            return None
        batch = self._batch_of(orders)
        index = batch.due(self._knowledge.module, orders.done)
        return None if index is None else (index, batch.moves[index])

    def _batch_of(self, orders: Orders) -> Batch:
        if self._batch is None or self._batch[0] != orders.number:
            self._batch = orders.number, Batch(self._knowledge.system, orders)
        return self._batch[1]


def _action(view: View, due: tuple[int, Move] | None) -> int:
    """Return the action of a move that is due; `STAY` if it cannot be made as far as is seen."""
    if due is None or due[1].source != view.site:
        return STAY
    action = 1 + view.moves.index(due[1])
    return action if view.mask[action] else STAY


def _make_free(knowledge: InitialKnowledge) -> Rule:
    return _Module(knowledge).choose_free


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    return (
        system.local
        and catalogue is not None
        and catalogue.lattice.arity == catalogue.lattice.dimension
    )


LEADER = RuleType(
    name="leader",
    summary="one module learns where all stand, searches, and orders moves that are made in parallel",
    source="own, with LSS-LRTA* (Koenig and Sun 2009), see cubepath.agents.rules.leader",
    fits=_fits,
    make=_Module,
    note_length=note_length,
    free=FreeRule(
        why="what modules know only grows, and a move is made once all that it waits for is done",
        make=_make_free,
        note_length=note_length,
    ),
)
