"""The module processes that a fleet starts itself: a child process each, or one thread."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable

from cubepath.agents.processes.host import host
from cubepath.agents.processes.offspring import Offspring
from cubepath.agents.processes.orders import Orders
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.credentials import process_name

_MODULE = "cubepath.agents.processes.host"
_END_S_MAX = 5.0


class Children:
    """Module processes by their numbers."""

    def __init__(self) -> None:
        """Start with none."""
        self._offspring = Offspring()
        self._numbers: dict[str, int] = {}
        self._thread: threading.Thread | None = None
        self._thread_error: list[BaseException] = []

    @property
    def by_process(self) -> dict[int, subprocess.Popen[bytes]]:
        """Return the processes by number."""
        return {self._numbers[name]: child for name, child in self._offspring.by_name.items()}

    def spawn(self, orders: Orders) -> None:
        """Start a process."""
        name = process_name(orders.process)
        self._numbers[name] = orders.process
        self._offspring.spawn(name, _MODULE, orders)

    def keep_here(self, orders: Orders) -> None:
        """Keep the modules in a thread of this process, on a session of their own."""
        self._thread = threading.Thread(target=self._host, args=(orders,), daemon=True)
        self._thread.start()

    def _host(self, orders: Orders) -> None:
        try:
            host(orders)
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
            self._thread_error.append(error)

    def check(self, died: Callable[[int, str], ProcessDied]) -> None:
        """Raise if one has ended; `died` makes the error from its number, and from how it ended."""
        for error in self._thread_error:
            if isinstance(error, CubepathError):
                raise error
            what = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise died(0, what) from error
        for ended in self._offspring.ended():
            if ended.told:
                raise ProcessDied(ended.last)
            raise died(self._numbers[ended.name], ended.how)

    def end(self, patience_s: float) -> None:
        """Wait so long for processes that were told to stop, and kill those that do not."""
        try:
            if self._thread is not None:
                self._thread.join(_END_S_MAX)
        finally:
            self._offspring.end(patience_s)
