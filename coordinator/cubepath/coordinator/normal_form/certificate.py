"""Building a certificate: that a schedule is in the class of its path, and that none is shorter.

The heap of pieces gives the pairs of moves that cancel and the cube of each remaining move; a chain
of dependent moves is found from the last cube down. `cubepath.coordinator.verification.proof`
explains what the certificate proves, and checks it without trusting this module.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.protocol.core.actions import Action, State, commute
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files.certificates import Certificate


def certificate_of(
    path: Sequence[Action], *, start: State | None = None, found: NormalForm | None = None
) -> Certificate:
    """Return the certificate of an admissible edge path.

    If `start`, the state before the first move, is given, the certificate lists the sites that are
    on at the end. `found` is what becomes of each move, if that is known already; otherwise a heap
    is built. Beyond that, the time is at most one call of `commute` for each remaining move.

    >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> found = certificate_of([step, far, step])
    >>> found.cancelled, found.cubes, found.chain
    ([(1, 3)], [[2]], [2])
    >>> certificate_of([step], start={1, 7}).end
    [2, 7]
    """
    found = cancellations(path) if found is None else found
    levels, partners = found
    left = np.flatnonzero(levels)
    order = left[np.argsort(levels[left], kind="stable")] + 1
    starts = np.cumsum(np.bincount(levels[left], minlength=1)).tolist()
    cubes: list[list[int]] = [order[begin:end].tolist() for begin, end in pairwise(starts)]
    later = np.flatnonzero((levels == 0) & (partners < np.arange(len(levels))))
    pairs = zip((partners[later] + 1).tolist(), (later + 1).tolist(), strict=True)
    cancelled: list[tuple[int, int]] = list(pairs)
    return Certificate(
        moves=len(path),
        cancelled=cancelled,
        cubes=cubes,
        chain=_chain(path, cubes),
        end=None if start is None else list(in_order(_end(path, start))),
    )


def _chain(path: Sequence[Action], cubes: Sequence[Sequence[int]]) -> list[int]:
    """Return the first move of the last cube, and down from there the first that blocks each move.

    Under every piece of a heap lies a piece of the level below that does not commute with it, and
    every piece of that level that does not commute with it lies under it.
    """
    found: list[int] = []
    for cube in reversed(cubes):
        if not found:
            found.append(cube[0])
            continue
        action = path[found[-1] - 1]
        found.append(next(move for move in cube if not commute(path[move - 1], action)))
    return found[::-1]


def _end(path: Iterable[Action], start: State) -> set[Site]:
    state = set(start)
    for action in path:
        # One local state replaces the other, so exactly the sites where they differ change.
        state ^= action.ends[0] ^ action.ends[1]
    return state


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
