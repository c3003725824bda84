"""Timetables as files: what `cubepath shorten --following RULE -o FILE` writes.

They are checked by code that shares nothing with what computed them before anybody is told.
"""

from __future__ import annotations

from cubepath.coordinator.theory.following.timetable import FollowingTimetable
from cubepath.coordinator.theory.proof_checking.following import check_following
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.path_files.durations import time_text
from cubepath.protocol.path_files.following import FollowingFile, FollowingHead, FollowingLine
from cubepath.protocol.plans.vehicle_plan import VehiclePlan


def checked(timetable: FollowingFile, plan: VehiclePlan) -> FollowingFile:
    """Return a timetable that keeps to its rule; a CheckError means a bug in computing it."""
    for check, why in check_following(timetable, plan).items():
        if why is not None:
            raise CheckError(f"the timetable does not hold: {check}: {why}")
    return timetable


def timetable_file(found: FollowingTimetable, *, timed: bool = False) -> FollowingFile:
    """Return a timetable as a file: by rounds, or with `timed` by when each move begins and ends.

    Moves are in order of start, and then of the plan.

    >>> from pathlib import Path
    >>> _ = Path("train.json").write_text(
    ...     '{"starts": [[0, 0], [1, 0]], "goals": [[1, 0], [2, 0]],'
    ...     ' "moves": [[[1, 0], [2, 0]], [[0, 0], [1, 0]]], "rounds": [2]}'
    ... )
    >>> plan = read_vehicle_plan("train.json")
    >>> file = timetable_file(following_timetable(plan, "cgshop"))
    >>> line = file.lines[1]
    >>> file.head.rounds, line.vehicle, line.round
    (1, 0, 1)
    """
    plan = found.plan
    lines: list[FollowingLine] = []
    for place in sorted(found.starts, key=lambda place: (found.starts[place], place)):
        move, start, after = plan.moves[place], found.starts[place], found.binding[place]
        lines.append(
            FollowingLine(
                move.vehicle,
                move.source,
                move.target,
                round=None if timed else int(start) + 1,
                start=time_text(start) if timed else None,
                end=time_text(start + found.durations[place]) if timed else None,
                move=place + 1,
                after=None if after is None else after + 1,
            )
        )
    head = FollowingHead(
        found.rule,
        vehicles=len(plan.starts),
        moves=len(lines),
        rounds=None if timed else int(found.makespan),
        makespan=time_text(found.makespan) if timed else None,
        input_moves=len(plan.moves),
        cancelled=[(earlier + 1, later + 1) for earlier, later in found.cancelled],
    )
    return FollowingFile(head, tuple(lines))
