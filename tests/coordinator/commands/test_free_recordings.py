"""Every command that takes a recording takes one of a run without rounds."""

import json
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.selection import FREE_SAID
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.wire.free_messages import Commit, decode_free, free_key
from samples.free_runs import free_recorded, free_run, results, write

SPEC = "hex:n=7"


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, object]:
    """Return the JSON document that a command answers with, after checking that it succeeds."""
    assert main([*map(str, arguments), "--json"]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def the_recording() -> Recording:
    """Return the recording of a run without rounds."""
    return free_recorded(SPEC, restarts=2)


def test_info_tells_the_clock_and_the_keepers(capsys: pytest.CaptureFixture[str]) -> None:
    """The parts of batches are counted by kind, as they stand in the file."""
    recording = the_recording()
    found = told(capsys, "log", "info", recording.path)
    assert (found["clock"], found["keepers"], found["format"]) == (
        "free",
        3,
        "cubepath-recording-5",
    )
    counted: dict[str, int] = {}
    for record in recording.records:
        for part in record.parts():
            if part != record:
                counted[part.kind] = counted.get(part.kind, 0) + 1
    assert found["parts"] == counted
    assert {"attempt", "decision", "place", "turn", "enter", "forwarded"} <= counted.keys()


@pytest.mark.thorough
def test_shorten_convert_and_view_read_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The cubes of the recording are those of its moves as a file."""
    path, moves = the_recording().path, tmp_path / "moves.jsonl"
    once, again = tmp_path / "once.jsonl", tmp_path / "again.jsonl"
    found = told(capsys, "shorten", path, "-o", once)
    told(capsys, "shorten", path, "--convert", "-o", moves)
    assert told(capsys, "shorten", moves, "--system", SPEC, "-o", again)["cubes"] == found["cubes"]
    assert once.read_bytes() == again.read_bytes()
    for name in ("run.png", "run.gif"):
        assert main(["view", str(path), "-o", str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size


@pytest.mark.slow
def test_its_schedule_is_carried_out_by_a_run_with_rounds(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The cubes are the rounds of that run, and its moves those that are left of the first."""
    recording = the_recording()
    found = told(
        capsys,
        *("run", "--schedule", recording.path, "--processes", 0, "--log", tmp_path / "log.mcap"),
    )
    heap = gathered(recording).heap
    assert (found["rounds"], found["moves"]) == (heap.cubes, heap.reduced_moves)


@pytest.mark.slow
@pytest.mark.parametrize("wall", [False, True])
def test_replay_puts_every_message_on_its_key(wall: bool, tmp_path: Path) -> None:
    """What is gathered from the wire is what is on record, whichever way it is paced."""
    scene, messages = free_run("agv:graph=grid6x6,n=6")
    whole = [*messages, *results(scene, messages, 3)]
    recording = read_recording(write(tmp_path / "a.mcap", scene, whole, wall=wall))
    found = replay(recording, rate=1000 if not wall else 10)
    assert found.same, found.differences
    assert found.messages == sum(record.kind in FREE_SAID for record in recording.records)
    assert found.path_digest == gathered(recording).digest


def test_keys_follow_from_the_bytes_alone() -> None:
    """No two messages of one topic that differ in receiver or tile share a key."""
    keys = {
        free_key("r", decode_free(record.data))
        for record in the_recording().records
        if record.kind in FREE_SAID
    }
    assert {key.split("/")[2] for key in keys} == set(FREE_SAID)
    assert all(key.split("/")[-1].startswith(("process_", "keeper_")) for key in keys)
    assert len(keys) > len({record.topic for record in the_recording().records})


def test_bad_kinds_and_a_recording_without_keepers_are_refused(tmp_path: Path) -> None:
    """In one line each, before anything is put."""
    recording = the_recording()
    with pytest.raises(InputError, match="expected topics of "):
        replay(recording, topics=["bundle"])
    copy_recording(recording, tmp_path / "b.mcap", {"keepers": "none"})
    with pytest.raises(InputError, match="keepers='none' in its parameters"):
        gathered(read_recording(tmp_path / "b.mcap"))


def test_a_forged_commit_is_named_with_its_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The exit code is 1, as for reports that contradict each other."""
    scene, messages = free_run(SPEC)
    first = next(each for each in messages if isinstance(each, Commit) and each.generator)
    forged = [
        *messages,
        Commit(first.keeper, first.serial, first.module, first.epoch, first.number, 99, 1),
    ]
    path = write(tmp_path / "a.mcap", scene, forged)
    assert main(["shorten", str(path)]) == 1
    error = capsys.readouterr().err
    assert "comes twice, and differs" in error
    assert f"message {len(messages)} (commit/keeper_{first.keeper})" in error


def compared(
    capsys: pytest.CaptureFixture[str], *arguments: object
) -> tuple[int, dict[str, object]]:
    """Return the exit code and the answer of a comparison."""
    code = main(["diff", *map(str, arguments), "--json"])
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return code, found


@pytest.mark.slow
def test_runs_are_compared_whatever_form_they_have(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A run is the same as its moves in a file, and homotopic to its schedule carried out."""
    path, moves, log = the_recording().path, tmp_path / "moves.jsonl", tmp_path / "log.mcap"
    told(capsys, "shorten", path, "--convert", "-o", moves)
    told(capsys, "run", "--schedule", path, "--processes", 0, "--log", log)
    system = ("--system", SPEC)
    same: dict[str, object] = {"same": True, "difference": None}
    assert compared(capsys, path, moves, *system, "--same") == (0, same)
    assert compared(capsys, path, log, "--homotopic")[0] == 0
    code, found = compared(capsys, path, log, "--same")
    assert (code, found["same"]) == (1, False)
    assert "times in the first" in str(found["difference"])
    moves.write_text("".join(moves.read_text().splitlines(keepends=True)[:-1]))
    assert compared(capsys, path, moves, *system, "--homotopic")[0] == 1


def test_recordings_of_other_scenes_differ_by_their_starts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line on standard error, exit code 1."""
    paths = the_recording().path, free_recorded("hex:n=3", moves=4).path
    assert main(["diff", *map(str, paths), "--same"]) == 1
    assert "not same: the starts differ: " in capsys.readouterr().err


def test_verify_answers_with_the_checks_of_its_clock(capsys: pytest.CaptureFixture[str]) -> None:
    """Levels in place of rounds, for people and machines."""
    path = the_recording().path
    found = told(capsys, "verify", path)
    checks = found["checks"]
    assert isinstance(checks, list)
    assert {"levels", "readers", "place", "turns"} <= {check["name"] for check in checks}
    assert main(["verify", str(path)]) == 0
    assert f"{found['rounds']} levels, " in capsys.readouterr().out
