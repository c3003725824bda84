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
| `runs` | runs, schedules, pictures | `search`, `verification`, `normal_form` |
| `playback` | recordings put back on zenoh, under control | `runs`, `verification` |
| `simulation` | whole runs under faults, each from its seed | `runs`, `verification` |
| `shortening` | paths from files and recordings | `runs`, `search`, `verification`, `normal_form` |
| `following` | plans whose vehicles follow | `satisfiability`, `verification` |
| `comparison` | two runs, where they part and why | `auditing`, `verification`, `shortening` |
| `paper` | the paper's claims, computed | `complexes`, `normal_form` |
| `viewing` | a run as a page in a browser | `runs`, `complexes`, `normal_form` |
| `live` | the same page while a run goes on | `viewing`, `runs`, `normal_form` |
| `experiments` | sweeps of many runs, and reports | `simulation`, `runs`, `search`, `normal_form` |
| `testing` | for the tests of others, and pytest | `runs`, `playback`, `simulation`, `shortening` |
| `attached` | a live run recorded from outside | `runs` |
| `exports` | recordings for other tools | `shortening`, `runs` |
| `commands` | the command line | all of these |
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.attached import Recorder, record
    from cubepath.coordinator.auditing import audit
    from cubepath.coordinator.comparison import Compared, diff
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
    from cubepath.coordinator.exports import Exported, export
    from cubepath.coordinator.following import (
        FewestRounds,
        FollowingTimetable,
        fewest_rounds,
        fewest_rounds_proof,
        following_timetable,
        read_vehicle_plan,
        timetable_file,
    )
    from cubepath.coordinator.live import Live, watch_run
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
    from cubepath.coordinator.playback import Player, PlayerStatus, Position, Replayed, replay
    from cubepath.coordinator.runs import (
        Divergence,
        Gatherer,
        LiveReplay,
        Outcome,
        Overheard,
        Plan,
        Running,
        Sheet,
        Status,
        Tap,
        animate,
        animate_beside,
        ask,
        gathered,
        info,
        replay_live,
        run,
        run_picture,
        start,
        what_if,
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
        ProvedFewest,
        ProvedOptimal,
        Recovered,
        Verification,
        check_certificate,
        check_fewest_rounds,
        check_following,
        check_optimality,
        check_proof,
        recover,
        verify,
    )
    from cubepath.coordinator.viewing import Shown, page_document, run_page
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "attached": "Recorder record",
            "auditing": "audit",
            "comparison": "Compared diff",
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
            "exports": "Exported export",
            "following": (
                "FewestRounds FollowingTimetable fewest_rounds fewest_rounds_proof "
                "following_timetable read_vehicle_plan timetable_file"
            ),
            "live": "Live watch_run",
            "normal_form": (
                "Timetable certificate_of durations_of earliest end_state is_cube is_normal "
                "normal_cube_path"
            ),
            "paper": "Claim Row all_claims compute_claims",
            "playback": "Player PlayerStatus Position Replayed replay",
            "runs": (
                "Divergence Gatherer LiveReplay Outcome Overheard Plan Running Sheet Status Tap "
                "animate animate_beside ask gathered info replay_live run run_picture start "
                "what_if"
            ),
            "search": "Improved Optimum Transitions improve lower_bound only_class optimum",
            "shortening": (
                "Beyond Converted PathInput Shortened Task beyond convert shorten task_of"
            ),
            "verification": (
                "ProvedFewest ProvedOptimal Recovered Verification check_certificate "
                "check_fewest_rounds check_following check_optimality check_proof recover verify"
            ),
            "viewing": "Shown page_document run_page",
        },
    )

__all__ = [
    "Beyond",
    "Claim",
    "Collapsed",
    "Compared",
    "Converted",
    "CubicalComplex",
    "Divergence",
    "Explored",
    "Exported",
    "FaultRates",
    "FewestRounds",
    "FollowingTimetable",
    "Gatherer",
    "Homology",
    "Improved",
    "Lift",
    "Links",
    "Live",
    "LiveReplay",
    "Macro",
    "Optimum",
    "Outcome",
    "Overheard",
    "PathInput",
    "Plan",
    "Player",
    "PlayerStatus",
    "Position",
    "ProvedFewest",
    "ProvedOptimal",
    "Recorder",
    "Recovered",
    "Replayed",
    "Report",
    "Row",
    "Running",
    "ShapeComplex",
    "Sheet",
    "Shortened",
    "Shown",
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
    "animate_beside",
    "ask",
    "audit",
    "beyond",
    "certificate_of",
    "check_certificate",
    "check_fewest_rounds",
    "check_following",
    "check_links",
    "check_optimality",
    "check_proof",
    "collapse",
    "complex_from_faces",
    "compute_claims",
    "contractibility",
    "convert",
    "diff",
    "draw_complex",
    "durations_of",
    "earliest",
    "end_state",
    "explore",
    "export",
    "f_vector",
    "fewest_rounds",
    "fewest_rounds_proof",
    "following_timetable",
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
    "page_document",
    "read_sweep",
    "read_vehicle_plan",
    "record",
    "recover",
    "replay",
    "replay_live",
    "run",
    "run_page",
    "run_picture",
    "shape_complex",
    "shorten",
    "standard",
    "start",
    "state_complex",
    "surface",
    "sweep",
    "task_of",
    "timetable_file",
    "to_networkx",
    "unfilled",
    "verify",
    "watch_run",
    "what_if",
    "write_complex",
    "write_report",
]
