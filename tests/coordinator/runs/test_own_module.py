"""A module process that was written from the page of the protocol alone, in real runs."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from threading import Thread, Timer

import pytest
import zenoh

from bridge import Bridge, What
from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.processes.network import Network
from cubepath.coordinator.auditing.recording import audit
from cubepath.coordinator.runs.launch import run
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.messages import Message, Report, Reports
from cubepath.protocol.wire.sessions import open_client, put
from recordings import parts

OWN = Path(__file__).parents[2] / "own_module.py"
MODULE = 1
SEED = 2
STILL_S = 1.5
LINES_MAX = 150
END_S = 60.0


def played(
    log: Path, meddle: Callable[[str], AbstractContextManager[str]] | None = None
) -> Outcome:
    """Run the own process with others in two processes of cubepath, to the end of both.

    `meddle` is given the endpoint, and returns a context for the run: of where the process joins.
    """
    with ExitStack() as around:

        def say(line: str) -> None:
            found = re.search(r"listening on (\S+)", line)
            if found is None:
                return
            endpoint = found[1]
            if meddle is not None:
                endpoint = around.enter_context(meddle(endpoint))
            around.enter_context(own_process(endpoint))

        return run(
            Plan(
                "agv-labelled:graph=grid10x4,n=4",
                seed=SEED,
                processes=2,
                max_rounds=300,
                log=log,
                listen="tcp/127.0.0.1:0",
                wait_for=1,
            ),
            say=say,
        )


@contextmanager
def own_process(endpoint: str) -> Generator[subprocess.Popen[str]]:
    """Start the own process; it has to end by itself when the run does."""
    child = subprocess.Popen(
        [sys.executable, "-I", OWN, endpoint, str(MODULE)], stderr=subprocess.PIPE, text=True
    )
    try:
        yield child
        _, errors = child.communicate(timeout=END_S)
        assert (child.returncode, errors) == (0, "")
    finally:
        child.kill()
        child.wait()


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Return a run in which nobody meddles."""
    return played(tmp_path_factory.mktemp("own") / "run.mcap")


@pytest.mark.slow
def test_it_reaches_its_goal_together_with_modules_of_cubepath(outcome: Outcome) -> None:
    """It moved, it lost a claim to another and won one over another, and nothing was refused."""
    assert (outcome.goal_reached, outcome.processes, outcome.refused) == (True, 3, 0)
    recording = read_recording(Path(outcome.log))
    own = [each for each in parts(recording, "report") if each.module == MODULE]
    assert {each.claim for each in own} == {"none", "granted", "lost"}
    assert site_from_json(own[-1].site) == (recording.scene.goals[MODULE][0], MODULE)
    assert any(each.module == MODULE for each in parts(recording, "verdict"))
    said = [json.loads(each.data) for each in recording.records if each.topic == "said/process_0"]
    assert {each["region"] for each in said} == {"0,0", "1,0"}


@pytest.mark.slow
def test_verify_accepts_its_recording(outcome: Outcome) -> None:
    """The others chose by the rule on record, from what they heard of it; it names its own."""
    found = audit(read_recording(Path(outcome.log)))
    assert found.ok
    (unchecked,) = (check for check in found.checks if not check.checked)
    assert unchecked.name == "choices"
    assert f"module_{MODULE}, whose process names a rule of its own: 'own'" in unchecked.detail


@contextmanager
def meddler(endpoint: str, heard: Counter[tuple[str, bytes]]) -> Generator[str]:
    """Double every message to a region, and ask the own process again for each of its own."""
    came: SimpleQueue[tuple[str, bytes] | None] = SimpleQueue()

    def take(sample: zenoh.Sample) -> None:
        came.put((str(sample.key_expr), sample.payload.to_bytes()))

    def meddle() -> None:
        while (each := came.get()) is not None:
            heard[each] += 1
            if heard[each] == 1:
                put(session, *each)
                again(*each)

    def again(key: str, data: bytes) -> None:
        message = json.loads(data)
        if message["process"] == 0:
            asked = {name: message[name] for name in ("round", "phase", "region")}
            root = "/".join(key.split("/")[:2])
            text = json.dumps({"kind": "again", "process": 1, **asked})
            put(session, f"{root}/again/process_1", text.encode())

    with open_client(endpoint) as session:
        session.declare_subscriber(
            "cubepath/*/to/**",
            zenoh.handlers.Callback(take, indirect=False),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        thread = Thread(target=meddle, daemon=True)
        thread.start()
        try:
            yield endpoint
        finally:
            came.put(None)
            thread.join()


@pytest.mark.slow
def test_what_comes_twice_and_is_asked_again_changes_nothing(
    outcome: Outcome, tmp_path: Path
) -> None:
    """It says the same bytes again, and the path is the same."""
    all_heard: Counter[tuple[str, bytes]] = Counter()
    found = played(tmp_path / "run.mcap", lambda endpoint: meddler(endpoint, all_heard))
    assert found.path_digest == outcome.path_digest
    heard = {
        data: count for (_, data), count in all_heard.items() if json.loads(data)["process"] == 0
    }
    assert max(heard.values()) > 1
    records = read_recording(tmp_path / "run.mcap").records
    assert heard.keys() == {each.data for each in records if each.topic == "said/process_0"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "what", [pytest.param("the router dies", marks=pytest.mark.thorough), "it stands still"]
)
def test_it_goes_on_after_what_goes_wrong(what: str, outcome: Outcome) -> None:
    """What was lost is asked for again, and the reports are the same."""
    told: list[Report] = []
    with ExitStack() as around:

        def say(line: str) -> None:
            found = re.search(r"listening on (\S+)", line)
            if found is not None:
                children.append(around.enter_context(own_process(found[1])))

        def sink(message: Message, data: bytes, wall_ns: int) -> None:
            if isinstance(message, Reports):
                told.extend(message.parts)

        children: list[subprocess.Popen[str]] = []
        recording = read_recording(Path(outcome.log))
        network = Network(listen="tcp/127.0.0.1:0", wait_for=1)
        with Fleet(
            recording.scene, "pibt", seed=SEED, network=network, say=say, sink=sink
        ) as fleet:
            for number in fleet.rounds(outcome.rounds):
                if number == 3 and what == "the router dies":
                    os.kill(fleet.pids["router"], signal.SIGKILL)
                elif number == 3:
                    children[0].send_signal(signal.SIGSTOP)
                    goes_on = children[0], signal.SIGCONT
                    Timer(STILL_S, subprocess.Popen.send_signal, goes_on).start()
    due = parts(recording, "report")
    assert sorted(told, key=lambda each: (each.round, each.module)) == sorted(
        due, key=lambda each: (each.round, each.module)
    )


LOST: frozenset[What] = frozenset(
    {
        (2, "said", "sense", 1),
        (3, "go", "claim", -1),
        (4, "said", "claim", 2),
        (5, "said", "sense", 0),
        (6, "ready", "claim", 0),
        (7, "reports", "", 0),
        (8, "go", "settle", -1),
    }
)


@pytest.mark.thorough
def test_what_is_lost_on_the_way_is_said_again(outcome: Outcome, tmp_path: Path) -> None:
    """In both directions, while all else comes twice; the path is the same."""
    bridge = Bridge(LOST)
    found = played(tmp_path / "run.mcap", bridge.across)
    assert found.path_digest == outcome.path_digest
    assert bridge.done == LOST


def test_it_knows_the_page_alone() -> None:
    """It imports zenoh and the standard library, and is short."""
    text = OWN.read_text()
    assert len(text.splitlines()) <= LINES_MAX
    imported = {
        (node.module if isinstance(node, ast.ImportFrom) else alias.name) or "."
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert {name.partition(".")[0] for name in imported} <= {"zenoh", *sys.stdlib_module_names}
