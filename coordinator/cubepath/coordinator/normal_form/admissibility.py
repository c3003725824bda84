"""Whether the moves of a path are admissible one after another, compiled, on numbered actions.

It decides the same as `cubepath.protocol.core.actions.end_at` does on sets. The state may be known
in part, as in `cubepath.protocol.path_files.moves.read_moves`.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.ordinals import Ordinals
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.numbered import NumberedPath

Numbers = NDArray[np.int32]
Bytes = NDArray[np.int8]

# What an action says about a site, as bits: on in local state 0, on in 1, in the trace, free.
_TRACE, _FREE = 4, 8
# What is known of a site's state, as bits: on, and unknown.
_ON, _UNKNOWN = 1, 2


class _Supports(NamedTuple):
    """The supports of all actions in compressed rows, and the pairs of sites of their guards."""

    starts: Numbers
    sites: Numbers
    says: Bytes
    guard_starts: Numbers
    guards: Numbers
    stated: NDArray[np.bool_]


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
    supports, sites = _supports(path)
    state = np.full(len(sites), _UNKNOWN if start is None else 0, dtype=np.int8)
    if start is not None:
        state[[number for site, number in sites.items() if site in start]] = _ON
    ends = path.ends.copy()
    walk = _walk.for_work(int(np.diff(supports.starts)[path.numbers].sum()))
    found = int(walk(supports, path.numbers, ends, state))
    if found >= 0:
        return InadmissibleMove(
            found, frozenset(site for site, number in sites.items() if state[number] & 1)
        )
    return replace(path, ends=ends)


def _supports(path: NumberedPath) -> tuple[_Supports, dict[Site, int]]:
    numbers = Ordinals[Site]()
    starts, guard_starts = [0], [0]
    sites: list[int] = []
    says: list[int] = []
    guards: list[tuple[int, int]] = []
    for action in path.actions:
        for site in action.support:
            sites.append(numbers[site])
            says.append(_said(action, site))
        guards += [(numbers[one], numbers[other]) for one, other in action.guards]
        starts.append(len(sites))
        guard_starts.append(len(guards))
    supports = _Supports(
        np.array(starts, dtype=np.int32),
        np.array(sites, dtype=np.int32),
        np.array(says, dtype=np.int8),
        np.array(guard_starts, dtype=np.int32),
        np.array(guards, dtype=np.int32).reshape(-1, 2),
        np.array(path.stated, dtype=np.bool_),
    )
    return supports, numbers


def _said(action: Action, site: Site) -> int:
    first, second = action.ends
    return (
        (site in first)
        + 2 * (site in second)
        + _TRACE * (site in action.trace)
        + _FREE * (site in action.free)
    )


@compiled
def _walk(  # noqa: C901, PLR0912 - one function, since a call costs as much as a move
    supports: _Supports, numbers: Numbers, ends: Bytes, state: Bytes
) -> int:
    """Make the moves and write `ends`; return the first move that is not admissible, or -1."""
    for move in range(len(numbers)):
        number = numbers[move]
        begin, stop = supports.starts[number], supports.starts[number + 1]
        if not supports.stated[number]:
            for index in range(begin, stop):
                if supports.says[index] & _TRACE:
                    state[supports.sites[index]] |= _UNKNOWN
            continue
        told = ends[move]
        fits = 3
        for index in range(begin, stop):
            site, said = supports.sites[index], supports.says[index]
            if said & _FREE:
                continue
            if state[site] & _UNKNOWN:
                if told < 0:
                    continue
                state[site] = (said >> told) & 1
            # One bit for each local state that agrees with the state of the site.
            fits &= said if state[site] & _ON else ~said
        for place in range(supports.guard_starts[number], supports.guard_starts[number + 1]):
            one, other = supports.guards[place]
            if state[one] == _ON and state[other] == 0:
                fits = 0
        if fits == 0:
            return move
        end = 0 if fits & 1 else 1
        if fits == 3:
            # Both local states fit, so no site of the trace is known, and the move does not say.
            end = told
        ends[move] = end
        for index in range(begin, stop):
            site, said = supports.sites[index], supports.says[index]
            if said & _FREE:
                continue
            if end < 0:
                state[site] |= _UNKNOWN & (said & _TRACE) >> 1
            elif said & _TRACE:
                state[site] = (said >> (1 - end)) & 1
            else:
                state[site] = (said >> end) & 1
    return -1
