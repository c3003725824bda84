"""Checking a certificate of a path in numbers, compiled: whether it proves, not why it fails.

`cubepath.coordinator.verification.proof` explains the five checks and why they suffice, and is the
reference: it takes actions, and names the moves at fault. This module decides the same over arrays,
without building one action; for the reason of a refusal, callers ask the reference. It trusts what
each row says an action writes and reads. It also checks that the rows are distinct actions, so that
equal moves have equal numbers. It shares no code with the heap of pieces.

Cost: as for the reference, one pass over the path for each check, plus sorting the entries of the
rows. Space: a few numbers for each move, each site, and each time that a site is written.
"""

from collections.abc import Iterable
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.supports import FREE, TRACE, SupportRows, Supports

Numbers = NDArray[np.int32]
Bytes = NDArray[np.int8]
Totals = NDArray[np.int64]


def proves(certificate: Certificate, numbers: Numbers, supports: Supports) -> bool:
    """Return whether a certificate passes the checks of `cubepath.coordinator.check_proof`.

    `numbers` are the actions of the moves in order, as rows of `supports`, shape (moves,). False is
    also the answer if two rows are the same action or two numbers the same site.
    """
    given = _given(certificate)
    if given is None or not _well_formed(given, len(numbers)) or not _distinct(supports):
        return False
    rows, sites = supports.rows, len(supports.sites)
    earlier = np.full(len(numbers), -1, dtype=np.int32)
    earlier[given.pairs[:, 1] - 1] = given.pairs[:, 0] - 1
    cubes = np.zeros(len(numbers), dtype=np.int32)
    cubes[given.order - 1] = np.repeat(np.arange(1, len(given.sizes) + 1), given.sizes)
    if not (cubes[given.chain - 1] > 0).all():
        return False
    steps = steps_of(numbers, rows)
    written = np.diff(supports.part(TRACE, TRACE)[0])[numbers[earlier < 0]]
    room = sites + int(written.sum())
    columns = _Columns(*(np.zeros(size, dtype=np.int32) for size in (sites, room, room, room)))
    if not _cancels.for_work(steps, by_entries=True)(rows, numbers, earlier, columns):
        return False
    last = np.zeros(len(rows.starts), dtype=np.int32)
    seen = _Seen(*(np.zeros(sites, dtype=np.int32) for _ in range(4)))
    if not _scheduled.for_work(2 * steps, by_entries=True)(rows, numbers, cubes, last, seen):
        return False
    links = numbers[given.chain - 1]
    waits = _waits.for_work(2 * steps_of(links, rows), by_entries=True)
    return bool(waits(rows, links, np.zeros(sites, dtype=np.int64)))


def steps_of(numbers: Numbers, rows: SupportRows) -> int:
    """Return how many entries the rows of these moves have."""
    return int(np.diff(rows.starts)[numbers].sum())


class _Given(NamedTuple):
    """A certificate as arrays: its pairs, (pairs, 2), the moves and sizes of cubes, its chain."""

    pairs: Totals
    order: Totals
    sizes: Totals
    chain: Totals


def _given(certificate: Certificate) -> _Given | None:
    """Return what a certificate says, None if some number has no room in 64 bits."""
    cubes = certificate.cubes
    try:
        return _Given(
            _numbers(chain.from_iterable(certificate.cancelled)).reshape(-1, 2),
            _numbers(chain.from_iterable(cubes)),
            _numbers(map(len, cubes)),
            _numbers(certificate.chain),
        )
    except OverflowError:
        return None


def _numbers(values: Iterable[int]) -> Totals:
    return np.fromiter(values, dtype=np.int64)


def _well_formed(given: _Given, moves: int) -> bool:
    """Return whether `form` holds, and all of `chain` but that its moves remain and wait."""
    members = np.concatenate([given.pairs.ravel(), given.order])
    if len(members) != moves or not given.sizes.all():
        return False
    if moves and not 1 <= int(members.min()) <= int(members.max()) <= moves:
        return False
    if len(given.chain) != len(given.sizes) or (np.diff(given.chain) <= 0).any():
        return False
    if len(given.chain) and not 1 <= int(given.chain[0]) <= int(given.chain[-1]) <= moves:
        return False
    in_turn = not (np.diff(given.pairs[:, 1]) < 0).any()
    return in_turn and bool((np.bincount(members, minlength=moves + 1)[1:] == 1).all())


def _distinct(supports: Supports) -> bool:
    """Return whether no two rows are one action, whichever of its local states comes first.

    Rows that differ in their guards alone count as one, so that the reference decides.
    """
    starts, sites, says = supports.rows[:3]
    if len(set(supports.sites)) < len(supports.sites):
        return False
    sizes = np.diff(starts)
    row = np.repeat(np.arange(len(sizes)), sizes)
    order = np.lexsort((sites, row))
    sites, says = sites[order].astype(np.int64), says[order].astype(np.int64)
    if (np.diff(sites)[np.diff(row) == 0] == 0).any():
        return False
    for size in np.unique(sizes).tolist():
        which = (starts[:-1][sizes == size, np.newaxis] + np.arange(size)).astype(np.int64)
        rows = says[which]
        # The local state that has the least site on which the two differ is taken as the first.
        least = np.argmax((rows ^ rows >> 1) & 1, axis=1)[:, np.newaxis]
        turned = np.take_along_axis(rows, least, axis=1) & 1 == 0
        rows = np.where(turned, rows & ~3 | (rows & 1) << 1 | (rows & 2) >> 1, rows)
        found = np.ascontiguousarray(sites[which] << 4 | rows)
        if len(np.unique(found.view(f"V{found.itemsize * size}"))) < len(found):
            return False
    return True


class _Columns(NamedTuple):
    """For each site a stack of what writes it, with how often each is read before the next.

    `top` holds for each site an entry. Entry e is of the move ``writer[e]``, counted from 1, or 0
    for the first entry of a site, entry e of site e; ``readers[e]`` moves that are left read the
    site after that, and ``below[e]`` is the entry under it.
    """

    top: Numbers
    writer: Numbers
    readers: Numbers
    below: Numbers


@compiled
def _cancels(rows: SupportRows, numbers: Numbers, earlier: Numbers, columns: _Columns) -> bool:
    """Return whether `cancelled` holds; `earlier` is -1, or what the move cancels, from 0."""
    top, writer, readers, below = columns
    starts, sites, says = rows.starts, rows.sites, rows.says
    for site in range(len(top)):
        top[site] = site
    used = len(top)
    for move in range(len(numbers)):
        number, first = numbers[move], earlier[move]
        # A pair the wrong way round finds nothing of its other move on top of any site.
        if first >= 0 and numbers[first] != number:
            return False
        for index in range(starts[number], starts[number + 1]):
            site = sites[index]
            entry = top[site]
            if says[index] & TRACE == 0:
                if first >= 0 and writer[entry] > first + 1:
                    return False
                readers[entry] += 1 if first < 0 else -1
            elif first < 0:
                writer[used] = move + 1
                below[used] = entry
                top[site] = used
                used += 1
            elif writer[entry] == first + 1 and readers[entry] == 0:
                top[site] = below[entry]
            else:
                return False
    return True


class _Seen(NamedTuple):
    """For each site: the last cube with a move that writes it and that uses it, and such moves."""

    written_in: Numbers
    touched_in: Numbers
    written: Numbers
    touched: Numbers


@compiled
def _scheduled(
    rows: SupportRows, numbers: Numbers, cubes: Numbers, last: Numbers, seen: _Seen
) -> bool:
    """Return whether `schedule` and `reduced` hold; `cubes` are counted from 1, 0 for none.

    `last` has a 0 for each action, and `seen` for each site.
    """
    written_in, touched_in, written, touched = seen
    starts, sites, says = rows.starts, rows.sites, rows.says
    for move in range(len(numbers)):
        number, cube = numbers[move], cubes[move]
        if cube == 0:
            continue
        before = last[number]
        cancels = before > 0
        for index in range(starts[number], starts[number + 1]):
            site = sites[index]
            if says[index] & TRACE:
                if touched_in[site] >= cube:
                    return False
                cancels = cancels and touched[site] == before
            else:
                if written_in[site] >= cube:
                    return False
                cancels = cancels and written[site] < before
        if cancels:
            return False
        last[number] = move + 1
        for index in range(starts[number], starts[number + 1]):
            site = sites[index]
            touched[site] = move + 1
            touched_in[site] = max(touched_in[site], cube)
            if says[index] & TRACE:
                written[site] = move + 1
                written_in[site] = cube
    return True


@compiled
def _waits(rows: SupportRows, links: Numbers, marks: Totals) -> bool:
    """Return whether of these actions none commutes with the next; `marks` has a 0 for a site."""
    starts, sites, says = rows.starts, rows.sites, rows.says
    for link in range(1, len(links)):
        before, number = links[link - 1], links[link]
        for index in range(starts[before], starts[before + 1]):
            marks[sites[index]] = 2 * link + (1 if says[index] & TRACE else 0)
        waits = False
        for index in range(starts[number], starts[number + 1]):
            mark = marks[sites[index]]
            if mark >> 1 == link and (mark & 1 != 0 or says[index] & TRACE != 0):
                waits = True
        if not waits:
            return False
    return True


def carry_out(numbers: Numbers, rows: SupportRows, state: Bytes) -> bool:
    """Return whether these actions are admissible one after another, and change the state by them.

    `state` is 1 for each site that is on, 0 for the others, shape (sites,). It decides what
    `cubepath.coordinator.verification.rounds.why_not` and `make` do for actions.
    """
    return bool(
        _carried.for_work(2 * steps_of(numbers, rows), by_entries=True)(rows, numbers, state)
    )


@compiled
def _carried(rows: SupportRows, numbers: Numbers, state: Bytes) -> bool:
    starts, sites, says = rows.starts, rows.sites, rows.says
    for move in range(len(numbers)):
        number = numbers[move]
        first = second = True
        for index in range(starts[number], starts[number + 1]):
            local = says[index]
            if local & FREE == 0:
                on = state[sites[index]]
                first = first and local & 1 == on
                second = second and local >> 1 & 1 == on
        if not (first or second):
            return False
        for pair in range(rows.guard_starts[number], rows.guard_starts[number + 1]):
            if state[rows.guards[pair, 0]] == 1 and state[rows.guards[pair, 1]] == 0:
                return False
        for index in range(starts[number], starts[number + 1]):
            local = says[index]
            if local & FREE == 0:
                state[sites[index]] = local >> 1 & 1 if first else local & 1
    return True
