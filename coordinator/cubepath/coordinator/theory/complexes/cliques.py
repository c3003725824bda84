"""The cliques of a small graph, one after another, for compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled


@compiled
def following(
    agree: NDArray[np.bool_],
    chosen: NDArray[np.int32],
    depth: int,
    deeper: bool,  # noqa: FBT001
) -> int:
    """Change the clique ``chosen[:depth]`` into the next one; return its size, 0 after the last.

    `agree` is symmetric, shape (size, size); `chosen` has room for `size` vertices in ascending
    order. Cliques come in lexicographic order, beginning with depth 0, the empty one. Without
    `deeper`, cliques that contain the current one are skipped.
    """
    size = len(agree)
    place = chosen[depth - 1] + 1 if depth else 0
    if not deeper:
        depth -= 1
    while True:
        while place < size:
            fits = True
            for other in range(depth):
                if not agree[place, chosen[other]]:
                    fits = False
                    break
            if fits:
                chosen[depth] = place
                return depth + 1
            place += 1
        if depth == 0:
            return 0
        depth -= 1
        place = chosen[depth] + 1
