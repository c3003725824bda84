"""Processes that play the runs of a sweep, and how they end."""

import os
import sys
import threading
import time
from pathlib import Path

from cubepath.coordinator.experiments.workers import Pool


def _half_an_answer(begun: Path) -> None:
    """Begin to send an answer of 256 bytes, and never end it."""
    writer = sys._getframe(1).f_locals["result_queue"]._writer
    os.write(writer.fileno(), b"\0\0\1\0half")
    begun.touch()
    time.sleep(600)


def test_a_pool_ends_though_an_answer_was_half_sent(tmp_path: Path) -> None:
    """A worker that is ended in the middle of an answer leaves nobody waiting for the rest."""
    pool = Pool(1)
    begun = tmp_path / "begun"
    running = pool.start().submit(_half_an_answer, begun)
    while not begun.exists():
        assert not running.done()
        time.sleep(0.01)
    ending = threading.Thread(target=pool.end, kwargs={"at_once": True}, daemon=True)
    ending.start()
    ending.join(30)
    assert not ending.is_alive()
