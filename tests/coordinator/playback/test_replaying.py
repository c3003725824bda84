"""Replaying: the recorded bytes go over zenoh again, and the same comes of them."""

import contextlib
import socket
import subprocess
import sys
import threading
from collections import Counter
from dataclasses import replace as with_fields
from queue import Empty, SimpleQueue

import pytest
import zenoh
from msgspec.structs import replace

from cubepath.coordinator.playback import replay_session as replay_module
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.selection import SAID
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire import sessions
from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.messages import decode
from cubepath.protocol.wire.sessions import open_client, put, subscribe
from processes.command_line import GOLDEN
from processes.ears import wait_for_subscriber
from samples.recordings import all_edited, edited, first, parts, recorded, with_records
from tampering.tamperings import crowd

REAL = [
    ("agv:graph=grid4x4,n=7", "tswap"),
    ("agv-labelled:graph=grid3x3,n=5", "random"),
    ("hex-open:n=5", "random"),
    ("arm:n=6", "word"),
]


@pytest.mark.parametrize(("spec", "rule"), REAL)
def test_a_replay_comes_to_the_same_result(spec: str, rule: str) -> None:
    """Digest, cubes and counts of a fresh coordinator are those of the run."""
    recording = recorded(spec, rule, rounds=10)
    found = replay(recording)
    summary = first(recording, "summary")
    assert found.same, found.differences
    assert (found.path_digest, found.cubes) == (summary.path_digest, summary.cubes)
    assert (found.rounds, found.moves) == (summary.rounds, summary.moves)
    assert found.reduced_moves == summary.reduced_moves
    assert found.max_cube_dimension == summary.max_cube_dimension
    assert found.messages == len(list(recording.of_kind(*SAID)))


@pytest.mark.thorough
def test_a_run_in_several_processes_is_replayed_from_one() -> None:
    """How many processes spoke makes no difference to a replay."""
    assert replay(recorded("hex:n=5", "chain", rounds=30, processes=3)).same


def test_listeners_outside_hear_the_very_bytes_on_the_keys_they_had() -> None:
    """Another session at the same router gets every message as recorded, in the same order."""
    recording = crowd()
    heard: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
    with contextlib.ExitStack() as sessions:
        runs: list[str] = []

        def listen(endpoint: str, run: str) -> None:
            runs.append(run)
            session = sessions.enter_context(open_client(endpoint))
            subscriber = subscribe(session, "cubepath/**", enqueue)
            sessions.callback(subscriber.undeclare)
            # The listener is there when a third session knows of it.
            with open_client(endpoint) as third:
                wait_for_subscriber(third, "cubepath/other/probe")

        def enqueue(sample: zenoh.Sample) -> None:
            heard.put((str(sample.key_expr), sample.payload.to_bytes()))

        assert replay(recording, announce=listen).same
        expected = [
            (key_of(runs[0], decode(record.data)), record.data)
            for record in recording.of_kind(*SAID)
        ]
        got: list[tuple[str, bytes]] = []
        while len(got) < len(expected):
            got.append(heard.get(timeout=10))
        assert got == expected
        with pytest.raises(Empty):
            heard.get_nowait()


def test_the_endpoint_can_be_chosen() -> None:
    """The router listens where it is told to, and lets go of it afterwards."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        taken.listen()
        with pytest.raises(InputError, match="cannot listen there"):
            replay(crowd(), endpoint=free)
    told: list[str] = []
    for _ in range(2):
        found = replay(crowd(), endpoint=free, announce=lambda where, _: told.append(where))
        assert found.same
        assert found.endpoint == free
    assert told == [free, free]


def test_replays_side_by_side_do_not_mix() -> None:
    """Three at a time, each on its own free port, come each to their own result."""
    found: dict[str, bool] = {}

    def one(spec: str, rule: str) -> None:
        found[spec] = replay(recorded(spec, rule, rounds=10)).same

    for spec, rule in REAL[:3]:
        recorded(spec, rule, rounds=10)
    threads = [threading.Thread(target=one, args=each) for each in REAL[:3]]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert found == {spec: True for spec, _ in REAL[:3]}


def test_only_the_kinds_asked_for_are_put() -> None:
    """Reports alone are enough for the result."""
    found = replay(crowd(), topics=["reports"])
    assert found.same
    assert found.messages == len(list(crowd().of_kind("reports")))


def test_a_rate_paces_the_rounds() -> None:
    """At 50 rounds a second the tenth round begins after 9/50 s, and no sooner."""
    rounds = first(crowd(), "summary").rounds
    found = replay(crowd(), rate=50)
    assert found.same
    assert found.seconds >= (rounds - 1) / 50


@pytest.mark.thorough
def test_a_rate_too_slow_for_the_clock_only_waits() -> None:
    """However far away the second round is, a signal ends the replay, and nothing else does."""
    code = f"""
import signal
from pathlib import Path
from cubepath.coordinator.playback.player import replay
from cubepath.protocol.recordings.recording import read_recording

signal.signal(signal.SIGALRM, signal.default_int_handler)

def progress(_number):
    signal.alarm(1)  # the first messages have arrived: what is left is to wait

replay(read_recording(Path({str(GOLDEN / "hex-5.mcap")!r})), rate=1e-300, progress=progress)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr.splitlines()[-1] == "KeyboardInterrupt"


def test_progress_is_told_of_every_message() -> None:
    """Whoever watches is told of each message that arrives."""
    told: list[int] = []
    found = replay(crowd(), progress=told.append)
    assert sum(told) == found.messages > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "rate=0.0: expected more than 0"),
        ({"rate": float("nan")}, "rate=nan: expected more than 0"),
        ({"endpoint": "nonsense"}, "endpoint nonsense: expected tcp/HOST:PORT"),
    ],
)
def test_bad_options_are_refused_in_one_line(options: dict[str, object], message: str) -> None:
    """What cannot be done is named before anything is put."""
    with pytest.raises(InputError, match=message) as caught:
        replay(crowd(), **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def differences(recording: Recording) -> str:
    """Return the differences that a replay names, as one text."""
    found = replay(recording)
    assert not found.same
    assert found.differences
    return "; ".join(found.differences)


@pytest.mark.thorough
def test_what_differs_from_the_record_is_named() -> None:
    """Other moves, edges, cubes or numbers than on record: not the same, and it says where."""
    whole = crowd()
    summary, edges = first(whole, "summary"), first(whole, "edges", lambda each: each.moves)
    cube = first(whole, "cube")
    assert "path_digest is" in differences(
        edited(whole, summary, replace(summary, path_digest="0" * 64))
    )
    assert f"round {edges.round}: other moves" in differences(
        edited(whole, edges, replace(edges, moves=[]))
    )
    assert f"round {edges.round}: gathered, but its edges" in differences(edited(whole, edges))
    assert "cube 1 is another" in differences(edited(whole, cube))
    assert "cube 1 is another" in differences(edited(whole, cube, replace(cube, moves=[])))
    assert "cube 0 is another" in differences(edited(whole, cube, cube, replace(cube, index=0)))
    report = first(whole, "report", lambda each: each.move)
    other = replace(report, move=GeneratorPlacement("edge", ((0, 0), (1, 0))))
    with pytest.raises(CheckError, match=rf"module_{report.module}: edge at .* is no move from"):
        replay(edited(whole, report, other))
    last = parts(whole, "report")[-1]
    assert "not all modules reported it" in differences(edited(whole, last))


def test_a_recording_without_its_end_has_nothing_to_compare_with() -> None:
    """A killed run is replayed as far as it goes, and said not to be shown the same."""
    whole = crowd()
    assert "no summary is on record" in differences(all_edited(whole, "summary", lambda _: None))
    damaged = with_fields(whole, problems=("corrupt: chunk 2",))
    found = replay(damaged)
    assert (found.same, found.complete, found.problems) == (True, False, ("corrupt: chunk 2",))
    assert found.result == "the same as recorded; the file is damaged"
    half = with_records(whole, whole.records[: len(whole.records) // 2])
    assert "no summary is on record" in differences(half)
    assert replay(half).result == "nothing to compare it with"
    edges = list(whole.of_kind("edges"))[-1]
    assert "its edges are not on record" in differences(edited(whole, decode(edges.data)))


def recovered(recording: Recording) -> Recording:
    """Return the recording with the parameter that says it was recovered."""
    return with_fields(recording, parameters={**recording.parameters, "recovered": "some"})


@pytest.mark.thorough
def test_what_was_recovered_is_compared_as_far_as_it_goes() -> None:
    """Cut off anywhere it is the same, and not complete; what is on record still counts."""
    whole = crowd()
    last = {kind: list(whole.of_kind(kind))[-1].sequence for kind in ("reports", "cube")}
    for end in (len(whole.records) // 2, last["reports"] + 1, last["cube"], last["cube"] + 1):
        found = replay(recovered(with_records(whole, whole.records[:end])))
        assert (found.same, found.complete, found.differences) == (True, False, ())
        assert found.result == "the same as recorded, as far as it goes"
    half = recovered(all_edited(whole, "summary", lambda _: None))
    edges, cube = first(half, "edges", lambda each: each.moves), first(half, "cube")
    assert f"round {edges.round}: other moves" in differences(
        edited(half, edges, replace(edges, moves=[]))
    )
    assert f"round {edges.round}: gathered, but its edges" in differences(edited(half, edges))
    assert differences(edited(half, cube)) == "cube 1 is another than on record"
    assert replay(edited(half, cube)).result == "differs from the recording"
    proof = first(half, "certificate")
    none = replace(proof, certificate=replace(proof.certificate, cubes=[]))
    assert "the certificate does not prove" in differences(edited(half, proof, none))
    ended = replay(recovered(whole))
    assert (ended.same, ended.complete, ended.result) == (True, True, "the same as recorded")


def test_what_is_no_message_is_refused_by_name() -> None:
    """A message that does not decode cannot be put on any key."""
    whole = crowd()
    records = [*whole.records]
    place = records.index(next(whole.of_kind("bundle")))
    records[place] = with_fields(records[place], data=b"[]")
    with pytest.raises(
        InputError, match=r"message \d+ \(bundle/process_0\): not a cubepath message"
    ):
        replay(with_records(whole, records))
    report = first(whole, "report")
    with pytest.raises(CheckError, match="twice, and differently"):
        replay(edited(whole, report, report, replace(report, failed="no")))


@pytest.mark.slow
def test_messages_that_do_not_arrive_are_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waiting is bounded: what never arrives is told with how much did."""
    monkeypatch.setattr(replay_module, "_PATIENCE_S_MAX", 0.3)
    lost = Counter[str]()

    def forgetful(session: zenoh.Session, key: str, data: bytes) -> None:
        lost[key] += 1
        if sum(lost.values()) != 5:
            put(session, key, data)

    monkeypatch.setattr(sessions, "put", forgetful)
    with pytest.raises(CheckError, match=r"\d+ of \d+ messages arrived, and none for"):
        replay(crowd())
