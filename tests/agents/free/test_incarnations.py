"""Incarnations of a folder of keepers' logs: later each time, written whole or not at all."""

import os
import signal
import sys
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from cubepath.agents.free import fleet as incarnations_written
from cubepath.agents.free.fleet import (
    INCARNATIONS,
    FreeFleet,
    LogsInfo,
    log_of,
    next_incarnations,
    read_incarnations,
)
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.protocol.core import output_files
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET

WRITERS = {incarnations_written.__file__, output_files.__file__}


def test_incarnations_are_later_each_time_and_keep_the_first_run(tmp_path: Path) -> None:
    """Without a folder there are none before."""
    assert next_incarnations(None, "one") == LogsInfo("one", 1)
    folder = tmp_path / "logs"
    assert next_incarnations(folder, "one") == LogsInfo("one", 1)
    assert next_incarnations(folder, "two") == LogsInfo("one", 1 + INCARNATIONS_OF_A_FLEET)
    assert read_incarnations(folder) == LogsInfo("one", 1 + INCARNATIONS_OF_A_FLEET)


@pytest.mark.parametrize(
    "text", [b"", b"1", b'{"run":"one"}', b'{"run":"on', b'{"run":"\xff"}', None]
)
def test_logs_without_their_incarnations_are_not_taken_up(
    tmp_path: Path, text: bytes | None
) -> None:
    """They would get incarnations that there were before; nothing is written."""
    log_of(tmp_path, 0).touch()
    if text is not None:
        (tmp_path / INCARNATIONS).write_bytes(text)
    with pytest.raises(
        InputError, match=rf"{INCARNATIONS}: .*, expected the run and the incarnation"
    ):
        next_incarnations(tmp_path, "two")
    assert (text is not None) == (tmp_path / INCARNATIONS).exists()


def _killed(folder: Path, lines: int) -> bool:
    """Ask for incarnations in a process that is killed at a line; return whether it was."""
    child = os.fork()
    if not child:

        def trace(frame: FrameType, _event: str, _: object) -> Any:
            nonlocal lines
            if frame.f_code.co_filename not in WRITERS:
                return None
            lines -= 1
            if not lines:
                os.kill(os.getpid(), signal.SIGKILL)
            return trace

        sys.settrace(trace)
        next_incarnations(folder, "two")
        os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


@pytest.mark.thorough
def test_incarnations_are_whole_wherever_the_process_is_killed_that_writes_them(
    tmp_path: Path,
) -> None:
    """The ones before, or the next ones; which are not given twice."""
    before = next_incarnations(tmp_path, "one")
    changed = 0
    for lines in count(1):
        killed = _killed(tmp_path, lines)
        after = read_incarnations(tmp_path)
        assert after is not None
        assert after in {before, LogsInfo("one", before.incarnation + INCARNATIONS_OF_A_FLEET)}
        changed += killed and after != before
        before = after
        if not killed:
            break
    assert changed


@pytest.mark.slow
def test_a_keeper_whose_log_lacks_commits_does_not_start(tmp_path: Path) -> None:
    """The fleet says which, how many it has, and how many are known."""
    fleet = FreeFleet(
        scene_from_spec("hex:n=3"), "random", keepers=1, logs=tmp_path, known=lambda _: 3
    )
    with fleet, pytest.raises(ProcessDied, match=r"keeper_0\.log: has 0 commits, expected the 3"):
        while True:
            fleet.look()
