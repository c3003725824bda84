"""Runs without rounds on several hosts: real commands that join as modules and as keepers."""

import json
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh
from msgspec.structs import replace

from cubepath.agents.free.config import FreeProcessConfig
from cubepath.agents.free.host_node import FreeHostNode
from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.processes.membership import (
    PROTOCOL,
    JoinRequest,
    orders_key,
    read_offer,
    read_orders,
)
from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.authority import make_certificates
from cubepath.protocol.wire.credentials import Credentials
from cubepath.protocol.wire.sessions import open_client
from cubepath.protocol.wire.shell import Shell
from processes.elsewhere import Commands, Running, soon

pytestmark = pytest.mark.slow

FREE = ("--clock=free", "--keepers=2", "--processes=1", "--json", "--log=run.mcap")
LOOPBACK = "tcp/127.0.0.1:0"
SLOW = tuple(f"--speed={module}=25" for module in range(6))
"""Modules that leave time to do something to them."""


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Return what starts commands, and ends them."""
    with Commands(tmp_path) as found:
        yield found


def joins(commands: Commands, runs: Running, *more: str) -> Running:
    """Start a process that joins a run."""
    endpoint = runs.says(r"endpoint (\S+), run")[1]
    return commands.start("join", f"--connect={endpoint}", "--json", *more)


def commits(folder: Path) -> int:
    """Return how many commits are on record."""
    log = folder / "run.mcap"
    return sum(1 for _ in read_recording(log).of_kind("commit")) if log.exists() else 0


def goes_on(folder: Path) -> None:
    """Wait until more is committed."""
    before = commits(folder)
    soon(lambda: commits(folder) > before + 1, "the run stands still")


def ended(runs: Running, folder: Path) -> dict[str, Any]:
    """Wait for the end of a run, which holds; return its outcome."""
    code, answer, errors = runs.end()
    assert code == 0, errors
    found = audit(read_recording(folder / "run.mcap"))
    assert found.ok, [check for check in found.checks if not check.ok]
    outcome: dict[str, Any] = json.loads(answer)
    return outcome


def test_modules_and_keepers_are_elsewhere(commands: Commands) -> None:
    """The rest is local; the keeper elsewhere has its log where it runs."""
    runs = commands.start("run", "hex:n=6", *FREE, f"--listen={LOOPBACK}", "--wait-for=2")
    modules = joins(commands, runs, "--modules=0-2")
    keeper = joins(commands, runs, "--as=keeper_1")
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["processes"]) == (True, 40, 2)
    code, answer, _ = modules.end()
    assert (code, json.loads(answer)["modules"]) == (0, [0, 1, 2])
    code, answer, _ = keeper.end()
    assert (code, json.loads(answer)["keeper"]) == (0, 1)
    log = commands.folder / json.loads(answer)["log"]
    assert '"committed"' in log.read_text()


@pytest.mark.thorough
def test_a_secure_run_takes_a_process_and_a_keeper_by_their_certificates(
    commands: Commands,
) -> None:
    """With the names of both, and of the local ones, in one folder."""
    make_certificates(commands.folder / "fleet", processes=2, keepers=2)
    secure = ("--secure=fleet", "--listen=tls/127.0.0.1:0", "--wait-for=2")
    runs = commands.start("run", "hex:n=6", *FREE, *secure)
    modules = joins(commands, runs, "--secure=fleet", "--as=process_0", "--modules=0-2")
    keeper = joins(commands, runs, "--secure=fleet", "--as=keeper_0")
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["processes"]) == (True, 40, 2)
    assert (modules.end()[0], keeper.end()[0]) == (0, 0)


@pytest.mark.thorough
def test_a_secure_run_takes_nothing_back_whose_certificate_it_lacks(commands: Commands) -> None:
    """The process that leaves says so, and the run misses it."""
    folder = commands.folder
    make_certificates(folder / "all", processes=2, keepers=2)
    shutil.copytree(folder / "all", folder / "rest", ignore=shutil.ignore_patterns("process_0.*"))
    secure = ("--secure=rest", "--listen=tls/127.0.0.1:0", "--wait-for=1")
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, *secure)
    joined = joins(commands, runs, "--secure=all", "--as=process_0", "--modules=0-2")
    goes_on(folder)
    joined.signal(signal.SIGINT)
    code, _, errors = joined.end()
    assert code == 130
    assert "process_0 leaves: rest/process_0.crt: No such file or directory" in errors[-2]
    code, _, errors = runs.end()
    assert (code, errors[-1]) == (1, "cubepath: process_0 has ended: it has left the network")


@pytest.mark.thorough
@pytest.mark.parametrize("named", ["--modules=3-5", "--as=keeper_1"])
def test_one_that_dies_elsewhere_is_waited_for_and_joins_again(
    commands: Commands, named: str
) -> None:
    """By the same command; nobody else stops for good, and all moves are on record."""
    again = ("--on-crash=restart", f"--listen={LOOPBACK}", "--wait-for=1")
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, *again)
    first = joins(commands, runs, named)
    goes_on(commands.folder)
    code, _, errors = joins(commands, runs, "--modules=0-1").end()
    assert code == 2
    assert "the run has begun, expected the place of " in errors[-1]
    first.signal()
    second = joins(commands, runs, named)  # before the run has missed the first
    runs.says(r"has died \(it has left the network\)$")
    runs.says("is back$")
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"]) == (True, 40)
    (crash,) = outcome["crashes"]
    assert crash["restarted"]
    assert second.end()[0] == 0


@pytest.mark.thorough
def test_a_process_and_a_keeper_move_to_another_host_and_back(commands: Commands) -> None:
    """While the run goes on: nothing has died, and each log is in one place alone."""
    here, there = (commands.folder / name for name in ("run.mcap.keepers", "logs"))
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, f"--listen={LOOPBACK}")
    modules = joins(commands, runs, "--as=process_0")
    runs.says("process_0 continues elsewhere$")
    keeper = joins(commands, runs, "--as=keeper_1")
    runs.says("keeper_1 continues elsewhere$")
    goes_on(commands.folder)
    soon(lambda: [*here.glob("*.log")] == [here / "keeper_0.log"])
    assert [path.name for path in there.rglob("*.log")] == ["keeper_1.log"]
    for joined, name in (modules, "process_0"), (keeper, "keeper_1"):
        joined.signal(signal.SIGINT)
        code, _, errors = joined.end()
        assert (code, errors[-2:]) == (
            130,
            [f"cubepath: {name} was handed back", "cubepath: interrupted"],
        )
        runs.says(f"{name} was handed back and continues here$")
    assert [*there.rglob("*.log")] == []
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 40, [])


@pytest.mark.thorough
def test_a_keeper_that_sleeps_before_it_begins_elsewhere_continues_where_it_was(
    commands: Commands,
) -> None:
    """Its place is here again, so it may not begin when it wakes: there is one keeper of a tile."""
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, f"--listen={LOOPBACK}")
    endpoint, run = runs.says(r"endpoint (\S+), run (\w+)").groups()
    goes_on(commands.folder)
    key, begin = orders_key(run, "keeper_1"), JoinRequest([], "sleeper", PROTOCOL, wants="begin")

    def answer(session: zenoh.Session, request: JoinRequest) -> zenoh.Reply:
        (reply,) = session.get(key, payload=msgspec.json.encode(request), timeout=20.0)
        return reply

    with open_client(endpoint) as session:
        offered = answer(session, replace(begin, wants="join")).ok
        assert offered is not None
        orders = read_orders(read_offer(offered.payload.to_bytes()).orders, KeeperConfig)
        assert b'"prepared"' in orders.logged or b'"committed"' in orders.logged
        runs.says("keeper_1 continues here, as nobody has begun elsewhere$")
        refused = answer(session, begin).err
    assert refused is not None
    assert refused.payload.to_string() == "another process has taken this place"
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 40, [])


@pytest.mark.thorough
def test_one_that_dies_elsewhere_ends_the_run_unless_told_otherwise(commands: Commands) -> None:
    """In one line."""
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, f"--listen={LOOPBACK}", "--wait-for=1")
    joined = joins(commands, runs, "--modules=3-5")
    goes_on(commands.folder)
    joined.signal()
    code, _, errors = runs.end()
    line = "cubepath: process_0 has ended: it has left the network"
    assert (code, errors[-1]) == (1, line)


@pytest.mark.thorough
def test_a_run_outlives_one_of_two_linked_routers(commands: Commands) -> None:
    """That of the run; nobody counts as dead, and nothing is missing on record."""
    one = commands.start("host", "router", f"--listen={LOOPBACK}")
    here = one.says(r"listening on (\S+) without TLS")[1]
    other = commands.start("host", "router", f"--listen={LOOPBACK}", f"--connect={here}")
    there = other.says(r"listening on (\S+) without TLS")[1]
    runs = commands.start(
        "run", "hex:n=6", *FREE, *SLOW, f"--connect={here},{there}", "--wait-for=2"
    )
    runs.says(r"waiting for 2 processes")
    join = ("join", f"--connect={there},{here}", "--json")
    joined = [commands.start(*join, named) for named in ("--modules=3-5", "--as=keeper_1")]
    goes_on(commands.folder)
    one.signal()
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 40, [])
    assert [each.end()[0] for each in joined] == [0, 0]


@pytest.mark.thorough
def test_a_host_that_is_cut_off_comes_back(commands: Commands) -> None:
    """Stopped for longer than the router waits, a keeper goes on where it was, and so do all."""
    again = ("--on-crash=continue", f"--listen={LOOPBACK}", "--wait-for=1")
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, *again)
    joined = joins(commands, runs, "--as=keeper_1")
    goes_on(commands.folder)
    joined.signal(signal.SIGSTOP)
    runs.says(r"keeper_1 has died \(it has left the network\)$")
    joined.signal(signal.SIGCONT)
    runs.says("keeper_1 is back$")
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"]) == (True, 40)
    assert joined.end()[0] == 0


def committed(folder: Path) -> int:
    """Return how many commits are in the logs of keepers elsewhere."""
    return sum(log.read_bytes().count(b'"type":"committed"') for log in folder.rglob("*.log"))


ALL = ("--modules=0-5", "--as=keeper_0", "--as=keeper_1")


def everything_elsewhere(commands: Commands) -> tuple[str, Running, list[Running]]:
    """Return where a router is, a coordinator there, and all else of its run, which has begun."""
    router = commands.start("host", "router", f"--listen={LOOPBACK}")
    where = "--connect=" + router.says(r"listening on (\S+) without TLS")[1]
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, where, "--wait-for=3")
    runs.says(r"waiting for 3 processes")
    joined = [commands.start("join", where, "--json", each) for each in ALL]
    goes_on(commands.folder)
    return where, runs, joined


@pytest.mark.thorough
def test_a_coordinator_that_was_away_hears_what_all_others_did(commands: Commands) -> None:
    """It stood still until modules were at their goal, and then records all of it."""
    _, runs, joined = everything_elsewhere(commands)
    runs.signal(signal.SIGSTOP)
    assert commits(commands.folder) < 40
    soon(lambda: committed(commands.folder) >= 40, "the modules stand still")
    runs.signal(signal.SIGCONT)
    outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"]) == (True, 40)
    assert [each.end()[0] for each in joined] == [0, 0, 0]


@pytest.mark.thorough
def test_all_others_go_on_without_a_coordinator_and_another_takes_the_run_up(
    commands: Commands,
) -> None:
    """Modules come to their goal while it is dead; the next one has their moves on record."""
    folder, there = commands.folder, commands.folder / "logs"
    where, runs, joined = everything_elsewhere(commands)
    runs.signal()
    before = commits(folder)
    soon(lambda: committed(there) >= 40, "the modules stand still")
    assert before < 40
    for each in joined:
        each.signal()
    resumes = ("run", "--from=run.mcap", "--log=more.mcap", "--json", where)
    refused = commands.start(*resumes, "--wait-for=3")
    code, _, errors = refused.end()
    assert code == 2
    assert errors[-1].endswith("as in run.mcap: it is an older log")
    logs = next(there.iterdir())
    for log in logs.glob("*.log"):
        shutil.copy(log, folder / "run.mcap.keepers")
    again = commands.start(*resumes, "--wait-for=3")
    again.says(r"waiting for 3 processes")
    joined = [commands.start("join", where, "--json", each) for each in ALL]
    code, answer, errors = again.end()
    assert code == 0, errors
    assert (json.loads(answer)["goal_reached"], json.loads(answer)["moves"]) == (True, 40)
    assert audit(read_recording(folder / "more.mcap")).ok
    assert [each.end()[0] for each in joined] == [0, 0, 0]


@pytest.mark.thorough
def test_messages_that_a_link_loses_are_said_again(commands: Commands) -> None:
    """Those of a process and of a keeper; shorter than the lease, nobody is missed."""
    endpoint = commands.start("host", "router", f"--listen={LOOPBACK}").says(r"on (tcp\S+)")[1]
    runs = commands.start("run", "hex:n=6", *FREE, *SLOW, f"--connect={endpoint}", "--wait-for=2")
    runs.says(r"waiting for 2 processes")
    with LinkProxy("process_0", endpoint) as one, LinkProxy("keeper_1", endpoint) as other:
        for link, named in ((one, "--modules=0-2"), (other, "--as=keeper_1")):
            commands.start("join", f"--connect={link.endpoint}", named)
        goes_on(commands.folder)
        for link in (one, other):
            link.cut()
        time.sleep(2.0)
        for link in (one, other):
            link.heal()
        outcome = ended(runs, commands.folder)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 40, [])


@pytest.mark.thorough
def test_a_process_that_wakes_when_another_has_its_place_ends(commands: Commands) -> None:
    """It moves nothing more; the other one has its modules, and the run goes on."""
    again = ("--on-crash=continue", f"--listen={LOOPBACK}", "--wait-for=1")
    slow = [f"--speed={module}=20" for module in range(6)]
    length = ("--rule=random", "--max-rounds=100000")
    runs = commands.start("run", "hex:n=6", *length, *FREE, *slow, *again)
    first = joins(commands, runs, "--modules=3-5")
    goes_on(commands.folder)
    first.signal(signal.SIGSTOP)
    runs.says(r"process_0 has died \(it has left the network\)$")
    second = joins(commands, runs, "--modules=3-5")
    runs.says("process_0 is back$")
    goes_on(commands.folder)
    first.signal(signal.SIGCONT)
    code, _, errors = first.end()
    line = "cubepath: another process has taken the place of process_0"
    assert (code, errors[-1]) == (1, line)
    goes_on(commands.folder)
    runs.signal(signal.SIGINT)
    assert (runs.end()[0], second.end()[0]) == (130, 0)
    assert audit(read_recording(commands.folder / "run.mcap")).ok


@pytest.mark.thorough
def test_of_two_processes_with_one_certificate_one_moves(commands: Commands) -> None:
    """The run refuses to let in the second; if it enters nevertheless, the first one ends."""
    folder = commands.folder / "fleet"
    make_certificates(folder, processes=2, keepers=2)
    secure = ("--secure=fleet", "--listen=tls/127.0.0.1:0", "--wait-for=1", "--on-crash=continue")
    slow = [f"--speed={module}=20" for module in range(6)]
    length = ("--rule=random", "--max-rounds=100000")
    runs = commands.start("run", "hex:n=6", *length, *FREE, *slow, *secure)
    own = ("--secure=fleet", "--as=process_0", "--modules=3-5")
    first = joins(commands, runs, *own)
    goes_on(commands.folder)
    code, _, errors = joins(commands, runs, *own).end()
    assert code == 2
    assert "the run has begun, " in errors[-1]
    found = runs.says(r"endpoint (\S+), run (\w+)")
    scene = scene_to_toml(scene_from_spec("hex:n=6"))
    config = FreeProcessConfig(found[1], found[2], 0, [3, 4, 5], 2, 9, scene, "random", 0)
    with Shell(
        FreeHostNode(config), config.endpoint, credentials=Credentials("process_0", "", str(folder))
    ) as shell:
        shell.start()
        while first.returncode is None:
            shell.step(0.1)
        goes_on(commands.folder)
        runs.signal(signal.SIGINT)
        while not shell.ended:
            shell.step(0.1)
    assert first.end()[0] == 1
    assert first.err.endswith("another process has taken the place of process_0")
    assert runs.end()[0] == 130
    assert audit(read_recording(commands.folder / "run.mcap")).ok
