"""By what a session shows who speaks: a password at a private router, a certificate over TLS.

The names are `COORDINATOR`, ``process_N`` and `GUEST`. A router over plain TCP asks nobody.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.sockets import SCHEME

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
"""Whoever may read the socket may listen, and say nothing."""


def process_name(process: int) -> str:
    """Return the name that a module process speaks by, in keys as in credentials."""
    return f"process_{process}"


def keeper_name(keeper: int) -> str:
    """Return the name that a keeper of sites speaks by."""
    return f"keeper_{keeper}"


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
        return {}  # a router without passwords refuses whoever has one
    if not credentials.folder:
        raise InputError(f"endpoint {endpoint}: expected a folder of certificates (--secure DIR)")
    authority, own, key = certificate_files(Path(credentials.folder), credentials.name)
    return {
        "transport/link/tls/root_ca_certificate": str(authority),
        "transport/link/tls/connect_certificate": str(own),
        "transport/link/tls/connect_private_key": str(key),
        "transport/link/tls/enable_mtls": True,
    }
