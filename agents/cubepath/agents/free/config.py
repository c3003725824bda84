"""The configuration of a module process in a run without rounds.

The fleet and the simulator create it in the same way.
"""

from typing import Literal, TypeAlias

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.credentials import GUEST, Credentials

OnCrash: TypeAlias = Literal["stop", "continue", "restart"]
ON_CRASH: tuple[OnCrash, ...] = ("stop", "continue", "restart")
HALT_S = 5.0
"""How long modules halt after an order to, unless it is repeated."""


class OwnMove(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A module's own move of a schedule, and how often its units were written and read before."""

    placed: GeneratorPlacement
    after: list[tuple[Site, int, int | None]]


class FreeProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The configuration of a module process."""

    endpoint: str
    run: str
    process: int
    modules: list[int]
    keepers: int
    incarnation: int
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
