"""The router of a run, in a separate process.

In the coordinator's process it would share zenoh's receiving threads with the coordinator's own
session, and under a flood the two would wait for each other. It is started as ``python -m
cubepath.protocol.wire.router`` with one line of JSON (`Routing`) on standard input. It prints its
address on standard output, and ends when its standard input closes.

Without an endpoint a router is private: it listens on a unix socket that only this user can reach,
knows every client by a password that is created for this run, and lets each publish on its own
keys.
"""

import contextlib
import os
import secrets
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import msgspec

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.wire.access import guarded_by_certificates, guarded_by_passwords
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    GUEST,
    PASSWORDS,
    ROUTER,
    TLS,
    Credentials,
    certificate_files,
    clear,
    discard,
    is_private,
    keeper_name,
    new_endpoint,
    process_name,
)
from cubepath.protocol.wire.sessions import (
    check_descriptors,
    check_endpoint,
    endpoints_in,
    open_router,
    reachable,
)

ON_LOOPBACK = "tls/127.0.0.1:0"
"""Where a router with certificates listens by default."""
_REFUSED = 4
_START_S_MAX = 30.0
_END_S_MAX = 5.0


class Routing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a router process needs when it starts."""

    endpoint: str
    passwords: dict[str, str] = {}
    folder: str = ""
    """Of the certificates, for an endpoint over TLS."""
    message_bytes_max: int = 0
    links: tuple[str, ...] = ()
    """Where the routers are to which it is linked."""


class Router:
    """A router process, as a context manager that ends it."""

    def __init__(
        self,
        endpoint: str | None = None,
        *,
        processes: int = 1,
        keepers: int = 0,
        secure: Path | None = None,
        links: Sequence[str] = (),
    ) -> None:
        """Start it at an endpoint, or a private one, and wait until it listens.

        Over ``tcp`` it lets everyone in and lets them say everything. Over ``tls`` it takes a
        certificate of the authority in the folder `secure`, and each speaks on its own keys.
        Private, it knows the coordinator, this many processes and keepers, and guests, who only
        listen. It connects to the routers at `links`, whose lists say what comes from there.

        Raises InputError if the endpoint is neither ``tcp/HOST:PORT`` nor ``tls/HOST:PORT``, its
        certificates are missing or the router cannot listen there, and CubepathError if
        `check_descriptors` finds too few file descriptors for `processes`.
        """
        check_descriptors(processes + keepers)
        if endpoint is not None:
            check_endpoint(endpoint)
            for each in (endpoint, *links):
                check_secure(each, secure)
        elif secure is not None:
            endpoint = ON_LOOPBACK
        if secure is not None:
            certificate_files(secure, ROUTER)
        self._secure = secure
        self._links = tuple(links)
        self._passwords: dict[str, str] = {}
        if endpoint is None:
            endpoint = new_endpoint()
            names = [
                COORDINATOR,
                *map(process_name, range(processes)),
                *map(keeper_name, range(keepers)),
            ]
            self._passwords = {name: secrets.token_hex() for name in names}
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the rest
        self.restarts = 0
        """How many times it was started again."""
        try:
            self._start(endpoint)
            self.listening = self._listening()
        except BaseException:
            self._complaints.close()
            discard(endpoint)
            raise
        self.endpoint = reachable(self.listening)
        """Where sessions on this machine find it."""

    def credentials(self, name: str) -> Credentials:
        """Return by what the one of this name shows who speaks."""
        if self._secure is not None:
            return Credentials(name, "", str(self._secure))
        password = self._passwords.get(name)
        return GUEST if password is None else Credentials(name, password)

    def _start(self, endpoint: str) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "cubepath.protocol.wire.router"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            # A terminal's interrupt goes to the coordinator, which ends its processes properly.
            process_group=0,
        )
        if self._child.stdin is None:
            raise AssertionError("no pipe to the router")  # it was requested above
        # The router's process starts faster without the messages themselves.
        from cubepath.protocol.wire.messages import MESSAGE_BYTES_MAX  # noqa: PLC0415

        folder = "" if self._secure is None else str(self._secure)
        settings = msgspec.json.encode(
            Routing(endpoint, self._passwords, folder, MESSAGE_BYTES_MAX, self._links)
        )
        with contextlib.suppress(BrokenPipeError):  # it died at once: noticed when listening
            self._child.stdin.write(settings + b"\n")
            self._child.stdin.flush()

    def _listening(self) -> str:
        """Wait until the router listens, and return where."""
        if self._child.stdout is None:
            raise AssertionError("no pipe from the router")  # it was requested above
        try:
            ready = select.select([self._child.stdout], [], [], _START_S_MAX)[0]
            if not ready:
                self._child.kill()  # its line is then empty
            found = self._child.stdout.readline().decode().strip()
        except BaseException:
            self._child.kill()
            self._stop()
            raise
        if found:
            return found
        code = self._child.wait()
        self._stop()
        self._complaints.seek(0)
        last = self._complaints.read().decode(errors="replace").strip().rpartition("\n")[2]
        if code == _REFUSED:
            raise InputError(last)
        raise CubepathError(f"the router did not start: {last or f'exit code {code}'}")

    @property
    def pid(self) -> int:
        """Return the process id."""
        return self._child.pid

    def look_after(self) -> bool:
        """Start it again where it was if it has ended; return whether that was so.

        Sessions find it there by themselves, however long it takes to start. What was on its way is
        lost.
        """
        if self._child.poll() is None:
            return False
        self._stop()
        self._start(self.listening)
        self.restarts += 1
        return True

    def close(self) -> None:
        """End the process, and remove its folder."""
        self._stop()
        discard(self.listening)
        self._complaints.close()

    def _stop(self) -> None:
        child = self._child
        with contextlib.suppress(OSError):
            if child.stdin is not None:
                child.stdin.close()
        try:
            child.wait(_END_S_MAX)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()

    def __enter__(self) -> Self:
        """Return the router, which listens already."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()


def check_secure(endpoint: str, secure: Path | None) -> None:
    """Check that endpoints over TLS have certificates, and no others have; InputError if not."""
    for each in endpoints_in(endpoint):
        if each.startswith(TLS) and secure is None:
            raise InputError(f"endpoint {each}: expected a folder of certificates (--secure DIR)")
        if secure is not None and not each.startswith(TLS):
            raise InputError(f"endpoint {each}: expected tls/HOST:PORT with certificates")


def without_tls(endpoint: str) -> str:
    """Return the warning about a router that authenticates nobody."""
    return f"listening on {endpoint} without TLS: any client that connects can speak for any module"


def _guard(routing: Routing) -> Mapping[str, Any]:
    """Return the settings that guard a router."""
    if routing.folder:
        return guarded_by_certificates(Path(routing.folder))
    if not is_private(routing.endpoint):
        return {}
    passwords = {**routing.passwords, GUEST.name: GUEST.password}
    return guarded_by_passwords(passwords, clear(routing.endpoint) / PASSWORDS)


def main() -> int:
    """Route until standard input closes; return the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = sys.stdin.buffer.readline()
    if not line:
        return 0  # the coordinator has ended already
    routing = msgspec.json.decode(line, type=Routing)
    try:
        session, found = open_router(
            routing.endpoint, _guard(routing), routing.message_bytes_max, routing.links
        )
    except InputError as error:
        print(error, file=sys.stderr)
        return _REFUSED
    if is_private(found):
        (Path(found.partition("/")[2]).parent / "passwords").unlink(missing_ok=True)
    with session:
        print(found, flush=True)
        while os.read(0, 1):
            pass
        discard(found)  # the coordinator may have been killed
    return 0


if __name__ == "__main__":
    sys.exit(main())
