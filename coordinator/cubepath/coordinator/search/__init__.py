"""Past the homotopy class: exact optima, lower bounds and shorter paths.

Room: coordinator. It takes a system, two states and a path between them; it knows nothing of files
and messages. It imports `complexes`, to find out whether there is only one class, `satisfiability`,
to ask for shorter windows of a path, and `normal_form`. `shortening` uses it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.search.anytime import CubePath, Improved, improve, prepare_all
    from cubepath.coordinator.search.budget import Budget, SpentError, Stage
    from cubepath.coordinator.search.endless import wandering
    from cubepath.coordinator.search.exact import MAX_STATES, Optimum, optimum, too_wide
    from cubepath.coordinator.search.heuristics import Potential, Ways
    from cubepath.coordinator.search.lower_bounds import lower_bound
    from cubepath.coordinator.search.own_ends import OwnEnds, ends_of
    from cubepath.coordinator.search.sat_windows import STAGE
    from cubepath.coordinator.search.simply_connected import only_class
    from cubepath.coordinator.search.transitions import LABELS_MAX, Transitions, maskable
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "anytime": "CubePath Improved improve prepare_all",
            "budget": "Budget SpentError Stage",
            "endless": "wandering",
            "exact": "MAX_STATES Optimum optimum too_wide",
            "heuristics": "Potential Ways",
            "lower_bounds": "lower_bound",
            "own_ends": "OwnEnds ends_of",
            "sat_windows": "STAGE",
            "simply_connected": "only_class",
            "transitions": "LABELS_MAX Transitions maskable",
        },
    )

__all__ = [
    "LABELS_MAX",
    "MAX_STATES",
    "STAGE",
    "Budget",
    "CubePath",
    "Improved",
    "Optimum",
    "OwnEnds",
    "Potential",
    "SpentError",
    "Stage",
    "Transitions",
    "Ways",
    "ends_of",
    "improve",
    "lower_bound",
    "maskable",
    "only_class",
    "optimum",
    "prepare_all",
    "too_wide",
    "wandering",
]
