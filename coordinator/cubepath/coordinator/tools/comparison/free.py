"""Two runs without rounds: the commits that differ first by what they depend on, and why.

When things happened differs between any two such runs, and is not compared. A commit is the same in
both if it is the same move of the same module, writes the same, and depends on the same commits,
all of them the same; so runs all of whose commits are the same are equal up to commuting. Of the
others those are first that depend on no other of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from cubepath.coordinator.tools.comparison.free_reasons import explain_commit
from cubepath.coordinator.tools.comparison.free_run import Commit, CommitId, FreeRun
from cubepath.coordinator.tools.comparison.moves import advance, compare_paths, named, states_text
from cubepath.coordinator.tools.comparison.results import (
    NAMES,
    Apart,
    MoveDifference,
    Paths,
)
from cubepath.coordinator.tools.comparison.told import Compared
from cubepath.coordinator.verification.transcript import site_in
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import Moved

NOT_COMPARED = (
    "not compared, as it follows from timing: who was shown what when, turns in which a module"
    " stayed, attempts that were refused, and what keepers say to each other"
)


def compare_free(a: Recording, b: Recording) -> Compared:
    """Return where two runs without rounds part; see `diff`."""
    runs = FreeRun(a), FreeRun(b)
    same = _same(runs)
    _check_comparable(runs)
    pairs = _other(runs, same)
    more = tuple(sum(name not in same for name in run.commits) for run in runs)
    notes = [NOT_COMPARED, *_notes(runs)]
    choice = None
    if pairs:
        also = [one or two for one, two in pairs[1:]]
        others = {each.id[0] for each in also if each is not None}
        choice = explain_commit(runs, pairs[0], others)
    ends = _ends(runs)
    lost = any(run.missing or run.loose for run in runs)
    beginning = None
    if not pairs and any(more) and not lost:
        beginning = "b" if not more[1] else "a" if not more[0] else None
    whole = bool(pairs) or not any(more)
    return Compared(
        str(a.path),
        str(b.path),
        clock="free",
        same=whole and not (pairs or lost or ends) and runs[0].odd == runs[1].odd,
        identical=False,
        parameters={},
        scene=None,
        compared=_compared(runs, same, more),
        notes=tuple(notes),
        choice=choice,
        move=_first_move(runs, same) if pairs else None,
        parted=_parted(pairs),
        # Where commits are only missing, levels do not tell how far a run had come.
        states=tuple(_states(runs)) if whole else (),
        rounds=tuple(_levels(runs)) if whole else (),
        ends=ends,
        paths=_paths(runs) if whole else _paths_of(runs, same),
        beginning=beginning,
        limited=any(run.partial for run in runs),
    )


def _check_comparable(runs: tuple[FreeRun, FreeRun]) -> None:
    """Refuse runs of which nothing can be compared, as the first commits are missing."""
    for run in runs:
        if not run.commits and run.partial:
            why = [f"has {run.cut}"] if run.cut is not None else []
            why += [f"is damaged: {problem}" for problem in run.recording.problems[:1]]
            raise InputError(
                f"{run.recording.path}: nothing to compare, as its first commits are not on record:"
                f" it {', and '.join(why) or 'is cut off'}"
            )


def _notes(runs: tuple[FreeRun, FreeRun]) -> Iterator[str]:
    for name, run in zip(NAMES, runs, strict=True):
        for problem in run.recording.problems:
            yield f"{name} is damaged: {problem}"
        if run.cut is not None:
            yield f"{name} has {run.cut}"
        yield from (f"{name}: {each}" for each in run.odd)
        if run.missing:
            are = "is" if run.missing == 1 else "are"
            yield f"{name}: {counted(run.missing, 'commit')} {are} not on record"
        if run.loose:
            follow = "follows" if run.loose == 1 else "follow"
            yield (
                f"{name}: {counted(run.loose, 'commit')} {follow} on others that are not on record,"
                " and cannot be compared"
            )
        if run.summary is None and run.cut is None:
            yield f"{name} is cut off: no summary"


def _compared(runs: tuple[FreeRun, FreeRun], same: set[CommitId], more: tuple[int, ...]) -> str:
    one, two = (len(run.commits) for run in runs)
    if not any(more):
        return f"{counted(one, 'commit')}, by what they depend on"
    return (
        f"{counted(one, 'commit')} in a, {two} in b, by what they depend on: {len(same)} of them"
        " are the same"
    )


_Pair = tuple[Commit | None, Commit | None]


def _same(runs: tuple[FreeRun, FreeRun]) -> set[CommitId]:
    """Return the commits that are the same in both, with all that they depend on."""
    one, two = (run.commits for run in runs)
    same: set[CommitId] = set()
    for name, commit in one.items():
        other = two.get(name)
        if (
            other is not None
            and (commit.content, commit.before) == (other.content, other.before)
            and commit.before <= same
        ):
            same.add(name)
    return same


def _other(runs: tuple[FreeRun, FreeRun], same: set[CommitId]) -> list[_Pair]:
    """Return the commits that differ and depend on none that does, by level and module.

    With each comes the commit of the same module and number in the other run, if there is one. What
    a run lacks that has not all its commits on record is no difference.
    """
    one, two = (run.commits for run in runs)
    found: dict[CommitId, _Pair] = {}
    for commit in chain(one.values(), two.values()):
        if commit.id in same or not commit.before <= same:
            continue
        pair = one.get(commit.id), two.get(commit.id)
        lacks = zip(runs, pair, strict=True)
        if not any(run.partial and each is None for run, each in lacks):
            found[commit.id] = pair
    return sorted(found.values(), key=_place)


def _first_move(runs: tuple[FreeRun, FreeRun], same: set[CommitId]) -> MoveDifference | None:
    """Return the first commit with a move that is not the same in both, by level and module."""
    one, two = (run.commits for run in runs)
    pairs = [
        (one.get(name), two.get(name))
        for name in {**one, **two}
        if name not in same and any(run.get(name) is not None for run in (one, two))
    ]
    moved = [
        pair
        for pair in pairs
        if any(each is not None and each.move is not None for each in pair)
        and not any(run.partial and each is None for run, each in zip(runs, pair, strict=True))
    ]
    if not moved:
        return None
    pair = min(moved, key=_place)
    level, module, _ = _place(pair)
    texts = [
        None if each is None or each.move is None else f"{each.move} (level {each.moved.level})"
        for each in pair
    ]
    return MoveDifference(level, module, texts[0], texts[1])


def _place(pair: _Pair) -> tuple[int, int, int]:
    return min(each.place for each in pair if each is not None)


def _parted(pairs: list[_Pair]) -> dict[int, int]:
    """Return by module the level of the first commit that differs, of those that come first."""
    found: dict[int, int] = {}
    for pair in pairs:
        level, module, _ = _place(pair)
        found.setdefault(module, level)
    return found


def _ends(runs: tuple[FreeRun, FreeRun]) -> tuple[str, str] | None:
    told = ["not on record" if run.summary is None else run.summary.ended for run in runs]
    return (told[0], told[1]) if told[0] != told[1] else None


_Named = tuple[int, str, Site]


def _by_level(run: FreeRun) -> dict[int, list[_Named]]:
    found: dict[int, list[_Named]] = {}
    for moved, _ in run.moves():
        named = moved.module, str(moved.generator), site_in(moved.at)
        found.setdefault(moved.level, []).append(named)
    return found


def _levels(runs: tuple[FreeRun, FreeRun]) -> list[tuple[int, int, int, int]]:
    one, two = (_by_level(run) for run in runs)
    found: list[tuple[int, int, int, int]] = []
    for level in sorted({*one, *two}):
        mine, theirs = set(one.get(level, ())), set(two.get(level, ()))
        if mine != theirs:
            found.append((level, len(mine), len(theirs), len(mine & theirs)))
    return found


def _states(runs: tuple[FreeRun, FreeRun]) -> list[Apart]:
    """Return from the end of which level to that of which the states differ."""
    states = [set(run.recording.scene.start_state) for run in runs]
    paths = [list(run.moves()) for run in runs]
    places = [0, 0]
    last = max((moved.level for path in paths for moved, _ in path), default=0)
    found: list[Apart] = []
    begin = None if states[0] == states[1] else 0
    for level in range(1, last + 1):
        for side, path in enumerate(paths):
            while places[side] < len(path) and path[places[side]][0].level <= level:
                advance(states[side], path[places[side]][1])
                places[side] += 1
        if (states[0] == states[1]) == (begin is None):
            continue
        if begin is None:
            begin = level
        else:
            found.append(Apart(begin, level))
            begin = None
    return found if begin is None else [*found, Apart(begin, None)]


def _paths(runs: tuple[FreeRun, FreeRun]) -> Paths:
    one, two = ([_action(*each) for each in run.moves()] for run in runs)
    starts = [run.recording.scene.start_state for run in runs]
    end = states_text(*(frozenset(run.history.state) for run in runs))
    identical = _by_level(runs[0]) == _by_level(runs[1])
    return compare_paths(one, two, (starts[0], starts[1]), end, identical=identical)


def _paths_of(runs: tuple[FreeRun, FreeRun], same: set[CommitId]) -> Paths:
    """Return how the paths compare of the commits that are the same in both."""
    kept = [{run.commits[name].name for name in same} for run in runs]
    one, two = (
        [
            _action(moved, action)
            for moved, action in run.moves()
            if (moved.keeper, moved.serial) in names
        ]
        for run, names in zip(runs, kept, strict=True)
    )
    starts = [run.recording.scene.start_state for run in runs]
    return compare_paths(one, two, (starts[0], starts[1]), None, identical=False)


def _action(moved: Moved, action: Action) -> Action:
    place = site_in(moved.at)
    if moved.generator is None or place is None:
        return action
    return named(action, moved.generator, place)
