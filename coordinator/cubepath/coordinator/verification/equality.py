"""Whether two edge paths are equal up to swapping commuting moves, or homotopic.

A path is given, up to swapping, by its moves and by the order of those that do not commute. Those
share a site that one of them writes, so the order is told by how often each site of a move was
written before it: the versions that it finds. Moves with equal actions do not commute, so the n-th
of one path belongs to the n-th of the other. Homotopic are paths that are equal when all that
cancels is taken out, from one start. Time is linear in the supports, and nothing is shared with
shortening.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from cubepath.coordinator.verification.dependencies import apart, numbered, remaining
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site, in_order, site_text


def difference(
    one: Sequence[Action],
    other: Sequence[Action],
    starts: tuple[AbstractSet[Site] | None, AbstractSet[Site] | None] = (None, None),
    *,
    homotopic: bool = False,
) -> str | None:
    """Return the first difference between two paths in one line, None if there is none.

    They differ if they begin at different states, where both are known, or if one is not the other
    up to swapping neighbouring moves that commute; with `homotopic`, also up to taking out or
    putting in a move that is undone at once.

    >>> a, b = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> difference([a, b], [b, a]), difference([a, b, a], [b], homotopic=True)
    (None, None)
    >>> difference([a, b, a], [b]) is None
    False
    """
    first, second = starts
    if first is not None and second is not None and first != second:
        site = in_order(first ^ second)[0]
        which = "first" if site in first else "second"
        return f"the starts differ: {site_text(site)} is on in the {which} alone"
    names, (ours, theirs) = numbered(one, other)
    if homotopic:
        ours, theirs = ours[remaining(ours, names)], theirs[remaining(theirs, names)]
    return apart(ours, theirs, names)
