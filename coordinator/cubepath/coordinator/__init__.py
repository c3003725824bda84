"""Coordinator: the global view, from launching a run to its shortest schedule and its record.

Room: coordinator; imports the protocol, and from the agents only what starts, names and draws them.
It offers what a user needs: run, replay and verify, shorten and convert, certificates and
timetables, complexes and their topology, searches past the homotopy class with their bounds,
pictures, standard instances, and the paper's claims. Inside the project, import each name from the
module that defines it.

| room | holds | may import |
|---|---|---|
| `normal_form` | heaps of pieces, the normal cube path, its proof and its timetable | none |
| `complexes` | state and shape complexes, links, homology, collapses | none |
| `verification` | recordings and certificates derived again | `normal_form.definitions` alone |
| `search` | exact optima, lower bounds, shorter paths | `complexes`, `normal_form` |
| `runs` | runs, schedules, replay, pictures | `search`, `verification`, `normal_form` |
| `simulation` | whole runs under faults, each from its seed | `runs`, `verification` |
| `shortening` | paths from files and recordings | `runs`, `search`, `verification`, `normal_form` |
| `paper` | the paper's claims, computed | `complexes`, `normal_form` |
| `experiments` | sweeps of many runs, and reports | `simulation`, `runs`, `search`, `normal_form` |
| `testing` | for the tests of others, and pytest | `runs`, `simulation`, `shortening` |
| `commands` | the command line | all of these |
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.auditing import audit
    from cubepath.coordinator.complexes import (
        Collapsed,
        CubicalComplex,
        Explored,
        Homology,
        Lift,
        Links,
        Macro,
        ShapeComplex,
        StateComplex,
        Surface,
        actions_at,
        check_links,
        collapse,
        complex_from_faces,
        contractibility,
        draw_complex,
        explore,
        f_vector,
        homology,
        lift,
        macro,
        shape_complex,
        state_complex,
        surface,
        to_networkx,
        unfilled,
        write_complex,
    )
    from cubepath.coordinator.experiments import (
        FaultRates,
        Report,
        StandardInstance,
        Sweep,
        SweepResults,
        read_sweep,
        standard,
        sweep,
        write_report,
    )
    from cubepath.coordinator.normal_form import (
        Timetable,
        certificate_of,
        durations_of,
        earliest,
        end_state,
        is_cube,
        is_normal,
        normal_cube_path,
    )
    from cubepath.coordinator.paper import Claim, Row, all_claims, compute_claims
    from cubepath.coordinator.runs import (
        Gatherer,
        Outcome,
        Overheard,
        Plan,
        Replayed,
        Running,
        Status,
        Tap,
        animate,
        ask,
        gathered,
        info,
        replay,
        run,
        run_picture,
        start,
    )
    from cubepath.coordinator.search import (
        Improved,
        Optimum,
        Transitions,
        improve,
        lower_bound,
        only_class,
        optimum,
    )
    from cubepath.coordinator.shortening import (
        Beyond,
        Converted,
        PathInput,
        Shortened,
        Task,
        beyond,
        convert,
        shorten,
        task_of,
    )
    from cubepath.coordinator.verification import (
        Recovered,
        Verification,
        check_certificate,
        check_proof,
        recover,
        verify,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "auditing": "audit",
            "complexes": (
                "Collapsed CubicalComplex Explored Homology Lift Links Macro ShapeComplex "
                "StateComplex Surface actions_at check_links collapse complex_from_faces "
                "contractibility draw_complex explore f_vector homology lift macro shape_complex "
                "state_complex surface to_networkx unfilled write_complex"
            ),
            "experiments": (
                "FaultRates Report StandardInstance Sweep SweepResults read_sweep standard sweep "
                "write_report"
            ),
            "normal_form": (
                "Timetable certificate_of durations_of earliest end_state is_cube is_normal "
                "normal_cube_path"
            ),
            "paper": "Claim Row all_claims compute_claims",
            "runs": (
                "Gatherer Outcome Overheard Plan Replayed Running Status Tap animate ask gathered "
                "info replay run run_picture start"
            ),
            "search": "Improved Optimum Transitions improve lower_bound only_class optimum",
            "shortening": (
                "Beyond Converted PathInput Shortened Task beyond convert shorten task_of"
            ),
            "verification": "Recovered Verification check_certificate check_proof recover verify",
        },
    )

__all__ = [
    "Beyond",
    "Claim",
    "Collapsed",
    "Converted",
    "CubicalComplex",
    "Explored",
    "FaultRates",
    "Gatherer",
    "Homology",
    "Improved",
    "Lift",
    "Links",
    "Macro",
    "Optimum",
    "Outcome",
    "Overheard",
    "PathInput",
    "Plan",
    "Recovered",
    "Replayed",
    "Report",
    "Row",
    "Running",
    "ShapeComplex",
    "Shortened",
    "StandardInstance",
    "StateComplex",
    "Status",
    "Surface",
    "Sweep",
    "SweepResults",
    "Tap",
    "Task",
    "Timetable",
    "Transitions",
    "Verification",
    "actions_at",
    "all_claims",
    "animate",
    "ask",
    "audit",
    "beyond",
    "certificate_of",
    "check_certificate",
    "check_links",
    "check_proof",
    "collapse",
    "complex_from_faces",
    "compute_claims",
    "contractibility",
    "convert",
    "draw_complex",
    "durations_of",
    "earliest",
    "end_state",
    "explore",
    "f_vector",
    "gathered",
    "homology",
    "improve",
    "info",
    "is_cube",
    "is_normal",
    "lift",
    "lower_bound",
    "macro",
    "normal_cube_path",
    "only_class",
    "optimum",
    "read_sweep",
    "recover",
    "replay",
    "run",
    "run_picture",
    "shape_complex",
    "shorten",
    "standard",
    "start",
    "state_complex",
    "surface",
    "sweep",
    "task_of",
    "to_networkx",
    "unfilled",
    "verify",
    "write_complex",
    "write_report",
]
