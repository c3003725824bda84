"""What moves depend on: the sites that they read and write, and at which version they find them.

Part of `cubepath verify`, and a second way to its answer: it uses neither the heap, nor `commute`,
nor the normal form. A move reads the sites of its support and writes those of its trace; the
version of a site counts how often it was written. Three things are checked.

*Each round, and each cube, is one step.* No site that one of its moves writes is read or written by
another. So the moves of a step have no order among themselves, and every conflict (two moves, one
of which writes a site that the other reads or writes) points from a step to a later one: the graph
of conflicts has no cycle, and the order of the steps is one of its orders.

*What is removed is undone.* A move undoes the last equal one that remains if it finds every site as
that one left it: those of the trace at the version that it wrote, read by nobody since, the others
not written since. So no remaining move between the two conflicts with either.

*The rest is in the cubes, and nothing else.* Each remaining move, named by its action and a count
of its earlier occurrences, finds in the cubes the same version of each of its sites as in the run.
Two moves that conflict at a site find it at versions that say which came first. So all conflicts
have the same order in both, and one path becomes the other by exchanging neighbours that do not
conflict.

Together they say that run and cubes are in one homotopy class. Other checks show that the cubes are
its normal form. Equal histories of each site up to cancelling would say less: if a conflicts with b
and with c, but b not with c, each site of (b a c a)(b a c a) sees a word that cancels, and the
whole does not.

Two whole edge paths are compared in the same terms: equal up to swapping commuting moves, or
homotopic. Up to swapping, a path is given by its moves and by the order of those that do not
commute. Those share a site that one of them writes, so the versions that each move finds give the
order. Moves with equal actions do not commute, so the n-th of one path corresponds to the n-th of
the other. Two paths from one start are homotopic if they are equal after everything that cancels is
removed. Time is linear in the supports, and nothing is shared with shortening.
"""

from collections.abc import Iterable, Sequence, Set as AbstractSet
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site, in_order, site_text

CHECK = "dependencies"
_Numbers = NDArray[np.int32]
_Counts = NDArray[np.int64]


class Table(NamedTuple):
    """What each action reads and writes, by number."""

    begin: _Numbers
    """Where the sites of each action begin in `sites`, those of its trace first; one more."""
    reads: _Numbers
    """Where the sites begin that it does not write."""
    sites: _Numbers


class Numbered(NamedTuple):
    """The actions of some paths and their sites, each in the order of their numbers."""

    actions: list[Action]
    sites: list[Site]
    table: Table

    def work(self, path: _Numbers) -> int:
        """Return how many sites the moves of a path read and write."""
        return int(np.diff(self.table.begin)[path].sum())


class _Live(NamedTuple):
    """The moves that are left so far."""

    version: _Numbers
    """For each site the last of them that wrote it, -1 if none did."""
    readers: _Numbers
    """How many of them have read the site since."""
    last: _Numbers
    """For each action the last of them that is it, -1 if none is."""
    equal: _Numbers
    """For each move the one with its action that was left before it."""
    starts: _Counts
    """Where the sites that a move wrote begin in `before`."""
    before: _Numbers
    """For each site that a move wrote, of shape (sites, 2), its version and readers before."""


class _Steps(NamedTuple):
    """The last step, from 1, in which each site was touched, and in which it was written."""

    touched: _Numbers
    written: _Numbers


class _Seen(NamedTuple):
    """How often each site of each move was written before it, and where its sites begin."""

    starts: _Counts
    versions: _Numbers


class _Pairs(NamedTuple):
    """Moves of two paths that have to find the same: their action, and the place of each."""

    actions: _Numbers
    ours: _Counts
    theirs: _Counts


def check_dependencies(
    path: Sequence[Action],
    ends: Sequence[int],
    cubes: Sequence[Sequence[Action]] | None,
    fail: Fail,
    *,
    whole: bool,
) -> None:
    """Check a path in rounds, which end after `ends` moves each, and its cubes, if they are known.

    If they are not the `whole` of the cubes, they have to be the first ones. Costs the supports.
    """
    flat = [] if cubes is None else list(chain.from_iterable(cubes))
    names, (run, found) = numbered(path, flat)
    _check_steps("round", run, np.asarray(ends, dtype=np.int64), names, fail)
    if cubes is None:
        return
    ends_of_cubes = np.cumsum([len(cube) for cube in cubes], dtype=np.int64)
    _check_steps("cube", found, ends_of_cubes, names, fail)
    _check_versions(run[remaining(run, names)], found, names, fail, whole=whole)


def numbered(*paths: Iterable[Action]) -> tuple[Numbered, list[_Numbers]]:
    """Return the actions and sites of some paths as numbers, and the paths by them."""
    known: dict[Action, int] = {}
    number = known.setdefault
    found = [np.array([number(each, len(known)) for each in path], np.int32) for path in paths]
    sites: dict[Site, int] = {}
    begin, reads, flat = [0], [0] * len(known), list[int]()
    for place, action in enumerate(known):
        flat += [sites.setdefault(site, len(sites)) for site in in_order(action.trace)]
        reads[place] = len(flat)
        flat += [sites.setdefault(site, len(sites)) for site in in_order(action.reads)]
        begin.append(len(flat))
    table = Table(*(np.array(each, np.int32) for each in (begin, reads, flat)))
    return Numbered(list(known), list(sites), table), found


def remaining(path: _Numbers, names: Numbered) -> NDArray[np.bool_]:
    """Return for each move whether it is left when all that is undone is taken out."""
    table, sites = names.table, len(names.sites)
    starts = np.zeros(len(path) + 1, np.int64)
    np.cumsum((table.reads - table.begin[:-1])[path], out=starts[1:])
    live = _Live(
        version=np.full(sites, -1, np.int32),
        readers=np.zeros(sites, np.int32),
        last=np.full(len(names.actions), -1, np.int32),
        equal=np.full(len(path), -1, np.int32),
        starts=starts,
        before=np.zeros((int(starts[-1]), 2), np.int32),
    )
    left = np.ones(len(path), np.bool_)
    _take_out.for_work(names.work(path), by_entries=True)(path, table, live, left)
    return left


def _check_steps(what: str, path: _Numbers, ends: _Counts, names: Numbered, fail: Fail) -> None:
    sites = len(names.sites)
    steps = _Steps(np.zeros(sites, np.int32), np.zeros(sites, np.int32))
    where = np.zeros(3, np.int64)
    shared = _shared.for_work(names.work(path), by_entries=True)
    if shared(path, ends, names.table, steps, where):
        step, move, site = where.tolist()
        fail(
            CHECK,
            f"{what} {step}: {names.actions[path[move]].label} and another move of it share"
            f" {site_text(names.sites[site])}, which one of them writes",
        )


def _check_versions(
    run: _Numbers, cubes: _Numbers, names: Numbered, fail: Fail, *, whole: bool
) -> None:
    count = len(names.actions)
    in_run, in_cubes = (np.bincount(each, minlength=count) for each in (run, cubes))
    odd = np.flatnonzero((in_run != in_cubes) if whole else (in_run < in_cubes))
    if odd.size:
        place = min(odd.tolist(), key=lambda each: names.actions[each].label)
        fail(
            CHECK,
            f"{names.actions[place].label} is {_times(in_cubes[place])} in the cubes, and in the"
            f" run {_times(in_run[place])} but for what it undoes",
        )
        return
    found = _first_apart(run, cubes, names)
    if found is not None:
        move, site, mine, other = found
        fail(
            CHECK,
            f"{names.actions[run[move]].label} finds {site_text(names.sites[site])} written"
            f" {_times(other)} in the cubes, and in the run {_times(mine)} but for what it undoes",
        )


def _first_apart(
    run: _Numbers, other: _Numbers, names: Numbered
) -> tuple[int, int, int, int] | None:
    """Return the first move of a path that finds a site at another version than in the other path.

    No action may be more often in the other path. With it come the site and both versions.
    """
    count = len(names.actions)
    in_run, in_other = (np.bincount(each, minlength=count) for each in (run, other))
    # Each move of the other path beside that of the run which is as often before it.
    ours, theirs = (np.argsort(each, kind="stable") for each in (run, other))
    first = np.zeros(count, np.int64)
    np.cumsum(in_run[:-1], out=first[1:])
    ours = ours[np.arange(len(ours)) - first[run[ours]] < in_other[run[ours]]]
    pairs = _Pairs(run[ours], ours, theirs)
    where = np.zeros(4, np.int64)
    differs = _differs.for_work(names.work(other), by_entries=True)
    if not differs(pairs, _seen(run, names), _seen(other, names), names.table, where):
        return None
    move, site, mine, found = where.tolist()
    return move, site, mine, found


def apart(one: _Numbers, other: _Numbers, names: Numbered) -> str | None:
    """Return in one line where two paths differ by more than the order of commuting moves."""
    count = len(names.actions)
    if not count:
        return None
    times = [np.bincount(each, minlength=count).tolist() for each in (one, other)]
    odd = [place for place in range(count) if times[0][place] != times[1][place]]
    if odd:
        place = min(odd, key=lambda each: names.actions[each].label)
        return (
            f"{label_of(names.actions[place])} is {_times(times[0][place])} in the first, and"
            f" {_times(times[1][place])} in the second"
        )
    found = _first_apart(one, other, names)
    if found is None:
        return None
    move, site, mine, theirs = found
    return (
        f"{label_of(names.actions[one[move]])} finds {site_text(names.sites[site])} written"
        f" {_times(mine)} in the first, and {_times(theirs)} in the second"
    )


def _times(count: int) -> str:
    return f"{count} time" if count == 1 else f"{count} times"


def label_of(action: Action) -> str:
    """Return the label of an action, or what it changes if it has none."""
    return action.label or f"the move of {', '.join(map(site_text, in_order(action.trace)))}"


def _seen(path: _Numbers, names: Numbered) -> _Seen:
    """Return the version at which each move finds each of its sites."""
    starts = np.zeros(len(path) + 1, np.int64)
    np.cumsum(np.diff(names.table.begin)[path], out=starts[1:])
    versions = np.zeros(int(starts[-1]), np.int32)
    written = np.zeros(len(names.sites), np.int32)
    note = _note_versions.for_work(len(versions), by_entries=True)
    note(path, names.table, written, versions)
    return _Seen(starts, versions)


@compiled
def _shared(path: _Numbers, ends: _Counts, table: Table, steps: _Steps, where: _Counts) -> bool:
    """Find the first move that shares a site with another of its step, one of them writing it.

    `where` is given the step, the move and the site.
    """
    move = 0
    for step in range(1, len(ends) + 1):
        while move < ends[step - 1]:
            action = path[move]
            for place in range(table.begin[action], table.begin[action + 1]):
                site = table.sites[place]
                writes = place < table.reads[action]
                if steps.written[site] == step or (writes and steps.touched[site] == step):
                    where[0] = step
                    where[1] = move
                    where[2] = site
                    return True
            for place in range(table.begin[action], table.begin[action + 1]):
                steps.touched[table.sites[place]] = step
                if place < table.reads[action]:
                    steps.written[table.sites[place]] = step
            move += 1
    return False


@compiled
def _take_out(path: _Numbers, table: Table, live: _Live, left: NDArray[np.bool_]) -> None:
    """Set `left` to False for each move that is undone, and for the one that undoes it."""
    for move in range(len(path)):
        action = path[move]
        earlier = int(live.last[action])
        if earlier >= 0 and _finds_all(action, earlier, table, live):
            left[earlier] = False
            left[move] = False
            live.last[action] = live.equal[earlier]
            _undo(action, earlier, table, live)
        else:
            live.equal[move] = earlier
            live.last[action] = move
            _write(action, move, table, live)


@compiled
def _finds_all(action: int, earlier: int, table: Table, live: _Live) -> bool:
    """Return whether every site of an action is as an earlier move with that action left it."""
    for place in range(table.begin[action], table.reads[action]):
        site = table.sites[place]
        if live.version[site] != earlier or live.readers[site] != 0:
            return False
    for place in range(table.reads[action], table.begin[action + 1]):
        # The version that it read is still there: it could not be undone before its reader.
        if live.version[table.sites[place]] > earlier:
            return False
    return True


@compiled
def _undo(action: int, earlier: int, table: Table, live: _Live) -> None:
    kept = live.starts[earlier]
    for place in range(table.begin[action], table.reads[action]):
        live.version[table.sites[place]] = live.before[kept, 0]
        live.readers[table.sites[place]] = live.before[kept, 1]
        kept += 1
    for place in range(table.reads[action], table.begin[action + 1]):
        live.readers[table.sites[place]] -= 1


@compiled
def _write(action: int, move: int, table: Table, live: _Live) -> None:
    kept = live.starts[move]
    for place in range(table.begin[action], table.reads[action]):
        site = table.sites[place]
        live.before[kept, 0] = live.version[site]
        live.before[kept, 1] = live.readers[site]
        live.version[site] = move
        live.readers[site] = 0
        kept += 1
    for place in range(table.reads[action], table.begin[action + 1]):
        live.readers[table.sites[place]] += 1


@compiled
def _note_versions(path: _Numbers, table: Table, written: _Numbers, versions: _Numbers) -> None:
    """Note how often each site of each move was written before it."""
    here = 0
    for move in range(len(path)):
        action = path[move]
        for place in range(table.begin[action], table.begin[action + 1]):
            versions[here] = written[table.sites[place]]
            here += 1
        for place in range(table.begin[action], table.reads[action]):
            written[table.sites[place]] += 1


@compiled
def _differs(pairs: _Pairs, ours: _Seen, theirs: _Seen, table: Table, where: _Counts) -> bool:
    """Find the first of our moves that finds a site at another version than theirs.

    `where` is given the move, the site and both versions.
    """
    found = False
    for pair in range(len(pairs.actions)):
        mine, other = pairs.ours[pair], pairs.theirs[pair]
        if found and mine >= where[0]:
            continue
        begin = table.begin[pairs.actions[pair]]
        for place in range(begin, table.begin[pairs.actions[pair] + 1]):
            one = ours.versions[ours.starts[mine] + place - begin]
            two = theirs.versions[theirs.starts[other] + place - begin]
            if one != two:
                found = True
                where[0] = mine
                where[1] = table.sites[place]
                where[2] = one
                where[3] = two
                break
    return found


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
    putting in a move that is undone immediately.

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
