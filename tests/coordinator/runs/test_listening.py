"""What listens to a run: what it raises and asks for waits until the round is over."""

import signal
import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal

import pytest

from cubepath.coordinator.runs.listeners import TappedMessage
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.run import Run, run, start
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import RecordingFull, RecordingWriter
from cubepath.protocol.wire.credentials import Credentials
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, subscribe
from processes.living import is_there

SYSTEM = "hex:n=4"
CLOCKS = pytest.mark.parametrize("clock", ["lockstep", "free"])
SMALL: dict[str, dict[str, Any]] = {
    "lockstep": {"processes": 1},
    "free": {"processes": 1, "keepers": 1},
}
Clock = Literal["lockstep", "free"]


class Raises:
    """A listener that raises at messages of a kind, so many times, and counts what it heard."""

    def __init__(self, kind: str, times: int = 1, error: BaseException | None = None) -> None:
        self.heard = 0
        self._kind = kind
        self._times = times
        self._error = error or ZeroDivisionError(kind)

    def __call__(self, overheard: TappedMessage) -> None:
        self.heard += 1
        if overheard.kind == self._kind and self._times:
            self._times -= 1
            raise self._error


def whole(running: Run, ended: str) -> None:
    """Assert that a run has ended so, that nothing is left of it, and that its log is whole."""
    assert running.outcome.ended == ended
    recording = read_recording(running.log)
    assert recording.problems == ()
    assert sum(each.kind == "summary" for each in recording.records) == 1
    assert verify(recording).ok


def test_what_a_listener_raises_breaks_no_round(tmp_path: Path) -> None:
    """It is raised after the round, the others hear all of it, and the run is the same as ever."""
    expected = run(SYSTEM, processes=0, log=tmp_path / "a.mcap")
    with start(SYSTEM, processes=0, log=tmp_path / "b.mcap") as running:
        first, second = Raises("claim", error=CheckError("mine")), Raises("summary", 0)
        running.listen(first)
        running.listen(second)
        with pytest.raises(CheckError, match=r"^mine$"):
            running.step(2)
        assert (running.round, running.goes_on) == (1, True)
        outcome = running.play()
    assert outcome.path_digest == expected.path_digest
    assert first.heard == second.heard > 0
    whole(running, "goal")


@pytest.mark.few(1)
@pytest.mark.slow
@CLOCKS
def test_what_is_raised_at_the_results_costs_no_result(clock: Clock, tmp_path: Path) -> None:
    """By each message of the end: the recording has its summary, and the run its outcome."""
    log = tmp_path / "a.mcap"
    with start(SYSTEM, clock=clock, **SMALL[clock], log=log) as running:
        running.listen(Raises("summary"))
        running.listen(Raises("certificate", times=9))
        with pytest.raises(ZeroDivisionError, match="certificate"):
            running.play()
    whole(running, "goal")
    assert list(tmp_path.iterdir()) == [log]


def test_an_error_of_the_block_is_not_hidden(tmp_path: Path) -> None:
    """By what a listener raises while the run ends; without one, that is raised."""
    running = start(SYSTEM, processes=0, log=tmp_path / "a.mcap")
    with pytest.raises(KeyError), running:
        running.listen(Raises("summary"))
        raise KeyError
    whole(running, "interrupted")
    running = start(SYSTEM, processes=0, log=tmp_path / "b.mcap")
    with pytest.raises(ZeroDivisionError), running:
        running.listen(Raises("summary"))
    whole(running, "interrupted")


def test_what_watches_may_raise_too(tmp_path: Path) -> None:
    """In a run that is stepped it goes on; in one that is run it ends, and its log is whole."""

    def watch(_: object) -> None:
        raise ZeroDivisionError

    with start(SYSTEM, processes=0, watch=watch, log=tmp_path / "a.mcap") as running:
        for number in (1, 2):
            with pytest.raises(ZeroDivisionError):
                running.step()
            assert running.round == number
    whole(running, "interrupted")
    with pytest.raises(ZeroDivisionError):
        run(SYSTEM, processes=0, watch=watch, log=tmp_path / "b.mcap")
    recording = read_recording(tmp_path / "b.mcap")
    assert [each.kind for each in recording.records].count("summary") == 1


@pytest.mark.few(1)
@pytest.mark.slow
@CLOCKS
def test_an_interrupt_in_a_round_ends_the_run_wholly(clock: Clock, tmp_path: Path) -> None:
    """It is raised, nothing is left, and who steps on is told that the run has ended."""
    plan: dict[str, Any] = {"clock": clock, **SMALL[clock], "processes": 2, "max_rounds": 10**6}
    with start("hex:n=6", "random", **plan, log=tmp_path / "a.mcap") as running:
        pids = list(running.pids.values())
        running.step(2)
        asked: list[TappedMessage] = []

        def hear(overheard: TappedMessage) -> None:
            if not asked:
                asked.append(overheard)
                signal.raise_signal(signal.SIGINT)

        running.listen(hear)
        with pytest.raises(KeyboardInterrupt):
            running.step()
        assert not running.step()
        assert not any(map(is_there, pids))
        whole(running, "interrupted")


@pytest.mark.few(1)
@pytest.mark.slow
@CLOCKS
@pytest.mark.parametrize("kind", ["cube", "certificate", "summary"])
def test_an_interrupt_while_results_are_written_loses_none(
    kind: str, clock: Clock, tmp_path: Path
) -> None:
    """It is raised when they are on record, each of them once."""
    log = tmp_path / "a.mcap"
    with start(SYSTEM, clock=clock, **SMALL[clock], log=log) as running:
        running.listen(Raises(kind, error=KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            running.play()
        kinds = [each.kind for each in read_recording(log).records]
        assert kinds.count("cube") == running.outcome.cubes
        whole(running, "goal")


@CLOCKS
def test_results_are_published_though_the_disk_is_full(
    clock: Clock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever listens is told how the run ended, and why."""
    heard: SimpleQueue[str] = SimpleQueue()
    with (
        start(SYSTEM, clock=clock, **SMALL[clock], log=tmp_path / "a.mcap") as running,
        open_client(running.endpoint) as guest,
    ):
        key = f"cubepath/{running.run}/summary/**"
        subscribe(guest, key, lambda each: heard.put(each.payload.to_string()))

        def full(_: RecordingWriter) -> None:
            raise RecordingFull("the disk is full")

        monkeypatch.setattr(RecordingWriter, "flush", full)
        assert running.play().ended == "failed"
        assert "the disk is full" in heard.get(timeout=30)


@pytest.mark.few(1)
@pytest.mark.slow
@CLOCKS
def test_a_listener_may_stop_the_run(clock: Clock, tmp_path: Path) -> None:
    """It is told how the run stands so far; whoever goes on with it ends it then."""
    found: list[Outcome] = []

    def hear(overheard: TappedMessage) -> None:
        if overheard.kind in ("report", "commit") and overheard.round == 2 and not found:
            found.append(running.stop())
            running.__exit__(None, None, None)

    with start(SYSTEM, clock=clock, **SMALL[clock], log=tmp_path / "a.mcap") as running:
        running.listen(hear)
        assert running.play().ended == found[0].ended == "interrupted"
    whole(running, "interrupted")


def test_a_round_is_played_by_one(tmp_path: Path) -> None:
    """Neither what listens to it, nor another thread, nor who enters again can begin another."""
    told: list[str] = []

    def refused(act: Callable[[], object]) -> None:
        with pytest.raises(CheckError) as error:
            act()
        told.append(str(error.value))

    def hear(_: TappedMessage) -> None:
        if told:
            return
        refused(running.step)
        refused(lambda: running.until(lambda _: True))
        refused(running.__enter__)
        other = threading.Thread(target=refused, args=(running.play,))
        other.start()
        other.join()

    with start(SYSTEM, processes=0, log=tmp_path / "a.mcap") as running:
        running.listen(hear)
        assert running.step()
        refused(running.__enter__)
        assert running.step()
    listening, thread, again = told[0], told[3], told[4]
    assert told[:3] == [listening] * 3
    assert listening.startswith("a round is under way: ")
    assert thread == "another thread is using this run: expected one at a time"
    assert again.startswith("the run has begun before: ")
    refused(running.__enter__)
    whole(running, "interrupted")


def test_another_thread_may_stop_the_run(tmp_path: Path) -> None:
    """Between two messages of those who play it."""
    begun = threading.Event()
    with start("hex:n=6", "random", processes=0, max_rounds=10**6, log=tmp_path / "a") as running:
        running.listen(lambda _: begun.set())
        thread = threading.Thread(target=running.play)
        thread.start()
        assert begun.wait(60)
        assert running.stop().ended == "interrupted"
        thread.join(60)
        assert not thread.is_alive()
        whole(running, "interrupted")


def test_what_is_heard_comes_in_the_order_of_the_log(tmp_path: Path) -> None:
    """Also what the coordinator finds in the last report of a round."""
    with start(SYSTEM, processes=1, log=tmp_path / "a.mcap") as running:
        heard = running.tap()
        running.step(3)
        kinds = [each.kind for each in heard if each.kind in ("reports", "edges", "go")]
    logged = [each.kind for each in read_recording(tmp_path / "a.mcap").records]
    assert kinds == [each for each in logged if each in ("reports", "edges", "go")][: len(kinds)]
    assert kinds.count("edges") == 3


@pytest.mark.slow
@CLOCKS
def test_an_interrupted_start_leaves_a_whole_recording(clock: Clock, tmp_path: Path) -> None:
    """And no process, no logs of keepers; to leave the block again hides nothing."""
    log = tmp_path / "a.mcap"

    def way(name: str, endpoint: str, credentials: Credentials) -> tuple[str, Credentials]:
        if name == "process_0":
            signal.raise_signal(signal.SIGINT)
        return endpoint, credentials

    running = start(SYSTEM, clock=clock, **SMALL[clock], way=way, log=log)
    with pytest.raises(KeyboardInterrupt):
        running.__enter__()
    assert list(tmp_path.iterdir()) == [log]
    running.__exit__(None, None, None)
    assert running.stop().rounds == 0
    whole(running, "interrupted")


def test_to_leave_a_run_that_was_never_entered_does_nothing(tmp_path: Path) -> None:
    """Nor one that could not be, since its log is there: that is what is told."""
    (tmp_path / "a.mcap").touch()
    running = start(SYSTEM, processes=0, log=tmp_path / "a.mcap")
    running.__exit__(None, None, None)
    with pytest.raises(InputError, match="exists already"):
        running.__enter__()
    running.__exit__(None, None, None)
    with pytest.raises(CheckError, match="has not begun"):
        running.stop()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["ready", "claim"])
def test_a_router_of_others_that_dies_is_part_of_the_outcome(kind: str, tmp_path: Path) -> None:
    """When all processes have joined as in a round; it is awaited for as long as any answer."""
    with Router("tcp/127.0.0.1:0") as router:
        there, log = router.endpoint, tmp_path / "a.mcap"
        running = start(SYSTEM, processes=1, connect=there, patience=2.0, log=log)
        running.listen(lambda each: router.close() if each.kind == kind else None)
        outcome = running.play_from_the_start()
    assert outcome.ended == "failed"
    assert str(outcome.error).startswith(f"no zenoh router at {there} any more: no answer within")
    whole(running, "failed")
