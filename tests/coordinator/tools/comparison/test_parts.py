"""Runs of which parts are on record: what both have is compared, and what is missing is said."""

from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol import filter_recording, split_recording
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.free_messages import Commit, decode_free
from processes.command_line import GOLDEN
from samples.free_runs import free_recorded
from samples.recordings import new_path, recorded, with_records
from samples.twin_runs import everything, first_choices, twin

HEX = GOLDEN / "hex-5.mcap"


def cut(source: Path, to: Path, **what: object) -> Path:
    """Return a recording with some of the messages of another."""
    filter_recording(source, to, **what)  # type: ignore[arg-type]
    return to


def test_a_run_from_a_later_round_on(tmp_path: Path) -> None:
    """It is compared from its first round on; what differs is that it lacks those before."""
    late = cut(HEX, tmp_path / "late.mcap", first=5)
    for found in (diff(HEX, late), diff(late, HEX)):
        assert found.compared == "rounds 5 to 29 (the first that both have)"
        assert (found.choice, found.message, found.move) == (None, None, None)
        assert found.states == ()
        assert found.paths is not None
        assert found.paths.identical
        assert not found.same
        assert found.answer.startswith("no difference in rounds 5 to 29")
    assert "b begins in round 5" in diff(HEX, late).notes
    same = diff(HEX, late, rounds=(5, None))
    assert same.same
    assert same.answer == "the same in rounds 5 to 29"
    with pytest.raises(InputError, match="has rounds 5 to 29"):
        diff(HEX, late, rounds=(1, 4))


@pytest.mark.parametrize(("first", "spec"), [(2, "hex:n=5"), (3, "agv:graph=grid4x4,n=6")])
def test_what_differs_later_is_named_as_in_whole_runs(
    first: int, spec: str, tmp_path: Path
) -> None:
    """The same choice in the same round, with what was sensed; the rule cannot be asked."""
    a, b = (recorded(spec, seed=seed) for seed in (1, 2))
    late = cut(a.path, tmp_path / "late.mcap", first=first)
    found, whole = diff(late, b), diff(a, b, rounds=(first, None))
    assert found.choice is not None
    assert whole.choice is not None
    assert (found.choice.round, found.choice.module) == (whole.choice.round, whole.choice.module)
    assert found.choice.also == whole.choice.also
    assert found.choice.a.sensed == whole.choice.a.sensed
    assert found.choice.a.chose == whole.choice.a.chose
    assert found.choice.a.drew is None
    assert whole.choice.a.drew is not None
    assert f"rounds before {first} are not on record" in " ".join(found.choice.why)
    assert found.states == whole.states
    assert found.paths == whole.paths
    assert found.rounds == whole.rounds


def test_parts_that_have_no_round_in_common_are_refused(tmp_path: Path) -> None:
    """With the rounds that each has."""
    parts = split_recording(HEX, tmp_path / "parts", parts=3)
    with pytest.raises(
        InputError, match=r"nothing to compare: .* has rounds 1 to \d+; .* has rounds"
    ):
        diff(parts[0], parts[1])
    claims = cut(HEX, tmp_path / "said.mcap", topics=("bundle",))
    with pytest.raises(InputError, match=r"has no round that all modules report: .*topics bundle"):
        diff(HEX, claims)


def without_rounds(recording: Recording, *lost: int) -> Recording:
    """Return a recording in which no message of some rounds is left."""
    return with_records(recording, [each for each in recording.records if each.round not in lost])


def test_rounds_behind_a_gap_are_compared() -> None:
    """Wherever the gap is; what differs behind it is found as if these rounds were asked for."""
    runs = [recorded("hex:n=5", "chain", seed=s, hesitate=0.3, rounds=20) for s in (1, 2)]
    a, b = (without_rounds(each, 2) for each in runs)
    late = diff(*runs, rounds=(3, None))
    assert late.choice is not None
    for found in (diff(a, b), diff(a, runs[1]), diff(runs[0], b)):
        assert found.compared == "rounds 1, 3 to 20"
        assert found.choice is not None
        assert (found.choice.round, found.choice.module) == (late.choice.round, late.choice.module)
        assert found.choice.causes == ("unknown",)
        assert "rounds before 3 are not on record" in " ".join(found.choice.why)
        assert found.message == late.message
        assert found.move == late.move
        assert found.states == late.states
        assert found.rounds == late.rounds
        assert found.paths is None
        assert not found.same


def test_runs_with_the_same_gap_are_not_said_to_be_the_same() -> None:
    """Nor is one the beginning of the other; rounds on either side of the gap can be the same."""
    whole = recorded("hex:n=5", "chain", seed=1, hesitate=0.3, rounds=20)
    one, other = without_rounds(whole, 4, 5), without_rounds(whole, 4, 5, 9)
    for a, b in ((one, one), (one, whole), (whole, one)):
        found = diff(a, b)
        assert not found.same
        assert found.answer == "no difference in rounds 1 to 3, 6 to 20; the notes say more"
    note = "does not have rounds 4 to 5, 9 as a whole: not compared"
    assert f"b {note}" in diff(one, other).notes
    short = without_rounds(whole, 4, *range(12, 30))
    assert diff(short, whole).beginning is None
    assert diff(one, whole, rounds=(6, 20)).same
    assert not diff(one, whole, rounds=(5, 20)).same


def test_copies_that_lost_one_chunk_are_compared_behind_it(tmp_path: Path) -> None:
    """Two runs differ behind it; one file beside itself has the same bytes."""
    paths: list[Path] = []
    for seed in (1, 2):
        run = recorded("hex:n=5", "chain", seed=seed, hesitate=0.3, rounds=20)
        data = bytearray(run.path.read_bytes())
        data[8905] ^= 0xFF
        paths.append(tmp_path / f"{seed}.mcap")
        paths[-1].write_bytes(data)
    found = diff(*paths)
    assert found.compared == "rounds 1, 3 to 20"
    assert found.choice is not None
    assert found.choice.round == 7
    for path in paths:
        assert diff(path, path).answer == "the same bytes"
    cut_off = tmp_path / "cut.mcap"
    cut_off.write_bytes(paths[0].read_bytes()[:16000])
    back = diff(paths[0], cut_off)
    assert not back.same
    assert back.answer.startswith("no difference in rounds 1, 3 to ")


def test_runs_that_are_cut_off_alike_are_the_same_as_far_as_they_go(tmp_path: Path) -> None:
    """What came after nobody knows."""
    early = [cut(HEX, tmp_path / f"{number}.mcap", until=9) for number in (1, 2)]
    later = recorded("hex:n=5", "chain", seed=1, hesitate=0.3)
    parts = [with_records(later, [r for r in later.records if r.round <= 6]) for _ in "ab"]
    assert diff(*parts).answer == "the same in rounds 1 to 6"
    assert diff(*early).answer == "the same in rounds 1 to 9"


def test_kinds_of_messages_that_were_left_out_are_no_difference(tmp_path: Path) -> None:
    """They are named; what reports tell is compared, and differs where it does."""
    reports = cut(HEX, tmp_path / "reports.mcap", topics=("report*",))
    found = diff(HEX, reports)
    assert (found.message, found.choice) == (None, None)
    line = "has no presence, claim, edges, cube, summary: these were not compared"
    assert f"b {line}" in found.notes
    assert f"a {line}" in diff(reports, HEX).notes
    assert not diff(HEX, reports, rounds=(1, 29)).same
    other = recorded("hex:n=5", "chain", seed=1, hesitate=0.3)
    whole, part = diff(HEX, other), diff(reports, other)
    assert whole.move == part.move
    assert whole.states == part.states


def test_the_beginning_of_a_run_is_said_to_be_that(tmp_path: Path) -> None:
    """Of both clocks, from either side; what comes after is not compared."""
    early = cut(HEX, tmp_path / "early.mcap", until=9)
    found = diff(early, HEX)
    assert found.answer == "a is the beginning of b: the same in rounds 1 to 9, and then a ends"
    assert found.paths is not None
    assert found.paths.identical
    a, b = (recorded("hex:n=5", seed=1, rounds=rounds) for rounds in (4, 7))
    found = diff(a, b)  # it ended there, and so what the other then did counts
    assert found.beginning == "a"
    assert found.paths is not None
    assert found.paths.moves[0] < found.paths.moves[1]


def test_moves_of_the_rounds_asked_for_are_counted() -> None:
    """And none before or after; states likewise."""
    a, b = (recorded("hex:n=5", "chain", seed=s, hesitate=0.3, rounds=20) for s in (1, 2))
    for first, last in ((1, 3), (8, 9), (5, 12)):
        found = diff(a, b, rounds=(first, last))
        assert found.limited
        assert found.paths is not None
        due = [
            sum(
                isinstance(fields, dict) and fields.get("move") is not None
                for (number, _, _), fields in everything(each).items()
                if first <= number <= last
            )
            for each in (a, b)
        ]
        assert list(found.paths.moves) == due
        assert all(first <= number <= last for number, *_ in found.rounds)
        assert all(first - 1 <= each.begin <= last for each in found.states)
        places = first_choices(_between(a, first, last), _between(b, first, last))
        if places is not None:
            assert found.choice is not None
            assert first <= found.choice.round <= last


def _between(recording: Recording, first: int, last: int) -> Recording:
    return with_records(recording, [r for r in recording.records if first <= r.round <= last])


def test_free_runs_are_cut_off_and_do_not_choose_otherwise() -> None:
    """Without their last commits one is the beginning of the other, whichever these are."""
    a = free_recorded("agv:graph=grid3x3,n=4", seed=4, moves=12)
    last = max(record.round for record in a.records)
    for level in range(1, last):
        kept = [each for each in a.records if each.round <= level]
        b = with_records(a, [each for each in kept if each.kind not in ("summary", "commits")])
        try:
            found = diff(a, b)
        except InputError as error:
            assert "nothing to compare" in str(error)  # noqa: PT017 - either is right
            continue
        assert found.choice is None
        assert found.move is None
        assert not found.same
        assert "the beginning of a" in found.answer or "both have" in found.answer
        assert found.paths is not None
        assert found.paths.same is None


def _level(record: Record) -> int | None:
    message = decode_free(record.data)
    return message.level if isinstance(message, Commit) else None


def test_commits_that_follow_on_missing_ones_are_not_compared() -> None:
    """They are counted; the others are the same."""
    a = free_recorded("agv:graph=grid3x3,n=4", seed=4, moves=12)
    lost = next(each for each in a.records if _level(each) == 2)
    b = with_records(a, [r for r in a.records if r != lost and r.kind != "commits"])
    found = diff(a, b)
    assert found.choice is None
    assert found.beginning is None
    assert not found.same
    assert "b: 1 commit is not on record" in found.notes
    assert any("cannot be compared" in note for note in found.notes)


def test_the_first_move_of_free_runs_has_a_level_in_each() -> None:
    """Those at which the commit is on record; notes are no moves."""
    a, b = (free_recorded("agv:graph=grid3x3,n=4", seed=seed, moves=12) for seed in (1, 2))
    found = diff(a, b)
    assert found.move is not None
    for text in (found.move.a, found.move.b):
        assert text is None or ("edge at " in text and "(level " in text)
        assert text is None or "notes" not in text
    assert found.choice is not None
    levels = [each for each in (found.choice.a.level, found.choice.b.level) if each is not None]
    assert all(f"at level {level} in" in str(found) for level in levels)
    assert levels or "of notes alone" in str(found)


def test_ended_runs_are_not_compared_after_their_end() -> None:
    """The state of a run that is over is not held against what the other does then."""
    a, b = twin("hex:n=5", seed=1), twin("hex:n=5", seed=2, rounds=4)
    last = max(number for number, *_ in everything(b))
    found = diff(a, b)
    assert found.states
    assert all(each.end is None or each.end <= last for each in found.states)
    assert all(number <= last for number, *_ in found.rounds)


def test_a_run_without_rounds_on_record_ended_before_the_first() -> None:
    """Its end is compared; rounds that were asked for it has not."""
    none, some = (recorded("hex:n=5", rounds=rounds) for rounds in (0, 3))
    assert diff(none, none).same
    found = diff(none, some)
    assert not found.same
    assert found.answer == "a ends before the first round, and b continues"
    assert found.compared == "no rounds"
    with pytest.raises(InputError, match="has no round that all modules report"):
        diff(none, some, rounds=(1, 2))


def test_two_systems_of_one_family_are_compared() -> None:
    """With choices; what rules know from birth is a thing that differs, and cannot be tried."""
    a, b = (twin(f"agv:graph=grid{size}x5,n=8", "tswap") for size in (4, 5))
    found = diff(a, b)
    assert found.scene is not None
    assert found.choice is not None
    assert any("knows from birth differs as well" in line for line in found.choice.why)
    assert found.choice.causes != ("record",)


@pytest.mark.parametrize("name", ["hex-5", "hex-free-5"])
@given(st.floats(0, 1), st.integers(0, 7), st.booleans())
@settings(max_examples=12)
def test_a_damaged_copy_never_chooses_otherwise(
    name: str, at: float, bit: int, truncated: bool
) -> None:
    """Whatever is lost: that it is damaged is said, and no message goes to differ."""
    whole = GOLDEN / f"{name}.mcap"
    data = bytearray(whole.read_bytes())
    place = min(int(len(data) * at), len(data) - 1)
    if truncated:
        del data[place:]
    else:
        data[place] ^= 1 << bit
    damaged = new_path()
    damaged.write_bytes(data)
    try:
        found = diff(whole, damaged)
    except InputError as error:
        assert str(damaged) in str(error)  # noqa: PT017 - a file may have lost all
        return
    assert (found.choice, found.message, found.move, found.outcome) == (None, None, None, None)
    assert any(note.startswith("b is damaged: ") for note in found.notes)
