"""``cubepath replay`` under options and under keys: a terminal that is left as it was."""

import json
import os
import pty
import re
import signal
import subprocess
import termios
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from cubepath.coordinator.commands.keyboard import keys_in, order_of, status_line
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.machine import PlayerStatus
from processes.command_line import GOLDEN, PYTHON

HEX = str(GOLDEN / "hex-5.mcap")
Capture = pytest.CaptureFixture[str]


def test_keys_have_names_however_they_are_sent() -> None:
    """Several at a time, and arrows in both forms; what means nothing orders nothing."""
    keys = keys_in(b" \x1b[C\x1bOD.\x1b[1~q\xff\x1b[5~\x1b")
    assert keys[:6] == [" ", "right", "left", ".", "0", "q"]
    assert [order_of(key, "0") for key in keys[6:]] == [None] * 3
    assert order_of("right", "0") == ("step", {"unit": "round"})
    assert order_of("left", "0") == ("back", {"unit": "round"})
    assert order_of("0", "3.5s") == ("seek", {"to": "3.5s"})
    # Messages on any keys have no rounds.
    assert order_of("right", "0s", "") == ("step", {})
    status = PlayerStatus("r", "paused", 3, 8, 0, 0.25, 1.0, "2x", 0)
    line = "paused, next: message 4 of 8, 0.25 of 1.00 s, 2x as fast as it was"
    assert status_line(status, "") == line
    for key in " .,+-q":
        assert order_of(key, "0") is not None


@pytest.mark.slow
def test_a_part_is_played_as_the_options_say(capsys: Capture) -> None:
    """The answer says what was not compared and what was not played; the exit code is 0."""
    words = ["replay", HEX, "--from", "3", "--until", "5", "--topics", "reports", "--run", "mine"]
    assert main([*words, "--exclude", "*/process_1", "--rate", "100x", "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert (found["run"], found["messages"], found["same"]) == ("mine", 3, False)
    assert found["not_compared"] == ["rounds 1 to 29", "cubes", "summary"]
    assert found["left_out"]["reports"] == 58 - 3
    assert re.fullmatch(r"cubepath: replaying on \S+ under cubepath/mine/\*\*\n", told.err)
    assert main(["replay", HEX, "--until", "2"]) == 0
    out = capsys.readouterr().out
    assert "186 bundle, 1 certificate, 19 cube, 29 edges, 88 go, 176 ready, 54 reports, " in out
    assert "result         the same as recorded in 2 rounds; not compared: rounds 3 to 29, " in out


def test_the_table_says_of_which_part_its_numbers_are(capsys: pytest.CaptureFixture[str]) -> None:
    """Where not all rounds that were compared are among them; and in levels without rounds."""
    assert main(["replay", HEX, "--from", "12"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "gathered       from round 12 on; the numbers are of that part"
    assert main(["replay", HEX, "--from", "29"]) == 0
    assert "the same as recorded in 1 round; not compared" in capsys.readouterr().out
    assert main(["replay", str(GOLDEN / "hex-free-5.mcap")]) == 0
    assert capsys.readouterr().out.startswith("levels         19\n")


class Terminal:
    """A command in a terminal of its own."""

    def __init__(self, *words: str, folder: Path | None = None) -> None:
        self.mine, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self._theirs = theirs
        self.told = ""

        def lead() -> None:
            os.setsid()
            os.close(os.open(os.ttyname(0), os.O_RDWR))  # it becomes the controlling terminal

        self.process = subprocess.Popen(
            [*PYTHON, *words],
            stdin=theirs,
            stderr=theirs,
            stdout=subprocess.PIPE,
            env={**os.environ, **({} if folder is None else {"TMPDIR": str(folder)})},
            preexec_fn=lead,  # noqa: PLW1509 - nothing else runs here yet
        )

    def press(self, keys: str) -> None:
        os.write(self.mine, keys.encode())

    def wait(self, what: Callable[[], object]) -> None:
        """Read until something holds."""
        deadline = time.monotonic() + 30
        os.set_blocking(self.mine, False)
        while not what():
            assert time.monotonic() < deadline, self.told
            try:
                self.told += os.read(self.mine, 4096).decode()
            except BlockingIOError:
                time.sleep(0.01)

    def shows(self, pattern: str) -> None:
        """Wait until the last status line is like this."""
        self.wait(lambda: re.search(pattern, self.told.rpartition("\r")[2]))

    @property
    def settings(self) -> list[object]:
        return list(termios.tcgetattr(self._theirs))

    def hang_up(self) -> None:
        """Close it at both ends, as when a window is closed."""
        os.close(self._theirs)
        os.close(self.mine)

    def close(self) -> str:
        """Return what was answered."""
        out, _ = self.process.communicate(timeout=30)
        os.close(self.mine)
        os.close(self._theirs)
        return out.decode()


@pytest.mark.slow
def test_keys_control_it_and_the_terminal_is_left_as_it_was() -> None:
    """Steps and jumps, a stop by the terminal and on again, another rate, the end."""
    terminal = Terminal("replay", HEX, "--paused", "--json")
    try:
        terminal.shows(r"paused, next: round 1, message \d+ of 578, .* as fast as possible")
        assert "space pause, right/left a round on/back" in terminal.told
        assert terminal.settings != terminal.before
        terminal.press("\x1b[C\x1b[C")
        terminal.shows(r"paused, next: round 3, ")
        terminal.process.send_signal(signal.SIGTSTP)
        os.waitpid(terminal.process.pid, os.WUNTRACED)
        assert terminal.settings == terminal.before
        terminal.process.send_signal(signal.SIGCONT)
        terminal.wait(lambda: terminal.settings != terminal.before)
        terminal.press("\x1b[D-")
        terminal.shows(r"paused, next: round 2, .* 10 rounds a second")
        terminal.press("q")
        found = json.loads(terminal.close())
        assert (found["rounds_compared"], found["messages"]) == (2, 24)
    finally:
        terminal.process.kill()
    assert terminal.process.returncode == 0


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGQUIT, -signal.SIGQUIT),
        pytest.param(signal.SIGINT, 130, marks=pytest.mark.thorough),
        pytest.param(signal.SIGTERM, 130, marks=pytest.mark.thorough),
    ],
)
def test_a_signal_leaves_the_terminal_as_it_was(number: signal.Signals, code: int) -> None:
    """A quit ends it at once, by the signal itself; any other with exit code 130, in one line."""
    terminal = Terminal("replay", HEX, "--rate", "0.01")
    try:
        terminal.shows(r"playing, next: round 2, ")
        assert terminal.settings != terminal.before
        terminal.process.send_signal(number)
        terminal.wait(lambda: terminal.process.poll() is not None)
        assert terminal.settings == terminal.before
    finally:
        terminal.process.kill()
        out = terminal.close()
    assert (terminal.process.returncode, out) == (code, "")
    if code == 130:
        assert terminal.told.rstrip().endswith("cubepath: interrupted")


@pytest.mark.slow
@pytest.mark.parametrize("hangup", [False, True])
def test_a_terminal_that_is_closed_ends_it_or_leaves_it_alone(hangup: bool, tmp_path: Path) -> None:
    """By SIGHUP in order, exit code 130, nothing left behind; it plays on to the end if ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL if hangup else signal.SIG_IGN)
    try:
        rate = "0.01" if hangup else "40"
        terminal = Terminal("replay", HEX, "--rate", rate, "--json", folder=tmp_path)
    finally:
        signal.signal(signal.SIGHUP, before)
    try:
        terminal.shows(r"playing, next: round \d")
        terminal.hang_up()
        out, _ = terminal.process.communicate(timeout=30)
    finally:
        terminal.process.kill()
    assert terminal.process.returncode == (130 if hangup else 0)
    assert (out == b"") if hangup else json.loads(out)["same"]
    assert list(tmp_path.iterdir()) == []
