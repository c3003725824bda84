"""A lower bound without a solver: the least length at which the windows leave every site a value.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from cubepath.coordinator.satisfiability.literal_windows import windows_of
from cubepath.coordinator.satisfiability.met_moves import MetMoves

_MOVES_A_STEP = 64


def window_bound(
    met: MetMoves, least: int, most: int, *, raised: Callable[[int], object] | None = None
) -> int:
    """Return the least number of rounds from `least` to `most` that the windows do not refute.

    No path between the ends of `met` has fewer cubes, if none has fewer than `least`. `raised` is
    called with each number that is refuted; what `met` spends may end this.

    Proof. A value is possible at a time only if the start reaches it by then, and the goal is
    reached from it in the rounds that are left, each as if moves never stood in each other's way.
    On a path every site has a value at every time, so where neither is possible there is no path.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> window_bound(MetMoves(scene.system, (), scene.start_state, scene.goal), 0, 9)
    3
    """
    for rounds in range(least, most):
        met.reach(rounds)
        met.spend(len(met.actions) // _MOVES_A_STEP)
        windows = windows_of(met.arrays(), met.on(0), met.on(1), rounds)
        if windows.value_possible().any(axis=1).all():
            return rounds
        if raised is not None:
            raised(rounds)
    return most
