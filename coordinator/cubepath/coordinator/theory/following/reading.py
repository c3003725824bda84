"""Reading plans of vehicles with the planner's rounds.

It touches only the files it is given.
"""

from __future__ import annotations

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, check_not_empty, opened
from cubepath.protocol.path_files.following import is_following
from cubepath.protocol.path_files.npz import is_npz
from cubepath.protocol.plans.formats import NO_HINTS, PlanHints, read_plan
from cubepath.protocol.plans.imported import Imported
from cubepath.protocol.plans.scenario import is_scenario, read_scenario
from cubepath.protocol.plans.vehicle_plan import VehiclePlan
from cubepath.protocol.recordings.recording import is_recording

_EXPECTED = (
    "expected a scenario or another program's plan of vehicles: --following is for those alone"
)


def read_vehicle_plan(
    source: Source, system: str | None = None, hints: PlanHints = NO_HINTS
) -> VehiclePlan:
    """Read a plan of vehicles, in which some may rotate; `hints` are as for `read_input`.

    InputError if the file cannot be read, holds no plan of vehicles on a grid, or holds an illegal
    move.

    >>> from pathlib import Path
    >>> _ = Path("train.json").write_text(
    ...     '{"starts": [[0, 0], [1, 0]], "goals": [[1, 0], [2, 0]],'
    ...     ' "moves": [[[1, 0], [2, 0]], [[0, 0], [1, 0]]], "rounds": [2]}'
    ... )
    >>> plan = read_vehicle_plan("train.json")
    >>> move = plan.moves[0]
    >>> move.vehicle, move.source, move.target, move.round
    (1, (1, 0), (2, 0), 1)
    """
    with opened(source) as file:
        check_not_empty(file)
        path = file.path
        found: Imported | None = None
        if is_following(file):
            raise InputError(f"{path}: a timetable of vehicles that follow already; {_EXPECTED}")
        if is_recording(file):
            raise InputError(f"{path}: a recording, whose rounds are cubes already; {_EXPECTED}")
        if not is_npz(file):
            found = read_plan(file, hints.format, companions=hints.companions, system=system)
            if found is None and is_scenario(file):
                if hints.companions or system is not None:
                    given = "--with" if hints.companions else "--system"
                    raise InputError(
                        f"{path}: a scenario, which says itself what its system is: expected no"
                        f" {given}"
                    )
                found = read_scenario(file)
        if found is None:
            raise InputError(f"{path}: a moves file, in which no vehicles are told; {_EXPECTED}")
        if found.vehicles is None:
            raise InputError(f"{path}: a plan of moves, not of vehicles; {_EXPECTED}")
        return found.vehicles()
