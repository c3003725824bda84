"""How far a long command has come: lines where standard error is no terminal, and not too many."""

import io
import sys
import threading

import pytest

from cubepath.coordinator.commands.console import Lines, progress_bar


class Clock:
    """A time of day that only moves when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_short_command_says_nothing_and_a_long_one_a_line_now_and_then() -> None:
    """After five seconds the first line, then one every half minute: what, how much, how long."""
    clock, stream = Clock(), io.StringIO()
    with Lines(stream, 60, "film", " frames", clock) as bar:
        for _ in range(50):
            bar.update()
            clock.now += 1.0
        bar.set_description("schedule")
        bar.set_postfix_str("7 cubes", refresh=False)
        clock.now += 60
        bar.update(3)
        bar.reset(9)
        clock.now += 60
        bar.update()
    assert stream.getvalue().splitlines() == [
        "cubepath: film: 6 of 60 frames, 5 s",
        "cubepath: film: 36 of 60 frames, 35 s",
        "cubepath: schedule: 53 of 60 frames, 7 cubes, 110 s",
        "cubepath: schedule: 1 of 9 frames, 7 cubes, 170 s",
    ]


def test_without_a_total_the_count_alone_is_told() -> None:
    """Nor is anything said after the end."""
    clock, stream = Clock(), io.StringIO()
    bar = Lines(stream, None, "shorten", " moves", clock)
    clock.now += 9
    bar.update(1000)
    bar.close()
    clock.now += 999
    bar.update()
    assert stream.getvalue() == "cubepath: shorten: 1000 moves, 9 s\n"


def test_a_log_that_nobody_reads_is_no_trouble() -> None:
    """The command goes on without lines."""

    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise BrokenPipeError(text)

    clock = Clock()
    bar = Lines(Full(), None, "run", " rounds", clock)
    clock.now += 99
    bar.update()
    bar.update()
    assert bar.n == 2


def test_the_time_is_told_while_nothing_is_counted() -> None:
    """A step of which nothing is known but that it takes long is told all the same."""
    clock, stream = Clock(), io.StringIO()
    bar = Lines(stream, None, "certificate", "", clock)
    clock.now += 7
    bar.refresh()
    bar.refresh()
    assert stream.getvalue() == "cubepath: certificate: 7 s\n"


def test_the_time_is_shown_without_being_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar that nobody updates writes its line by itself, and none after it is closed."""
    written = threading.Event()

    class Stream(io.StringIO):
        def write(self, text: str) -> int:
            written.set()
            return super().write(text)

    stream = Stream()
    monkeypatch.delenv("CUBEPATH_PROGRESS")
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("cubepath.coordinator.commands.console._FIRST_SECONDS", 0.0)
    with progress_bar(None, "draw", "") as bar:
        assert written.wait(30)
    assert bar.disable
    assert stream.getvalue().startswith("cubepath: draw: ")


def test_off_a_terminal_there_are_lines_unless_none_are_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The environment says so, for who compares what a command writes to standard error."""
    with progress_bar(None, "run", " rounds") as bar:
        assert isinstance(bar, Lines)
        assert bar.disable
    monkeypatch.setenv("CUBEPATH_PROGRESS", "1")
    with progress_bar(None, "run", " rounds") as bar:
        assert isinstance(bar, Lines)
        assert not bar.disable
