"""Files of paths: moves, cubes, schedules, durations, timetables, certificates and proofs.

Room: protocol. It reads, writes and checks file formats; judging a path is up to the coordinator.
It imports only `core`. Messages carry some of these formats, and all code that takes a path from a
file reads it here.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.path_files.certificates import (
        Certificate,
        certificate_schema,
        companion,
        read_certificate,
        write_certificate,
    )
    from cubepath.protocol.path_files.durations import (
        Durations,
        durations_in_words,
        read_durations,
        time_from,
        time_text,
    )
    from cubepath.protocol.path_files.following import (
        FollowingFile,
        FollowingHead,
        FollowingLine,
        following_schemas,
        is_following,
        read_following,
        write_following,
    )
    from cubepath.protocol.path_files.following_proofs import (
        FollowingProof,
        is_following_proof,
        read_following_proof,
        write_following_proof,
    )
    from cubepath.protocol.path_files.moves import (
        CubeName,
        MoveName,
        NumberedId,
        PathMove,
        cube_schema,
        known_of_named,
        move_schemas,
        read_cubes,
        read_moves,
        write_cubes,
        write_moves,
    )
    from cubepath.protocol.path_files.npz import (
        NumberedCubes,
        holds_cubes,
        is_npz,
        read_cubes_npz,
        read_moves_npz,
        write_cubes_npz,
        write_moves_npz,
    )
    from cubepath.protocol.path_files.numbered import (
        IrregularError,
        NumberedPath,
        Progress,
        number_moves,
        read_path,
    )
    from cubepath.protocol.path_files.optimality_proofs import (
        Group,
        Ladder,
        LadderKind,
        OptimalityProof,
        is_proof,
        read_proof,
        write_proof,
    )
    from cubepath.protocol.path_files.path_lines import write_path
    from cubepath.protocol.path_files.schedules import (
        Cubes,
        OwnMoves,
        by_generator,
        schedule_from_jsonl,
        schedule_to_jsonl,
    )
    from cubepath.protocol.path_files.supports import FIRST, FREE, TRACE, Rows, Supports
    from cubepath.protocol.path_files.timetables import (
        TimedLine,
        read_timetable,
        timetable_schema,
        write_timetable,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "certificates": (
                "Certificate certificate_schema companion read_certificate write_certificate"
            ),
            "durations": "Durations durations_in_words read_durations time_from time_text",
            "following": (
                "FollowingFile FollowingHead FollowingLine following_schemas is_following "
                "read_following write_following"
            ),
            "following_proofs": (
                "FollowingProof is_following_proof read_following_proof write_following_proof"
            ),
            "moves": (
                "CubeName MoveName NumberedId PathMove cube_schema known_of_named "
                "move_schemas read_cubes read_moves write_cubes write_moves"
            ),
            "npz": (
                "NumberedCubes holds_cubes is_npz read_cubes_npz read_moves_npz write_cubes_npz "
                "write_moves_npz"
            ),
            "numbered": "IrregularError NumberedPath Progress number_moves read_path",
            "optimality_proofs": (
                "Group Ladder LadderKind OptimalityProof is_proof read_proof write_proof"
            ),
            "path_lines": "write_path",
            "schedules": "Cubes OwnMoves by_generator schedule_from_jsonl schedule_to_jsonl",
            "supports": "FIRST FREE TRACE Rows Supports",
            "timetables": "TimedLine read_timetable timetable_schema write_timetable",
        },
    )

__all__ = [
    "FIRST",
    "FREE",
    "TRACE",
    "Certificate",
    "CubeName",
    "Cubes",
    "Durations",
    "FollowingFile",
    "FollowingHead",
    "FollowingLine",
    "FollowingProof",
    "Group",
    "IrregularError",
    "Ladder",
    "LadderKind",
    "MoveName",
    "NumberedCubes",
    "NumberedId",
    "NumberedPath",
    "OptimalityProof",
    "OwnMoves",
    "PathMove",
    "Progress",
    "Rows",
    "Supports",
    "TimedLine",
    "by_generator",
    "certificate_schema",
    "companion",
    "cube_schema",
    "durations_in_words",
    "following_schemas",
    "holds_cubes",
    "is_following",
    "is_following_proof",
    "is_npz",
    "is_proof",
    "known_of_named",
    "move_schemas",
    "number_moves",
    "read_certificate",
    "read_cubes",
    "read_cubes_npz",
    "read_durations",
    "read_following",
    "read_following_proof",
    "read_moves",
    "read_moves_npz",
    "read_path",
    "read_proof",
    "read_timetable",
    "schedule_from_jsonl",
    "schedule_to_jsonl",
    "time_from",
    "time_text",
    "timetable_schema",
    "write_certificate",
    "write_cubes",
    "write_cubes_npz",
    "write_following",
    "write_following_proof",
    "write_moves",
    "write_moves_npz",
    "write_path",
    "write_proof",
    "write_timetable",
]
