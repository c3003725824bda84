"""Where a guest of a run can listen, and by what it shows who it is.

Who records a run and who watches it attach in the same way.
"""

from __future__ import annotations

from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.credentials import GUEST, Credentials
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import check_endpoint
from cubepath.protocol.wire.sockets import is_private


def guest_at(endpoint: str, secure: Path | str | None) -> Credentials:
    """Return the credentials of a guest at an endpoint; `secure` is a folder of certificates.

    InputError if a run cannot be listened to at such an endpoint, or if it takes certificates and
    none are given, or the other way round.

    >>> guest_at("tcp/127.0.0.1:7447", None).name
    'guest'
    """
    if not isinstance(endpoint, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"endpoint={endpoint!r}: expected where a run can be joined")
    folder = None if secure is None else Path(secure)
    if not is_private(endpoint):
        try:
            check_endpoint(endpoint, connect=True)
        except InputError as error:
            raise InputError(f"{error}, or the unixsock-stream/PATH that a run has said") from None
    check_secure(endpoint, folder)
    return GUEST if folder is None else Credentials(GUEST.name, "", str(folder))
