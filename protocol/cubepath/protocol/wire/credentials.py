"""The credentials with which a session authenticates: passwords, certificates, a router's folder.

The last process of a run removes the folder, so a killed run leaves nothing behind. Its name is new
each time, so a folder that was left behind does no harm.

The names are `COORDINATOR`, ``process_N`` and `GUEST`. A router over plain TCP authenticates
nobody.
"""

import contextlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from cubepath.protocol.core.errors import CubepathError, InputError

SCHEME = "unixsock-stream/"
_PREFIX = "cubepath-router-"
_NAME = "socket"
PASSWORDS = "passwords"
"""The file with the passwords that a private router reads when it opens."""
_BYTES_MAX = 107
"""Of the path of a unix socket (``unix(7)``)."""
_PLAIN = re.compile(r"[\w/.+-]+", re.ASCII)
"""Other characters have a meaning in an endpoint, or none."""
_LAST_RESORT = "/tmp"  # noqa: S108 - a folder of its own is made there, which nobody else can enter


def new_endpoint() -> str:
    """Make a folder of mode 0700, and return the endpoint of a socket in it.

    It is made where temporary files go, or in /tmp where that path is too long for a socket.
    CubepathError if neither can be had.
    """
    first = tempfile.gettempdir()
    for parent in dict.fromkeys((first, _LAST_RESORT)):
        longest = f"{parent}/{_PREFIX}{'x' * 8}/{_NAME}"
        if len(os.fsencode(longest)) > _BYTES_MAX or not _PLAIN.fullmatch(parent):
            continue
        with contextlib.suppress(OSError):
            return SCHEME + str(Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent)) / _NAME)
    raise CubepathError(
        f"{first}: no place for the router's socket, nor is {_LAST_RESORT}: expected a folder to"
        f" write to, with a path of plain letters and at most"
        f" {_BYTES_MAX - len(_PREFIX) - len(_NAME) - 10} bytes (TMPDIR)"
    )


def is_private(endpoint: str) -> bool:
    """Return whether an endpoint is a socket in its own folder."""
    path = Path(endpoint.removeprefix(SCHEME))
    return (
        endpoint.startswith(SCHEME) and path.name == _NAME and path.parent.name.startswith(_PREFIX)
    )


def has_ended(endpoint: str) -> bool:
    """Return whether a private router has ended, which removes its socket."""
    return is_private(endpoint) and not Path(endpoint.removeprefix(SCHEME)).exists()


def clear(endpoint: str) -> Path:
    """Remove what a router that was killed left of its socket; return its folder, there again.

    CubepathError if somebody else has made that folder in the meantime.
    """
    folder = Path(endpoint.removeprefix(SCHEME)).parent
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o077:
        raise CubepathError(f"{folder}: not a folder of yours alone, expected that of the router")
    for name in (_NAME, f"{_NAME}.lock", PASSWORDS):
        (folder / name).unlink(missing_ok=True)
    return folder


def discard(endpoint: str) -> None:
    """Remove the folder of a private endpoint, if there still is one; others are left alone."""
    if is_private(endpoint):
        shutil.rmtree(Path(endpoint.removeprefix(SCHEME)).parent, ignore_errors=True)


COORDINATOR = "coordinator"
ROUTER = "router"
AUTHORITY = "authority"
_GUEST = "guest"
TLS = "tls/"


class Credentials(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A name with its password, or with the folder that holds its certificate and key."""

    name: str = _GUEST
    password: str = _GUEST
    folder: str = ""

    def __repr__(self) -> str:
        """Return the name alone: secrets do not belong in a traceback."""
        return f"Credentials({self.name!r})"


GUEST = Credentials()
"""Every user who may read the socket may listen, and publish nothing."""


def process_name(process: int) -> str:
    """Return the name that a module process speaks by, in keys as in credentials."""
    return f"process_{process}"


def keeper_name(keeper: int) -> str:
    """Return the name that a keeper of sites speaks by."""
    return f"keeper_{keeper}"


def number_in(name: str) -> int:
    """Return the number in the name of a process or a keeper."""
    return int(name.rpartition("_")[2])


def certificate_files(folder: Path, name: str) -> tuple[Path, Path, Path]:
    """Return the authority's certificate, and a name's own with its key.

    InputError if one of them is not there or cannot be read.
    """
    files = folder / f"{AUTHORITY}.crt", folder / f"{name}.crt", folder / f"{name}.key"
    for path in files:
        try:
            path.open("rb").close()
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected what 'cubepath host certificates'"
                " writes"
            ) from None
    return files


def settings_for(endpoint: str, credentials: Credentials) -> Mapping[str, Any]:
    """Return the settings of a client that connects to an endpoint with these credentials.

    InputError if it takes a certificate and there is none.
    """
    if endpoint.startswith(SCHEME):
        return {
            "transport/auth/usrpwd/user": credentials.name,
            "transport/auth/usrpwd/password": credentials.password,
        }
    if not endpoint.startswith(TLS):
        return {}  # a router without passwords refuses a client that has one
    if not credentials.folder:
        raise InputError(f"endpoint {endpoint}: expected a folder of certificates (--secure DIR)")
    authority, own, key = certificate_files(Path(credentials.folder), credentials.name)
    return {
        "transport/link/tls/root_ca_certificate": str(authority),
        "transport/link/tls/connect_certificate": str(own),
        "transport/link/tls/connect_private_key": str(key),
        "transport/link/tls/enable_mtls": True,
    }
