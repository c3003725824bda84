"""Whether the moves of a path are admissible one after another, compiled, on numbered actions.

It decides as `cubepath.protocol.core.actions.end_at` does on sets. The state may be known only in
part, as in `cubepath.protocol.path_files.moves.read_moves`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.numbered import NumberedPath
from cubepath.protocol.path_files.supports import FIRST, FREE, TRACE, SupportRows

Bytes = NDArray[np.int8]

# What is known of a site's state, as bits: on, and unknown.
_ON, _UNKNOWN = 1, 2


class InadmissibleMove(NamedTuple):
    """A move that is not admissible, as its place from 0, and the known part of the state there."""

    move: int
    state: frozenset[Site]


def carried_out(path: NumberedPath, start: State | None) -> NumberedPath | InadmissibleMove:
    """Return the path with the local state at which each move was made, or the first misfit.

    With a start the whole state is known. Without one, the first move with a site in its support
    determines the state of the site; a move that does not say from which of its local states it
    starts is checked only against what is known. A move without stated local states makes its trace
    unknown. In the result, `ends` is -1 for moves whose local state is not known. Time is linear in
    the supports.
    """
    supports = path.supports
    rows, sites = supports.rows, supports.sites
    state = np.full(len(sites), _UNKNOWN if start is None else 0, dtype=np.int8)
    if start is not None:
        state[[number for number, site in enumerate(sites) if site in start]] = _ON
    ends = path.ends.copy()
    walk = _walk.for_work(int(np.diff(rows.starts)[path.numbers].sum()))
    found = int(walk(rows, path.numbers, ends, state))
    if found >= 0:
        return InadmissibleMove(
            found, frozenset(site for number, site in enumerate(sites) if state[number] & 1)
        )
    return replace(path, ends=ends, table=supports)


def end_of(path: NumberedPath, start: State) -> frozenset[Site]:
    """Return the state at the end of a path that is admissible from `start` on.

    Every move changes the sites where its two local states differ; what is changed an odd number of
    times is changed.
    """
    rows, sites = path.supports.rows, path.supports.sites
    odd = np.bincount(path.numbers, minlength=len(rows.starts) - 1) & 1
    changes = (rows.says ^ rows.says >> 1) & FIRST & np.repeat(odd, np.diff(rows.starts))
    times = np.bincount(rows.sites[changes > 0], minlength=len(sites))
    changed = [sites[site] for site in np.flatnonzero(times & 1).tolist()]
    return frozenset(start).symmetric_difference(changed)


@compiled
def _walk(  # noqa: C901, PLR0912 - one function, since a call costs as much as a move
    supports: SupportRows, numbers: NDArray[np.int32], ends: Bytes, state: Bytes
) -> int:
    """Make the moves and write `ends`; return the first move that is not admissible, or -1."""
    for move in range(len(numbers)):
        number = numbers[move]
        begin, stop = supports.starts[number], supports.starts[number + 1]
        if not supports.stated[number]:
            for index in range(begin, stop):
                if supports.says[index] & TRACE:
                    state[supports.sites[index]] |= _UNKNOWN
            continue
        end_index = ends[move]
        fits = 3
        for index in range(begin, stop):
            site, local = supports.sites[index], supports.says[index]
            if local & FREE:
                continue
            if state[site] & _UNKNOWN:
                if end_index < 0:
                    continue
                state[site] = (local >> end_index) & 1
            # One bit for each local state that agrees with the state of the site.
            fits &= local if state[site] & _ON else ~local
        for place in range(supports.guard_starts[number], supports.guard_starts[number + 1]):
            one, other = supports.guards[place]
            if state[one] == _ON and state[other] == 0:
                fits = 0
        if fits == 0:
            return move
        end = 0 if fits & 1 else 1
        if fits == 3:
            # Both local states fit, so no site of the trace is known, and the move does not say.
            end = end_index
        ends[move] = end
        for index in range(begin, stop):
            site, local = supports.sites[index], supports.says[index]
            if local & FREE:
                continue
            if end < 0:
                state[site] |= _UNKNOWN & (local & TRACE) >> 1
            elif local & TRACE:
                state[site] = (local >> (1 - end)) & 1
            else:
                state[site] = (local >> end) & 1
    return -1
