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

The normal form of a path is found here, too: what remains, in one more pass.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set as AbstractSet
from itertools import accumulate, chain
from typing import NamedTuple

from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site, in_order, site_text

CHECK = "dependencies"


class Numbered(NamedTuple):
    """The actions of some paths and their sites, each in the order of their numbers."""

    actions: list[Action]
    sites: list[Site]
    used: list[tuple[tuple[int, ...], tuple[int, ...]]]
    """The sites that each action writes, and those that it only reads, by their numbers."""


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
    names, (run, found) = numbered(path, chain.from_iterable(cubes or ()))
    _check_steps("round", run, ends, names, fail)
    if cubes is None:
        return
    _check_steps("cube", found, accumulate(map(len, cubes)), names, fail)
    why = _apart([run[place] for place in remaining(run, names)], found, names, whole=whole)
    if why is not None:
        what, mine, other = why
        fail(CHECK, f"{what} {other} in the cubes, and in the run {mine} but for what it undoes")


def numbered(*paths: Iterable[Action]) -> tuple[Numbered, list[list[int]]]:
    """Return the actions and sites of some paths as numbers, and the paths by them."""
    known: dict[Action, int] = {}
    number = known.setdefault
    found = [[number(each, len(known)) for each in path] for path in paths]
    sites: dict[Site, int] = {}

    def numbers(some: AbstractSet[Site]) -> tuple[int, ...]:
        return tuple(sites.setdefault(site, len(sites)) for site in in_order(some))

    used = [(numbers(action.trace), numbers(action.reads)) for action in known]
    return Numbered(list(known), list(sites), used), found


def remaining(path: Sequence[int], names: Numbered) -> list[int]:
    """Return the places of the moves that remain when all that is undone is taken out."""
    # For each site the remaining moves that wrote it, each with how many have read it since.
    columns = [[[-1, 0]] for _ in names.sites]
    equal: list[list[int]] = [[] for _ in names.actions]
    left = [True] * len(path)
    for move, action in enumerate(path):
        writes, reads = names.used[action]
        earlier = equal[action][-1] if equal[action] else -1
        # A version that it read is still there: it could not be undone before its reader.
        undone = (
            earlier >= 0
            and all(columns[site][-1] == [earlier, 0] for site in writes)
            and all(columns[site][-1][0] <= earlier for site in reads)
        )
        if undone:
            left[earlier] = left[move] = False
            equal[action].pop()
        else:
            equal[action].append(move)
        for site in writes:
            if undone:
                columns[site].pop()
            else:
                columns[site].append([move, 0])
        for site in reads:
            columns[site][-1][1] += -1 if undone else 1
    return [place for place, each in enumerate(left) if each]


def cubes_of(path: Sequence[Action]) -> list[list[Action]]:
    """Return the normal cube path of an edge path; a cube has its moves in the order of the path.

    Normal is what cannot be moved further down: the level of a move is one more than the greatest
    level of those before it that remain and do not commute with it.

    >>> out, other = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> cubes_of([out, other]) == [[out, other]], cubes_of([out, other, out]) == [[other]]
    (True, True)
    """
    written: dict[Site, int] = {}
    touched: dict[Site, int] = {}
    cubes: list[list[Action]] = []
    names, (numbers,) = numbered(path)
    for place in remaining(numbers, names):
        action = path[place]
        below = 0
        for site in action.trace:
            below = max(below, touched.get(site, 0))
        for site in action.reads:
            below = max(below, written.get(site, 0))
        for site in action.trace:
            written[site] = touched[site] = below + 1
        for site in action.reads:
            touched[site] = max(below + 1, touched.get(site, 0))
        if below == len(cubes):
            cubes.append([])
        cubes[below].append(action)
    return cubes


def _check_steps(
    what: str, path: Sequence[int], ends: Iterable[int], names: Numbered, fail: Fail
) -> None:
    """Name the first move that shares a site with another of its step, one of them writing it."""
    # The last step, from 1, in which each site was touched, and in which it was written.
    touched, written = [0] * len(names.sites), [0] * len(names.sites)
    begin = 0
    for step, end in enumerate(ends, 1):
        for action in path[begin:end]:
            writes, reads = names.used[action]
            shared = chain(
                (site for site in writes if touched[site] == step),
                (site for site in reads if written[site] == step),
            )
            for site in shared:
                fail(
                    CHECK,
                    f"{what} {step}: {names.actions[action].label} and another move of it share"
                    f" {site_text(names.sites[site])}, which one of them writes",
                )
                return
            for site in writes:
                touched[site] = written[site] = step
            for site in reads:
                touched[site] = step
        begin = end


def _apart(
    one: Sequence[int], other: Sequence[int], names: Numbered, *, whole: bool = True
) -> tuple[str, str, str] | None:
    """Return where two paths differ by more than the order of moves that commute.

    That is an action, or what it finds, and how often in each; None if nowhere. Unless the other
    is `whole`, only what it has counts.
    """
    actions = names.actions
    mine, theirs = Counter(one), Counter(other)
    odd = [
        each
        for each in range(len(actions))
        if mine[each] < theirs[each] or (whole and mine[each] > theirs[each])
    ]
    if odd:
        first = min(odd, key=lambda each: actions[each].label)
        return f"{label_of(actions[first])} is", _times(mine[first]), _times(theirs[first])
    known = dict(_versions(other, names))
    for name, found in _versions(one, names):
        for site, version in found.items():
            there = known.get(name, found)[site]
            if version != there:
                what = f"{label_of(actions[name[0]])} finds {site_text(names.sites[site])} written"
                return what, _times(version), _times(there)
    return None


def _versions(
    path: Sequence[int], names: Numbered
) -> Iterator[tuple[tuple[int, int], dict[int, int]]]:
    """Yield each move by its action and how often that came before, with what its sites are at."""
    written, times = [0] * len(names.sites), [0] * len(names.actions)
    for action in path:
        writes, reads = names.used[action]
        yield (action, times[action]), {site: written[site] for site in (*writes, *reads)}
        times[action] += 1
        for site in writes:
            written[site] += 1


def _times(count: int) -> str:
    return f"{count} time" if count == 1 else f"{count} times"


def label_of(action: Action) -> str:
    """Return the label of an action, or what it changes if it has none."""
    return action.label or f"the move of {', '.join(map(site_text, in_order(action.trace)))}"


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
        ours, theirs = ([each[n] for n in remaining(each, names)] for each in (ours, theirs))
    why = _apart(ours, theirs, names)
    return None if why is None else f"{why[0]} {why[1]} in the first, and {why[2]} in the second"
