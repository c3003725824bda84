"""Two runs without rounds: the commits that differ first by what they depend on, and why.

Room: coordinator. When things happened differs between any two such runs, and is not compared. A
commit is the same in both if it is the same move of the same module, writes the same, and depends
on the same commits, all of them the same; so runs all of whose commits are the same are equal up to
commuting. Of the others those are first that depend on no other of them.
"""

from __future__ import annotations

from itertools import chain

from cubepath.coordinator.comparison.free_reasons import explain_commit
from cubepath.coordinator.comparison.free_run import Commit, CommitId, FreeRun
from cubepath.coordinator.comparison.moves import advance, compare_paths
from cubepath.coordinator.comparison.results import Apart, Compared, MoveDifference, Paths
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording

NOT_COMPARED = (
    "not compared, as it follows from timing: who was shown what when, turns in which a module"
    " stayed, attempts that were refused, and what keepers say to each other"
)


def compare_free(a: Recording, b: Recording, levels: tuple[int, int | None]) -> Compared:
    """Return where two runs without rounds part; see `diff`."""
    runs = FreeRun(a), FreeRun(b)
    pairs = _other(runs, levels)
    notes = [NOT_COMPARED]
    for name, run in zip("ab", runs, strict=True):
        notes += [f"{name}: {each}" for each in (*run.recording.problems, *run.odd)]
        if run.summary is None:
            notes.append(f"{name} is cut off: no summary")
    choice = move = None
    if pairs:
        first, also = pairs[0], [one or two for one, two in pairs[1:]]
        others = {each.id[0] for each in also if each is not None}
        choice = explain_commit(runs, first, others)
        texts = [None if each is None else each.text() for each in first]
        move = MoveDifference(choice.round, choice.module, texts[0], texts[1])
    ends = None
    if levels[1] is None:
        ends = _ends(runs)
    paths = _paths(runs)
    return Compared(
        str(a.path),
        str(b.path),
        clock="free",
        same=not pairs and ends is None and runs[0].odd == runs[1].odd,
        identical=False,
        parameters={},
        scene=None,
        compared="commits by what they depend on, and what led to the first that differs",
        notes=tuple(notes),
        choice=choice,
        move=move,
        parted=_parted(pairs),
        states=tuple(_states(runs)),
        rounds=tuple(_levels(runs)),
        ends=ends,
        paths=paths,
    )


_Pair = tuple[Commit | None, Commit | None]


def _other(runs: tuple[FreeRun, FreeRun], levels: tuple[int, int | None]) -> list[_Pair]:
    """Return the commits that differ and depend on none that does, by level and module.

    With each comes the commit of the same module and number in the other run, if there is one.
    """
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
    first, last = levels
    found: dict[CommitId, _Pair] = {}
    for commit in chain(one.values(), two.values()):
        within = first <= max(commit.moved.level, 1) and (
            last is None or commit.moved.level <= last
        )
        if commit.id not in same and commit.before <= same and within:
            found[commit.id] = one.get(commit.id), two.get(commit.id)
    return sorted(found.values(), key=_place)


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
    for each in run.history.path():
        named = each.moved.module, each.move.generator, each.move.at
        found.setdefault(each.moved.level, []).append(named)
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
    paths = [run.history.path() for run in runs]
    places = [0, 0]
    last = max((each.moved.level for path in paths for each in path), default=0)
    found: list[Apart] = []
    begin = None if states[0] == states[1] else 0
    for level in range(1, last + 1):
        for side, path in enumerate(paths):
            while places[side] < len(path) and path[places[side]].moved.level <= level:
                advance(states[side], path[places[side]].move.action)
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
    one, two = (run.history.actions for run in runs)
    starts = [run.recording.scene.start_state for run in runs]
    ends = [frozenset(run.history.state) for run in runs]
    identical = _by_level(runs[0]) == _by_level(runs[1])
    return compare_paths(one, two, (starts[0], starts[1]), (ends[0], ends[1]), identical=identical)
