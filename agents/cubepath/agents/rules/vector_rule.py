"""The vectorised form of a rule: one function that chooses for all modules of many environments.

It has in arrays what `rule` has for one module. The environments share a scene, and each has a
seed; E is the number of environments, n that of modules.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.random_streams import Streams
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System


@dataclass(frozen=True, slots=True)
class VectorKnowledge:
    """What the modules know from the start, by module: `InitialKnowledge` of all of them.

    `streams` makes the modules' own streams, as they are before anything is drawn, and
    `shared_streams` those that the modules of each environment share, of shape (E, 1). What a rule
    does for one module must follow from that module's part.
    """

    system: System
    environments: int
    starts: tuple[Site, ...]
    goals: tuple[tuple[Site, ...], ...]
    streams: Callable[[], Streams]
    shared_streams: Callable[[], Streams]

    @property
    def modules(self) -> int:
        """Return the number of modules in each environment."""
        return len(self.starts)


class VectorView(NamedTuple):
    """What the modules see in one round: what `observe` returns for each, stacked."""

    observation: NDArray[np.int32]
    """Shape (E, n, `observation_length`)."""
    action_mask: NDArray[np.int8]
    """Shape (E, n, `move_slots` + 1)."""
    notes: NDArray[np.int32]
    """Shape (E, n, `reach_slots`, note length)."""
    playing: NDArray[np.bool_]
    """Shape (E,): False for environments that are over; nothing is chosen or drawn there."""


class VectorChoice(NamedTuple):
    """Where a rule in vectorised form writes what it chooses, of environments that are playing."""

    actions: NDArray[np.int32]
    """Shape (E, n), `STAY` before the rule is asked."""
    notes: NDArray[np.int32]
    """Shape (E, n, note length): the last notes, zeros at first; one left as it is is kept."""


class RuleFailure(NamedTuple):
    """A module finds that it cannot reach its goal: `Choice.failed`."""

    environment: int
    module: int
    why: str


VectorRule: TypeAlias = Callable[[VectorView, VectorChoice], Iterable[RuleFailure]]
"""It is called once per round, and returns who gives up. The arrays are C-contiguous."""
