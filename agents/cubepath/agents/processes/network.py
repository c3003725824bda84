"""Where the processes of a run meet, and how many of them join from elsewhere."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from cubepath.protocol.core.errors import OptionError
from cubepath.protocol.wire.access import PROCESSES_MAX
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    ROUTER,
    Credentials,
    certificate_files,
    keeper_name,
    process_name,
)
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import (
    check_endpoint,
    check_endpoints,
    check_links,
    endpoints_in,
)

Way: TypeAlias = Callable[[str, str, Credentials], tuple[str, Credentials]]
"""Where a process finds the router, and what it shows there of who it is.

It is given the name of the process, where the router listens and the credentials there; a test of a
bad wire gives a process another way to the router.
"""


def straight(_name: str, endpoint: str, credentials: Credentials) -> tuple[str, Credentials]:
    """Return the way that leads straight to the router."""
    return endpoint, credentials


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """A private router by default."""

    listen: str | None = None
    """Where the router of the run listens, ``tcp/HOST:PORT`` or ``tls/HOST:PORT``."""
    connect: str | None = None
    """Where another router listens already, or linked ones, separated by commas: the run uses them
    instead of one of its own, or links its own with them."""
    secure: Path | None = None
    """The folder of certificates, for TLS."""
    wait_for: int = 0
    """How many processes join from elsewhere before the run begins."""

    @property
    def elsewhere(self) -> str | None:
        """Where the routers are that the run uses, None if it has one of its own."""
        return self.connect if self.listen is None else None

    @property
    def links(self) -> list[str]:
        """Where the routers are that its own is linked with."""
        return [] if self.listen is None or self.connect is None else endpoints_in(self.connect)

    @property
    def is_open(self) -> bool:
        """Whether anyone who can connect can speak for any module."""
        return self.secure is None and self.listen is not None

    def check(self, modules: int, processes: int, keepers: int = 0) -> None:
        """Check it for a run of this many modules in this many own processes, and of keepers.

        InputError if something is wrong.
        """
        for endpoint in (self.listen, self.connect):
            if endpoint is not None:
                (check_endpoints if endpoint is self.connect else check_endpoint)(endpoint)
                check_secure(endpoint, self.secure)
        if self.listen is not None:
            check_links(self.listen, self.links)
        if not 0 <= self.wait_for <= modules + keepers:
            each = "one a module or keeper" if keepers else "one a module"
            raise OptionError(
                f"wait-for={self.wait_for}: expected 0 to {modules + keepers}, {each}"
            )
        if self.wait_for and (self.listen, self.connect, self.secure) == (None, None, None):
            raise OptionError(
                f"wait-for={self.wait_for}: no process can join a private run, expected --listen or"
                " --connect"
            )
        if self.secure is not None:
            self._check_certificates(self.secure, processes, keepers)

    def _check_certificates(self, folder: Path, processes: int, keepers: int) -> None:
        """Check that those who speak here have certificates; InputError names a missing one.

        A process whose modules were taken by others needs none, which is not known yet; so with
        those the certificates of own processes are asked for when they are needed.
        """
        if self.wait_for + processes > PROCESSES_MAX:
            raise OptionError(
                f"processes={processes}: with certificates there are at most {PROCESSES_MAX}"
            )
        certificate_files(folder, COORDINATOR)
        if self.elsewhere is None:
            certificate_files(folder, ROUTER)
        if not self.wait_for:
            for process in range(max(1, processes)):
                certificate_files(folder, process_name(process))
            for keeper in range(keepers):
                certificate_files(folder, keeper_name(keeper))


PRIVATE = NetworkConfig()
