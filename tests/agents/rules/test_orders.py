"""Orders as notes: what modules know only grows, and a batch is carried out in any fair order."""

from collections.abc import Collection

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.rules.leader import shape_estimate
from cubepath.agents.rules.orders import MOST_ORDERS, OrderBatch, Orders, note_length
from cubepath.agents.rules.waves import Election
from cubepath.protocol.core.actions import apply
from cubepath.protocol.scenes.specs import scene_from_spec

CELLS = st.tuples(st.integers(-9, 9), st.integers(-9, 9))
START = tuple((x, 0) for x in range(3))
RANKS = (7, 3, 5)


def elected(heard: Collection[int]) -> Election:
    """Return what is known of the election by who has heard of these modules."""
    rank, leader = min((RANKS[module], module) for module in heard)
    return Election(rank, leader, sum(1 << module for module in heard))


@st.composite
def known(draw: st.DrawFn) -> Orders:
    """Return what a module may know: places before the first order, then what is done."""
    number = draw(st.integers(0, 2))
    if number == 0:
        heard = draw(st.sets(st.integers(0, 2), min_size=1))
        cells = tuple(cell if module in heard else None for module, cell in enumerate(START))
        return Orders(0, 0, (), cells, elected(heard))
    moves = tuple((module, number) for module in range(3))
    return Orders(number, draw(st.integers(0, 7)), moves, START, elected(range(3)))


@settings(max_examples=40, derandomize=True)
@given(known(), known(), known())
def test_notes_may_come_late_twice_and_in_any_order(one: Orders, two: Orders, six: Orders) -> None:
    """Merging is commutative, associative and idempotent, as for any state that only grows."""
    assert one.merged(two) == two.merged(one)
    assert one.merged(two).merged(six) == one.merged(two.merged(six))
    assert one.merged(one) == one
    assert one.merged(two).merged(two) == one.merged(two)


@settings(max_examples=20, derandomize=True)
@given(
    st.integers(0, 9),
    st.lists(st.tuples(st.integers(0, 5), st.integers(1, 80)), max_size=MOST_ORDERS),
    st.lists(st.none() | CELLS, min_size=1, max_size=70),
    st.integers(0, (1 << 70) - 1),
)
def test_a_note_is_read_back(
    number: int, moves: list[tuple[int, int]], cells: list[tuple[int, int] | None], heard: int
) -> None:
    """Whatever is known and whatever is not; its length depends on the number of modules alone."""
    count = len(cells)
    election = Election(5, 0, heard & (1 << count) - 1)
    orders = Orders(number, (1 << len(moves)) - 1, tuple(moves), tuple(cells), election)
    assert Orders.of(orders.note(), count) == orders
    assert len(orders.note()) == note_length(count)


def ordered(spec: str, steps: int) -> tuple[Orders, frozenset[object]]:
    """Return a batch of first legal moves that lead to ever new states, and where it ends."""
    scene = scene_from_spec(spec)
    cells, moves = list(scene.start), list[tuple[int, int]]()
    state = frozenset(scene.start)
    seen = {state}
    for _ in range(steps):
        mover, action, move, state = next(
            (mover, action, move, after)
            for mover, cell in enumerate(cells)
            for action, move in enumerate(scene.system.moves(cell), 1)
            if move is not None and move.possible(state)
            for after in (apply(move.action, state),)
            if after not in seen
        )
        seen.add(state)
        moves.append((mover, action))
        cells = [dict(move.motion).get(cell, cell) for cell in cells]
    known_cells = tuple(cell for cell in scene.start if isinstance(cell, tuple))
    election = Election(0, 0, (1 << len(cells)) - 1)
    return Orders(1, 0, tuple(moves), known_cells, election), state


@pytest.mark.slow
@settings(max_examples=30, derandomize=True)
@given(st.sampled_from(["sliding-shapes:n=6", "hex-shapes:n=8"]), st.data())
def test_due_moves_are_legal_in_any_order_and_lead_to_one_state(
    spec: str, data: st.DataObject
) -> None:
    """Whichever module that is due moves next, its move is legal, and all end where ordered."""
    scene = scene_from_spec(spec)
    orders, end = ordered(spec, 8)
    batch = OrderBatch(scene.system, orders)
    assert set(batch.cells) == end
    state = frozenset(scene.start)
    while not orders.complete:
        dues = [batch.due(module, orders.done) for module in range(len(scene.start))]
        due = data.draw(st.sampled_from([each for each in dues if each is not None]))
        assert due.move.possible(state)
        state = apply(due.move.action, state)
        orders = orders.with_done(due.order)
    assert state == end


@settings(max_examples=20, derandomize=True)
@given(st.sets(CELLS, min_size=4, max_size=4), st.sets(CELLS, min_size=4, max_size=4))
def test_only_the_goal_seems_reached(one: set[tuple[int, int]], two: set[tuple[int, int]]) -> None:
    """The estimate of a shape is 0 at the goal alone, and the same both ways."""
    assert (shape_estimate(one)(two) == 0) == (one == two)
    assert shape_estimate(one)(two) == shape_estimate(two)(one)
