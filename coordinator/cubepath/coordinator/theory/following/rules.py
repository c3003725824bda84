"""The rules by which a vehicle may follow another into a vertex, and the inequalities they mean.

Under the rule of multi-agent path finding (`mapf`) a vehicle may enter a vertex while another
leaves it: it begins to enter no earlier than the other begins to leave, and arrives no earlier than
the other has left. Under that of CG:SHOP 2021 (`cgshop`) it may do so only in the direction in
which the other leaves; otherwise it begins when the other has left. Where all moves take one round,
"no earlier" is: in the same round, or later. Nobody swaps places along an edge.

For unit squares that move at a constant pace the rule of CG:SHOP is what their bodies allow: two of
them on a line do not overlap if and only if the one behind neither begins nor arrives earlier.
"""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from cubepath.protocol.plans.vehicle_plan import VehicleMove

Rule: TypeAlias = Literal["mapf", "cgshop"]
RULES: Final[tuple[Rule, ...]] = ("mapf", "cgshop")


def same_direction(one: VehicleMove, other: VehicleMove) -> bool:
    """Return whether two moves on a grid go in one direction."""
    return all(
        b - a == d - c
        for a, b, c, d in zip(one.source, one.target, other.source, other.target, strict=True)
    )


def may_overlap(rule: Rule, leaving: VehicleMove, entering: VehicleMove) -> bool:
    """Return whether a vertex may be entered by one move while another leaves it."""
    return rule == "mapf" or same_direction(leaving, entering)


def wait(rule: Rule, leaving: VehicleMove, entering: VehicleMove, times: tuple[int, int]) -> int:
    """Return how much later than `leaving` the move `entering` begins at least.

    `times` is how long the two take, in any unit.
    """
    leaves, enters = times
    return max(0, leaves - enters) if may_overlap(rule, leaving, entering) else leaves
