"""Plans carried out as arrays, against the vehicles that make their moves one by one."""

from itertools import accumulate, chain
from random import Random

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.compiled import allowance
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.numbered import number_moves
from cubepath.protocol.plans.grid_moves import CarriedPlan, GridMoves, carry_out, cells_of
from cubepath.protocol.plans.imported import VehicleMove
from cubepath.protocol.plans.vehicles import Vehicles
from oracles.vehicle_rounds import Cell, Drawn, Move, draw_plan


def damaged(plan: Drawn, random: Random) -> list[list[Move]]:
    """Return the rounds of a plan, sometimes with two of them as one, or a move turned round."""
    rounds = [list(moves) for moves in plan.rounds]
    what = random.randrange(4)
    if what == 0 and len(rounds) > 1:
        rounds[:2] = [rounds[0] + rounds[1]]
    elif what == 1 and any(rounds):
        moves = random.choice([moves for moves in rounds if moves])
        who, (x, y), _ = moves[-1]
        moves[-1] = (who, (x, y), (x + random.choice((-1, 1)), y))
    return rounds


def as_arrays(
    plan: Drawn, rounds: list[list[Move]], free: list[Cell], *, rotate: bool
) -> CarriedPlan | None:
    moves = [*chain.from_iterable(rounds)]
    sources, targets = cells_of([move[1] for move in moves]), cells_of([move[2] for move in moves])
    ends = np.array([*accumulate(map(len, rounds))], dtype=np.int64)
    return carry_out(plan.starts, free, GridMoves(sources, targets, ends), rotate=rotate)


@pytest.mark.parametrize("work", [pytest.param(0, marks=pytest.mark.slow), 10**9])
@given(st.integers(0, 10**6))
def test_arrays_and_objects_make_the_same_moves(work: int, seed: int) -> None:
    """The same plans are legal, with the same moves in the same order, with rotations or without.

    So they are in compiled code and in plain Python.
    """
    kept, allowance.left = allowance.left, work
    random = Random(seed)  # noqa: S311 - to be repeated
    plan = draw_plan(seed)
    free = [(x, y) for x in range(plan.size[0]) for y in range(plan.size[1])]
    rounds = damaged(plan, random)
    legal = all(len({who for who, _, _ in moves}) == len(moves) for moves in rounds)
    turned: list[VehicleMove] = []
    vehicles = Vehicles(plan.starts, free.__contains__, called="agent")
    try:
        for number, moves in enumerate(rounds, 1):
            legal = legal and all(vehicles.at[who] == source for who, source, _ in moves)
            goes = {who: target for who, _, target in moves}
            turned += [VehicleMove(*each, number) for each in vehicles.turn(goes)]
    except InputError:
        legal = False
    found = as_arrays(plan, rounds, free, rotate=True)
    allowance.left = kept
    assert (found is not None) == legal
    if found is not None:
        assert found.vehicle_moves(by_round=True) == tuple(turned)
        assert found.at == vehicles.at


@given(st.integers(0, 10**6))
def test_numbered_paths_are_those_of_the_moves(seed: int) -> None:
    """Without rotations: the same numbers, ends, names and actions with their labels."""
    plan = draw_plan(seed)
    free = [(x, y) for x in range(plan.size[0]) for y in range(plan.size[1])]
    vehicles = Vehicles(plan.starts, free.__contains__, called="agent")
    found = as_arrays(plan, plan.rounds, free, rotate=False)
    try:
        made = [
            move
            for moves in plan.rounds
            for move in vehicles.go({who: target for who, _, target in moves})
        ]
    except InputError:
        assert found is None
        return
    assert found is not None
    path, expected = found.numbered(), number_moves(made)
    assert path.numbers.tolist() == expected.numbers.tolist()
    assert path.ends.tolist() == expected.ends.tolist()
    assert path.action_names == expected.action_names
    assert [(each, each.label) for each in path.actions] == [
        (each, each.label) for each in expected.actions
    ]
    assert path.stated_start() == expected.stated_start()
