"""A module process that was written from the page of the protocol alone, in real runs."""

import ast
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import pytest
import zenoh

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.sessions import open_client, put
from processes.ears import wait_for_subscriber
from samples.recordings import parts

OWN = Path(__file__).parents[2] / "processes" / "own_module.py"
MODULE = 1
SEED = 8
STILL_S = 1.5
LINES_MAX = 160
END_S = 60.0


def rig(log: Path, *, links: bool = False) -> RunUnderTest:
    """Return a run of the own process with others in two processes of cubepath."""
    return RunUnderTest(
        "agv-labelled:graph=grid10x4,n=4",
        seed=SEED,
        max_rounds=300,
        log=log,
        commands={"own": [sys.executable, "-I", str(OWN), "{endpoint}", str(MODULE)]},
        links=links,
        timeout_s=END_S,
    )


def played(run: RunUnderTest) -> Outcome:
    """Play to the end of the run, and of the own process, which ends by itself."""
    outcome = run.play()
    assert (run.commands["own"].wait(), run.commands["own"].err) == (0, "")
    return outcome


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Return a run in which nobody meddles."""
    with rig(tmp_path_factory.mktemp("own") / "run.mcap") as run:
        return played(run)


@pytest.mark.slow
def test_it_reaches_its_goal_together_with_modules_of_cubepath(outcome: Outcome) -> None:
    """It moved, it lost a claim to another and won one over another, and nothing was refused."""
    assert (outcome.goal_reached, outcome.processes, outcome.refused) == (True, 3, 0)
    recording = read_recording(Path(outcome.log))
    own = [each for each in parts(recording, "report") if each.module == MODULE]
    assert {each.claim for each in own} == {"none", "granted", "lost"}
    assert site_from_json(own[-1].site) == (recording.scene.goals[MODULE][0], MODULE)
    assert any(each.module == MODULE for each in parts(recording, "verdict"))
    said = [json.loads(each.data) for each in recording.records if each.topic == "bundle/process_0"]
    assert {each["region"] for each in said} == {"0,0", "1,0"}


def test_verify_accepts_its_recording(outcome: Outcome) -> None:
    """The others chose by the rule on record, from what they heard of it; it names its own."""
    found = audit(read_recording(Path(outcome.log)))
    assert found.ok
    (unchecked,) = (check for check in found.checks if not check.checked)
    assert unchecked.name == "choices"
    assert f"module_{MODULE}, whose process names its own rule: 'own'" in unchecked.detail


@contextmanager
def meddler(endpoint: str, heard: Counter[tuple[str, bytes]]) -> Generator[None]:
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
            text = json.dumps({"kind": "retransmit", "process": 1, **asked})
            put(session, f"{root}/retransmit/process_1", text.encode())

    with open_client(endpoint) as session:
        session.declare_subscriber(
            "cubepath/*/to/**",
            zenoh.handlers.Callback(take, indirect=False),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        thread = Thread(target=meddle, daemon=True)
        thread.start()
        with open_client(endpoint) as other:
            wait_for_subscriber(other, "cubepath/probe/to/nobody")
        try:
            yield
        finally:
            came.put(None)
            thread.join()


@pytest.mark.thorough
def test_what_comes_twice_and_is_asked_again_changes_nothing(
    outcome: Outcome, tmp_path: Path
) -> None:
    """It says the same bytes again, and the path is the same."""
    all_heard: Counter[tuple[str, bytes]] = Counter()

    def heard() -> dict[bytes, int]:
        return {
            data: count
            for (_, data), count in tuple(all_heard.items())
            if json.loads(data)["process"] == 0
        }

    with rig(tmp_path / "run.mcap") as run, meddler(run.run.endpoint, all_heard):
        found = played(run)
        records = read_recording(tmp_path / "run.mcap").records
        said = {each.data for each in records if each.topic == "bundle/process_0"}
        deadline = time.monotonic() + END_S
        while not said <= heard().keys() and time.monotonic() < deadline:
            time.sleep(0.05)  # the last may still be on their way
    assert found.path_digest == outcome.path_digest
    assert max(heard().values()) > 1
    assert heard().keys() - said == said - heard().keys() == set()


@pytest.mark.thorough
@pytest.mark.parametrize("what", ["the router dies", "it stands still"])
def test_it_goes_on_after_what_goes_wrong(what: str, outcome: Outcome, tmp_path: Path) -> None:
    """What was lost is asked for again, and the reports are the same."""
    with rig(tmp_path / "run.mcap") as run:
        if what == "the router dies":
            wound = run.kill("router", at=3)
        else:
            wound = run.pause("own", at=3, seconds=STILL_S)
        assert played(run).path_digest == outcome.path_digest
        assert wound.done
    told, due = (parts(read_recording(Path(log)), "report") for log in (run.path, outcome.log))
    assert sorted(told, key=lambda each: (each.round, each.module)) == sorted(
        due, key=lambda each: (each.round, each.module)
    )


LOST: list[dict[str, Any]] = [
    {"what": "bundle", "round": 2, "phase": "sense", "sender": "process_1", "to": "own"},
    {"what": "go", "round": 3, "phase": "claim", "to": "own"},
    {"what": "bundle", "round": 4, "phase": "claim", "sender": "process_2", "to": "own"},
    {"what": "bundle", "round": 5, "phase": "sense", "sender": "own"},
    {"what": "ready", "round": 6, "phase": "claim", "sender": "own"},
    {"what": "reports", "round": 7, "sender": "own"},
    {"what": "go", "round": 8, "phase": "settle", "to": "own"},
]


def first_copies() -> Callable[[WireMessage], bool]:
    """Return what holds of a message the first time that it comes."""
    came: Counter[bytes] = Counter()

    def is_first(seen: WireMessage) -> bool:
        came[seen.data] += 1
        return came[seen.data] == 1

    return is_first


@pytest.mark.thorough
def test_what_is_lost_on_the_way_is_said_again(outcome: Outcome, tmp_path: Path) -> None:
    """In both directions, while all else comes twice; the path is the same."""
    with rig(tmp_path / "run.mcap", links=True) as run:
        lost = [run.drop(**each, where=first_copies()) for each in LOST]
        twice = run.double(to="own")
        found = played(run)
    assert found.path_digest == outcome.path_digest
    assert all(rule.count for rule in (*lost, twice)), [rule.count for rule in lost]


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
