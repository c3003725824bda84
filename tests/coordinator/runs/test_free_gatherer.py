"""Commits of keepers are gathered by their versions, in any order, and never what cannot be."""

from collections.abc import Sequence
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import replace
from numpy.random import default_rng

from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.free_messages import Commit, CommitLog
from oracles.obvious import obvious_normal_form
from samples.free_runs import free_run, results, write

SPECS = (
    "agv:graph=grid6x6,n=6",
    "hex:n=7",
    "agv-labelled:graph=grid6x6,n=5",
    "sliding:p=3,q=2,n=4",
)
KEEPERS = 3


def run_of(spec: str, seed: int = 0) -> tuple[Scene, list[Any]]:
    """Return the scene and the commits of a run, in the order in which they were made."""
    scene, messages = free_run(spec, keepers=KEEPERS, seed=seed)
    return scene, [message for message in messages if isinstance(message, Commit)]


def gather(scene: Scene, commits: Sequence[Commit]) -> FreeGatherer:
    """Return what is gathered of these commits in this order."""
    found = FreeGatherer(scene, KEEPERS)
    for moved in commits:
        found.receive(moved)
    return found


@pytest.mark.parametrize("spec", SPECS)
@given(order=st.randoms(use_true_random=False))
@settings(max_examples=3, deadline=None)
def test_the_result_does_not_depend_on_the_order_of_arrival_nor_on_doubles(
    spec: str, order: Random
) -> None:
    """Path, digest, cubes and sites are those of the order in which keepers committed."""
    scene, commits = run_of(spec)
    whole = gather(scene, commits)
    shuffled = [*commits, *order.choices(commits, k=10)]
    order.shuffle(shuffled)
    found = gather(scene, shuffled)
    assert found.unfinished is None
    assert list(found.path) == list(whole.path)
    assert (found.digest, found.sites, found.schedule()) == (
        whole.digest,
        whole.sites,
        whole.schedule(),
    )
    assert found.live.cubes == found.heap.cubes == len(obvious_normal_form(found.path))


@pytest.mark.parametrize("spec", SPECS)
def test_levels_are_those_of_the_heap_without_cancellation(spec: str) -> None:
    """A move is one level above the highest move before it that does not commute with it."""
    scene, commits = run_of(spec)
    found = gather(scene, commits)
    below: list[tuple[Any, int]] = []
    for step in found.steps:
        levels = [
            1 + max((level for other, level in below if not commute(action, other)), default=0)
            for action in step.actions
        ]
        assert levels == [step.round] * len(step.actions)
        names = [(each.generator, str(each.at)) for each in step.executed]
        assert len(set(names)) == len(names)
        below += zip(step.actions, levels, strict=True)


def test_what_was_released_at_any_time_could_be_all_that_happened() -> None:
    """Every prefix of the released moves is admissible, and its heap that of its definition."""
    scene, commits = run_of(SPECS[1])
    default_rng(3).shuffle(commits)
    released: list[Commit] = []
    found = FreeGatherer(scene, KEEPERS, released.append)
    for moved in commits:
        found.receive(moved)
        assert found.moves == sum(each.generator is not None for each in released)
        assert found.live.cubes == len(obvious_normal_form(found.path))
    assert len(released) == len(commits)


def test_a_missing_commit_is_asked_for_and_holds_back_what_depends_on_it() -> None:
    """The gap is named with the keeper; once it is there nothing is missing."""
    scene, commits = run_of(SPECS[1])
    # Its keeper has another one after it, which shows that it is missing.
    lost = next(
        each for each in commits if any(each.keeper == o.keeper for o in commits[5:] if o != each)
    )
    found = gather(scene, [moved for moved in commits if moved != lost])
    assert found.missing()[lost.keeper] == lost.serial - 1
    assert found.unfinished == f"commit {lost.serial} of keeper_{lost.keeper} is missing"
    assert found.moves < sum(moved.generator is not None for moved in commits)
    found.receive(lost)
    assert not found.missing()
    assert found.unfinished is None


def test_a_last_commit_that_is_missing_shows_against_the_tails() -> None:
    """No number is missing after it, so only the keepers know of it."""
    scene, messages = free_run(SPECS[0], keepers=KEEPERS)
    commits = [message for message in messages if isinstance(message, Commit)]
    tails = [message for message in messages if isinstance(message, CommitLog)]
    last = commits[-1]
    found = gather(scene, [moved for moved in commits if moved is not last])
    assert not found.missing()
    for tail in tails:
        kept = [part for part in tail.parts if part != last]
        found.tail(replace(tail, parts=kept))
    assert found.missing() == {last.keeper: last.serial - 1}
    found.tail(next(tail for tail in tails if tail.keeper == last.keeper))
    assert not found.missing()
    assert found.unfinished is None


def test_a_unit_that_a_keeper_knows_later_than_was_gathered_is_named() -> None:
    """The tails say how often each unit was written and read."""
    scene, messages = free_run(SPECS[0], keepers=KEEPERS)
    tail = next(message for message in messages if isinstance(message, CommitLog) and message.units)
    found = FreeGatherer(scene, KEEPERS)
    found.tail(replace(tail, parts=[], serial=0))
    unit, version, *_ = next(each for each in tail.units if each[1])
    assert f"at version {version}" in next(
        line for line in found.lacking() if site_text(unit) in line
    )


def _written(moved: Commit, version: int, reads: int) -> Commit:
    (unit, old, readers), *rest = moved.written
    return replace(moved, written=[(unit, old + version, readers + reads), *rest])


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda moved: replace(moved, level=moved.level + 1), "is of level"),
        (lambda moved: replace(moved, at=[9, 9]), "its motion is not that of"),
        (lambda moved: replace(moved, module=moved.module + 1), "its motion is not that of"),
        (lambda moved: replace(moved, read=moved.read[1:]), "other units than its move does"),
        (lambda moved: replace(moved, written=moved.written[1:]), "reads or writes other units"),
        (
            lambda moved: replace(moved, written=[*moved.written, moved.written[0]]),
            "reads or writes other units",
        ),
        (
            lambda moved: replace(
                moved, motion=[(m, one, two, version + 40) for m, one, two, version in moved.motion]
            ),
            None,
        ),
        (lambda moved: _written(moved, 0, 1), None),
        (lambda moved: _written(moved, 1, 0), None),
    ],
)
def test_what_cannot_be_is_not_gathered(change: Any, why: str | None) -> None:
    """The commit is named with what is wrong; or it waits for what never comes."""
    scene, commits = run_of(SPECS[1])
    place = next(n for n, moved in enumerate(commits) if moved.generator and moved.read)
    changed = [*commits[:place], change(commits[place]), *commits[place + 1 :]]
    if why is None:
        found = gather(scene, changed)
        assert found.unfinished is not None
        return
    with pytest.raises(CheckError, match=why):
        gather(scene, changed)


def test_two_commits_of_one_number_and_two_writers_of_one_version_are_named() -> None:
    """Whichever of the two comes first."""
    scene, commits = run_of(SPECS[0])
    first = next(moved for moved in commits if moved.generator is not None)
    with pytest.raises(CheckError, match="comes twice, and differs"):
        gather(scene, [*commits, replace(first, turn=first.turn + 1)])
    serial = 1 + max(moved.serial for moved in commits if moved.keeper == first.keeper)
    with pytest.raises(CheckError, match="which another has overwritten"):
        gather(scene, [*commits, replace(first, serial=serial)])
    with pytest.raises(CheckError, match="this run has 3"):
        gather(scene, [replace(first, keeper=3)])
    with pytest.raises(CheckError, match="count from 1"):
        gather(scene, [replace(first, serial=0)])


def test_a_reader_that_the_next_writer_did_not_count_is_named() -> None:
    """A commit that reads a version must be among the readers that its overwriter counts."""
    scene, commits = run_of(SPECS[1])
    reader, writer = next(
        (one, two)
        for one in commits
        for two in commits
        for unit, version, _ in two.written
        if (unit, version) in one.read
    )
    uncounted = [
        replace(
            each,
            written=[
                (unit, version, reads - ((unit, version) in reader.read))
                for unit, version, reads in each.written
            ],
        )
        if each is writer
        else each
        for each in commits
    ]
    with pytest.raises(CheckError, match=r"readers, found|not this reader"):
        gather(scene, uncounted)


def test_a_recording_is_gathered_by_its_clock_and_damage_is_one_line(tmp_path: Any) -> None:
    """What a recording lacks is named, and nothing of it is shortened."""
    scene, messages = free_run(SPECS[1], keepers=KEEPERS)
    whole = write(tmp_path / "a.mcap", scene, [*messages, *results(scene, messages, KEEPERS)])
    assert (
        gathered(read_recording(whole)).digest
        == gather(scene, [each for each in messages if isinstance(each, Commit)]).digest
    )
    lost = next(each for each in messages if isinstance(each, Commit))
    kept = [each for each in messages if not isinstance(each, CommitLog) and each != lost]
    cut = write(tmp_path / "b.mcap", scene, kept)
    with pytest.raises(InputError, match=f"commit {lost.serial} of keeper_{lost.keeper} is miss"):
        shorten(cut)
