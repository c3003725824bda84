"""The proof that no timetable in which vehicles follow is shorter, as a file.

But the log of a solver, which it reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import IO

from cubepath.coordinator.theory.following.encoding import cell_of
from cubepath.coordinator.theory.following.optimum import Refuted
from cubepath.protocol.path_files.following import FollowingFile
from cubepath.protocol.path_files.following_proofs import FollowingProof

_CHUNK = 1 << 20


def fewest_rounds_proof(refuted: Refuted, timetable: FollowingFile) -> FollowingProof:
    """Return the proof that no timetable has so few rounds as were refuted.

    `timetable` is the best that is known, by rounds. The log of the refutation is read when the
    proof is written.

    >>> from contextlib import ExitStack
    >>> from pathlib import Path
    >>> _ = Path("cross.json").write_text(
    ...     '{"starts": [[0, 0], [1, 1]], "goals": [[2, 0], [1, -1]], "rounds": [1, 1, 1, 1],'
    ...     ' "moves": [[[0, 0], [1, 0]], [[1, 0], [2, 0]], [[1, 1], [1, 0]], [[1, 0], [1, -1]]]}'
    ... )
    >>> plan = read_vehicle_plan("cross.json")
    >>> own = timetable_file(following_timetable(plan, "cgshop"))
    >>> with ExitStack() as logs:
    ...     best = fewest_rounds(plan, "cgshop", within=4, seconds=60, logs=logs)
    ...     checked = check_fewest_rounds(fewest_rounds_proof(best.refuted, own))
    >>> best.timetable, checked.rounds, checked.optimal
    (None, 4, True)
    """
    task, clauses = refuted.task, refuted.clauses
    places = task.places
    rounds = timetable.head.rounds or 0
    schedule: list[list[tuple[int, int]]] = [[] for _ in range(rounds)]
    for line in timetable.lines:
        schedule[(line.round or 1) - 1].append((line.vehicle, places[line.target]))
    edges = [(places[one], places[other]) for one, other in task.edges]
    proof = FollowingProof(
        rule=task.rule,
        starts=task.starts,
        ends=task.ends,
        vertices=[cell_of(site) for site in places],
        edges=edges,
        refuted=refuted.rounds,
        solver=refuted.why,
        log=_log(refuted.log),
        schedule=schedule,
    )
    return proof if clauses is None else replace(proof, variables=clauses.meanings)


def _log(file: IO[bytes] | None) -> Iterator[bytes]:
    if file is not None:
        file.seek(0)
        while chunk := file.read(_CHUNK):
            yield chunk
