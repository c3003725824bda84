"""Runs that are watched and paced by HTTP, without a browser."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import urlsplit

import pytest

from cubepath.agents.free.joining import Joining, join
from cubepath.coordinator.playback.player import Player
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import Run, run, start
from cubepath.coordinator.tools.live.remote_pages import RemoteRunPage
from cubepath.coordinator.tools.live.watching import LivePage
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import read_recording
from processes.elsewhere import soon

pytestmark = pytest.mark.slow

SPEC = "hex:n=4"
Said: TypeAlias = tuple[list[tuple[int, tuple[str, str], int]], list[tuple[str, int, int]]]
"""Of a step its claims, each with 1 if it was granted, and its deliveries."""


class Client:
    """One who watches: takes all events of a page in a thread, until there are no more."""

    def __init__(self, address: str) -> None:
        self.rows: list[list[int]] = []
        self.moves: list[tuple[str, str]] = []
        self.states: list[dict[str, Any]] = []
        self.ended: dict[str, Any] | None = None
        self._said: dict[str, dict[int, list[int]]] = {"claims": {}, "heard": {}}
        self._kinds: list[str] = []
        self._generators: list[str] = []
        self._stream = urllib.request.urlopen(f"{address}events", timeout=20)  # noqa: S310
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        kind = ""
        for raw in self._stream:
            line = raw.decode().rstrip()
            if line.startswith("event: "):
                kind = line[7:]
            elif line.startswith("data: "):
                self._take(kind, json.loads(line[6:]))

    def _take(self, kind: str, told: dict[str, Any]) -> None:
        match kind:
            case "steps":
                self._grow(told)
                del self.rows[told["from"] :]
                self.rows += told["rows"]
            case "said":
                self._grow(told)
                self._kinds = told.get("kinds", [])
                for key, steps in self._said.items():
                    steps.update(told.get(key, []))
            case "state":
                self.states.append(told)
            case "end":
                self.ended = told
            case _:
                pass

    def _grow(self, told: dict[str, Any]) -> None:
        rows = (told["world"] or {}).get("rows")
        if rows is not None:
            self._generators += rows["generators"]
            names = [self._generators[number] for number in rows["generator"]]
            self.moves += zip(names, rows["at"], strict=True)

    @property
    def said(self) -> list[Said]:
        """Return the claims and the deliveries of each step."""
        claims, heard = (
            [batched(self._said[key].get(step, [])) for step in range(1, len(self.rows) + 1)]
            for key in ("claims", "heard")
        )
        return [
            (
                sorted((module, self.moves[row], won) for module, row, won in one),
                sorted((self._kinds[kind], sender, module) for kind, sender, module in other),
            )
            for one, other in zip(claims, heard, strict=True)
        ]

    def join(self) -> Client:
        self._thread.join(20)
        assert not self._thread.is_alive()
        return self

    @property
    def path(self) -> list[list[tuple[str, str]]]:
        """Return the moves of each step: the generator, and where it is placed."""
        return [[self.moves[row] for row in step] for step in self.rows]


def recorded(log: Path) -> list[list[tuple[str, str]]]:
    """Return the same of a recording."""
    return [
        [(each.generator, json.dumps(each.at, separators=(",", ":"))) for each in step.executed]
        for step in gathered(read_recording(log)).steps
    ]


def said(log: Path, begin: int) -> list[Said]:
    """Return the claims and the deliveries of the rounds of a recording after some."""
    recording = read_recording(log)
    rounds = len(gathered(recording).steps)
    found: list[Said] = [([], []) for _ in range(rounds)]
    columns = recording.claims()
    for number, module, generator, at, outcome in zip(
        *(columns[name].tolist() for name in ("round", "module", "generator", "at", "outcome")),
        strict=True,
    ):
        move = generator, json.dumps(at, separators=(",", ":"))
        found[number - 1][0].append((module, move, int(outcome == "granted")))
    for logged in recording.messages("report"):
        for kind, sender in logged.message.deliveries():
            found[logged.round - 1][1].append((kind, sender, logged.message.module))
    return [(sorted(claims), sorted(heard)) for claims, heard in found[begin:]]


def batched(flat: list[int]) -> list[list[int]]:
    """Return the entries of a list that has three numbers for each."""
    return [flat[place : place + 3] for place in range(0, len(flat), 3)]


def order(address: str, order: str, value: object = None) -> None:
    request = urllib.request.Request(  # noqa: S310 - an address of ours
        f"{address}orders",
        json.dumps({"order": order, "value": value}).encode(),
        {"Content-Type": "application/json"},
    )
    with urllib.request.urlopen(request, timeout=20) as answer:  # noqa: S310
        assert answer.status == 200


def unused(address: str) -> bool:
    """Return whether nobody listens at the port of an address any more."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port_of(address))) != 0


def port_of(address: str) -> int:
    port = urlsplit(address).port
    assert port is not None
    return port


@contextmanager
def ended(child: subprocess.Popen[str]) -> Generator[None]:
    """Leave no process behind when a test fails."""
    try:
        yield
    finally:
        if child.poll() is None:
            child.kill()


def nothing_left() -> bool:
    return not [each for each in threading.enumerate() if "cubepath-" in each.name]


def test_who_watches_has_the_run_as_it_is_recorded(tmp_path: Path) -> None:
    """From the first step, however late it comes; one that vanishes is not missed by the run."""
    plain = run(SPEC, seed=5, processes=0, log=tmp_path / "plain.mcap")
    log = tmp_path / "run.mcap"
    with start(SPEC, seed=5, processes=0, log=log) as running, LivePage(running) as page:
        address = page.address
        first = Client(address)
        running.step(3)
        with socket.create_connection(("127.0.0.1", port_of(address))) as gone:
            path = address.split("/", 3)[3]
            gone.sendall(
                f"GET /{path}events HTTP/1.1\r\nHost: {address.split('/')[2]}\r\n\r\n".encode()
            )
            assert gone.recv(10) == b"HTTP/1.1 2"
        second = Client(address)
        outcome = running.play()
    assert outcome.path_digest == plain.path_digest
    for client in (first, second):
        assert client.join().path == recorded(log)
        assert client.ended == {"ended": "goal", "error": None}
        assert client.said == said(log, 0)
    assert unused(address)
    assert nothing_left()
    assert verify(log).ok


def test_a_run_is_paused_stepped_and_resumed(tmp_path: Path) -> None:
    """Orders that come twice count once, but for steps; the path is as if nobody had paused it."""
    plain = run(SPEC, seed=5, processes=0, log=tmp_path / "plain.mcap")
    running = Run(plan(tmp_path / "run.mcap", patience=0.3))
    with LivePage(running, paused=True) as page:
        client = Client(page.address)
        player = threading.Thread(target=running.play_from_the_start)
        player.start()
        for count, orders in ((1, ["step"]), (3, ["step", "step"]), (3, ["pause", "pause"])):
            for each in orders:
                order(page.address, each)
            soon(lambda: len(client.rows) == count and client.states[-1]["steps"] == 0)  # noqa: B023
        with pytest.raises(urllib.error.HTTPError, match="400"):
            order(page.address, "step", 10**6)
        player.join(0.5)  # longer than its patience
        assert running.round == 3
        order(page.address, "resume")
        order(page.address, "resume")
        player.join(20)
    assert running.outcome.path_digest == plain.path_digest
    assert client.join().path == recorded(running.log)
    assert [state["paused"] for state in client.states][-1] is False
    assert nothing_left()


def plan(log: Path, **fields: Any) -> Plan:
    return Plan(SPEC, seed=5, processes=1, log=log, **fields)


def test_processes_from_elsewhere_wait_as_long_as_a_run_is_paused(tmp_path: Path) -> None:
    """Though their patience is shorter than that: they hear that the run is there."""
    left: list[object] = []
    joined: list[threading.Thread] = []

    def join_it(line: str) -> None:
        found = re.search(r"tcp/[0-9.:]+", line)
        if found is not None and not joined:
            joining = Joining(found[0], (0, 1), patience_s=1.5)
            thread = threading.Thread(target=lambda: left.append(join(joining, lambda _: None)))
            joined.append(thread)
            thread.start()

    log = tmp_path / "run.mcap"
    here = Plan(SPEC, seed=5, processes=0, log=log, listen="tcp/127.0.0.1:0", wait_for=1)
    with start(here, say=join_it) as running, LivePage(running) as page:
        running.step(1)
        order(page.address, "pause")
        resume = threading.Timer(4.5, order, (page.address, "resume"))
        resume.start()
        assert running.play().goal_reached
        resume.join()
    joined[0].join(20)
    assert len(left) == 1
    assert verify(log).ok


def test_a_process_that_dies_while_a_run_is_paused_ends_it(tmp_path: Path) -> None:
    """At once, and whoever watches is told which it was."""
    with start(plan(tmp_path / "run.mcap")) as running, LivePage(running, paused=True) as page:
        client = Client(page.address)
        killer = threading.Timer(0.2, running.signal, ["process_0"])
        killer.start()
        assert running.play().ended == "failed"
        killer.join()
    told = client.join().ended or {}
    assert "(process 0) died" in told["error"]


@pytest.mark.thorough
def test_a_run_without_rounds_can_be_watched_alone(tmp_path: Path) -> None:
    """Its levels come as they are known, and at the end they are those of the recording."""
    log = tmp_path / "free.mcap"
    with (
        start("hex:n=4", clock="free", processes=1, keepers=1, log=log) as running,
        LivePage(running) as page,
    ):
        client = Client(page.address)
        with pytest.raises(urllib.error.HTTPError, match="409"):
            order(page.address, "pause")
        assert running.play().goal_reached
    assert client.join().path == recorded(log)
    assert client.states == []
    # A keeper and the modules that asked it are heard in no order: a claim may come after its move.
    claimed = {move for claims, _ in client.said for _, move, _ in claims}
    assert claimed >= {move for step in client.path for move in step}
    with pytest.raises(InputError, match="can be watched, not paced"):
        LivePage(Run(plan(tmp_path / "no.mcap", clock="free")), paused=True)


@pytest.mark.thorough
def test_a_run_elsewhere_is_watched_from_where_it_stands(tmp_path: Path) -> None:
    """The page begins with the round that it came in, and has all from there to the end."""
    log = tmp_path / "run.mcap"
    with start(SPEC, seed=5, processes=1, log=log) as running:
        running.step(4)
        with RemoteRunPage(running.endpoint, running.run) as watched:
            client = Client(watched.address)
            outcome = running.play()
            assert watched.wait(20)
            assert (watched.begins, watched.round) == (4, outcome.rounds)
            address = watched.address
        assert client.join().path == recorded(log)[4:]
        assert client.ended == {"ended": "goal", "error": None}
    assert unused(address)
    assert nothing_left()
    assert client.said == said(log, 4)
    with pytest.raises(CheckError, match="no run"):
        elsewhere_run(tmp_path)


@pytest.mark.slow
def test_a_replay_is_not_watched() -> None:
    """It goes back and forth; one line says how a recording is seen."""
    path = Path(__file__).parents[4] / "logs" / "golden" / "hex-5.mcap"
    said = "a replay, expected a run; .* cubepath view LOG"
    with Player(path) as player, pytest.raises(InputError, match=said):
        RemoteRunPage(player.endpoint)


@pytest.mark.thorough
def test_a_run_without_rounds_is_watched_from_elsewhere(tmp_path: Path) -> None:
    """All its levels, however late one comes; at the end they are those of the recording."""
    log = tmp_path / "free.mcap"
    with start("hex:n=6", clock="free", processes=2, keepers=2, seed=3, log=log) as running:
        running.step(4)
        with RemoteRunPage(running.endpoint) as watched:
            client = Client(watched.address)
            while len(client.rows) < 2:
                assert not watched.wait(0.1)
            outcome = running.play()
            assert watched.wait(20)
            assert (watched.begins, watched.round) == (0, outcome.rounds)
            with pytest.raises(urllib.error.HTTPError, match="409"):
                order(watched.address, "pause")
        assert client.join().path == recorded(log)
    assert client.ended == {"ended": "goal", "error": None}
    assert {won for step in client.said for _, _, won in step[0]} >= {1}
    assert nothing_left()


def elsewhere_run(folder: Path) -> None:
    with start(SPEC, processes=0, log=folder / "other.mcap") as running:
        RemoteRunPage(running.endpoint, "0123456789ab", patience_s=0.5)


@contextmanager
def said_by(*command: str) -> Generator[tuple[subprocess.Popen[str], Callable[[str], str]]]:
    """Start a command; also return what waits for a line on standard error that has a pattern."""
    with (
        subprocess.Popen(
            command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        ) as child,
        ended(child),
    ):
        assert child.stderr is not None
        lines = child.stderr

        def next_match(pattern: str) -> str:
            for line in lines:
                found = re.search(pattern, line.rstrip("\n"))
                if found is not None:
                    return found[1]
            raise AssertionError(f"never said: {pattern}")

        yield child, next_match


@pytest.mark.thorough
def test_the_command_tells_the_address_and_ends_a_paused_run(tmp_path: Path) -> None:
    """By an interrupt, with the recording closed; each address is the last word of its line."""
    log = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "cubepath.coordinator", "run", SPEC, "--processes", "0"]
    with said_by(*command, "--live", "--paused", "--log", str(log)) as (child, next_match):
        address = next_match(r"live at (http://127\.0\.0\.1:\d+/\S+/)$")
        endpoint = next_match(r"endpoint (\S+), run ")
        client = Client(address)
        order(address, "step")
        soon(lambda: len(client.rows) == 1)
        with said_by(*command[:3], "view", "--connect", endpoint) as (_, next_said):
            assert not unused(next_said(r"end of round 1 on, live at (\S+/)$"))
        os.kill(child.pid, signal.SIGINT)
        assert child.wait(20) == 130
    assert client.join().ended == {"ended": "interrupted", "error": "interrupted"}
    assert unused(address)
    assert read_recording(log).problems == ()
