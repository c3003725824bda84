"""Plans of other planners, read as moves of the systems here.

Room: protocol. There is one module per format; `read_plan` detects the format. It imports
`path_files`, `scenes`, `systems` and `core`. Only shortening takes such plans.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.plans.formats import NO_HINTS, PlanHints, read_plan
    from cubepath.protocol.plans.imported import Imported
    from cubepath.protocol.plans.scenario import is_scenario, read_scenario
    from cubepath.protocol.plans.vehicle_plan import VehicleMove, VehiclePlan
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "formats": "NO_HINTS PlanHints read_plan",
            "imported": "Imported",
            "scenario": "is_scenario read_scenario",
            "vehicle_plan": "VehicleMove VehiclePlan",
        },
    )

__all__ = [
    "NO_HINTS",
    "Imported",
    "PlanHints",
    "VehicleMove",
    "VehiclePlan",
    "is_scenario",
    "read_plan",
    "read_scenario",
]
