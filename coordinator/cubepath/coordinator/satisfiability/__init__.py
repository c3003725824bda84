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
    from cubepath.coordinator.satisfiability.encoding import (
        Encoding,
        TooLargeError,
        encode,
        prepare,
    )
    from cubepath.coordinator.satisfiability.met_moves import MetMoves
    from cubepath.coordinator.satisfiability.proving import (
        PROPAGATION,
        SEARCH,
        WINDOWS,
        Prover,
        Refutation,
    )
    from cubepath.coordinator.satisfiability.solver_process import (
        LOG_MAX,
        SECOND_SOLVER,
        SOLVER,
        Answer,
        Problem,
        SolverError,
        SolverProcess,
        check_installed,
        solvers_installed,
    )
    from cubepath.coordinator.satisfiability.window_bounds import window_bound
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "clauses": "OFF ON",
            "encoding": "Encoding TooLargeError encode prepare",
            "met_moves": "MetMoves",
            "proving": "PROPAGATION Prover Refutation SEARCH WINDOWS",
            "solver_process": (
                "Answer LOG_MAX Problem SECOND_SOLVER SOLVER SolverError SolverProcess "
                "check_installed solvers_installed"
            ),
            "window_bounds": "window_bound",
        },
    )

__all__ = [
    "LOG_MAX",
    "OFF",
    "ON",
    "PROPAGATION",
    "SEARCH",
    "SECOND_SOLVER",
    "SOLVER",
    "WINDOWS",
    "Answer",
    "Encoding",
    "MetMoves",
    "Problem",
    "Prover",
    "Refutation",
    "SolverError",
    "SolverProcess",
    "TooLargeError",
    "check_installed",
    "encode",
    "prepare",
    "solvers_installed",
    "window_bound",
]
