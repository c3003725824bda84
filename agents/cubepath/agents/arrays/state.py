"""Where the modules of a batch are, what they observe, and memory for their claims.

The first axis of all arrays but those of `Scratch` is the environment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import Bits, Ints

STAYED, GRANTED, LOST, ILLEGAL = 0, 1, 2, 3
"""What came of a module's action."""
SILENT = np.iinfo(np.int32).min


class BatchState(NamedTuple):
    """Where the modules are; the first axis is the environment."""

    place: Ints
    """Shape (environments, modules): the number of the place of each module."""
    code: Ints
    """What each module shows."""
    shown: Ints
    """Shape (environments, places): what each place shows."""
    module: Ints
    """The module at each place, -1 for none."""
    bits: Bits
    """Shape (environments, modules, words): the probes of each module, when it last observed."""
    at_goal: NDArray[np.int64]
    """How many modules of each environment are on sites of the goal."""
    round: NDArray[np.int64]
    key: Bits
    """What the ranks of claims are drawn under, by the seed of each environment."""
    said: Ints
    """Shape (environments, modules, note_length): the last notes."""


class ObservationArrays(NamedTuple):
    """What all modules observe, as `observe` documents it."""

    observation: Ints
    """Shape (environments, modules, observation_length)."""
    mask: NDArray[np.int8]
    """Shape (environments, modules, move_slots + 1)."""
    notes: Ints
    """Shape (environments, modules, reach_slots, note_length)."""


class Scratch(NamedTuple):
    """Memory for the claims of one environment."""

    head: Ints
    """By place, the last site of a trace there, -1 for none."""
    claim: Ints
    """By such site, whose it is; the claims are numbered in the order of the modules."""
    code: Ints
    following: Ints
    claimant: Ints
    """By claim, the module."""
    move: Ints
    """By claim, the number of its move among all kinds."""
    first: Ints
    """By claim, the first entry with a rival, -1 for none: entry 2 p + s is pair p from side s."""
    granted: NDArray[np.uint8]
    """By claim: 0 while it is open, 1 if it is granted."""
    waiting: Ints
    """The claims with rivals."""
    stack: Ints
    rivals: Ints
    """Shape (pairs, 4): two claims, and for each of them its next entry."""
    rank: Bits
    """By claim, if it has rivals."""
    movers: Ints
