"""Groups of sites of which at most one, or exactly one, is on in every state of a path.

A vehicle is at one vertex, and at most one vehicle at a vertex. Solvers and provers do not see this
from one round; it holds because it holds at the start and no move breaks it. Groups are proposed by
labels and places, and kept only if that is so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability.literal_windows import LiteralWindows
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.move_arrays import FREE, MoveArrays


class SiteGroup(NamedTuple):
    """Sites, by number, of which at most one is on, or with `exactly` one."""

    exactly: bool
    sites: tuple[int, ...]


def groups_of(met: MetMoves, moves: MoveArrays, windows: LiteralWindows) -> tuple[SiteGroup, ...]:
    """Return the groups that are proposed for the system and hold."""
    found: list[SiteGroup] = []
    on, able = met.on(0), windows.first <= windows.last
    for sites in met.proposed_groups():
        if len(sites) > 1:
            exactly = _kept(sites, moves, able)
            count = int(on[list(sites)].sum())
            if exactly is not None and count <= 1:
                found.append(SiteGroup(exactly and count == 1, sites))
    return tuple(found)


def _kept(sites: tuple[int, ...], moves: MoveArrays, able: NDArray[np.bool_]) -> bool | None:
    """Return whether moves keep the number of sites that are on; None if it could exceed one."""
    inside = np.zeros(int(moves.sites.max(initial=0)) + 1, dtype=np.bool_)
    inside[[site for site in sites if site < len(inside)]] = True
    places = np.flatnonzero(inside[moves.sites])
    action = np.searchsorted(moves.starts, places, side="right") - 1
    codes = moves.codes[places]
    count = len(moves.starts) - 1
    size = np.bincount(action, minlength=count)
    free = np.bincount(action, (codes & FREE) != 0, count) > 0
    keeps = True
    for way in (0, 1):
        some = able[way::2] & (size > 0)
        old = np.bincount(action, (codes >> way) & 1, count)
        new = np.bincount(action, (codes >> (1 - way)) & 1, count)
        if (some & (free | (new > 1))).any():
            return None
        fewer = new < old
        # None was on among those that it reads, which must be all of them.
        first = (new > old) & (old == 0) & (size == len(sites))
        if (some & ~((new == old) | fewer | first)).any():
            return None
        keeps = keeps and not (some & (new != old)).any()
    return keeps
