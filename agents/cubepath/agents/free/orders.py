"""What a module process is told at its birth, in a run without rounds.

The fleet and the simulator give the same orders.
"""

from __future__ import annotations

import msgspec

from cubepath.protocol.core.names import GeneratorPlacement, Json
from cubepath.protocol.wire.credentials import GUEST, Credentials


class OwnMove(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A module's own move of a schedule, and how often its units were written and read before."""

    placed: GeneratorPlacement
    after: list[tuple[Json, int, int | None]]


class FreeOrders(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a module process is told."""

    endpoint: str
    run: str
    process: int
    modules: list[int]
    keepers: int
    birth: int
    """How often a process has been started for these modules, from 1."""
    scene: str
    """The scene as TOML text."""
    rule: str
    seed: int
    hesitate: float = 0.0
    speeds: dict[int, float] = {}
    """By module how many times slower than at once it chooses: the time it takes to think."""
    jitter: float = 0.0
    """By which share at most its thinking takes longer, at random."""
    schedule: dict[int, list[OwnMove]] | None = None
    """By module its own moves of a schedule, in their order, instead of the rule."""
    credentials: Credentials = GUEST
