"""Moves that are known by a list alone, by the site at which a search meets them.

A move in one of its directions is met at the first site, in canonical order, that is on before it,
and one before which nothing is on is met anywhere. A list may be long, and a search may see little
of it: of a path in numbers only the actions that are met are built.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files.numbered import NumberedPath

Directed = tuple[Action, int]
"""An action, and the local state, 0 or 1, in which a move by it begins."""


class Listed(NamedTuple):
    """The moves of a list: those that are met at a site, and those that are met anywhere."""

    at: Callable[[Site], list[Directed]]
    anywhere: list[Directed]


def listed_moves(listed: Iterable[Action] | NumberedPath) -> Listed:
    """Return the moves that occur, each once, in the order in which they come first."""
    if isinstance(listed, NumberedPath):
        return _of_path(listed)
    at: dict[Site, list[Directed]] = {}
    anywhere: list[Directed] = []
    for action in dict.fromkeys(listed):
        for end in (0, 1):
            on = action.ends[end]
            (at.setdefault(in_order(on)[0], []) if on else anywhere).append((action, end))
    return Listed(lambda site: at.get(site, []), anywhere)


def _of_path(path: NumberedPath) -> Listed:
    supports = path.supports
    starts, sites, says = supports.rows[:3]
    nowhere = len(supports.sites)
    present = path.numbers[np.sort(np.unique(path.numbers, return_index=True)[1])]
    least = np.full((len(present), 2), nowhere, dtype=np.int64)
    if len(present):
        for end in (0, 1):
            ranked = np.where(says >> end & 1, supports.order[sites], nowhere)
            least[:, end] = np.minimum.reduceat(ranked, starts[:-1])[present]
    met = least.ravel()
    order = np.argsort(met, kind="stable")
    begins = np.searchsorted(met[order], np.arange(nowhere + 2))
    rank = dict(zip(supports.sites, supports.order.tolist(), strict=True))

    def at(site: Site) -> list[Directed]:
        return directed(rank[site]) if site in rank else []

    def directed(place: int) -> list[Directed]:
        some = order[begins[place] : begins[place + 1]].tolist()
        return [(path.actions[int(present[each // 2])], each % 2) for each in some]

    return Listed(at, directed(nowhere))
