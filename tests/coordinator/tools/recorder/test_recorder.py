"""A recorder attaches to a live run, writes what is on the wire, and leaves; the run goes on."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.selection import SAID
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.run import start
from cubepath.coordinator.tools.recorder.recorder import Recorder
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from processes.command_line import GOLDEN
from processes.publisher import message

pytestmark = pytest.mark.slow
TESTS = Path(__file__).parents[3]


def messages_of(path: Path) -> Counter[tuple[str, int, bytes]]:
    """Return what is on record, whatever the order of those who speak at one time."""
    return Counter((each.topic, each.round, each.data) for each in read_recording(path).records)


@contextmanager
def published(
    endpoint: str, count: int, *, rate: int = 0, how: str = "block", size: int = 200
) -> Generator[subprocess.Popen[str]]:
    """Start a process that publishes so many messages once it reads a line."""
    command = [
        sys.executable,
        "processes/publisher.py",
        endpoint,
        *map(str, (count, rate, how, size)),
    ]
    with subprocess.Popen(
        command, cwd=TESTS, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None
            assert child.stdout.readline() == "there\n"
            yield child
        finally:
            child.kill()


def said(child: subprocess.Popen[str]) -> None:
    """Let it publish, and wait until it has."""
    assert child.stdin is not None
    assert child.stdout is not None
    child.stdin.write("\n")
    child.stdin.flush()
    assert child.stdout.readline()


def test_from_the_first_round_on_it_is_the_runs_own_recording(tmp_path: Path) -> None:
    """But for who joined before anyone listened; every check holds, and the rules are asked."""
    inside, outside = tmp_path / "in.mcap", tmp_path / "out.mcap"
    with start("agv:graph=grid4x4,n=4", processes=2, log=inside) as run:
        with Recorder(run.endpoint, outside) as recorder:
            assert run.play().goal_reached
            assert recorder.wait(20)
        assert (recorder.ended, recorder.lost, recorder.cut_off) == ("run ended", {}, 0)
    own, other = messages_of(inside), messages_of(outside)
    before = {topic for topic, number, _ in own - other if number == 0}
    missing = sorted((topic, number) for topic, number, _ in own - other if number)
    assert not missing
    assert before <= {"ready/process_0", "ready/process_1"}
    assert not other - own
    found = audit(outside)
    assert found.ok
    assert found.complete
    assert all(check.checked for check in found.checks)
    assert found.path_digest == verify(inside).path_digest


def test_who_leaves_before_the_end_has_a_recording_that_is_fine_as_far_as_it_goes(
    tmp_path: Path,
) -> None:
    """Verified and compared from the first round on; it is not complete, and nothing fails."""
    outside = tmp_path / "out.mcap"
    with start("hex:n=4", processes=1, seed=1, log=tmp_path / "in.mcap") as run:
        with Recorder(run.endpoint, outside):
            run.step(4)
        run.play()
    found = audit(outside)
    assert (found.ok, found.complete, found.rounds) == (True, False, 4)
    again = replay(outside)
    assert (again.same, again.complete, again.rounds_compared) == (True, False, 4)
    assert again.result == "the same as recorded, as far as it goes"


def test_a_router_that_ends_with_its_run_is_no_failure(tmp_path: Path) -> None:
    """A run at an address has a router of its own, which is gone as soon as the run has ended."""
    with start("hex:n=3", processes=1, listen="tcp/127.0.0.1:0", log=tmp_path / "in.mcap") as run:
        recorder = Recorder(run.endpoint, tmp_path / "out.mcap")
        run.play()
    with recorder:
        assert recorder.wait(20)
    assert recorder.ended == "run ended"


@pytest.mark.thorough
def test_without_rounds_it_is_the_same(tmp_path: Path) -> None:
    """What keepers and modules say, their numbers, and the results that the run announces."""
    inside, outside = tmp_path / "in.mcap", tmp_path / "out.mcap"
    with (
        start("agv:graph=P4,n=2", processes=1, clock="free", keepers=1, log=inside) as run,
        Recorder(run.endpoint, outside) as recorder,
    ):
        run.play()
        assert recorder.wait(20)
    told = {topic.partition("/")[0] for topic, _, _ in messages_of(outside)}
    assert told >= {"commit", "turns", "edges", "cube", "certificate", "summary", "go"}
    assert read_recording(outside).format == "cubepath-recording-5"


def test_in_the_middle_it_is_said_to_begin_there_and_the_run_does_not_notice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What needs the rounds before is not checked, and says so; the path is that of any run."""
    logs = [tmp_path / f"{name}.mcap" for name in ("alone", "in", "out")]
    with start("hex:n=4", processes=0, seed=1, log=logs[0]) as run:
        digest = run.play().path_digest
    with start("hex:n=4", processes=1, seed=1, log=logs[1]) as run:
        run.step(5)
        with Recorder(run.endpoint, logs[2]) as recorder:
            run.step(4)
        assert recorder.ended == "stopped"
        assert run.play().path_digest == digest
    recording = read_recording(logs[2])
    assert recording.parameters["attached"] == "6"
    assert {record.round for record in recording.records} == {6, 7, 8, 9}
    assert main(["verify", str(logs[2])]) == 0
    text = capsys.readouterr().out
    assert "not checked: the recording begins in round 6" in text
    assert "4 rounds, " in text
    assert main(["log", "info", str(logs[2])]) == 0
    found = replay(logs[2])
    assert (found.rounds_compared, found.agrees, found.complete) == (4, True, False)
    assert found.not_compared[0] == "rounds 1 to 5"
    whole = read_recording(logs[1]).moves()
    here = (whole["round"] >= 6) & (whole["round"] <= 9)
    assert recording.moves()["module"].tolist() == whole["module"][here].tolist()


@pytest.mark.thorough
def test_topics_are_chosen_by_glob_and_exclusion(tmp_path: Path) -> None:
    """And the recording says what was left out."""
    with start("hex:n=4", processes=2, log=tmp_path / "in.mcap") as run:
        with Recorder(
            run.endpoint, tmp_path / "out.mcap", topics=["bundle", "reports/*"], exclude=["*/*_1"]
        ) as recorder:
            run.step(3)
        assert recorder.left_out > 0
    recording = read_recording(tmp_path / "out.mcap")
    assert {record.topic for record in recording.records} == {
        "bundle/process_0",
        "reports/process_0",
    }
    assert recording.parameters["attached"] == "1"  # the round began with what is left out
    with pytest.raises(
        InputError, match=r"left out when it was .*\(topics bundle reports/\*, excl"
    ):
        gathered(recording)
    found = verify(recording)
    assert found.ok
    why = "not checked: messages were left out (topics bundle reports/*)"
    assert {check.detail for check in found.checks if not check.checked} == {why}


@pytest.mark.thorough
def test_files_are_split_between_rounds_and_each_is_a_recording(tmp_path: Path) -> None:
    """By size; together they hold what one file would, in its order."""
    with start("hex:n=4", processes=1, log=tmp_path / "in.mcap") as run:
        with Recorder(run.endpoint, tmp_path / "out.mcap", split_megabytes=0.007) as recorder:
            run.play()
            recorder.wait(20)
        logs = recorder.logs
    assert [path.name for path in logs] == [f"out-{n:03}.mcap" for n in range(len(logs))]
    assert len(logs) > 2
    together: Counter[tuple[str, int, bytes]] = Counter()
    last = 0
    for number, path in enumerate(logs):
        part = read_recording(path)
        assert part.problems == ()
        assert part.parameters["part"] == str(number)
        rounds = [record.round for record in part.records]
        assert int(part.parameters["attached"]) in (min(rounds), 1)
        assert min(rounds) > last or number == 0
        last = max(rounds)
        assert verify(part).ok or number == 0
        together += messages_of(path)
    assert not together - messages_of(tmp_path / "in.mcap")
    assert together.total() == recorder.messages


@pytest.mark.thorough
def test_files_are_split_by_time(tmp_path: Path) -> None:
    """A file that has its time is closed when the next round begins."""
    with start("hex:n=4", processes=1, log=tmp_path / "in.mcap") as run:
        with Recorder(run.endpoint, tmp_path / "out.mcap", split_seconds=0.1) as recorder:
            for _ in range(3):
                run.step()
                time.sleep(0.15)
        assert len(recorder.logs) == 3


def test_the_last_seconds_are_written_whenever_asked(tmp_path: Path) -> None:
    """From Python and by a zenoh query; each is a recording, of what came in that time."""
    with start("hex:n=4", processes=1, log=tmp_path / "in.mcap") as run:
        with Recorder(run.endpoint, tmp_path / "last.mcap", snapshot_seconds=0.5) as recorder:
            run.step(2)
            time.sleep(0.7)
            run.step(2)
            time.sleep(0.1)
            first = recorder.snapshot()
            with open_client(run.endpoint) as session:
                key = f"cubepath/{recorder.run}/recorder/*/snapshot"
                (reply,) = session.get(key)
            assert reply.ok is not None
            second = Path(json.loads(reply.ok.payload.to_bytes())["log"])
        assert recorder.logs == [first, second]
        assert (first.name, second.name) == ("last-000.mcap", "last-001.mcap")
    for path in (first, second):
        assert {record.round for record in read_recording(path).records} == {3, 4}
    assert not (tmp_path / "last.mcap").exists()
    with pytest.raises(CheckError, match="the recorder has ended"):
        recorder.snapshot()


def test_nothing_is_lost_from_who_blocks(tmp_path: Path) -> None:
    """Twenty thousand messages, as fast as they go: each is there, in order."""
    with Router("tcp/127.0.0.1:0") as router, published(router.endpoint, 20_000) as child:
        with Recorder(router.endpoint, tmp_path / "out.mcap") as recorder:
            said(child)
            assert child.stdin is not None
            child.stdin.close()
            assert recorder.wait(60)
        assert (recorder.lost, recorder.cut_off) == ({}, 0)
    found = [each.data for each in read_recording(tmp_path / "out.mcap").records]
    assert found == [message(number, 200) for number in range(20_000)]


@pytest.mark.thorough
def test_a_full_backlog_holds_up_who_blocks_and_memory_is_bounded(tmp_path: Path) -> None:
    """With room for four messages all of three thousand come."""
    with Router("tcp/127.0.0.1:0") as router, published(router.endpoint, 3000, size=2000) as child:
        with Recorder(router.endpoint, tmp_path / "out.mcap", memory_megabytes=0.01) as recorder:
            said(child)
            assert child.stdin is not None
            child.stdin.close()
            assert recorder.wait(60)
        # A busy machine may stop it for longer than the router waits; then it says so.
        assert recorder.room == 4
        assert recorder.cut_off or (recorder.messages, recorder.lost) == (3000, {})


@pytest.mark.thorough
def test_a_recorder_leaves_while_its_backlog_is_full(tmp_path: Path) -> None:
    """While more comes than it has room for: its file is closed, and nothing is raised."""
    log = tmp_path / "out.mcap"
    with Router("tcp/127.0.0.1:0") as router, published(router.endpoint, 500_000) as child:
        with Recorder(router.endpoint, log, memory_megabytes=0.001) as recorder:
            assert child.stdin is not None
            child.stdin.write("\n")
            child.stdin.flush()
            deadline = time.monotonic() + 20
            while not recorder.messages:
                assert time.monotonic() < deadline
                time.sleep(0.01)
        assert recorder.ended == "stopped"
    assert read_recording(log).problems == ()
    assert len(read_recording(log).records) == recorder.messages


@pytest.mark.thorough
def test_what_a_publisher_drops_is_counted(tmp_path: Path) -> None:
    """While the recorder stands still; what came and what is missing are all that was put."""
    count = 60_000
    with (
        Router("tcp/127.0.0.1:0") as router,
        published(router.endpoint, count, how="drop") as child,
    ):
        log = tmp_path / "out.mcap"
        with command("--connect", router.endpoint, "-o", str(log)) as recorder:
            recorder.send_signal(signal.SIGSTOP)
            said(child)
            recorder.send_signal(signal.SIGCONT)
            assert child.stdin is not None
            child.stdin.close()
            out, _ = recorder.communicate(timeout=60)
    told = json.loads(out)
    lost = sum(told["lost"].values())
    there = [json.loads(each.data)["number"] for each in read_recording(log).records]
    assert len(there) == told["messages"] == len(set(there))
    assert lost > 0
    assert len(there) + lost == count + 1 - there[0]
    assert there[-1] == count


@contextmanager
def command(*arguments: str) -> Generator[subprocess.Popen[str]]:
    """Start the command, and wait until it records."""
    line = [sys.executable, "-m", "cubepath.coordinator", "log", "record", "--json", *arguments]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        try:
            assert child.stderr is not None
            assert "recording run" in child.stderr.readline()
            yield child
        finally:
            child.kill()


@pytest.mark.few(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_with_the_file_closed(number: int, tmp_path: Path) -> None:
    """Exit code 130, as of every command; the file is whole, and the run goes on."""
    log = tmp_path / "out.mcap"
    with start("hex:n=4", processes=1, log=tmp_path / "in.mcap") as run:
        with command("--connect", run.endpoint, "-o", str(log)) as child:
            run.step(3)
            time.sleep(0.2)
            child.send_signal(number)
            out, errors = child.communicate(timeout=20)
        assert child.returncode == 130
        assert errors.splitlines()[-1] == "cubepath: interrupted"
        assert run.play().goal_reached
    assert json.loads(out)["logs"] == [str(log)]
    recording = read_recording(log)
    assert recording.problems == ()
    # Until the first round begins, a process repeats now and then that it is there.
    begun = [record for record in recording.records if (record.kind, record.round) != ("ready", 0)]
    assert {record.round for record in begun} == {1, 2, 3}


@pytest.mark.thorough
def test_the_command_writes_snapshots_on_a_signal_and_leaves_in_time(tmp_path: Path) -> None:
    """SIGUSR1 asks, `--duration` ends; the exit code is 0."""
    log = tmp_path / "last.mcap"
    with (
        start("hex:n=4", processes=1, log=tmp_path / "in.mcap") as run,
        command(
            *("--connect", run.endpoint, "-o", str(log), "--snapshot", "60", "--timeout", "2")
        ) as child,
    ):
        run.step(2)
        time.sleep(0.3)
        os.kill(child.pid, signal.SIGUSR1)
        out, errors = child.communicate(timeout=20)
    assert child.returncode == 0
    assert "last-000.mcap: " in errors
    assert json.loads(out)["logs"] == [str(tmp_path / "last-000.mcap")]
    assert len(read_recording(tmp_path / "last-000.mcap").records) > 0


@pytest.mark.thorough
def test_a_recorder_that_stands_still_or_dies_does_not_hold_up_the_run(tmp_path: Path) -> None:
    """It goes on to its goal, and its own recording is whole."""
    with (
        start("agv:graph=grid4x4,n=5", processes=2, log=tmp_path / "in.mcap") as run,
        command("--connect", run.endpoint, "-o", str(tmp_path / "out.mcap")) as child,
    ):
        run.step(2)
        child.send_signal(signal.SIGSTOP)
        run.step(3)
        child.kill()
        assert run.play().goal_reached
    assert verify(tmp_path / "in.mcap").ok


@pytest.mark.thorough
def test_a_router_with_several_runs_is_asked_for_one(tmp_path: Path) -> None:
    """One clear line names them; with `run` it is the one meant."""
    with Router("tcp/127.0.0.1:0") as router:
        with pytest.raises(CheckError, match=r"no run answers at tcp/.*, in 0\.2 s"):
            Recorder(router.endpoint, patience_s=0.2)
        options = {"processes": 1, "connect": router.endpoint}
        with (
            start("hex:n=4", log=tmp_path / "a.mcap", **options) as one,  # type: ignore[arg-type]
            start("hex:n=3", log=tmp_path / "b.mcap", **options) as two,  # type: ignore[arg-type]
        ):
            names = ", ".join(sorted((one.run, two.run)))
            with pytest.raises(InputError, match=f"2 runs are at .*: expected --run, .* {names}"):
                Recorder(router.endpoint, tmp_path / "c.mcap")
            with Recorder(router.endpoint, tmp_path / "c.mcap", run=two.run) as recorder:
                one.step(1)
                two.step(1)
            assert recorder.run == two.run
    assert read_recording(tmp_path / "c.mcap").parameters["system"] == "hex:n=3"


def test_a_replay_can_be_recorded_as_far_as_it_puts_messages(tmp_path: Path) -> None:
    """What it puts back is there byte for byte; that the coordinator is silent is said."""
    log, out = GOLDEN / "hex-5.mcap", tmp_path / "out.mcap"
    with contextlib.ExitStack() as recorders:
        heard: list[Recorder] = []
        replay(
            log,
            announce=lambda endpoint, run: heard.append(
                recorders.enter_context(Recorder(endpoint, out, run=run))
            ),
        )
        assert heard[0].wait(20)
    put = [each for each in read_recording(log).records if each.kind in SAID]
    found = read_recording(out)
    assert [each.data for each in found.records] == [each.data for each in put]
    assert {check.name for check in verify(found).checks if check.checked} == {
        *("readable", "parameters", "messages")
    }
