"""Building a certificate: that a schedule is in the class of its path, and that none is shorter.

The heap of pieces gives the pairs of moves that cancel and the cube of each remaining move; a chain
of dependent moves is found from the last cube down. `cubepath.coordinator.verification.proof`
explains what the certificate proves, and checks it without trusting this module.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import normal_form_of
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.numbered import NumberedPath, number_actions
from cubepath.protocol.path_files.supports import TRACE, SupportRows, Supports

_PIECE = 4096
"""Pairs that are made at a time."""
_encode = msgspec.json.Encoder().encode


def certificate_of(
    path: Sequence[Action] | NumberedPath,
    *,
    start: State | None = None,
    found: NormalForm | None = None,
    as_text: bool = False,
) -> Certificate:
    """Return the certificate of an admissible edge path.

    If `start`, the state before the first move, is given, the certificate lists the sites that are
    on at the end. `found` is what becomes of each move, if that is known already; otherwise a heap
    is built. With `as_text` the certificate is for encoding, and for nothing else: its pairs and
    cubes are JSON text already, made piece by piece, since as lists they would take some hundred
    bytes a move.

    >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> found = certificate_of([step, far, step])
    >>> found.cancelled, found.cubes, found.chain
    ([(1, 3)], [[2]], [2])
    >>> certificate_of([step], start={1, 7}).end
    [2, 7]
    """
    numbered = path if isinstance(path, NumberedPath) else number_actions(path)
    numbers, supports = numbered.numbers, numbered.supports
    parts = _Parts(normal_form_of(numbered) if found is None else found)
    cancelled: Any
    cubes: Any
    if as_text:
        cancelled, cubes = _joined(parts.pairs()), _joined([cube] for cube in parts.cubes())
    else:
        cancelled, cubes = [pair for some in parts.pairs() for pair in some], [*parts.cubes()]
    return Certificate(
        moves=len(numbers),
        cancelled=cancelled,
        cubes=cubes,
        chain=parts.chain(numbers, supports),
        end=None if start is None else list(in_order(end_of(numbered, start))),
    )


def _joined(pieces: Iterable[list[Any]]) -> msgspec.Raw:
    """Return the JSON text of one list, given in pieces that are not empty."""
    text = bytearray()
    for piece in pieces:
        text += b"," if text else b"["
        text += _encode(piece)[1:-1]
    text += b"]" if text else b"[]"
    return msgspec.Raw(text)


class _Parts:
    """What became of each move, as arrays of the moves, which are counted from 1."""

    def __init__(self, found: NormalForm) -> None:
        levels, partners = found
        left = np.flatnonzero(levels).astype(np.int32)
        self._order = left[np.argsort(levels[left], kind="stable")] + 1
        self._ends = np.cumsum(np.bincount(levels[left], minlength=1))
        later = np.flatnonzero((levels == 0) & (partners < np.arange(len(levels), dtype=np.int32)))
        self._later = later.astype(np.int32) + 1
        self._earlier = partners[later] + 1

    def cubes(self) -> Iterator[list[int]]:
        """Yield the moves of each cube in the order of the path."""
        for place in range(len(self._ends) - 1):
            found: list[int] = self._order[self._ends[place] : self._ends[place + 1]].tolist()
            yield found

    def pairs(self) -> Iterator[list[tuple[int, int]]]:
        """Yield the pairs of moves that cancel, in the order of the later, some at a time."""
        for begin in range(0, len(self._later), _PIECE):
            some = (each[begin : begin + _PIECE].tolist() for each in (self._earlier, self._later))
            yield list(zip(*some, strict=True))

    def chain(self, numbers: NDArray[np.int32], supports: Supports) -> list[int]:
        """Return the first move of the last cube, and down from there the first that blocks each.

        Under every piece of a heap lies a piece of the level below that does not commute with it,
        and every piece of that level that does not commute with it lies under it.
        """
        rows = supports.rows
        found = np.zeros(len(self._ends) - 1, dtype=np.int64)
        marks = np.zeros(len(supports.sites), dtype=np.int64)
        pieces = numbers[self._order - 1]
        steps = int(np.diff(rows.starts)[pieces].sum())
        descend = _descend.for_work(2 * steps, by_entries=True)
        if not descend(rows, pieces, self._ends, marks, found):
            raise AssertionError("a piece of the heap lies on nothing")
        chain: list[int] = self._order[found].tolist()
        return chain


@compiled
def _descend(
    rows: SupportRows,
    pieces: NDArray[np.int32],
    ends: NDArray[np.int64],
    marks: NDArray[np.int64],
    found: NDArray[np.int64],
) -> bool:
    """Write the chain into `found`, as places in `pieces`; return whether there is one.

    Cube i, from 0, has the actions ``pieces[ends[i]:ends[i + 1]]``; `marks` has a 0 for each site.
    """
    starts, sites, says = rows.starts, rows.sites, rows.says
    for cube in range(len(found) - 1, -1, -1):
        blocks = cube == len(found) - 1
        for place in range(ends[cube], ends[cube + 1]):
            number = pieces[place]
            for index in range(starts[number], starts[number + 1]):
                # What the move above does at this site: nothing, or read it, or write it.
                mark = marks[sites[index]] - 2 * (cube + 1)
                if mark == 1 or (mark == 0 and says[index] & TRACE != 0):
                    blocks = True
            if blocks:
                found[cube] = place
                break
        if not blocks:
            return False
        number = pieces[found[cube]]
        for index in range(starts[number], starts[number + 1]):
            marks[sites[index]] = 2 * cube + (1 if says[index] & TRACE else 0)
    return True


class Link(NamedTuple):
    """Why a move waits for the one before it in a chain: a site, and what each does with it."""

    site: Site
    before_writes: bool
    writes: bool


def link(before: Action, action: Action, beside: Collection[Site] = ()) -> Link:
    """Return the first site, in canonical order, over which two actions do not commute.

    Sites that both write come before all others, unless they are in `beside`. ValueError if the
    actions commute.
    """
    both = (before.trace & action.trace).difference(beside)
    met = in_order(both or (before.trace & action.support) | (before.support & action.trace))
    if not met:
        raise ValueError(f"{before!r} and {action!r} commute")
    return Link(met[0], met[0] in before.trace, met[0] in action.trace)
