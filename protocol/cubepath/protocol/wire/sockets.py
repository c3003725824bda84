"""The folder of a private router: a unix socket that only its owner can reach.

Whoever is left of a run takes the folder away, so a run that was killed leaves nothing behind. Its
name is new each time; one that was left all the same is in nobody's way.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
from pathlib import Path

from cubepath.protocol.core.errors import CubepathError

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
    """Return whether an endpoint is a socket in a folder of its own."""
    path = Path(endpoint.removeprefix(SCHEME))
    return (
        endpoint.startswith(SCHEME) and path.name == _NAME and path.parent.name.startswith(_PREFIX)
    )


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
