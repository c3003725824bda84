"""Whether one triangulation can become another in some number of rounds: a refutation that is fast.

Each edge has two marks for each moment, before the first round, between rounds and after the last:
whether it may be on, and whether it may be off. At first they say what the two ends and the known
bound by crossings leave open. Then rules remove marks until nothing changes:

- A flip is possible in a round only if before it its diagonal may be on and the other one off,
  after it the other way round, and each side may be on both times.
- An edge may be on after a round only if it may be on before, or a possible flip brings it; it may
  be on before only if it may be on after, or a possible flip takes it away. Likewise for off.
- An edge that is off before a round and on after it was brought by a flip. If only one is possible,
  its diagonal was on, its sides were on and stay on. Likewise for an edge that is taken away.

Proof of soundness: by induction no rule removes a mark that a path between the ends needs, since
each says what holds along every path. So if an edge may be neither on nor off at some moment, there
is no path of this many rounds; nor of fewer, since rounds may be empty. This is unit propagation,
as in a solver for satisfiability, on the formula that says that there is a path.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.systems.point_sets import Edge, edges_of

Marks = NDArray[np.uint8]
Rows = NDArray[np.int64]
Counts = NDArray[np.int64]

FLIPS_MAX = 400_000
"""The most flips that are listed: some seconds."""
_OFTEN = 100
"""The number of edges after which the caller may stop."""
_STEPS_A_MARK = 20
"""Steps that a flip takes in a round, at a guess."""


class _Round(NamedTuple):
    """The marks before and after a round, and what its possible flips do to each edge."""

    on: Marks
    off: Marks
    then_on: Marks
    then_off: Marks
    brought: Counts
    """How many possible flips bring an edge, and the last of them."""
    taken: Counts
    """How many possible flips take an edge away, and the last of them."""


@inner
def _count(flips: Rows, here: _Round) -> None:
    """Count the possible flips of a round, by the edges that they bring and take away."""
    here.brought[:] = 0
    here.taken[:] = 0
    for number in range(len(flips)):
        old, new = flips[number, 0], flips[number, 1]
        able = here.on[old] and here.off[new] and here.then_on[new] and here.then_off[old]
        for place in range(2, 6):
            side = flips[number, place]
            able = able and here.on[side] and here.then_on[side]
        if able:
            here.brought[new, 0] += 1
            here.brought[new, 1] = number
            here.taken[old, 0] += 1
            here.taken[old, 1] = number


@inner
def _clear(marks: Marks, edge: int) -> int:
    """Remove a mark; return 1 if it was there."""
    there = marks[edge]
    marks[edge] = 0
    return int(there)


@inner
def _stay(here: _Round, edge: int) -> tuple[int, int]:
    """Remove marks of an edge that no possible flip explains; return how many before and after."""
    before = after = 0
    if not here.brought[edge, 0]:
        if not here.on[edge]:
            after += _clear(here.then_on, edge)
        if not here.then_off[edge]:
            before += _clear(here.off, edge)
    if not here.taken[edge, 0]:
        if not here.off[edge]:
            after += _clear(here.then_off, edge)
        if not here.then_on[edge]:
            before += _clear(here.on, edge)
    return before, after


@inner
def _force(flips: Rows, here: _Round, edge: int) -> tuple[int, int]:
    """Remove what the only flip that can change an edge excludes; return how many marks."""
    if not here.on[edge] and not here.then_off[edge] and here.brought[edge, 0] == 1:
        flip = flips[here.brought[edge, 1]]
    elif not here.off[edge] and not here.then_on[edge] and here.taken[edge, 0] == 1:
        flip = flips[here.taken[edge, 1]]
    else:
        return 0, 0
    before = _clear(here.off, flip[0]) + _clear(here.on, flip[1])
    after = _clear(here.then_on, flip[0]) + _clear(here.then_off, flip[1])
    for side in flip[2:]:
        before += _clear(here.off, side)
        after += _clear(here.then_off, side)
    return before, after


@compiled
def refuted(flips: Rows, may_on: Marks, may_off: Marks) -> bool:
    """Apply the rules until nothing changes; return whether an edge is left without a mark.

    `flips` has a row for each direction of each flip: the edge that it takes away, the one that it
    brings, and four sides. The marks have shape (rounds + 1, edges) and are changed in place.
    """
    rounds, edges = len(may_on) - 1, may_on.shape[1]
    brought, taken = np.empty((edges, 2), dtype=np.int64), np.empty((edges, 2), dtype=np.int64)
    stale = np.ones(rounds + 2, dtype=np.uint8)
    stale[0] = stale[rounds + 1] = 0
    while stale.any():
        for number in range(1, rounds + 1):
            if not stale[number]:
                continue
            here = _Round(
                may_on[number - 1],
                may_off[number - 1],
                may_on[number],
                may_off[number],
                brought,
                taken,
            )
            _count(flips, here)
            before = after = 0
            for edge in range(edges):
                one, other = _stay(here, edge)
                before, after = before + one, after + other
                one, other = _force(flips, here, edge)
                before, after = before + one, after + other
                if not (here.on[edge] or here.off[edge]):
                    return True
                if not (here.then_on[edge] or here.then_off[edge]):
                    return True
            stale[number] = before + after > 0
            stale[number - 1] |= before > 0
            stale[number + 1] |= after > 0
            stale[0] = stale[rounds + 1] = 0
    return False


class TriangulationPair(NamedTuple):
    """Two triangulations, and what a refutation asks about them."""

    start: frozenset[Edge]
    goal: frozenset[Edge]
    discovery: Callable[[], Callable[[Edge], Iterable[Move]]]
    """As `System.discovery`."""
    away: Callable[[Sequence[Edge]], list[int]]
    """How many rounds it takes at least until each edge is in the goal, or, from the goal on, until
    it is there."""


def proved(ends: TriangulationPair, least: int) -> Iterator[int]:
    """Yield ever greater numbers of rounds that every path needs, from `least` up.

    The same number may come again, so that the caller can stop now and then. It ends when a number
    of rounds is not refuted, or would have too many flips.
    """
    away: dict[Edge, int] = {}
    while True:
        listed: _Listed | None = None
        for found in _listing(ends, least, away):
            yield least
            listed = found
        if listed is None or not _refuted(ends, least, away, listed):
            return
        least += 1
        yield least


class _Listed(NamedTuple):
    """The edges that may be on, with the first moment when they may, and the flips among them."""

    first: dict[Edge, int]
    flips: list[tuple[Edge, ...]]


def _listing(
    ends: TriangulationPair, rounds: int, away: dict[Edge, int]
) -> Iterator[_Listed | None]:
    """Yield None now and then, and at the end the edges and flips, or None if they are too many.

    The edges of each moment are those that flips among earlier ones bring, unless they are too far
    from the goal by then.
    """
    discover = ends.discovery()
    found = _Listed({}, [])
    new: dict[Edge, None] = dict.fromkeys(sorted(ends.start))
    for moment in range(rounds + 1):
        unknown = [edge for edge in new if edge not in away]
        away.update(zip(unknown, ends.away(unknown), strict=True))
        layer = [edge for edge in new if moment + away[edge] <= rounds]
        found.first.update(dict.fromkeys(layer, moment))
        new = {}
        for count, edge in enumerate(layer):
            if count % _OFTEN == 0:
                yield None
            for move in discover(edge):
                (old,), (brought,) = edges_of((move.source,)), edges_of((move.target,))
                found.flips.append((old, brought, *edges_of(move.action.reads)))
                if brought not in found.first:
                    new[brought] = None
        if len(found.flips) > FLIPS_MAX:
            yield None
            return
    yield found


def _refuted(ends: TriangulationPair, rounds: int, away: dict[Edge, int], listed: _Listed) -> bool:
    first, flips = listed
    if not ends.goal <= first.keys():
        return True
    numbers = {edge: number for number, edge in enumerate(first)}
    rows = [[numbers[edge] for edge in flip] for flip in flips if flip[1] in numbers]
    array = np.array(rows, dtype=np.int64).reshape(-1, 6)
    may_on = np.zeros((rounds + 1, len(numbers)), dtype=np.uint8)
    may_off = np.ones((rounds + 1, len(numbers)), dtype=np.uint8)
    for edge, number in numbers.items():
        may_on[first[edge] : rounds - away[edge] + 1, number] = 1
        for moment, state in ((0, ends.start), (rounds, ends.goal)):
            may_on[moment, number] = edge in state
            may_off[moment, number] = edge not in state
    work = _STEPS_A_MARK * len(array) * rounds
    return bool(refuted.for_work(work)(array, may_on, may_off))
