"""Plans of vehicles read from files, and timetables and proofs about them written to files.

A timetable is checked before it is printed, by code that shares nothing with the code that computed
it.
"""

from dataclasses import replace

from cubepath.coordinator.theory.following.optimum import Refuted, cell_of
from cubepath.coordinator.theory.following.timetable import FollowingTimetable
from cubepath.coordinator.theory.proof_checking.following import check_following
from cubepath.coordinator.theory.satisfiability.solver_process import pieces_of
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.file_forms import NO_HINTS, PlanHints, form_of, read_plan
from cubepath.protocol.path_files.durations import time_text
from cubepath.protocol.path_files.following import (
    FollowingFile,
    FollowingHead,
    FollowingLine,
    FollowingProof,
)
from cubepath.protocol.plans.imported import VehiclePlan

_EXPECTED = (
    "expected a scenario or another program's plan of vehicles: --following is for those alone"
)


def read_vehicle_plan(
    source: Source, system: str | None = None, hints: PlanHints = NO_HINTS
) -> VehiclePlan:
    """Read a plan of vehicles, in which some may rotate; `hints` are as for `read_input`.

    InputError if the file cannot be read, holds no plan of vehicles on a grid, or holds an illegal
    move.
    """
    with opened(source) as file:
        path, form = file.path, form_of(file)
        if form.name == "following timetable":
            raise InputError(f"{path}: a timetable of vehicles that follow already; {_EXPECTED}")
        if form.name == "recording":
            raise InputError(f"{path}: a recording, whose rounds are cubes already; {_EXPECTED}")
        if not form.plan and hints.format is None:
            raise InputError(f"{path}: {form.what}, which names no vehicles; {_EXPECTED}")
        spec = hints.format or form.name
        found = read_plan(file, spec, companions=hints.companions, system=system)
        if found.vehicles is None:
            raise InputError(f"{path}: a plan of moves, not of vehicles; {_EXPECTED}")
        return found.vehicles()


def checked(timetable: FollowingFile, plan: VehiclePlan) -> FollowingFile:
    """Return a timetable that keeps to its rule; a CheckError means a bug in computing it."""
    for check, why in check_following(timetable, plan).items():
        if why is not None:
            raise CheckError(f"the timetable does not hold: {check}: {why}")
    return timetable


def timetable_file(found: FollowingTimetable, *, timed: bool = False) -> FollowingFile:
    """Return a timetable as a file: by rounds, or with `timed` by when each move begins and ends.

    Moves are in order of start, and then of the plan.
    """
    plan = found.plan
    lines: list[FollowingLine] = []
    for place in sorted(found.starts, key=found.starts.__getitem__):  # by place they are already
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


def fewest_rounds_proof(refuted: Refuted, timetable: FollowingFile) -> FollowingProof:
    """Return the proof that no timetable has so few rounds as were refuted.

    `timetable` is the best that is known, by rounds. The log of the refutation is read when the
    proof is written.
    """
    task, clauses = refuted.task, refuted.clauses
    places = task.places
    rounds = timetable.head.rounds or 0
    schedule: list[list[tuple[int, int]]] = [[] for _ in range(rounds)]
    for line in timetable.lines:
        schedule[(line.round or 1) - 1].append((line.vehicle, places[line.target]))
    edges = [(places[one], places[other]) for one, other in task.edges]
    proof = FollowingProof(
        rule=task.rule,
        starts=task.starts,
        ends=task.ends,
        vertices=[cell_of(site) for site in places],
        edges=edges,
        refuted=refuted.rounds,
        solver=refuted.why,
        log=pieces_of(refuted.log),
        schedule=schedule,
    )
    return proof if clauses is None else replace(proof, variables=clauses.meanings)
