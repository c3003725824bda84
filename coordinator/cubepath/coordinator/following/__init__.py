"""Plans whose vehicles may follow one another: their least timetables, and optima of small ones.

Room: coordinator. Moves that follow do not commute, so nothing here is a cube: it imports neither
shortening nor complexes, and these know nothing of it. Results are checked by `verification`, and
solvers are those of `satisfiability`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.following.files import checked, timetable_file
    from cubepath.coordinator.following.optimum import FewestRounds, fewest_rounds
    from cubepath.coordinator.following.proofs import fewest_rounds_proof
    from cubepath.coordinator.following.reading import read_vehicle_plan
    from cubepath.coordinator.following.timetable import FollowingTimetable, following_timetable
    from cubepath.coordinator.following.words import chain_in_words
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "files": "checked timetable_file",
            "optimum": "FewestRounds fewest_rounds",
            "proofs": "fewest_rounds_proof",
            "reading": "read_vehicle_plan",
            "timetable": "FollowingTimetable following_timetable",
            "words": "chain_in_words",
        },
    )

__all__ = [
    "FewestRounds",
    "FollowingTimetable",
    "chain_in_words",
    "checked",
    "fewest_rounds",
    "fewest_rounds_proof",
    "following_timetable",
    "read_vehicle_plan",
    "timetable_file",
]
