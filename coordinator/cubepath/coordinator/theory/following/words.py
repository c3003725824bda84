"""The chain of moves that proves a timetable the least, in words."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from cubepath.coordinator.theory.following.rules import same_direction
from cubepath.coordinator.theory.following.timetable import FollowingTimetable
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.path_files.durations import time_text


def chain_in_words(found: FollowingTimetable, *, timed: bool = False) -> list[str]:
    """Return lines on why no timetable of these moves, in their order, is shorter."""
    if not found.chain:
        return ["Nothing moves."]
    count = len(found.chain)
    what = "A chain of one move" if count == 1 else f"A chain of {count} moves"
    lines = [f"{what}, each of which binds the next:", *_links(found, timed=timed)]
    whole = time_text(found.makespan)
    units = "" if timed else " round" if whole == 1 else " rounds"
    lines.append(
        f"Checked, so proved: under the rule {found.rule} these moves, with every vertex visited in"
        f" the order of the input, take at least {whole}{units}."
    )
    return lines


def _links(found: FollowingTimetable, *, timed: bool) -> Iterator[str]:
    moves = found.plan.moves
    reasons = [""] + [f"  {_why(found, one, other)}" for one, other in pairwise(found.chain)]
    for place, why in zip(found.chain, reasons, strict=True):
        move, start = moves[place], found.starts[place]
        when = f"from {time_text(start)}" if timed else f"round {int(start) + 1}"
        goes = f"{site_text(move.source)} to {site_text(move.target)}"
        called = f"{found.plan.called} {move.vehicle}"
        yield f"  {when:<8}  move {place + 1}  {called}, {goes}{why}"


def _why(found: FollowingTimetable, before: int, after: int) -> str:
    one, other = found.plan.moves[before], found.plan.moves[after]
    if one.vehicle == other.vehicle:
        return "after its last move"
    follows = found.rule == "mapf" or same_direction(one, other)
    return f"{'follows' if follows else 'waits for'} {found.plan.called} {one.vehicle}"
