"""Two runs without rounds: which commits differ, by an obvious definition of depending."""

from dataclasses import replace
from functools import cache
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace as with_fields

from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import Commit, CommitLog, Turns, decode_free
from cubepath.protocol.wire.messages import encode
from processes.command_line import GOLDEN
from samples.free_runs import free_recorded

AGV = "agv:graph=grid3x3,n=4"
Name = tuple[int, int]


def commits(recording: Recording) -> dict[Name, Commit]:
    """Return all commits by module, numbered from 1."""
    found: dict[Name, Commit] = {}
    for record in recording.records:
        message: Any = decode_free(record.data)
        for moved in message.parts if isinstance(message, CommitLog) else [message]:
            if isinstance(moved, Commit):
                found[moved.keeper, moved.serial] = moved
    by_module: dict[int, list[Commit]] = {}
    for moved in sorted(found.values(), key=lambda each: (each.epoch, each.number)):
        by_module.setdefault(moved.module, []).append(moved)
    return {(m, n): each for m, some in by_module.items() for n, each in enumerate(some, 1)}


def changes(moved: Commit) -> dict[int, int]:
    """Return the modules that a commit moves or whose registers it writes, with their versions."""
    written = {module: version for _, module, version, note in moved.notes if note is not None}
    return {**written, **{module: version for module, _, _, version in moved.motion}}


def depends(later: Commit, earlier: Commit) -> bool:
    """Return whether a commit found what the other made, or overwrote what it had read."""
    finds = [*later.read, *later.guarded, *((unit, at) for unit, at, _ in later.written)]
    made = [(unit, at + 1) for unit, at, _ in earlier.written]
    overwritten = [(unit, at) for unit, at, _ in later.written]
    held = {module: version for _, module, version, _ in later.notes}
    modules = changes(later)
    of_modules = any(
        (module in modules and modules[module] == version + 1)
        or (module not in modules and held.get(module) == version)
        for module, version in changes(earlier).items()
    )
    return (
        any(each in finds for each in made)
        or any(each in earlier.read for each in overwritten)
        or of_modules
    )


def obvious(a: Recording, b: Recording) -> set[Name]:
    """Return the commits that differ, and depend on none that does."""
    runs = commits(a), commits(b)
    before = [
        {one: {two for two in run if two != one and depends(run[one], run[two])} for one in run}
        for run in runs
    ]

    @cache
    def same(name: Name) -> bool:
        one, two = (run.get(name) for run in runs)
        if one is None or two is None:
            return False
        alike = (one.generator, one.at, _notes(one)) == (two.generator, two.at, _notes(two))
        links = before[0][name] == before[1][name]
        return alike and links and all(same(each) for each in before[0][name])

    return {
        name
        for side in (0, 1)
        for name in runs[side]
        if not same(name) and all(same(each) for each in before[side][name])
    }


def _notes(moved: Commit) -> list[tuple[int, list[int]]]:
    return [(module, note) for _, module, _, note in moved.notes if note is not None]


@pytest.mark.parametrize("seeds", [(0, 1), (1, 2), (2, 2)])
def test_the_first_commits_that_differ_are_those_of_the_definition(seeds: tuple[int, int]) -> None:
    """Of two runs, whatever the order of arrival; both ways the same."""
    a, b = (free_recorded(AGV, seed=seed, moves=12) for seed in seeds)
    mixed = list(b.records)
    Random(1).shuffle(mixed)  # noqa: S311 - a seeded one
    b = replace(b, records=tuple(mixed))
    due = obvious(a, b)
    found, back = diff(a, b), diff(b, a)
    assert found.same == (not due)
    assert found.paths is not None
    assert not found.same or found.paths.same is None
    if not due:
        assert found.choice is None
        return
    assert found.choice is not None
    assert back.choice is not None
    assert (found.choice.module, found.choice.number) in due
    assert {found.choice.module, *found.choice.also} == {module for module, _ in due}
    assert (found.choice.round, found.choice.module) == (back.choice.round, back.choice.module)
    assert found.choice.a == back.choice.b
    assert any("is not on record" not in line for line in found.choice.why)


def test_a_commit_with_another_content_is_the_first_that_differs() -> None:
    """A register that was forged: the module is named, and that its rule did otherwise."""
    a = free_recorded(AGV, seed=3, moves=12)
    wanted = next(
        each
        for each in commits(a).values()
        if each.generator is not None and any(note for *_, note in each.notes)
    )

    def forged(data: bytes) -> bytes:
        message: Any = decode_free(data)
        if isinstance(message, CommitLog):
            return encode(with_fields(message, parts=[*map(changed, message.parts)]))
        return encode(changed(message)) if message == wanted else data

    def changed(moved: Commit) -> Commit:
        notes = [(p, m, v, None if n is None else [7, 7]) for p, m, v, n in moved.notes]
        return with_fields(moved, notes=notes) if moved == wanted else moved

    records = tuple(replace(each, data=forged(each.data)) for each in a.records)
    b = replace(a, records=records)
    found = diff(a, b)
    assert found.choice is not None
    assert found.choice.module == wanted.module
    assert "[7, 7]" in found.choice.b.chose
    assert obvious(a, b) == {(found.choice.module, found.choice.number)}
    once = tuple(
        replace(each, data=forged(each.data)) if each.kind == "commit" else each
        for each in a.records
    )
    both = diff(a, replace(a, records=once)), diff(a, replace(a, records=once[::-1]))
    assert both[0] == both[1]  # whichever of two that contradict each other comes first
    assert not both[0].same
    assert "comes twice, and differs" in str(both[0])


def test_a_run_is_the_same_as_itself_and_as_another_of_its_moves() -> None:
    """The golden one; levels alone are not enough."""
    golden = read_recording(GOLDEN / "hex-free-5.mcap")
    found = diff(golden, golden)
    assert found.same
    assert found.identical
    assert any(note.startswith("not compared") for note in found.notes)


def test_what_is_missing_is_said() -> None:
    """Commits that are not on record, and turns that led to others."""
    a = free_recorded(AGV, seed=4, moves=12)
    last = max(commits(a).values(), key=lambda each: (each.level, each.serial))
    kept = [
        each
        for each in a.records
        if not isinstance(decode_free(each.data), CommitLog)
        and not (isinstance(moved := decode_free(each.data), Commit) and moved == last)
    ]
    found = diff(a, replace(a, records=tuple(kept)))
    assert not found.same
    assert "b has no such commit" in str(found) or "not on record" in str(found)
    silent = [each for each in a.records if not isinstance(decode_free(each.data), Turns)]
    other = free_recorded(AGV, seed=5, moves=12)
    found = diff(replace(a, records=tuple(silent)), other)
    assert found.choice is not None
    assert found.choice.a.drew is None
    assert found.choice.causes == ("unknown",)
    assert "a: the turn that led to it is not on record" in str(found)
