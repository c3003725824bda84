"""Runs on several hosts: real commands that join over loopback addresses."""

import json
import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from cubepath.agents.free.joining import Joining, join
from cubepath.agents.processes.membership import GONE_S, alive_key
from cubepath.coordinator.runs.contents import info, render
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.sessions import LEASE_S, open_client
from processes.elsewhere import Commands, Running, soon

pytestmark = pytest.mark.slow

SYSTEM = ("hex:n=6", "--rule=random", "--seed=3", "--max-rounds=40")
ENDLESS = ("hex:n=6", "--rule=random", "--max-rounds=20000", "--log=run.mcap")
LOOPBACK = "tcp/127.0.0.1:0"


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Return what starts commands, and ends them."""
    with Commands(tmp_path) as found:
        yield found


@pytest.fixture(scope="module")
def digest(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of the run in one process."""
    log = tmp_path_factory.mktemp("alone") / "a.mcap"
    plan = Plan("hex:n=6", "random", seed=3, max_rounds=40, processes=0, log=log)
    return run(plan).path_digest


def listens(command: Running) -> str:
    """Return where a command listens."""
    return command.says(r"listening on (\S+) without TLS: any client that connects can speak")[1]


def joins(commands: Commands, endpoint: str, modules: str, *more: str) -> Running:
    """Start a process that joins."""
    return commands.start("join", f"--connect={endpoint}", f"--modules={modules}", *more)


def recorded(folder: Path) -> int:
    """Return how many bytes are on record."""
    log = folder / "run.mcap"
    return log.stat().st_size if log.exists() else 0


def child_of(router: Running) -> int:
    """Return the process id of the router itself, which the command looks after."""
    task = Path(f"/proc/{router.pid}/task/{router.pid}/children")
    return int(task.read_text().split()[0])


def goes_on(folder: Path) -> None:
    """Wait until more is recorded."""
    before = recorded(folder)
    soon(lambda: recorded(folder) > before + 20_000, "the run stands still")


@pytest.mark.thorough
def test_hosts_on_several_addresses_give_the_same_path(commands: Commands, digest: str) -> None:
    """A router on 127.0.0.1, joins from 127.0.0.2 and 127.0.0.3; the rest is dealt to own ones."""
    router = commands.start("host", "router", f"--listen={LOOPBACK}")
    endpoint = listens(router)
    runs = commands.start("run", *SYSTEM, f"--connect={endpoint}", "--wait-for=2", "--json")
    runs.says(r"waiting for 2 processes: modules 0-5")
    first = joins(commands, f"{endpoint}#bind=127.0.0.2:0", "3-4", "--json")
    runs.says(r"waiting for 1 process: modules 0-2, 5")
    second = joins(commands, f"{endpoint}#bind=127.0.0.3:0", "0,2", "--json")
    code, answer, _ = runs.end()
    assert code == 0
    found = json.loads(answer)
    assert (found["path_digest"], found["processes"]) == (digest, 4)
    told = [json.loads(each.end()[1]) for each in (first, second)]
    assert [(each["process"], each["modules"]) for each in told] == [(1, [3, 4]), (0, [0, 2])]
    recording = read_recording(commands.folder / found["log"])
    assert verify(recording).ok
    assert recording.parameters["wait_for"] == "2"
    router.signal(signal.SIGINT)
    assert router.end()[0] == 0


@pytest.mark.thorough
def test_no_own_process_where_all_modules_are_elsewhere(commands: Commands, digest: str) -> None:
    """One process that joins can have them all."""
    runs = commands.start("run", *SYSTEM, f"--listen={LOOPBACK}", "--wait-for=1", "--json")
    joined = joins(commands, listens(runs), "0-5", "--as=process_0")
    code, answer, _ = runs.end()
    assert (code, json.loads(answer)["path_digest"]) == (0, digest)
    assert json.loads(answer)["processes"] == 1
    assert joined.end()[0] == 0
    contents = info(read_recording(commands.folder / json.loads(answer)["log"]))
    assert contents["processes"] == 1
    assert re.search(r"modules +6 in 1 processes", render(contents))
    with chdir(commands.folder):
        log = run(*SYSTEM[:1], "random", seed=3, max_rounds=40, processes=0, log="alone.mcap").log
        found = diff(json.loads(answer)["log"], log)
    assert found.parameters == {"wait_for": ("1", None), "processes": ("1", "0")}


@pytest.mark.thorough
def test_whoever_is_refused_is_told_why_and_the_run_goes_on_waiting(
    commands: Commands, digest: str
) -> None:
    """Modules that are not there, or taken, names out of bounds: one line, exit code 2."""
    runs = commands.start("run", *SYSTEM, f"--listen={LOOPBACK}", "--wait-for=2", "--json")
    endpoint = listens(runs)
    first = joins(commands, endpoint, "0-2")
    runs.says("waiting for 1 process: modules 3-5")
    for modules, more, line in (
        ("5-6", (), "modules 6: the run has modules 0-5"),
        ("2-3", (), "modules 2: taken by another process"),
        ("3", ("--as=process_2",), "process_2: those that join are process_0 to process_1"),
    ):
        code, answer, errors = joins(commands, endpoint, modules, *more).end()
        assert (code, answer, errors[-1]) == (2, "", f"cubepath: {line}")
    second = joins(commands, endpoint, "3-5")
    code, answer, _ = runs.end()
    assert (code, json.loads(answer)["path_digest"]) == (0, digest)
    assert (first.end()[0], second.end()[0]) == (0, 0)


@pytest.mark.thorough
def test_two_runs_at_one_router_do_not_meet(commands: Commands, digest: str) -> None:
    """Who joins has to say which run; each has the path that it has alone."""
    endpoint = listens(commands.start("host", "router", f"--listen={LOOPBACK}"))
    arguments = (*SYSTEM, f"--connect={endpoint}", "--wait-for=1", "--processes=1", "--json")
    both = [commands.start("run", *arguments, f"--log={name}.mcap") for name in "ab"]
    ids = [each.says(r"run ([0-9a-f]{12})")[1] for each in both]
    for each in both:
        each.says("waiting for 1 process")
    code, _, errors = joins(commands, endpoint, "0").end()
    assert code == 2
    assert errors[-1].endswith(f"expected --run, one of {', '.join(sorted(ids))}")
    joined = [joins(commands, endpoint, "0-3", f"--run={run}") for run in ids]
    assert [json.loads(each.end()[1])["path_digest"] for each in both] == [digest, digest]
    assert [each.end()[0] for each in joined] == [0, 0]


@pytest.mark.thorough
def test_a_run_that_waits_can_be_interrupted(commands: Commands) -> None:
    """Exit code 130 there; who waited for it to begin is told that it has ended."""
    runs = commands.start("run", *ENDLESS, f"--listen={LOOPBACK}", "--wait-for=2")
    joined = joins(commands, listens(runs), "0-2")
    runs.says("waiting for 1 process")
    runs.signal(signal.SIGINT)
    assert runs.end()[0] == 130
    code, _, errors = joined.end()
    assert (code, errors[-1]) == (1, "cubepath: the run has ended")


@pytest.mark.thorough
def test_who_leaves_before_the_beginning_is_waited_for_again(
    commands: Commands, digest: str
) -> None:
    """Its modules are free again after some seconds, though it was killed."""
    runs = commands.start("run", *SYSTEM, f"--listen={LOOPBACK}", "--wait-for=2", "--json")
    endpoint = listens(runs)
    gone = joins(commands, endpoint, "0-2")
    runs.says("waiting for 1 process: modules 3-5")
    gone.signal()
    runs.says("waiting for 2 processes: modules 0-5", again=True)
    joined = [joins(commands, endpoint, modules) for modules in ("0-2", "3-5")]
    assert json.loads(runs.end()[1])["path_digest"] == digest
    assert [each.end()[0] for each in joined] == [0, 0]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 130)]
)
def test_a_joined_process_that_ends_ends_the_run(
    commands: Commands, number: signal.Signals, code: int
) -> None:
    """At once, and it is named."""
    runs = commands.start("run", *ENDLESS, f"--listen={LOOPBACK}", "--wait-for=1")
    joined = joins(commands, listens(runs), "0,4")
    goes_on(commands.folder)
    joined.signal(number)
    begun = time.monotonic()
    assert joined.end()[0] == code
    found, _, errors = runs.end()
    assert found == 1
    assert "module_0, module_4 (process 0) died in round" in errors[-1]
    assert errors[-1].endswith("it has left the network")
    assert time.monotonic() - begun < 10
    assert verify(read_recording(commands.folder / "run.mcap")).ok


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_joined_process_ends_when_its_coordinator_does_not_go_on(
    commands: Commands, number: signal.Signals
) -> None:
    """With one line, when its patience is over; with the coordinator its router was killed too."""
    runs = commands.start("run", *ENDLESS, f"--listen={LOOPBACK}", "--wait-for=1")
    joined = joins(commands, listens(runs), "0-3", "--patience=3")
    goes_on(commands.folder)
    runs.signal(number)
    code, answer, errors = joined.end()
    assert (code, answer) == (1, "")
    assert re.search(r"nothing was heard of run \w+ for 3 s$", errors[-1])


@pytest.mark.thorough
def test_a_joined_process_ends_when_its_coordinator_alone_has_died(commands: Commands) -> None:
    """Within seconds, however patient it is: its router knows."""
    endpoint = listens(commands.start("host", "router", f"--listen={LOOPBACK}"))
    runs = commands.start("run", *ENDLESS, f"--connect={endpoint}", "--wait-for=1")
    joined = joins(commands, endpoint, "0-3", "--patience=600")
    goes_on(commands.folder)
    runs.signal()
    code, _, errors = joined.end()
    assert code == 1
    assert re.search(r"the coordinator of run \w+ is gone$", errors[-1])


@pytest.mark.thorough
def test_a_joined_process_that_is_paused_is_waited_for(commands: Commands) -> None:
    """It is alive, as far as anyone knows, and goes on where it was."""
    runs = commands.start("run", *ENDLESS, f"--listen={LOOPBACK}", "--wait-for=1")
    joined = joins(commands, listens(runs), "0-3")
    goes_on(commands.folder)
    joined.signal(signal.SIGSTOP)
    time.sleep(3)
    joined.signal(signal.SIGCONT)
    goes_on(commands.folder)
    runs.signal(signal.SIGINT)
    assert (runs.end()[0], joined.end()[0]) == (130, 0)
    assert verify(read_recording(commands.folder / "run.mcap")).ok


@pytest.mark.thorough
def test_a_process_that_waits_to_join_can_be_interrupted(commands: Commands) -> None:
    """Exit code 130; the run goes on waiting, and can be interrupted too."""
    runs = commands.start("run", *ENDLESS, f"--listen={LOOPBACK}", "--wait-for=2")
    joined = joins(commands, listens(runs), "0-3")
    runs.says("waiting for 1 process")
    joined.signal(signal.SIGINT)
    code, answer, errors = joined.end()
    assert (code, answer, errors[-1]) == (130, "", "cubepath: interrupted")
    runs.says("waiting for 2 processes: modules 0-5", again=True)
    runs.signal(signal.SIGTERM)
    assert runs.end()[0] == 130


@pytest.mark.thorough
def test_a_router_elsewhere_that_dies_is_waited_for(commands: Commands) -> None:
    """Its command starts it again, and the run goes on with those that joined."""
    router = commands.start("host", "router", f"--listen={LOOPBACK}")
    endpoint = listens(router)
    runs = commands.start("run", *ENDLESS, f"--connect={endpoint}", "--wait-for=1")
    joined = joins(commands, endpoint, "0-3")
    goes_on(commands.folder)
    os.kill(child_of(router), signal.SIGKILL)
    router.says("the router died, and was started again")
    goes_on(commands.folder)
    runs.signal(signal.SIGINT)
    assert runs.end()[0] == 130
    assert joined.end()[0] == 0
    assert verify(read_recording(commands.folder / "run.mcap")).ok


@pytest.mark.thorough
@pytest.mark.parametrize("first", [True, False])
def test_a_run_outlives_one_of_two_linked_routers(commands: Commands, first: bool) -> None:
    """Whichever dies for good: that of the run, or that of the process which has joined."""
    one = commands.start("host", "router", f"--listen={LOOPBACK}")
    here = listens(one)
    other = commands.start("host", "router", f"--listen={LOOPBACK}", f"--connect={here}")
    there = listens(other)
    runs = commands.start("run", *ENDLESS, f"--connect={here},{there}", "--wait-for=1")
    runs.says("waiting for 1 process")
    joined = joins(commands, f"{there},{here}", "0-3")
    goes_on(commands.folder)
    (one if first else other).signal()
    goes_on(commands.folder)
    runs.signal(signal.SIGINT)
    assert (runs.end()[0], joined.end()[0]) == (130, 0)
    assert verify(read_recording(commands.folder / "run.mcap")).ok


@pytest.mark.thorough
def test_a_run_links_its_own_router_with_others(commands: Commands, digest: str) -> None:
    """So its host needs no other; processes join at any of them, whichever dies."""
    here = listens(commands.start("host", "router", f"--listen={LOOPBACK}"))
    dies = commands.start("host", "router", f"--listen={LOOPBACK}", f"--connect={here}")
    there = listens(dies)
    links = (f"--listen={LOOPBACK}", f"--connect={here},{there}")
    runs = commands.start("run", *SYSTEM, *links, "--wait-for=3", "--json")
    own = listens(runs)
    survives = joins(commands, f"{there},{here}", "2")
    survives.says("waiting for run")
    dies.signal()
    others = [joins(commands, endpoint, str(at)) for at, endpoint in enumerate((own, here))]
    joined = [*others, survives]
    code, answer, errors = runs.end()
    assert code == 0, errors
    assert json.loads(answer)["path_digest"] == digest
    assert [each.end()[0] for each in joined] == [0, 0, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("failover", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_run_outlives_a_router_that_stands_still_or_a_host_that_is_cut_off(
    commands: Commands, failover: bool
) -> None:
    """For longer than the lease of a link, whether or not a process has another router; by the
    same path."""
    length = ("hex:n=6", "--rule=random", "--seed=3", "--max-rounds=500")
    alone = commands.start("run", *length, "--json", "--log=alone.mcap").end()[1]
    here = listens(commands.start("host", "router", f"--listen={LOOPBACK}"))
    other = commands.start("host", "router", f"--listen={LOOPBACK}", f"--connect={here}")
    there = listens(other)
    whole = ("--json", "--log=run.mcap", f"--connect={here}", "--wait-for=1")
    runs = commands.start("run", *length, *whole)
    runs.says("waiting for 1 process")
    joined = joins(commands, f"{there},{here}" if failover else there, "0-3")
    goes_on(commands.folder)
    os.kill(child_of(other), signal.SIGSTOP)
    try:
        if failover:
            goes_on(commands.folder)
        else:
            time.sleep(LEASE_S + GONE_S + 3)
    finally:
        os.kill(child_of(other), signal.SIGCONT)
    code, answer, errors = runs.end()
    assert code == 0, errors
    assert json.loads(answer)["path_digest"] == json.loads(alone)["path_digest"]
    assert joined.end()[0] == 0
    assert verify(read_recording(commands.folder / "run.mcap")).ok


def test_a_run_that_listens_without_waiting_says_so_and_is_found(commands: Commands) -> None:
    """It shows its coordinator's token, and refuses those that would join in one line."""
    runs = commands.start("run", *ENDLESS, "--processes=1", f"--listen={LOOPBACK}")
    endpoint = listens(runs)
    runs.says("others can listen, but not join: expected --wait-for N")
    code, answer, errors = joins(commands, endpoint, "0-2").end()
    line = "the run waits for no processes, expected one that has --wait-for N"
    assert (code, answer, errors[-1]) == (2, "", f"cubepath: {line}")
    with open_client(endpoint) as session:
        key = alive_key("*", COORDINATOR)
        assert [each.ok is not None for each in session.liveliness().get(key)] == [True]
    goes_on(commands.folder)
    runs.signal(signal.SIGINT)
    assert runs.end()[0] == 130


def test_a_run_waits_for_others_no_longer_than_its_patience(commands: Commands) -> None:
    """One line says what was missing; exit code 1."""
    runs = commands.start("run", *SYSTEM, f"--listen={LOOPBACK}", "--wait-for=2", "--patience=1.5")
    code, _, errors = runs.end()
    line = "no process joined within 1.5 s, expected 2 processes: modules 0-5"
    assert (code, errors[-1]) == (1, f"cubepath: {line}")
    assert "cubepath: waiting for 2 processes: modules 0-5" in errors


@pytest.mark.parametrize("place", ["127.0.0.1:9", "[::1]:9", "127.0.0.1:9#bind=127.0.0.2:0"])
def test_a_process_that_finds_nothing_at_an_address_ends_soon(place: str) -> None:
    """Within three seconds, however patient it is."""
    began = time.monotonic()
    line = f"no zenoh router at tcp/{place}: no answer"
    with pytest.raises(CheckError, match=f"^{re.escape(line)}$"):
        join(Joining(f"tcp/{place}", (0,)))
    assert 1.0 < time.monotonic() - began < 3.0


@pytest.mark.thorough
def test_a_process_waits_for_a_router_that_stands_still(commands: Commands) -> None:
    """The address answers, so it waits for its patience; and it joins once the router goes on."""
    router = commands.start("host", "router", f"--listen={LOOPBACK}")
    endpoint = listens(router)
    child = child_of(router)
    os.kill(child, signal.SIGSTOP)
    try:
        joined = joins(commands, endpoint, "0")
        with pytest.raises(CheckError, match="did not end within 6 s"):
            joined.wait(6)
    finally:
        os.kill(child, signal.SIGCONT)
    runs = commands.start("run", "hex:n=2", f"--connect={endpoint}", "--wait-for=1")
    assert (runs.end()[0], joined.end()[0]) == (0, 0)


@pytest.mark.thorough
def test_no_run_to_join_is_one_line(commands: Commands) -> None:
    """When patience is over: no router, or no run that waits there."""
    port = listens(commands.start("host", "router", f"--listen={LOOPBACK}"))
    for endpoint, line in (
        ("tcp/127.0.0.1:9", "no zenoh router at tcp/127.0.0.1:9: no answer"),
        ("tcp/a..b:9", "no zenoh router at tcp/a..b:9: no answer"),  # no host has that name
        (port, f"no run waits at {port}"),
    ):
        code, answer, errors = joins(commands, endpoint, "0", "--patience=1").end()
        assert (code, answer, errors) == (1, "", [f"cubepath: {line}"])
