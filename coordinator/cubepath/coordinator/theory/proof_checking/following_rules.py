"""Carrying out a timetable of vehicles by the definition of the rule for following.

In rounds: at the end of each, no two vehicles are at one vertex; no two swap places; a vertex where
somebody stands is entered only if that vehicle leaves it in this round, under the rule of CG:SHOP
2021 only in the same direction. With unequal times a vehicle holds the vertex that it leaves until
its move ends, and the one that it enters from when its move begins. Two hold one vertex only while
one leaves it and the other enters it, who neither begins nor ends earlier; under the rule of
CG:SHOP 2021 only in the same direction. No two are on one edge at one time in opposite directions.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

from cubepath.protocol.core.sites import site_text
from cubepath.protocol.path_files.durations import time_text
from cubepath.protocol.path_files.following import FollowingFile, FollowingLine
from cubepath.protocol.plans.vehicle_plan import VehiclePlan

Cell = tuple[int, int]


def why_illegal(timetable: FollowingFile, plan: VehiclePlan) -> str | None:
    """Return the first thing that a timetable does against its rule, None if it keeps to it.

    Only for lines of vehicles that the plan has.
    """
    rule = timetable.head.rule
    if timetable.head.rounds is not None:
        return why_not_in_rounds(timetable.lines, plan.starts, rule)
    ways: dict[int, list[FollowingLine]] = {who: [] for who in range(len(plan.starts))}
    for line in sorted(timetable.lines, key=lambda line: line.times):
        ways[line.vehicle].append(line)
    for who, way in ways.items():
        why = _why_no_way(who, plan.starts[who], way)
        if why is not None:
            return why
    return _why_vertex_shared(ways, plan.starts, rule) or _why_edge_shared(timetable.lines)


def why_not_in_rounds(
    lines: Iterable[FollowingLine], starts: Iterable[Cell], rule: str
) -> str | None:
    """Return the first thing that moves of one round each do against a rule, None if nothing."""
    rounds: dict[int, list[FollowingLine]] = {}
    for line in lines:
        rounds.setdefault(line.round or 0, []).append(line)
    at = list(starts)
    for number, moving in sorted(rounds.items()):
        standing = {cell: who for who, cell in enumerate(at)}
        goes = {line.vehicle: line for line in moving}
        if len(goes) < len(moving):
            return f"round {number}: a vehicle moves twice"
        for line in moving:
            why = _why_not(line, at, standing, goes, rule)
            if why is not None:
                return f"round {number}: {_told(line)}: {why}"
        for line in moving:
            at[line.vehicle] = line.target
        if len(set(at)) < len(at):
            return f"round {number}: two vehicles are at {site_text(_twice(at))}"
    return None


def _why_not(
    line: FollowingLine,
    at: list[Cell],
    standing: dict[Cell, int],
    goes: dict[int, FollowingLine],
    rule: str,
) -> str | None:
    if at[line.vehicle] != line.source:
        return f"it is at {site_text(at[line.vehicle])}"
    there = standing.get(line.target)
    if there is None:
        return None
    ahead = goes.get(there)
    if ahead is None:
        return f"vehicle {there} stays there"
    if ahead.target == line.source:
        return f"vehicle {there} comes the other way"
    if rule == "cgshop" and _direction(ahead) != _direction(line):
        return f"vehicle {there} leaves it in another direction"
    return None


def _why_no_way(who: int, start: Cell, way: list[FollowingLine]) -> str | None:
    """Return why the moves of a vehicle, in order of time, are no way from its start."""
    here = start
    for line in way:
        if line.source != here:
            return f"{_told(line)}: it is at {site_text(here)}"
        here = line.target
    for one, other in pairwise(way):
        if other.times[0] < one.times[1]:
            return f"vehicle {who} begins a move at {_at(other)} before its last has ended"
    return None


def _why_vertex_shared(
    ways: dict[int, list[FollowingLine]], starts: Iterable[Cell], rule: str
) -> str | None:
    """Return where two vehicles hold one vertex without following."""
    stays: dict[Cell, list[tuple[FollowingLine | None, FollowingLine | None, int]]] = {}
    for who, start in enumerate(starts):
        moves = (None, *ways[who], None)
        for arrives, leaves in pairwise(moves):
            cell = start if arrives is None else arrives.target
            stays.setdefault(cell, []).append((arrives, leaves, who))
    for cell, here in stays.items():
        here.sort(key=lambda stay: (stay[0] is not None, stay[0].times if stay[0] else ()))
        for (_, leaves, first), (arrives, _, second) in pairwise(here):
            if arrives is None:
                return f"vehicles {first} and {second} both start at {site_text(cell)}"
            if leaves is None:
                return f"{_told(arrives)}, at {_at(arrives)}: vehicle {first} stays there"
            (begin, end), (next_begin, next_end) = leaves.times, arrives.times
            if end <= next_begin:
                continue
            if next_begin < begin or next_end < end:
                return f"{_told(arrives)}, at {_at(arrives)}: vehicle {first} has not left it"
            if rule == "cgshop" and _direction(leaves) != _direction(arrives):
                return (
                    f"{_told(arrives)}, at {_at(arrives)}: vehicle {first} leaves it in another"
                    " direction"
                )
    return None


def _why_edge_shared(lines: Iterable[FollowingLine]) -> str | None:
    edges: dict[frozenset[Cell], list[FollowingLine]] = {}
    for line in lines:
        edges.setdefault(frozenset((line.source, line.target)), []).append(line)
    for along in edges.values():
        along.sort(key=lambda line: line.times)
        for one, other in pairwise(along):
            if other.times[0] < one.times[1]:
                return f"{_told(other)}, at {_at(other)}: vehicle {one.vehicle} is on that edge"
    return None


def _direction(line: FollowingLine) -> Cell:
    return line.target[0] - line.source[0], line.target[1] - line.source[1]


def _told(line: FollowingLine) -> str:
    return f"vehicle {line.vehicle}, {site_text(line.source)} to {site_text(line.target)}"


def _at(line: FollowingLine) -> object:
    return time_text(line.times[0])


def _twice(at: list[Cell]) -> Cell:
    return next(cell for place, cell in enumerate(at) if cell in at[:place])
