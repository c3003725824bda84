"""A relay before a router's unix socket, that can be slow, or cut for a while."""

from __future__ import annotations

import contextlib
import shutil
import socket
import tempfile
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

_SCHEME = "unixsock-stream/"


class Relay:
    """Passes on what clients and the router say to each other; nothing gets through while cut."""

    def __init__(self, endpoint: str, *, delay_s: float = 0.0) -> None:
        self._target = endpoint.removeprefix(_SCHEME)
        self._folder = Path(tempfile.mkdtemp(prefix="relay-"))
        self.endpoint = f"{_SCHEME}{self._folder}/socket"
        self.delay_s = delay_s
        self._open = threading.Event()
        self._open.set()
        self._closed = False
        self.passed = 0
        self._sockets: list[socket.socket] = []
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(f"{self._folder}/socket")
        self._listening.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        self._open.clear()

    def heal(self) -> None:
        self._open.set()

    def _accept(self) -> None:
        while not self._closed:
            try:
                client, _ = self._listening.accept()
            except OSError:
                return
            router = socket.socket(socket.AF_UNIX)
            try:
                router.connect(self._target)
            except OSError:
                client.close()
                continue
            self._sockets += [client, router]
            for one, other in ((client, router), (router, client)):
                threading.Thread(target=self._pump, args=(one, other), daemon=True).start()

    def _pump(self, one: socket.socket, other: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(1 << 16):
                if self.delay_s:
                    time.sleep(self.delay_s)
                self._open.wait()
                other.sendall(data)
                self.passed += len(data)
        for each in (one, other):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closed = True
        self.heal()
        for each in (self._listening, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        shutil.rmtree(self._folder, ignore_errors=True)
