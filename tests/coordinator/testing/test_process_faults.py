"""What a test does to the processes of a run: when, for how long, and what comes of a mistake."""

import time
from pathlib import Path

import pytest

from cubepath.coordinator.runs.listeners import TappedMessage
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.protocol.core.errors import InputError

pytestmark = pytest.mark.slow
SYSTEM = "hex:n=4"


def stands_still(pid: int) -> bool:
    """Return whether a process is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


def test_a_time_is_over_with_what_it_was_for(cubepath_run: RunFixture) -> None:
    """A pause or a cut that is ended by hand does not end the next one."""
    rig = cubepath_run(SYSTEM)
    pid, link = rig.pids["process_0"], rig.links["process_0"]
    for name, act, undo in (("resume", rig.pause, rig.resume), ("heal", rig.cut_off, rig.heal)):
        act("process_0", seconds=3600)
        (first,) = rig._timers.values()
        undo("process_0")
        assert first.finished.is_set(), name
        act("process_0", seconds=3600)
        (second,) = rig._timers.values()
        act("process_0")
        assert second.finished.is_set(), name
        assert not rig._timers
        assert "process_0" in rig._paused if act == rig.pause else link.up.cut
        undo("process_0")
    rig.pause("process_0", seconds=0.05)
    while stands_still(pid):
        time.sleep(0.01)
    rig.step()


def test_what_is_planned_and_raises_fails_the_test(cubepath_run: RunFixture) -> None:
    """As it was raised, and the run goes on."""

    def fails() -> None:
        raise InputError("this is mine")

    rig = cubepath_run(SYSTEM, links=False)
    planned = rig.when("claim", fails)
    assert repr(planned) == "<planned: to come>"
    with pytest.raises(InputError, match=r"^this is mine$"):
        rig.play()
    assert repr(planned) == f"<planned: done at bundle of {planned.at and planned.at.sender}>"
    rig.until_goal()
    rig.finish().assert_legal()


def test_what_is_planned_and_raises_is_told_at_the_end(tmp_path: Path) -> None:
    """If nobody awaits anything after it."""
    with (
        pytest.raises(ZeroDivisionError),
        RunUnderTest(SYSTEM, links=False, log=tmp_path / "a") as rig,
    ):
        rig.when("claim", lambda: print(1 // 0))
        rig.run.step(2)


def test_a_message_is_heard_though_another_listener_raised(cubepath_run: RunFixture) -> None:
    """Parts that did not come are not taken for the messages after them."""
    rig = cubepath_run(SYSTEM, links=False)
    said = [each for each in heard(rig) if hasattr(each.message, "parts")]
    rig.heard.clear()
    for each in (said[0], said[1], said[1]):  # without their parts
        rig._hear(each)
    assert len(rig.heard) == 3


def heard(rig: RunUnderTest) -> list[TappedMessage]:
    """Return what is heard of a round."""
    tap = rig.run.tap()
    rig.step()
    return list(tap)


@pytest.mark.thorough
def test_who_was_mended_is_started_again(cubepath_run: RunFixture) -> None:
    """A death that the run has mended by itself is over."""
    rig = cubepath_run("hex:n=7", "random", clock="free", on_crash="restart", max_rounds=10**6)
    before = rig.pids["process_1"]
    rig.kill("process_1")
    rig.until(lambda run: run.pids.get("process_1") not in (None, before))
    mended = rig.pids["process_1"]
    rig.restart("process_1")
    assert rig.pids["process_1"] not in (before, mended)
    rig.step()
