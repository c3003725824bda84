"""Exactly how `compression` shares out shapes without rounds, where a turn takes time.

A module waits, sees what is around it and draws its step, and makes it some time later. Waits and
turns are drawn from exponential distributions with the means 1 and `latency`, so shapes with what
their modules are about to do are a Markov chain in continuous time. A module is waiting, about to
step in a direction, or busy in vain: it drew nothing, or a cell of its support has changed since,
and it will be refused.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEXAGONS, Cell
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.compressed import Shape, neighbours, pairs_in, up_to_symmetry

_WAITS, _IN_VAIN = -2, -1
_State = tuple[tuple[Cell, int], ...]
"""Each module's cell, and `_WAITS`, `_IN_VAIN` or a direction."""
_SYSTEM = scene_from_spec("compression:n=2").system


@cache
def _steps(shape: Shape) -> dict[tuple[Cell, int], tuple[Cell, Action, int]]:
    """Return by cell and direction where steps lead, and what is gained."""
    found = {}
    for cell in shape:
        for move in _SYSTEM.moves(cell):
            if move is not None and move.possible(frozenset(shape)):
                there = HEXAGONS.check(move.target)
                gained = pairs_in({*shape, there} - {cell}) - pairs_in(shape)
                found[cell, neighbours(cell).index(there)] = there, move.action, gained
    return found


def _changes(state: _State, latency: float, bias: float) -> Iterator[tuple[_State, float]]:
    """Yield the states that follow, with their rates."""
    steps = _steps(tuple(cell for cell, _ in state))
    for number, (cell, does) in enumerate(state):
        before, after = state[:number], state[number + 1 :]
        if does == _WAITS:
            left = 1.0
            for turn in range(6):
                if (cell, turn) in steps:
                    rate = 0.9 * min(1.0, bias ** steps[cell, turn][2]) / 6
                    left -= rate
                    yield (*before, (cell, turn), *after), rate
            yield (*before, (cell, _IN_VAIN), *after), left
        elif does == _IN_VAIN:
            yield (*before, (cell, _WAITS), *after), 1 / latency
        else:
            there, action, _ = steps[cell, does]
            others = [
                (
                    other,
                    _IN_VAIN
                    if todo >= 0 and action.trace & steps[other, todo][1].support
                    else todo,
                )
                for other, todo in (*before, *after)
            ]
            yield _at_origin([*others, (there, _WAITS)]), 1 / latency


def _at_origin(state: list[tuple[Cell, int]]) -> _State:
    q, r = (min(cell[axis] for cell, _ in state) for axis in (0, 1))
    return tuple(sorted(((cell[0] - q, cell[1] - r), does) for cell, does in state))


def shares_without_rounds(count: int, latency: float, bias: float) -> dict[Shape, float]:
    """Return the share of time of each shape up to symmetry; 3 modules have 512 states, 4 6,400."""
    numbers: dict[_State, int] = {tuple(((q, 0), _WAITS) for q in range(count)): 0}
    queue = list(numbers)
    rates: list[tuple[int, int, float]] = []
    for state in queue:  # it grows meanwhile
        for other, rate in _changes(state, latency, bias):
            if other not in numbers:
                numbers[other] = len(numbers)
                queue.append(other)
            rates.append((numbers[state], numbers[other], rate))
    flow: NDArray[np.float64] = np.zeros((len(numbers), len(numbers)))
    for source, target, rate in rates:
        flow[target, source] += rate
        flow[source, source] -= rate
    flow[0] = 1.0  # one equation follows from the others: the shares add up to 1 instead
    total = np.zeros(len(numbers))
    total[0] = 1.0
    found: dict[Shape, float] = {}
    for state, share in zip(numbers, np.linalg.solve(flow, total).tolist(), strict=True):
        kind = up_to_symmetry(cell for cell, _ in state)
        found[kind] = found.get(kind, 0.0) + share
    return found
