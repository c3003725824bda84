"""How far a long command has come: lines where standard error is no terminal, and not too many."""

from __future__ import annotations

import io

from cubepath.coordinator.commands.progress import Lines, progress_bar


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


def test_off_a_terminal_there_are_lines() -> None:
    """In this test's own standard error, which is captured."""
    assert isinstance(progress_bar(None, "run", " rounds"), Lines)
