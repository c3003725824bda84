"""Runs over three hosts, each with an address and a router, and all that may befall them."""

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.authority import make_certificates
from cubepath.protocol.wire.free_messages import Turns, decode_free
from processes.command_line import here
from processes.elsewhere import Running, soon
from processes.hosts import ADDRESSES, ENDPOINTS, HOSTS, Hosts

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

OVER_S = 15.0
"""Longer than the lease of a link."""
PATIENT_S = 120.0
"""How long a busy machine may take to start a command."""
JOINED = [(1, "--modules=0-3"), (1, "--as=keeper_0"), (2, "--modules=4-7"), (2, "--as=keeper_2")]
"""What is on other hosts than the coordinator and the rest."""
ROUNDS = ("agv:graph=grid8x8,n=12", "--rule=random", "--max-rounds=1000000")
ENDLESS = (*ROUNDS, *(f"--speed={module}=20" for module in range(12)))
CLOCKS = pytest.mark.parametrize("clock", ["free", "lockstep"])
PAIRS = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)]
CONTINUE, RESTART = "--on-crash=continue", "--on-crash=restart"


class Fleet:
    """A run on three hosts."""

    def __init__(
        self,
        hosts: Hosts,
        *arguments: str,
        joined: Sequence[tuple[int, str]] = JOINED,
        clock: Sequence[str] = ("--clock=free", "--keepers=4"),
        within: Callable[[int], Sequence[str]] = lambda _: (),
        secure: Path | None = None,
    ) -> None:
        """Start its routers, each linked with those before, the run, and all that join it.

        `within` says for each host what stands before its commands. With certificates in the folder
        `secure` all traffic is over TLS.
        """
        self.hosts, self.within = hosts, within
        self._kind = "commit" if clock else "go"
        self.secure = () if secure is None else (f"--secure={secure}",)
        scheme = "tcp" if secure is None else "tls"
        self.endpoints = [each.replace("tcp", scheme) for each in ENDPOINTS]
        self.log = hosts.host(0) / "run.mcap"
        self.routers = [self.router(host) for host in range(HOSTS)]
        self.run = hosts.start_on(
            0,
            *("run", *arguments, *clock, "--processes=1", "--log=run.mcap"),
            *("--patience=200", f"--wait-for={len(joined)}", "--json"),
            *(f"--connect={self._order(0)}", *self.secure),
            within=within(0),
        )
        self.run.says("waiting for", PATIENT_S)
        self.joined = {name: self.join(host, name) for host, name in joined}

    def router(self, host: int) -> Running:
        """Start a router."""
        links = [f"--connect={each}" for each in self.endpoints[:host]]
        route = ("host", "router", f"--listen={self.endpoints[host]}", *links, *self.secure)
        found = self.hosts.start_on(host, *route, within=self.within(host))
        found.says("listening on", PATIENT_S)
        return found

    def join(self, host: int, name: str) -> Running:
        """Start a process that joins."""
        ask = ["join", name, "--patience=200", f"--connect={self._order(host)}", *self.secure]
        if self.secure and name.startswith("--modules"):
            ask.append(f"--as=process_{host - 1}")
        return self.hosts.start_on(host, *ask, within=self.within(host))

    def _order(self, host: int) -> str:
        """Return all endpoints, that of a host first."""
        return ",".join(self.endpoints[host:] + self.endpoints[:host])

    @property
    def commits(self) -> int:
        """Return how many commits are on record, or phases of rounds."""
        if not self.log.exists():
            return 0
        return sum(1 for _ in read_recording(self.log).of_kind(self._kind))

    def goes_on(self) -> None:
        """Wait until more is committed."""
        before = self.commits
        try:
            soon(lambda: self.commits > before + 1)
        except AssertionError:
            raise AssertionError(f"the run stands still: {self.run.err}") from None

    def end(self) -> None:
        """Interrupt the run; what it has recorded is right."""
        self.goes_on()
        self.run.signal(signal.SIGINT)
        assert self.run.wait(PATIENT_S) == 130
        self.verify()

    def verify(self) -> None:
        """Check the recording, and that no module moves for two incarnations."""
        recording = read_recording(self.log)
        found = audit(recording)
        assert found.ok, [check for check in found.checks if not check.ok]
        of_epoch: dict[tuple[int, int], int] = {}
        for record in recording.of_kind("turns"):
            message = decode_free(record.data)
            assert isinstance(message, Turns)
            for turn in message.parts:
                known = of_epoch.setdefault((turn.module, turn.epoch), message.incarnation)
                assert known == message.incarnation


def endless(hosts: Hosts, clock: str) -> Fleet:
    """Start a run of a clock that goes on until it is interrupted, whatever befalls it."""
    if clock == "free":
        return Fleet(hosts, *ENDLESS, CONTINUE)
    return Fleet(hosts, *ROUNDS, joined=JOINED[::2], clock=())


def _children(command: Running) -> list[int]:
    """Return the process ids of what a command has started."""
    task = Path(f"/proc/{command.pid}/task/{command.pid}/children")
    return [int(pid) for pid in task.read_text().split()]


@contextmanager
def _stopped(*pids: int) -> Generator[None]:
    """Have processes stand still."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Hosts]:
    """Return three hosts."""
    with Hosts(tmp_path) as found:
        yield found


@pytest.mark.thorough
@pytest.mark.parametrize("secure", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_run_outlives_the_router_of_its_host_and_a_short_cut(hosts: Hosts, secure: bool) -> None:
    """Nobody counts as dead, and all are at the goal in the end."""
    folder = hosts.folder / "fleet" if secure else None
    if folder is not None:
        make_certificates(folder, processes=3, keepers=4, hosts=ADDRESSES)
    slow = [f"--speed={module}=4" for module in range(8)]
    fleet = Fleet(hosts, "hex:n=8", *slow, secure=folder)
    fleet.goes_on()
    fleet.routers[0].signal()
    hosts.cut((1, 2))
    time.sleep(2.0)
    hosts.heal()
    assert fleet.run.wait(PATIENT_S) == 0
    outcome = json.loads(fleet.run.out)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 70, [])
    assert [each.wait(20) for each in fleet.joined.values()] == [0] * len(JOINED)
    fleet.verify()


@pytest.mark.nightly
@pytest.mark.parametrize("host", range(HOSTS))
def test_a_router_that_dies_is_replaced_by_the_others(hosts: Hosts, host: int) -> None:
    """And by itself when it is started again."""
    fleet = Fleet(hosts, *ENDLESS)
    fleet.goes_on()
    fleet.routers[host].signal()
    fleet.goes_on()
    time.sleep(OVER_S)
    fleet.router(host)
    fleet.end()
    assert "has died" not in fleet.run.err


@pytest.mark.nightly
@CLOCKS
@pytest.mark.parametrize("host", range(HOSTS))
def test_a_router_may_stand_still(hosts: Hosts, clock: str, host: int) -> None:
    """Its processes look for another when the lease of their links is over."""
    fleet = endless(hosts, clock)
    fleet.goes_on()
    with _stopped(*_children(fleet.routers[host])):
        time.sleep(2 * OVER_S)
        fleet.goes_on()
    fleet.end()


@pytest.mark.nightly
@pytest.mark.parametrize(("host", "name"), JOINED[:2])
def test_what_has_joined_may_die_and_join_again(hosts: Hosts, host: int, name: str) -> None:
    """A keeper has its log; nothing that was committed is lost."""
    fleet = Fleet(hosts, *ENDLESS, CONTINUE)
    fleet.goes_on()
    fleet.joined[name].signal()
    fleet.run.says("has died", PATIENT_S)
    fleet.goes_on()
    fleet.join(host, name)
    fleet.run.says("is back", PATIENT_S)
    fleet.end()


@pytest.mark.nightly
@pytest.mark.parametrize(("host", "name"), JOINED[:2])
def test_what_has_joined_may_stand_still(hosts: Hosts, host: int, name: str) -> None:
    """It goes on where it was."""
    fleet = Fleet(hosts, *ENDLESS, CONTINUE)
    fleet.goes_on()
    with _stopped(fleet.joined[name].pid):
        fleet.run.says("has died", PATIENT_S)
        fleet.goes_on()
    fleet.run.says("is back", PATIENT_S)
    fleet.end()


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_what_is_beside_the_coordinator_may_die_or_stand_still(hosts: Hosts, number: int) -> None:
    """Each in turn: two keepers and a process."""
    fleet = Fleet(hosts, *ENDLESS, RESTART)
    fleet.goes_on()
    children = _children(fleet.run)
    assert len(children) == 3
    for pid in children:
        if number == signal.SIGSTOP:
            with _stopped(pid):
                time.sleep(OVER_S)
        else:
            os.kill(pid, number)
            fleet.run.says("was started again", PATIENT_S, again=True)
        fleet.goes_on()
    fleet.end()


@pytest.mark.nightly
def test_the_coordinator_may_stand_still(hosts: Hosts) -> None:
    """The others move on, and it catches up."""
    fleet = Fleet(hosts, *ENDLESS, CONTINUE)
    fleet.goes_on()
    before = fleet.commits
    with _stopped(fleet.run.pid):
        time.sleep(2 * OVER_S)
    soon(lambda: fleet.commits > before + 300, "it does not catch up")
    fleet.end()


@pytest.mark.nightly
@CLOCKS
@pytest.mark.parametrize(
    "cuts", [*((pair,) for pair in PAIRS), *zip(PAIRS[::2], PAIRS[1::2], strict=True)]
)
def test_two_hosts_may_not_hear_each_other(
    hosts: Hosts, clock: str, cuts: tuple[tuple[int, int], ...]
) -> None:
    """One of the other, or neither: what they say goes over the third."""
    fleet = endless(hosts, clock)
    fleet.goes_on()
    hosts.cut(*cuts)
    time.sleep(2 * OVER_S)
    fleet.goes_on()
    hosts.heal()
    fleet.end()


@pytest.mark.nightly
@CLOCKS
@pytest.mark.parametrize("ways", ["to", "from", "to and from"])
@pytest.mark.parametrize("host", range(HOSTS))
def test_a_host_that_is_cut_off_comes_back(hosts: Hosts, clock: str, host: int, ways: str) -> None:
    """In one direction or both; without rounds the others move on until they need its places."""
    fleet = endless(hosts, clock)
    fleet.goes_on()
    others = [other for other in range(HOSTS) if other != host]
    if "to" in ways:
        hosts.cut(*((other, host) for other in others))
    if "from" in ways:
        hosts.cut(*((host, other) for other in others))
    if host and clock == "free":
        fleet.goes_on()
    time.sleep(2 * OVER_S)
    hosts.heal()
    fleet.goes_on()
    time.sleep(OVER_S)
    fleet.end()


@pytest.mark.nightly
@CLOCKS
def test_half_of_all_that_is_sent_may_be_lost(hosts: Hosts, clock: str) -> None:
    """For half a minute, between all hosts."""
    fleet = endless(hosts, clock)
    fleet.goes_on()
    for pair in PAIRS:
        hosts.degrade(*pair, loss=0.5)
    time.sleep(2 * OVER_S)
    hosts.heal()
    time.sleep(OVER_S)  # what waits long to send once more is closed, and opened anew
    fleet.end()


@pytest.mark.nightly
def test_hosts_may_be_far_from_each_other(hosts: Hosts) -> None:
    """A tenth of a second in each direction, which is more than most modules think."""
    for pair in PAIRS:
        hosts.degrade(*pair, loss=0.0, delay_s=0.1)
    fleet = Fleet(hosts, "hex:n=8")
    assert fleet.run.wait(200) == 0
    outcome = json.loads(fleet.run.out)
    assert (outcome["goal_reached"], outcome["moves"], outcome["crashes"]) == (True, 70, [])
    fleet.verify()


CLOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *found) {
    int (*real)(clockid_t, struct timespec *) = dlsym(RTLD_NEXT, "clock_gettime");
    int file, code = real(clock, found);
    char text[32] = "";
    if (clock == CLOCK_REALTIME && (file = open(getenv("CLOCK_OFFSET"), O_RDONLY)) >= 0) {
        if (read(file, text, sizeof text - 1) > 0)
            found->tv_sec += atol(text);
        close(file);
    }
    return code;
}
"""
"""A wall clock that is off by the seconds in a file."""


@pytest.mark.nightly
def test_clocks_may_differ_and_jump(hosts: Hosts) -> None:
    """Wall clocks by a day in either direction while all is under way; the others, which never
    jump, by what hosts differ that were started months apart."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no clock to set: no C compiler")
    folder = hosts.folder
    (folder / "clock.c").write_text(CLOCK)
    command = [compiler, "-shared", "-fPIC", "-o", "clock.so", "clock.c"]
    subprocess.run(command, cwd=folder, check=True)
    offsets = [folder / f"offset_{host}" for host in range(HOSTS)]

    def within(host: int) -> list[str]:
        own = [f"LD_PRELOAD={folder / 'clock.so'}", f"CLOCK_OFFSET={offsets[host]}"]
        return ["unshare", "--time", f"--monotonic={host * 10_000_000}", "env", *own]

    fleet = Fleet(hosts, *ENDLESS, "--log-time=wall", within=within)
    for jumps in ((86_400, 0, -86_400), (-86_400, 86_400, 0), (0, 0, 0)):
        for offset, jump in zip(offsets, jumps, strict=True):
            offset.write_text(str(jump))
        fleet.goes_on()
        time.sleep(5.0)
    fleet.end()
    assert "has died" not in fleet.run.err
    times = [record.wall_ns for record in read_recording(fleet.log).records]
    assert max(times) - min(times) > 86_400 * 10**9


@pytest.mark.nightly
def test_thirty_vehicles_reach_their_goals_whatever_befalls_their_hosts(hosts: Hosts) -> None:
    """One host is cut off for a minute, and routers die in turn; the path has the normal form of
    the same moves in a run without faults."""
    slow = [f"--speed={module}=100" for module in range(30)]
    modules = [(1, "--modules=0-9"), (2, "--modules=10-19"), *JOINED[1::2]]
    city = ("agv:graph=grid8x8,n=30", "--rule=tswap", *slow, CONTINUE)
    fleet = Fleet(hosts, *city, joined=modules)
    fleet.goes_on()
    hosts.cut_off(2)
    time.sleep(60.0)
    hosts.heal()
    fleet.goes_on()
    for host in range(HOSTS):
        fleet.routers[host].signal()
        fleet.goes_on()
        fleet.router(host)
        fleet.goes_on()
    assert fleet.run.wait(300) == 0
    assert json.loads(fleet.run.out)["goal_reached"]
    fleet.verify()
    again = hosts.folder / "again.mcap"
    assert here("run", "--clock=free", "--schedule", fleet.log, "--log", again).returncode == 0
    assert here("diff", "--homotopic", fleet.log, again).returncode == 0
