"""Whether a path of so many rounds leads from one state to another, asked of SAT solvers.

Room: coordinator. It takes a system or a list of actions, and two states: it knows no files, no
messages and no kind of system. From the protocol it imports `core`, from the coordinator
`normal_form`. `search` and `shortening` use it; `verification` shares nothing with it, and checks
what it proves by code of its own.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.satisfiability.clauses import OFF, ON
    from cubepath.coordinator.satisfiability.encoding import prepare
    from cubepath.coordinator.satisfiability.met_moves import MetMoves
    from cubepath.coordinator.satisfiability.proving import WINDOWS, Prover, Refutation
    from cubepath.coordinator.satisfiability.solver_process import (
        SECOND_SOLVER,
        SOLVER,
        Answer,
        Problem,
        SolverError,
        SolverProcess,
        check_installed,
    )
    from cubepath.coordinator.satisfiability.window_bounds import window_bound
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "clauses": "OFF ON",
            "encoding": "prepare",
            "met_moves": "MetMoves",
            "proving": "WINDOWS Prover Refutation",
            "solver_process": (
                "Answer Problem SECOND_SOLVER SOLVER SolverError SolverProcess check_installed"
            ),
            "window_bounds": "window_bound",
        },
    )

__all__ = [
    "OFF",
    "ON",
    "SECOND_SOLVER",
    "SOLVER",
    "WINDOWS",
    "Answer",
    "MetMoves",
    "Problem",
    "Prover",
    "Refutation",
    "SolverError",
    "SolverProcess",
    "check_installed",
    "prepare",
    "window_bound",
]
