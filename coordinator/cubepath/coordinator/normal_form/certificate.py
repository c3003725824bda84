"""Building a certificate: that a schedule is in the class of its path, and that none is shorter.

The heap of pieces says which moves cancel each other and in which cube each other move is; a chain
of dependent moves is found from the last cube down. What the certificate proves, and how that is
checked without trusting any of this, is said in `cubepath.coordinator.verification.proof`.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.protocol.core.actions import Action, State, commute
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files.certificates import Certificate


def certificate_of(
    path: Sequence[Action], *, start: State | None = None, found: NormalForm | None = None
) -> Certificate:
    """Return the certificate of an admissible edge path.

    Where `start` is known, the state before the first move, it says what is on at the end. `found`
    is what becomes of each move, if that is known already; else a heap is built. Time beyond that
    is one question to `commute` for each move that remains.

    >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> found = certificate_of([step, far, step])
    >>> found.cancelled, found.cubes, found.chain
    ([(1, 3)], [[2]], [2])
    >>> certificate_of([step], start={1, 7}).end
    [2, 7]
    """
    found = cancellations(path) if found is None else found
    levels, partners = (array.tolist() for array in found)
    cubes: list[list[int]] = [[] for _ in range(max(levels, default=0))]
    cancelled: list[tuple[int, int]] = []
    for place, (level, partner) in enumerate(zip(levels, partners, strict=True)):
        if level:
            cubes[level - 1].append(place + 1)
        elif partner < place:
            cancelled.append((partner + 1, place + 1))
    return Certificate(
        moves=len(path),
        cancelled=cancelled,
        cubes=cubes,
        chain=_chain(path, cubes),
        end=None if start is None else list(in_order(_end(path, start))),
    )


def _chain(path: Sequence[Action], cubes: Sequence[Sequence[int]]) -> list[int]:
    """Return the first move of the last cube, and from there down the first that holds it up.

    Under every piece of a heap lies one of the level before that does not commute with it, and
    whatever of that level does not commute with it lies under it.
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
        # One local state goes and the other comes: what differs between them changes.
        state ^= action.ends[0] ^ action.ends[1]
    return state


class Link(NamedTuple):
    """Why a move waits for the one before it in a chain: a site, and what each does with it."""

    site: Site
    before_writes: bool
    writes: bool


def link(before: Action, action: Action, beside: Collection[Site] = ()) -> Link:
    """Return the first site, in canonical order, over which two actions do not commute.

    A site that both write is taken before all others, and sites `beside` are not looked at.
    ValueError where they commute.
    """
    both = (before.trace & action.trace).difference(beside)
    met = in_order(both or (before.trace & action.support) | (before.support & action.trace))
    if not met:
        raise ValueError(f"{before!r} and {action!r} commute")
    return Link(met[0], met[0] in before.trace, met[0] in action.trace)
