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
    process_name,
)
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import check_endpoint

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
    """Instead: where another router listens already."""
    secure: Path | None = None
    """The folder of certificates, for TLS."""
    wait_for: int = 0
    """How many processes join from elsewhere before the run begins."""

    @property
    def is_open(self) -> bool:
        """Whether anyone who can connect can speak for any module."""
        return self.secure is None and self.listen is not None

    def check(self, modules: int, processes: int) -> None:
        """Check it for a run of this many modules in this many own processes; InputError if not."""
        if self.listen is not None and self.connect is not None:
            raise OptionError(f"connect={self.connect}: the run has a router already, to listen")
        endpoint = self.listen if self.connect is None else self.connect
        if endpoint is not None:
            check_endpoint(endpoint, connect=self.connect is not None)
            check_secure(endpoint, self.secure)
        if not 0 <= self.wait_for <= modules:
            raise OptionError(f"wait-for={self.wait_for}: expected 0 to {modules}, one a module")
        if self.wait_for and endpoint is None and self.secure is None:
            raise OptionError(
                f"wait-for={self.wait_for}: no process can join a private run, expected --listen or"
                " --connect"
            )
        if self.secure is not None:
            self._check_certificates(self.secure, processes)

    def _check_certificates(self, folder: Path, processes: int) -> None:
        """Check that those who speak here have certificates; InputError names a missing one.

        A process whose modules were taken by others needs none, which is not known yet; so the
        certificates of own processes are asked for when they are needed.
        """
        if self.wait_for + processes > PROCESSES_MAX:
            raise OptionError(
                f"processes={processes}: with certificates there are at most {PROCESSES_MAX}"
            )
        certificate_files(folder, COORDINATOR)
        if self.connect is None:
            certificate_files(folder, ROUTER)
        for process in () if self.wait_for else range(max(1, processes)):
            certificate_files(folder, process_name(process))
