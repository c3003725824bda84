"""A lower bound without a solver: the least length at which each site keeps a value."""

from __future__ import annotations

from collections.abc import Callable

from cubepath.coordinator.theory.satisfiability.literal_windows import windows_of
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves

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
    What fits into fewer rounds fits into more, by waiting first or last; so where all moves are
    known, and looking at many rounds finds no more of them, the least number is found by halving.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> window_bound(MetMoves(scene.system, (), scene.start_state, scene.goal), 0, 9)
    3
    """

    def refuted(rounds: int) -> bool:
        met.reach(rounds)
        met.spend(len(met.actions) // _MOVES_A_STEP)
        found = windows_of(met.arrays(), met.on(0), met.on(1), rounds, met.spend).refuted()
        if found and raised is not None:
            raised(rounds)
        return found

    stride, open_from = 1, most
    while least < open_from:
        rounds = min(least + stride - 1, open_from - 1)
        if refuted(rounds):
            least = rounds + 1
            stride *= 2 if met.complete and open_from == most else 1
        else:
            open_from = rounds
        if met.complete and open_from < most:
            stride = max(1, (open_from - least + 1) // 2)
    return least
