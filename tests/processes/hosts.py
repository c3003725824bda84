"""Three hosts on one machine, with addresses of their own, and what is done to their network."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from processes import switch
from processes.elsewhere import Commands, Running

HOSTS = 3
PORT = 7447
DELAY_S = 0.002
"""How long a frame is on its way from one host to another."""
ADDRESSES = [f"10.0.0.{host + 1}" for host in range(HOSTS)]
ENDPOINTS = [f"tcp/{address}:{PORT}" for address in ADDRESSES]


class Hosts(Commands):
    """Commands on three hosts, each with a folder, as a context manager that ends all of it.

    The test is skipped where this user cannot have networks of its own.
    """

    def __init__(self, folder: Path) -> None:
        """Connect all of them."""
        super().__init__(folder)
        self._switch = subprocess.Popen(
            [sys.executable, "-I", switch.__file__, str(HOSTS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.callback(self._switch.communicate)
        if self._switch.stdout is None:
            raise AssertionError("no pipe from the switch")  # it was requested above
        self._networks = self._switch.stdout.readline().split()
        if not self._networks:
            line = self._switch.communicate()[1].strip().rpartition("\n")[2]
            pytest.skip(f"no hosts on this machine: {line}")
        self.heal()

    def host(self, number: int) -> Path:
        """Return the folder of a host."""
        found = self.folder / f"host_{number}"
        found.mkdir(exist_ok=True)
        return found

    def start_on(self, number: int, *arguments: str, within: Sequence[str] = ()) -> Running:
        """Start a command on a host."""
        enter = ("nsenter", f"--net={self._networks[number]}", *within)
        return self.enter_context(Running(self.host(number), arguments, enter))

    def degrade(self, sender: int, receiver: int, loss: float, delay_s: float = DELAY_S) -> None:
        """Lose this share of the frames from one host to another."""
        if self._switch.stdin is None:
            raise AssertionError("no pipe to the switch")  # it was requested above
        self._switch.stdin.write(json.dumps([sender, receiver, loss, delay_s]) + "\n")
        self._switch.stdin.flush()

    def cut(self, *pairs: tuple[int, int]) -> None:
        """Lose all from the first of each pair to the second, and nothing the other way."""
        for sender, receiver in pairs:
            self.degrade(sender, receiver, 1.0)

    def cut_off(self, host: int) -> None:
        """Lose all to and from a host."""
        self.cut(*((one, host) for one in range(HOSTS)), *((host, one) for one in range(HOSTS)))

    def heal(self) -> None:
        """Lose nothing any more."""
        for sender in range(HOSTS):
            for receiver in range(HOSTS):
                self.degrade(sender, receiver, 0.0)
