"""Recordings with a hole: what stands before it is checked as ever, what comes after it is said."""

from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.contents import info
from cubepath.coordinator.verification.findings import Verification
from cubepath.coordinator.verification.partial import hole_in
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.recordings.recording import Recording, read_recording
from processes.command_line import GOLDEN
from tampering.wrecks import taken_apart


def with_hole(name: str, chunk: int, folder: Path) -> Recording:
    """Return a golden recording, one of whose chunks is damaged."""
    data = bytearray((GOLDEN / f"{name}.mcap").read_bytes())
    begin, end, _ = taken_apart(name, bytes(data)).chunks[chunk]
    data[(begin + end) // 2] ^= 0xFF
    path = folder / "hole.mcap"
    path.write_bytes(data)
    return read_recording(path)


def told(found: Verification, *, ok: bool, checked: bool) -> dict[str, str]:
    """Return what is said of the checks that came out like this."""
    checks = (each for each in found.checks if (each.ok, each.checked) == (ok, checked))
    return {each.name: each.detail for each in checks}


def test_only_what_stands_before_a_hole_is_derived_and_nothing_behind_it_fails(
    tmp_path: Path,
) -> None:
    """Rounds behind the hole are not checked, messages are counted; the same once recovered."""
    damaged = with_hole("hex-5", 3, tmp_path)
    found = verify(damaged)
    assert [*told(found, ok=False, checked=True)] == ["readable"]
    why = "not checked after round 7: 50 messages are missing from message 150 on"
    unchecked = told(found, ok=True, checked=False)
    assert unchecked["claims"] == unchecked["summary"] == why
    assert [*told(found, ok=True, checked=True)] == ["parameters", "messages"]
    assert (found.rounds, found.moves, found.missing) == (7, 10, (2, 50))
    saved = recover(damaged, tmp_path / "saved.mcap")
    assert (saved.messages, saved.rounds) == (528, 27)
    again = verify(saved.out)
    assert (again.ok, again.complete, again.missing) == (True, False, found.missing)
    assert told(again, ok=True, checked=False) == unchecked
    assert not info(saved.out)["complete"]


@pytest.mark.parametrize(("name", "chunk"), [("hex-5", 0), ("agv-6", 2), ("hex-free-5", 1)])
def test_whatever_chunk_is_lost_what_is_recovered_holds_as_far_as_it_goes(
    name: str, chunk: int, tmp_path: Path
) -> None:
    """The first of a run too, and without rounds."""
    damaged = with_hole(name, chunk, tmp_path)
    hole = hole_in(damaged)
    assert hole is not None
    found = verify(recover(damaged, tmp_path / "saved.mcap").out)
    assert (found.ok, found.complete) == (True, False)
    assert found.missing.messages >= hole.messages
    unchecked = told(found, ok=True, checked=False)
    assert all("missing from message" in each for each in unchecked.values())


def test_what_is_wrong_on_either_side_of_a_hole_is_found(tmp_path: Path) -> None:
    """What is derived before it, and a message behind it that stands under another topic."""
    damaged = with_hole("hex-5", 3, tmp_path)
    records = list(damaged.records)
    assert hole_in(replace(damaged, records=records)) == hole_in(damaged)
    behind = [*records[:-1], replace(records[-1], topic="presence/module_0")]
    found = verify(replace(damaged, records=behind, problems=(), parameters=recovered(damaged)))
    assert [*told(found, ok=False, checked=True)] == ["messages"]
    place = next(n for n, each in enumerate(records) if each.kind == "edges")
    untold = replace(records[place], data=records[place].data.replace(b"pivot-2", b"pivot-1"))
    assert untold != records[place]
    earlier = [*records[:place], untold, *records[place + 1 :]]
    found = verify(replace(damaged, records=earlier, problems=(), parameters=recovered(damaged)))
    assert "edges" in told(found, ok=False, checked=True)


def recovered(recording: Recording) -> dict[str, str]:
    """Return the parameters with the one that says that it was recovered."""
    return {**recording.parameters, "recovered": "some"}


def test_without_damage_there_is_no_hole() -> None:
    """Nor in what was cut off, whatever is missing there, nor where messages change places."""
    whole = read_recording(GOLDEN / "hex-5.mcap")
    assert hole_in(whole) is None
    records = list(whole.records)
    mixed = replace(whole, records=[*records[50:], *records[:50]], problems=("merged",))
    assert hole_in(mixed) is None
    assert hole_in(replace(mixed, records=records[:50])) is None


def test_a_recording_with_a_hole_is_compared_on_both_sides_of_it(tmp_path: Path) -> None:
    """All whole rounds, and one line on what is missing."""
    damaged = with_hole("hex-5", 3, tmp_path)
    found = replay(damaged)
    assert found.agrees
    assert not found.same
    assert found.not_compared == ("rounds 8 to 9", "cubes", "summary")
    assert (found.rounds_compared, found.differences) == (27, ())
    assert found.lacking == "50 messages are missing from message 150 on"
    assert found.result.endswith("; the file is damaged")
    first = replay(with_hole("hex-5", 0, tmp_path))
    assert (first.rounds_compared, first.not_compared[0]) == (27, "rounds 1 to 2")
