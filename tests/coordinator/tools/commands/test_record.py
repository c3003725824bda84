"""`cubepath log record` beside other commands, each a process of its own."""

import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from cubepath.coordinator.testing import Command
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.sessions import open_client
from processes.command_line import GOLDEN
from processes.elsewhere import Commands, Running, soon

pytestmark = pytest.mark.slow
RANDOM = ("run", "hex:n=6", "--rule=random", "--max-rounds=20000")
"""A run that goes on until it is ended."""


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Return what starts commands, and ends them."""
    with Commands(tmp_path) as found:
        yield found


@pytest.mark.thorough
def test_the_line_that_a_run_says_of_itself_is_what_record_takes(
    commands: Commands, tmp_path: Path
) -> None:
    """Also of a run that listens at an address: its endpoint and its name, to be pasted."""
    run = commands.start("run", "hex:n=3", "--listen=tcp/127.0.0.1:0", "--wait-for=1")
    run.says(r"listening on \S+ without TLS")
    endpoint, name = run.says(r"endpoint (\S+), run (\S+)").groups()
    recorder = commands.start(
        "log", "record", "--connect", endpoint, "--run", name, "-o", "out.mcap"
    )
    recorder.says(f"recording run {name}")
    commands.start("join", "--connect", endpoint, "--modules=0-2")
    assert run.end()[0] == 0
    assert recorder.end()[0] == 0
    assert read_recording(tmp_path / "out.mcap").parameters["attached"] == "1"


@pytest.mark.slow
@pytest.mark.few(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_what_only_ends_by_a_signal_ends_well(
    number: int, commands: Commands, tmp_path: Path
) -> None:
    """A recorder of any keys, and a router: exit code 0, and the file is whole."""
    router = commands.start("host", "router", "--listen=tcp/127.0.0.1:0")
    endpoint = router.says(r"listening on (\S+) without TLS")[1]
    recorder = commands.start(
        "log", "record", "--connect", endpoint, "--keys=a/*", "-o", "out.mcap"
    )
    recorder.says(r"recording a/\*")
    with open_client(endpoint) as session:
        session.put("a/b", "1", congestion_control=zenoh.CongestionControl.BLOCK)
        soon((tmp_path / "out.mcap").exists)
    for each in (recorder, router):
        each.signal(number)
        code, _, errors = each.end()
        assert code == 0, errors
    assert [each.data for each in read_recording(tmp_path / "out.mcap").records] == [b"1"]


@pytest.mark.thorough
def test_a_run_that_is_killed_is_gone_without_a_word(commands: Commands, tmp_path: Path) -> None:
    """What came until then is whole, and a line says that how it ended is not known."""
    run = commands.start(*RANDOM)
    endpoint, name = run.says(r"endpoint (\S+), run (\S+)").groups()
    log = tmp_path / "out.mcap"
    recorder = commands.start("log", "record", "--connect", endpoint, "-o", str(log), "--json")
    recorder.says("recording run")
    soon(lambda: log.exists() and log.stat().st_size > 20_000)
    run.signal(signal.SIGKILL)
    code, answer, said = recorder.end()
    assert (code, json.loads(answer)["ended"]) == (0, "run gone")
    assert said[-1] == f"cubepath: run {name} is gone, and has not said how it ended"
    recording = read_recording(log)
    assert recording.problems == ()
    assert verify(recording).ok


@pytest.mark.thorough
@pytest.mark.parametrize("mine", [True, False])
def test_who_watches_a_run_goes_on_at_another_of_two_linked_routers(
    commands: Commands, tmp_path: Path, mine: bool
) -> None:
    """Whether the router of those who watch dies, or that of the run."""
    routers, endpoints = list[Running](), list[str]()
    for links in ((), ("--connect",)):
        router = commands.start("host", "router", "--listen=tcp/127.0.0.1:0", *links, *endpoints)
        endpoints.append(router.says(r"listening on (\S+) without TLS")[1])
        routers.append(router)
    clock = ("--clock=free", "--rule=random", "--max-rounds=20000", "--processes=1", "--keepers=1")
    run = commands.start("run", "hex:n=6", *clock, f"--connect={','.join(endpoints)}")
    run.says(r"endpoint \S+, run")
    where = f"--connect={','.join(reversed(endpoints))}"
    log = tmp_path / "out.mcap"
    recorder = commands.start("log", "record", where, "-o", str(log), "--json")
    page = commands.start("view", where, "--json")
    recorder.says("recording run")
    page.says("live at")
    soon(log.exists)  # the file begins with the first message
    routers[mine].signal()
    run.says(r"endpoint \S+, run")
    before = log.stat().st_size
    soon(lambda: log.stat().st_size > before + 20_000)
    run.signal(signal.SIGINT)
    assert run.end()[0] == 130
    code, answer, _ = recorder.end()
    found = json.loads(answer)
    assert (code, found["ended"], found["cut_off"]) == (0, "run ended", int(mine))
    code, answer, errors = page.end()
    assert (code, json.loads(answer)["ended"]) == (0, "interrupted"), errors


@pytest.mark.thorough
def test_a_replay_that_has_ended_is_gone_and_not_its_router_alone(
    commands: Commands, tmp_path: Path
) -> None:
    """At an address, where the router of a run might come back."""
    played = str(GOLDEN / "hex-5.mcap")
    words = ("--listen=tcp/127.0.0.1:0", "--wait-for-subscribers", "--rate=100")
    replay = commands.start("replay", played, *words)
    endpoint, name = replay.says(r"replaying on (\S+) under cubepath/(\w+)/").groups()
    log = tmp_path / "out.mcap"
    recorder = commands.start("log", "record", "--connect", endpoint, "-o", str(log), "--json")
    assert replay.end()[0] == 0
    code, answer, said = recorder.end()
    assert (code, json.loads(answer)["ended"]) == (0, "run gone")
    assert said[-1] == f"cubepath: run {name} is gone, and has not said how it ended"


@pytest.mark.thorough
def test_a_snapshot_that_does_not_fit_leaves_no_other_file(
    commands: Commands, tmp_path: Path
) -> None:
    """One line says why, and the exit code is 1."""
    inside = tmp_path / "in.mcap"
    run = commands.start(*RANDOM, f"--log={inside}")
    endpoint = run.says(r"endpoint (\S+), run")[1]
    script = "import resource, sys; sys.dont_write_bytecode = True;"
    script += "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000));"
    script += "from cubepath.coordinator.commands.main import main; sys.exit(main(sys.argv[1:]))"
    line = ["log", "record", f"--connect={endpoint}", "-o", "last.mcap", "--snapshot=60"]
    with Command([sys.executable, "-c", script, *line], name="record", cwd=tmp_path) as recorder:
        recorder.says("recording run")
        before = inside.stat().st_size
        soon(lambda: inside.stat().st_size > before + 200_000)
        recorder.signal(signal.SIGUSR1)
        recorder.says(r"last-000\.mcap: recording stopped after .*: File too large")
        assert recorder.wait(20) == 1
    assert not (tmp_path / "last.mcap").exists()
