"""The configuration of a keeper. The fleet and the simulator create it in the same way."""

import msgspec

from cubepath.protocol.wire.credentials import GUEST, Credentials


class KeeperConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The configuration of a keeper."""

    endpoint: str
    run: str
    keeper: int
    keepers: int
    modules_of: list[list[int]]
    """The modules of every process: which process speaks for which module."""
    scene: str
    log: str
    """The path of the keeper's log."""
    log_run: str
    """The run that began the log."""
    logged: bytes = b""
    """What the keeper has logged elsewhere before, if it is to continue."""
    incarnation: int = 1
    """How often it has been started, from 1."""
    commits: int = 0
    """How many commits are known of it; its log has no fewer."""
    tell_reads: bool = False
    credentials: Credentials = GUEST
