"""Protocol: what every process agrees on, from sites and actions to systems, files and messages.

Room: protocol; imports neither agents nor coordinator. This face offers what users need: systems
and scenes and their parts, the one definition of admissible and of commuting, files of moves,
cubes, certificates and durations, plans of other planners, recordings, and the errors. Inside the
project, names are imported from the modules that define them.

| room | holds | may import |
|---|---|---|
| `core` | sites, actions, catalogues, `System` and `Scene`, errors | none |
| `systems` | kinds of systems: on a lattice, on a graph, listed, flips | `core` |
| `path_files` | files of moves, cubes, schedules, durations, certificates | `core` |
| `scenes` | scenes by name or from TOML, the families of scenes | `systems`, `core` |
| `wire` | messages, key expressions, sessions | `path_files`, `core` |
| `recordings` | the recording format in MCAP | `wire`, `scenes`, `core` |
| `plans` | plans of other planners | `path_files`, `scenes`, `systems`, `core` |

Two modules belong to no room: `faces`, which builds every face, and `compiled`, which all may use.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.core import (
        CLOSED,
        EDGES,
        EMPTY,
        FILLED,
        FIRST_LABEL,
        HEXAGONS,
        MODULE,
        SQUARES,
        Action,
        Bound,
        Catalogue,
        CheckError,
        CubepathError,
        ExcludedError,
        Generator,
        GeneratorPlacement,
        InputError,
        Lattice,
        Move,
        RuleError,
        Scene,
        Site,
        State,
        System,
        VehicleGraph,
        Ways,
        admissible,
        apply,
        commute,
        in_order,
        site_from_json,
        why_inadmissible,
    )
    from cubepath.protocol.path_files import (
        Certificate,
        Durations,
        FollowingFile,
        FollowingHead,
        FollowingLine,
        FollowingProof,
        MoveName,
        OptimalityProof,
        PathMove,
        TimedLine,
        certificate_schema,
        cube_schema,
        following_schemas,
        move_schemas,
        read_certificate,
        read_cubes,
        read_durations,
        read_following,
        read_following_proof,
        read_moves,
        read_proof,
        read_timetable,
        timetable_schema,
        write_certificate,
        write_cubes,
        write_following,
        write_following_proof,
        write_moves,
        write_proof,
        write_timetable,
    )
    from cubepath.protocol.plans import PlanHints, VehicleMove, VehiclePlan, read_plan
    from cubepath.protocol.recordings import (
        Record,
        Recording,
        RecordingWriter,
        filter_recording,
        merge_recordings,
        read_recording,
        split_recording,
    )
    from cubepath.protocol.scenes import (
        Family,
        all_families,
        hex_catalogue,
        read_scene,
        scene_from_spec,
        scene_from_toml,
        scene_to_toml,
    )
    from cubepath.protocol.systems import FlipSystem, GraphSystem, LatticeSystem, TabledSystem
    from cubepath.protocol.wire import Message, decode, open_client, schema_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "core": (
                "Action Bound CLOSED Catalogue CheckError CubepathError EDGES EMPTY ExcludedError "
                "FILLED FIRST_LABEL Generator GeneratorPlacement HEXAGONS InputError Lattice "
                "MODULE Move RuleError SQUARES Scene Site State System VehicleGraph Ways "
                "admissible apply commute in_order site_from_json why_inadmissible"
            ),
            "path_files": (
                "Certificate Durations FollowingFile FollowingHead FollowingLine FollowingProof "
                "MoveName OptimalityProof PathMove TimedLine certificate_schema cube_schema "
                "following_schemas move_schemas read_certificate read_cubes read_durations "
                "read_following read_following_proof read_moves read_proof read_timetable "
                "timetable_schema write_certificate write_cubes write_following "
                "write_following_proof write_moves write_proof write_timetable"
            ),
            "plans": "PlanHints VehicleMove VehiclePlan read_plan",
            "recordings": (
                "Record Recording RecordingWriter filter_recording merge_recordings read_recording "
                "split_recording"
            ),
            "scenes": (
                "Family all_families hex_catalogue read_scene scene_from_spec scene_from_toml "
                "scene_to_toml"
            ),
            "systems": "FlipSystem GraphSystem LatticeSystem TabledSystem",
            "wire": "Message decode open_client schema_of",
        },
    )

__all__ = [
    "CLOSED",
    "EDGES",
    "EMPTY",
    "FILLED",
    "FIRST_LABEL",
    "HEXAGONS",
    "MODULE",
    "SQUARES",
    "Action",
    "Bound",
    "Catalogue",
    "Certificate",
    "CheckError",
    "CubepathError",
    "Durations",
    "ExcludedError",
    "Family",
    "FlipSystem",
    "FollowingFile",
    "FollowingHead",
    "FollowingLine",
    "FollowingProof",
    "Generator",
    "GeneratorPlacement",
    "GraphSystem",
    "InputError",
    "Lattice",
    "LatticeSystem",
    "Message",
    "Move",
    "MoveName",
    "OptimalityProof",
    "PathMove",
    "PlanHints",
    "Record",
    "Recording",
    "RecordingWriter",
    "RuleError",
    "Scene",
    "Site",
    "State",
    "System",
    "TabledSystem",
    "TimedLine",
    "VehicleGraph",
    "VehicleMove",
    "VehiclePlan",
    "Ways",
    "admissible",
    "all_families",
    "apply",
    "certificate_schema",
    "commute",
    "cube_schema",
    "decode",
    "filter_recording",
    "following_schemas",
    "hex_catalogue",
    "in_order",
    "merge_recordings",
    "move_schemas",
    "open_client",
    "read_certificate",
    "read_cubes",
    "read_durations",
    "read_following",
    "read_following_proof",
    "read_moves",
    "read_plan",
    "read_proof",
    "read_recording",
    "read_scene",
    "read_timetable",
    "scene_from_spec",
    "scene_from_toml",
    "scene_to_toml",
    "schema_of",
    "site_from_json",
    "split_recording",
    "timetable_schema",
    "why_inadmissible",
    "write_certificate",
    "write_cubes",
    "write_following",
    "write_following_proof",
    "write_moves",
    "write_proof",
    "write_timetable",
]
