"""A player controlled by the keys of a terminal.

Keys are read without waiting for a new line, and signals keep their keys. Whatever ends or stops
the command, the terminal is left as it was found. If the terminal is gone and the command should
continue without it (``nohup``), there are no more keys.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import sys
import termios
import time
import tty
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

from cubepath.coordinator.commands.console import complain, silence
from cubepath.protocol.core.errors import CubepathError

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.playback.machine import PlayerStatus
from cubepath.coordinator.playback.player import Player

HELP = (
    "space pause, right/left a {} on/back, . and , a message on/back, up/down 10% faster/slower,"
    " + and - twice/half as fast, 0 to the start, q end, ? help"
)
_KEY = re.compile(rb"\x1b[\[O][0-9;]*[A-Za-z~]|\x1b|.", re.DOTALL)
_NAMES = {
    b"\x1b[A": "up",
    b"\x1b[B": "down",
    b"\x1b[C": "right",
    b"\x1b[D": "left",
    b"\x1bOA": "up",
    b"\x1bOB": "down",
    b"\x1bOC": "right",
    b"\x1bOD": "left",
    b"\x1b[H": "0",
    b"\x1bOH": "0",
    b"\x1b[1~": "0",
}
_ORDERS: dict[str, tuple[str, dict[str, str]]] = {
    " ": ("toggle", {}),
    "right": ("step", {"unit": "round"}),
    "left": ("back", {"unit": "round"}),
    ".": ("step", {}),
    ",": ("back", {}),
    "up": ("rate", {"times": "1.1"}),
    "down": ("rate", {"times": "0.9"}),
    "+": ("rate", {"times": "2"}),
    "-": ("rate", {"times": "0.5"}),
    "q": ("stop", {}),
}
_TICK_S = 0.1


def has_terminal() -> bool:
    """Return whether keys can be read and answered: a terminal of which this has the foreground."""
    try:
        number = sys.stdin.fileno()
        return sys.stdin.isatty() and sys.stderr.isatty() and os.tcgetpgrp(number) == os.getpgrp()
    except (OSError, ValueError, AttributeError):  # closed, or replaced by something else
        return False


def keys_in(data: bytes) -> list[str]:
    """Return the names of the keys whose bytes came from a terminal."""
    found: list[bytes] = _KEY.findall(data)
    return [_NAMES.get(each) or each.decode("ascii", "replace") for each in found]


def order_of(key: str, start: str, step: str = "round") -> tuple[str, dict[str, str]] | None:
    """Return what a key orders; None if nothing. `start` is where the replay begins.

    Without a name for a `step`, messages have no rounds, and a step is a message.
    """
    found = ("seek", {"to": start}) if key == "0" else _ORDERS.get(key)
    return (found[0], {}) if found and not step and "unit" in found[1] else found


def status_line(status: PlayerStatus, step: str) -> str:
    """Return where a player stands, in a line: what comes next, and how fast."""
    where = f"at the end, after {step} {status.round}" if step else "at the end"
    if status.message < status.messages:
        at = f"{step} {status.round}, " if step else ""
        where = f"next: {at}message {status.message + 1} of {status.messages}"
    laps = f", lap {status.laps + 1}" if status.laps else ""
    return (
        f"{status.state}, {where}, {status.time_s:.2f} of {status.seconds:.2f} s,"
        f" {_rate_text(status.rate, step)}{laps}"
    )


def _rate_text(rate: str, step: str) -> str:
    if rate == "max":
        return "as fast as possible"
    return f"{rate} as fast as it was" if rate.endswith("x") else f"{rate} {step}s a second"


class Keys:
    """The keys of the terminal at standard input, as a context manager."""

    def __enter__(self) -> Self:
        """Read keys as they are pressed, until this is left."""
        self._number = sys.stdin.fileno()
        self._gone = False
        self._found = termios.tcgetattr(self._number)
        self._before: dict[int, Any] = {}
        try:
            self._take()
            for number, handler in (
                (signal.SIGTSTP, self._stop),
                (signal.SIGCONT, self._go_on),
                (signal.SIGQUIT, self._quit),
            ):
                self._before[number] = signal.signal(number, handler)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._give_back()

    def _take(self) -> None:
        tty.setcbreak(self._number, termios.TCSADRAIN)

    def _give_back(self) -> None:
        with contextlib.suppress(termios.error):  # it may be gone
            termios.tcsetattr(self._number, termios.TCSADRAIN, self._found)

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        """Stop as if there were no handler, with the terminal as it was."""
        self._give_back()
        os.kill(os.getpid(), signal.SIGSTOP)

    def _go_on(self, _number: int, _frame: FrameType | None) -> None:
        with contextlib.suppress(OSError, termios.error):
            if os.tcgetpgrp(self._number) == os.getpgrp():
                self._take()

    def _quit(self, number: int, _frame: FrameType | None) -> None:
        """Die of it as if there were no handler, with the terminal as it was."""
        self._give_back()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    def pressed(self, timeout_s: float) -> list[str]:
        """Return the keys that were pressed, after waiting for one this long."""
        if self._gone:
            time.sleep(timeout_s)
            return []
        ready = select.select([self._number], [], [], timeout_s)[0]
        if not ready:
            return []
        try:
            data = os.read(self._number, 256)
        except OSError:
            data = b""
        self._gone = not data
        return keys_in(data)


def play_by_keys(player: Player, start: str, step: str) -> None:
    """Let the keys control a player until it is over; nothing is left on the terminal."""
    complain(HELP.format(step or "message"))
    with Keys() as keys:
        try:
            while not player.over:
                for key in keys.pressed(_TICK_S):
                    _press(player, key, start, step)
                _show(status_line(player.position, step))
        except CubepathError:
            if not player.over:
                raise
            # It ended meanwhile; the waiting caller learns how.
        finally:
            _show("")


def _press(player: Player, key: str, start: str, step: str) -> None:
    order = order_of(key, start, step)
    if order is None:
        if key == "?":
            _show("")
            complain(HELP.format(step or "message"))
        return
    try:
        player.order(order[0], **order[1])
    except CubepathError as error:
        if not player.over:
            _show("")
            complain(error)


def _show(line: str) -> None:
    try:
        print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)
    except OSError:  # nobody sees it any more
        silence(sys.stderr)
