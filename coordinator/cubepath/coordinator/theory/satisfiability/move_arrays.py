"""Supports, traces and local states of actions as arrays, for compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.int32]
IN_TRACE, FREE = 4, 8
"""Flags of a site in a support; the two lowest bits are its values in the two local states."""


class MoveArrays(NamedTuple):
    """The supports of actions, one after another.

    The sites of action ``a`` are ``sites[starts[a]:starts[a + 1]]``, with their `codes`: bit 0 and
    bit 1 hold the values in its two local states, `IN_TRACE` and `FREE` say the rest. Its guards
    ``(p, q)``, if p is on then q is on, are rows of `guards`.
    """

    starts: Numbers
    sites: Numbers
    codes: Numbers
    guard_starts: Numbers
    guards: Numbers
