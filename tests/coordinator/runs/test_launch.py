"""A run from end to end: real processes, a closed recording, and what is said of it."""

import gc
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest
import zenoh

from cubepath.agents.environments.rollouts import play
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.runs.edge_path import Gathered, PathDigest
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.messages import Executed, Summary, decode, kind_of
from cubepath.protocol.wire.sessions import open_client, put, subscribe
from samples.recordings import parts

PYTHON = [sys.executable, "-m", "cubepath.coordinator"]
LONG = ["--rule=random", "--max-rounds=20000"]
KEYS = [
    "log",
    "system",
    "rule",
    "seed",
    "modules",
    "processes",
    "rounds",
    "moves",
    "reduced_moves",
    "cubes",
    "max_cube_dimension",
    "goal_reached",
    "path_digest",
    "seconds",
    "refused",
]


def cubepath(*arguments: str, **keywords: Any) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own."""
    return subprocess.run(
        [*PYTHON, *arguments], capture_output=True, text=True, timeout=100, check=False, **keywords
    )


def digest_of_play(
    system: str | Scene, rule: str, *, seed: int, hesitate: float, rounds: int
) -> str:
    """Return the digest of the same run in the environment, in one process."""
    scene = scene_from_spec(system) if isinstance(system, str) else system
    played = play(
        scene, rule_named(rule, scene.system), seed=seed, hesitate=hesitate, max_rounds=rounds
    )
    digest = PathDigest()
    for done in played.rounds:
        digest.add(
            done.number,
            [Executed(module, move.generator, move.at) for module, move in done.moves.items()],
        )
    return digest.text()


def summary_of(recording: Recording) -> Summary:
    """Return the summary of a recording."""
    (record,) = recording.of_kind("summary")
    message = decode(record.data)
    assert isinstance(message, Summary)
    return message


@pytest.mark.thorough
def test_run_alone_takes_a_chain_to_another(tmp_path: Path) -> None:
    """`cubepath run` without arguments reaches its goal in several processes, and says so."""
    done = cubepath("run", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert list(answer) == KEYS
    assert answer["goal_reached"]
    assert answer["processes"] > 1
    assert answer["modules"] == 12
    assert (answer["rounds"], answer["moves"]) == (54, 154)
    assert answer["cubes"] <= answer["rounds"]
    recording = read_recording(tmp_path / answer["log"])
    assert recording.problems == ()
    assert summary_of(recording).path_digest == answer["path_digest"]
    assert answer["path_digest"] == digest_of_play(
        "hex", "chain", seed=0, hesitate=0.0, rounds=1000
    )


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_the_digest_is_that_of_the_environment(tmp_path: Path, processes: int) -> None:
    """The edge path on record is the one that the PettingZoo environment takes."""
    system = "agv-labelled:graph=grid4x4,n=6"
    plan = Plan(
        system=system,
        rule="random",
        seed=4,
        hesitate=0.2,
        processes=processes,
        max_rounds=30,
        log=tmp_path / "run.mcap",
    )
    outcome = run(plan)
    assert outcome.ended in ("goal", "max-rounds")
    assert outcome.moves > 20
    assert outcome.path_digest == digest_of_play(system, "random", seed=4, hesitate=0.2, rounds=30)


@pytest.mark.nightly
def test_a_thousand_modules_reach_their_goal(tmp_path: Path) -> None:
    """Each vehicle of a crowd goes on by one column, as in the environment; verify passes."""
    scene = scene_from_spec("agv:graph=grid50x40,n=1000")
    start, goals = ([(x + step, y) for x in range(25) for y in range(40)] for step in (0, 1))
    scene = replace(
        scene, start=tuple(start), goal=frozenset(goals), goals=tuple((each,) for each in goals)
    )
    path = tmp_path / "crowd.toml"
    path.write_text(scene_to_toml(scene))
    plan = Plan(system=str(path), hesitate=0.5, processes=4, log=tmp_path / "run.mcap")
    outcome = run(plan)
    assert (outcome.goal_reached, outcome.modules, outcome.processes) == (True, 1000, 4)
    rounds = outcome.rounds
    again = digest_of_play(scene, "tswap", seed=0, hesitate=0.5, rounds=rounds)
    assert (rounds > 5, outcome.path_digest) == (True, again)
    assert verify(read_recording(tmp_path / "run.mcap")).ok


@pytest.mark.slow
def test_log_time_is_the_round_and_bytes_are_those_of_the_wire(tmp_path: Path) -> None:
    """Log time is the logical round, publish time the wall clock; each message is whole."""
    began = time.time_ns()
    outcome = run(Plan("hex:n=4", "random", processes=0, max_rounds=6, log=tmp_path / "a.mcap"))
    recording = read_recording(Path(outcome.log))
    assert len(recording.records) == outcome.messages
    for record in recording.records:
        assert decode(record.data).round == record.round
        assert began <= record.wall_ns <= time.time_ns()
    kinds = {record.kind for record in recording.records}
    assert kinds >= {"bundle", "reports", "go", "ready", "edges", "cube", "summary"}
    assert {"presence", "claim", "report"} <= {kind_of(part) for part in parts(recording)}
    assert recording.parameters["rule"] == "random"
    assert recording.parameters["eclipse-zenoh"]


def test_a_start_at_the_goal_is_a_run_of_no_rounds(tmp_path: Path) -> None:
    """Nothing has to be moved: no process starts, and there are 0 cubes."""
    outcome = run(Plan("hex:n=3,bend=0,shift=0", log=tmp_path / "a.mcap"))
    assert (outcome.rounds, outcome.moves, outcome.cubes) == (0, 0, 0)
    assert outcome.goal_reached
    assert read_recording(tmp_path / "a.mcap").problems == ()


def test_an_earlier_recording_is_never_written_over(tmp_path: Path) -> None:
    """A log that exists is refused, be it a recording or the system file itself."""
    log = tmp_path / "a.mcap"
    log.write_bytes(b"precious")
    with pytest.raises(InputError, match="exists already, expected a new file"):
        run(Plan("hex:n=3", log=log))
    assert log.read_bytes() == b"precious"


@pytest.mark.slow
def test_a_log_that_is_removed_ends_the_run(tmp_path: Path) -> None:
    """The folder of the log goes in the second round: the run fails in one line, soon."""
    logs = tmp_path / "logs"

    def remove(gatherer: Gathered) -> None:
        if gatherer.rounds == 2:
            shutil.rmtree(logs)

    plan = Plan("hex:n=6", "random", processes=0, max_rounds=200, log=logs / "a.mcap")
    outcome = run(plan, watch=remove)
    assert outcome.ended == "failed"
    assert outcome.rounds < 20
    assert outcome.error is not None
    assert outcome.error.startswith(f"{logs / 'a.mcap'}: recording stopped after ")
    assert outcome.error.endswith(" messages: its file was removed or moved")


@pytest.mark.parametrize(
    ("system", "name"),
    [
        ("my-robot.toml", "my-robot-random-0-"),
        ("./folder/My robot, 2.toml", "My-robot-2-random-0-"),
        ("folder/robot", "robot-random-0-"),
        ("agv:graph=P3,n=1", "agv-random-0-"),
    ],
)
def test_the_log_of_a_file_bears_its_name(
    system: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it is called on the command line, whatever its family; a family's log bears that."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    if "graph" not in system:
        Path(system).write_text(scene_to_toml(scene_from_spec("agv:graph=P3,n=1")))
    outcome = run(Plan(system, "random", processes=0, max_rounds=0))
    assert Path(outcome.log).parent == Path("logs")
    assert Path(outcome.log).name.startswith(name)


def running() -> LockstepFleet:
    """Return the fleet of the run that goes on in this process."""
    fleets = (one for one in gc.get_objects() if isinstance(one, LockstepFleet))
    return next(one for one in fleets if one._shell is not None)  # not one that is over


@pytest.mark.thorough
def test_nonsense_is_on_record(tmp_path: Path) -> None:
    """Bytes that are no message change nothing, are counted, and told of with their key."""

    def nonsense(gatherer: Gathered) -> None:
        if gatherer.rounds != 3:
            return
        fleet = running()
        with open_client(fleet.endpoint, credentials=fleet.credentials(COORDINATOR)) as session:
            put(session, f"cubepath/{fleet.run}/hello/me", b"not json")

    plan = Plan("hex:n=3", "random", processes=0, max_rounds=200, log=tmp_path / "a.mcap")
    outcome = run(plan, watch=nonsense)
    assert (outcome.ended, outcome.refused) == ("max-rounds", 1)
    recording = read_recording(tmp_path / "a.mcap")
    (told,) = parts(recording, "refused")
    assert (told.key, told.sender, told.reason) == ("hello/me", "me", "malformed")
    assert (told.count, told.sample) == (1, "not json")
    assert verify(recording).ok


@contextmanager
def started(tmp_path: Path, *arguments: str) -> Generator[subprocess.Popen[str]]:
    """Start a long run in a session of its own, and wait until it records rounds.

    Whatever the test does with it, nothing of it is left running.
    """
    log = tmp_path / "run.mcap"
    child = subprocess.Popen(
        [*PYTHON, "run", "hex:n=6", *LONG, f"--log={log}", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        wait_until(lambda: log.exists() and log.stat().st_size > 20_000, child)
        yield child
    finally:
        if child.poll() is None:
            child.kill()  # its children end when its pipes to them close
        child.communicate()


def complaints(err: str) -> list[str]:
    """Return what a run has said beside where it can be listened to, which comes first."""
    first, *others = err.splitlines()
    assert re.fullmatch(r"cubepath: endpoint unixsock-stream/\S+/socket, run [0-9a-f]{12}", first)
    return others


def wait_until(holds: Callable[[], bool], child: subprocess.Popen[str]) -> None:
    """Wait until something holds of a run that goes on."""
    deadline = time.monotonic() + 30
    while not holds():
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def children_of(pid: int) -> dict[int, str]:
    """Return the process ids of a process's children, each with the module that it runs."""
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            # It may have just been started, and have no command yet, or may have just ended.
            with suppress(FileNotFoundError, ProcessLookupError, ValueError):
                command = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                found[int(child)] = command[command.index(b"-m") + 1].decode()
    return found


def router_of(pid: int) -> int:
    """Return the process id of the router of a run."""
    (found,) = (child for child, module in children_of(pid).items() if module.endswith(".router"))
    return found


def assert_gone(pids: Iterable[int]) -> None:
    """Assert that none of the processes runs."""
    deadline = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, "a module process still runs"
        time.sleep(0.02)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_closes_the_recording(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C ends with 130 and a whole recording that says so; no process is left."""
    with started(tmp_path, "--processes", "2", "--json") as child:
        pids = children_of(child.pid)
        assert len(pids) == 3
        child.send_signal(number)
        out, err = child.communicate(timeout=30)
        assert child.returncode == 130
    assert complaints(err) == ["cubepath: interrupted"]
    answer = json.loads(out)
    assert_gone(pids)
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.problems == ()
    assert summary_of(recording).ended == "interrupted"
    assert summary_of(recording).rounds == answer["rounds"] > 0


@pytest.mark.thorough
def test_a_terminal_interrupt_reaches_every_process_and_closes_the_recording(
    tmp_path: Path,
) -> None:
    """Ctrl-C at a terminal is sent to the whole group: the end is the same."""
    with started(tmp_path, "--processes", "2") as child:
        pids = children_of(child.pid)
        os.killpg(child.pid, signal.SIGINT)
        _, err = child.communicate(timeout=30)
        assert child.returncode == 130
    assert complaints(err) == ["cubepath: interrupted"]
    assert_gone(pids)
    assert read_recording(tmp_path / "run.mcap").problems == ()


def goes_on(tmp_path: Path, child: subprocess.Popen[str]) -> None:
    """Wait until some rounds more are on record."""
    log = tmp_path / "run.mcap"
    before = log.stat().st_size
    wait_until(lambda: log.stat().st_size > before + 20_000, child)


def ends_whole(tmp_path: Path, child: subprocess.Popen[str]) -> None:
    """Interrupt a run, and assert that its recording is whole and passes every check."""
    pids = children_of(child.pid)
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=30)
    assert child.returncode == 130
    assert_gone(pids)
    found = verify(read_recording(tmp_path / "run.mcap"))
    assert found.ok, [check for check in found.checks if not check.ok]


@pytest.mark.thorough
def test_routers_that_die_as_they_start_are_started_again(tmp_path: Path) -> None:
    """What was on its way is lost and asked for again; the recording passes every check."""
    with started(tmp_path, "--processes", "2") as child:
        for _ in range(4):
            router = router_of(child.pid)
            os.kill(router, signal.SIGKILL)
            assert_gone([router])
            wait_until(
                lambda: any(name.endswith(".router") for name in children_of(child.pid).values()),
                child,
            )
        goes_on(tmp_path, child)
        ends_whole(tmp_path, child)


@pytest.mark.nightly
def test_a_coordinator_that_is_paused_for_long_goes_on(tmp_path: Path) -> None:
    """For 12 s, longer than the lease of a link by default; it goes on within some seconds."""
    with started(tmp_path, "--processes", "2") as child:
        os.kill(child.pid, signal.SIGSTOP)
        time.sleep(12)
        os.kill(child.pid, signal.SIGCONT)
        begun = time.monotonic()
        goes_on(tmp_path, child)
        assert time.monotonic() - begun < 5
        ends_whole(tmp_path, child)


@pytest.mark.thorough
def test_messages_that_come_twice_change_nothing(tmp_path: Path) -> None:
    """Somebody who may puts every message of the run once more, late and in another order."""
    plan = Plan("hex:n=6", "random", seed=3, processes=2, max_rounds=40)
    quiet = run(replace(plan, log=tmp_path / "a.mcap"))
    guest: list[zenoh.Session] = []
    heard: SimpleQueue[zenoh.Sample] = SimpleQueue()

    def meddle(gatherer: Gathered) -> None:
        if not guest:
            fleet = running()
            credentials = fleet.credentials(COORDINATOR)
            guest.append(open_client(fleet.endpoint, credentials=credentials))
            subscribe(guest[0], f"cubepath/{fleet.run}/**", heard.put)
        del gatherer
        again = [heard.get() for _ in range(heard.qsize())][::-1][:100]
        for sample in again:
            guest[0].put(sample.key_expr, sample.payload)

    try:
        loud = run(replace(plan, log=tmp_path / "b.mcap"), watch=meddle)
    finally:
        for session in guest:
            session.close()
    assert (loud.ended, loud.path_digest) == (quiet.ended, quiet.path_digest)
    assert verify(read_recording(tmp_path / "b.mcap")).ok
    assert heard.qsize() or loud.rounds == 40


@pytest.mark.slow
def test_a_killed_coordinator_leaves_no_process_and_a_readable_file(tmp_path: Path) -> None:
    """kill -9 of the coordinator: its processes end by themselves, what was flushed can be read."""
    with started(tmp_path, "--processes", "2") as child:
        pids = children_of(child.pid)
        child.kill()
        child.communicate(timeout=30)
    assert_gone(pids)
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.problems
    assert len(list(recording.records)) >= 50


@pytest.mark.slow
def test_a_full_disk_ends_the_run_and_keeps_what_was_written(tmp_path: Path) -> None:
    """When the recording takes no more: exit code 1, one line, and a readable beginning."""
    code = (
        "import resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
        "from cubepath.coordinator.commands.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    log = tmp_path / "full.mcap"
    done = subprocess.run(
        [
            *(sys.executable, "-c", code),
            *("run", "hex:n=6", "--rule=random", "--processes=0", f"--log={log}"),
        ],
        # Python before 3.12 would leave half of a file, for all who come after.
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert "full.mcap: recording stopped after" in done.stderr
    assert len(complaints(done.stderr)) == 1
    recording = read_recording(log)
    assert recording.problems
    assert len(recording.records) > 50


def test_a_run_without_memory_ends_with_its_recording_closed(tmp_path: Path) -> None:
    """With a summary that says why, and all rounds so far."""
    log = tmp_path / "a.mcap"
    outcome = run(
        Plan("agv:graph=P5,n=1", processes=0, log=log),
        watch=lambda _gatherer: print(bytes(1 << 60)),
    )
    assert (outcome.ended, outcome.error, outcome.rounds) == ("failed", "out of memory", 1)
    recording = read_recording(log)
    assert recording.problems == ()
    assert summary_of(recording).error == "out of memory"


def test_a_run_off_the_main_thread_needs_no_signals(tmp_path: Path) -> None:
    """The library can be used from any thread."""
    found: list[int] = []
    plan = Plan("agv:graph=P3,n=1", processes=0, log=tmp_path / "a.mcap")
    thread = threading.Thread(target=lambda: found.append(run(plan).moves))
    thread.start()
    thread.join(30)
    assert found == [2]


def test_an_unknown_family_runs_at_random(tmp_path: Path) -> None:
    """A scene from a file with no family runs under the random rule by default."""
    from cubepath.protocol.scenes.toml import scene_to_toml

    text = scene_to_toml(scene_from_spec("agv:graph=P3,n=1")).replace('family = "agv"\n', "")
    path = tmp_path / "mine.toml"
    path.write_text(text)
    outcome = run(Plan(str(path), processes=0, max_rounds=3, log=tmp_path / "a.mcap"))
    assert outcome.rule == "random"
    with pytest.raises(InputError, match="not for this system"):
        run(Plan(str(path), rule="chain", log=tmp_path / "b.mcap"))


@pytest.mark.slow
def test_a_run_that_no_recording_could_hold_is_refused_at_once(tmp_path: Path) -> None:
    """Before anything is written or started, with how many processes there may be."""
    log = tmp_path / "run.mcap"
    with pytest.raises(InputError, match=r"65535 at most: expected at most 13105 processes"):
        run(Plan("agv:graph=grid130x130,n=13107", processes=1_000_000, log=log))
    assert not log.exists()


@pytest.mark.slow
def test_there_are_no_more_processes_than_modules(tmp_path: Path) -> None:
    """However many are asked for, what they say fits into a recording."""
    outcome = run(Plan("agv:graph=P3,n=1", processes=1_000_000, log=tmp_path / "run.mcap"))
    assert (outcome.processes, outcome.ended) == (1, "goal")
