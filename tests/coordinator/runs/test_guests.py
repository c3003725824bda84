"""Guests of a private run: they hear everything, and whatever they do, the run goes on as ever."""

import select
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Message, Reports
from cubepath.protocol.wire.nodes import Keep

pytestmark = pytest.mark.slow

LONGEST_S = 5.0
"""A round in which a guest is cut off takes a second, and two to ask for what was lost."""
GUEST = """
import sys, time
from cubepath.protocol.wire.sessions import open_client, subscribe
session = open_client(sys.argv[1])
heard = []
def take(sample):
    heard.append(sample)
    if {slow}:
        time.sleep(0.1)
subscriber = subscribe(session, "cubepath/**", take)
while not heard:
    time.sleep(0.01)
run = str(heard[0].key_expr).split("/")[1]
{do}
print("done", flush=True)
sys.stdin.read()
"""
NONSENSE = """
for topic in ("go/coordinator", "ready/process_0", "to/0,0", "to/0,0/process_0", "hello/me"):
    session.put(f"cubepath/{run}/{topic}", b"not json")
"""
FLOOD = """
for number in range(100_000):
    session.put(f"cubepath/{run}/go/coordinator", b'{"type": "go", "round": 1, "phase": "stop"}')
"""
HUGE = """
for _ in range(3):
    session.put(f"cubepath/{run}/go/coordinator", bytes(100_000_000))
"""
FAKE = """
token = session.liveliness().declare_token(f"cubepath/{run}/alive/process_0")
orders = session.declare_queryable(f"cubepath/{run}/orders/*", print)
"""
DISGUISED = """
import zenoh
from cubepath.protocol.wire import sessions
from cubepath.protocol.wire.credentials import GUEST, settings_for
for mode in ("peer", "router"):
    settings = {
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "connect/endpoints": [sys.argv[1]],
        **settings_for(sys.argv[1], GUEST),
    }
    session = zenoh.open(sessions._config(mode, sys.argv[1], **settings))
    for topic in ("go/coordinator", "hello/me"):
        session.put(f"cubepath/{run}/{topic}", b"not json")
"""


@contextmanager
def guest(
    fleet: LockstepFleet, do: str, *, slow: bool = False
) -> Generator[subprocess.Popen[bytes]]:
    """Start a guest in a process of its own."""
    code = GUEST.format(do=do, slow=slow)
    child = subprocess.Popen(
        [sys.executable, "-c", code, fleet.endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def played(do: str | None = None, *, slow: bool = False, stop: bool = False) -> list[Reports]:
    """Play rounds, with a guest until some rounds after it has done what it does."""
    told: list[Reports] = []

    def sink(kept: Keep[Message], wall_ns: int) -> None:
        if isinstance(kept.message, Reports):
            told.append(kept.message)

    scene = scene_from_spec("hex:n=30")
    with LockstepFleet(scene, "random", seed=5, processes=2, sink=sink) as fleet:
        if do is None:
            for _ in fleet.rounds(ROUNDS):
                pass
            return told
        with guest(fleet, do, slow=slow) as child:
            assert child.stdout is not None
            done = 0
            while not done or fleet.round < done + ROUNDS:
                begun = time.monotonic()
                fleet.play_round()
                assert time.monotonic() - begun < LONGEST_S
                if not done and is_done(child):
                    done = fleet.round
                    if stop:
                        child.send_signal(signal.SIGSTOP)
                assert child.poll() is None
            rss = resident_mb(fleet.pids["router"])
        assert rss < 300
    return told


def is_done(child: subprocess.Popen[bytes]) -> bool:
    """Return whether the guest has said so."""
    assert child.stdout is not None
    return bool(select.select([child.stdout], [], [], 0)[0])


def resident_mb(pid: int) -> float:
    """Return the most memory that a process has had."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


ROUNDS = 40


def by_process(told: list[Reports]) -> list[Reports]:
    """Return the reports of the first rounds in one order."""
    return sorted(
        (each for each in told if each.round <= ROUNDS), key=lambda each: (each.round, each.process)
    )


@pytest.fixture(scope="module")
def quiet() -> list[Reports]:
    """Return the reports of the run without guests."""
    found = by_process(played())
    assert len(found) == 2 * ROUNDS
    return found


@pytest.mark.parametrize(
    "do",
    [
        pytest.param(NONSENSE, id="nonsense", marks=pytest.mark.thorough),
        pytest.param(FAKE, id="fake", marks=pytest.mark.thorough),
        pytest.param(DISGUISED, id="disguised", marks=pytest.mark.thorough),
        pytest.param(FLOOD, id="flood", marks=pytest.mark.nightly),
        pytest.param(HUGE, id="huge", marks=pytest.mark.nightly),
    ],
)
def test_what_a_guest_says_is_not_heard(do: str, quiet: list[Reports]) -> None:
    """Nonsense, 100,000 orders to stop, 100 MB at a time; as another, or as a router."""
    assert by_process(played(do)) == quiet


@pytest.mark.nightly
def test_a_guest_that_reads_slowly_holds_nobody_up(quiet: list[Reports]) -> None:
    """Its queue fills, it is cut off, and comes back: each time the run waits a second at most."""
    assert by_process(played("time.sleep(15)", slow=True)) == quiet


@pytest.mark.thorough
def test_a_guest_that_stands_still_holds_nobody_up(quiet: list[Reports]) -> None:
    """As one that reads slowly, for ever."""
    assert by_process(played("pass", stop=True)) == quiet
