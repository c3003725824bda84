"""Checking a certificate for `cubepath verify`, in a recording or in a file.

`cubepath.coordinator.verification.proof` checks the proof itself. This module also checks the state
at the end, and that given cubes are the cubes of the certificate. It uses nothing that builds
certificates or shortens.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import TypeAlias

from cubepath.coordinator.verification.proof import check_proof
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.coordinator.verification.transcript import Fail, Transcript
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.moves import CubeName, MoveName, NumberedId
from cubepath.protocol.path_files.numbered import NumberedPath

CHECKS = {
    "form": "each move of the path is in one cancelled pair or in one cube",
    "cancelled": "the moves of a pair are equal, and nothing that is left comes between them",
    "schedule": "of two moves that do not commute the earlier is in an earlier cube",
    "reduced": "of the moves that remain none cancel",
    "chain": "as many moves as there are cubes, each not commuting with the next",
    "end": "the cubes are admissible one after another, and end where the path ends",
    "cubes": "the cubes file has the moves of the certificate, cube by cube",
}
"""The checks of a certificate by name, with what holds if they pass."""

Found: TypeAlias = dict[str, str | None]
"""For each check that was made, why it fails; None if it holds."""


def check_certificate(
    certificate: Certificate, path: Sequence[Action], start: frozenset[Site] | None = None
) -> Found:
    """Return the results of checking a certificate against its path; nothing is raised.

    If the start is known, the check `end` carries out the path and the cubes from there, and
    compares both ends with the end that the certificate must state. If the start is not known, a
    certificate that states an end fails this check.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> proof = certificate_of([left, right], start={1})
    >>> found = check_certificate(proof, [left, right], frozenset({1}))
    >>> list(found), any(found.values())
    (['form', 'cancelled', 'schedule', 'reduced', 'chain', 'end'], False)
    >>> check_certificate(proof, [right, left])["end"]
    'it says what is on at the end, but what is on at the start is unknown'
    """
    if certificate.moves != len(path):
        return {"form": f"it is of {certificate.moves} moves, and the path has {len(path)}"}
    found = check_proof(path, certificate.cancelled, certificate.cubes, certificate.chain)
    if len(found) > 1 and (start is not None or certificate.end is not None):
        found["end"] = _end(certificate, path, start)
    return found


def _end(
    certificate: Certificate, path: Sequence[Action], start: frozenset[Site] | None
) -> str | None:
    if start is None:
        return "it says what is on at the end, but what is on at the start is unknown"
    after_path, after_cubes = set(start), set(start)
    why = _carry_out(after_path, ((f"path, move {n}", each) for n, each in enumerate(path, 1)))
    cubes = enumerate(certificate.cubes, 1)
    moves = ((f"cube {n}, move {move}", path[move - 1]) for n, cube in cubes for move in cube)
    why = why or _carry_out(after_cubes, moves)
    if why is None and after_cubes != after_path:
        why = f"{_stray(after_cubes ^ after_path)} is not after the cubes as after the path"
    return why or _told_end(certificate.end, after_path)


def _told_end(end: Sequence[object] | None, state: set[Site]) -> str | None:
    if end is None:
        return 'it has no "end", expected one: what is on at the start is known'
    stated: set[Site] = set()
    for site in end:
        if site in stated:
            return f"{site_text(site)} stands twice at the end"
        stated.add(site)
    return f"{_stray(stated ^ state)} is not at the end as it says" if stated != state else None


def _carry_out(state: set[Site], steps: Iterable[tuple[str, Action]]) -> str | None:
    for where, action in steps:
        why = why_not(action, state)
        if why is not None:
            return f"{where}: {why}"
        make(action, state)
    return None


def _stray(sites: set[Site]) -> str:
    return min(map(site_text, sites))


def compare_cubes(
    certificate: Certificate, path: NumberedPath, cubes: Sequence[Sequence[CubeName]]
) -> str | None:
    """Return where the cubes of a cubes file differ from those of the certificate, None if nowhere.

    Moves are compared by their names; an id shared by moves with different contents is ambiguous
    without the number of the move. Only for a certificate whose `form` holds.
    """
    shared = _shared_ids(path, certificate.cubes)
    for number, (ours, theirs) in enumerate(zip(certificate.cubes, cubes, strict=False), 1):
        unclear = [name for name in theirs if isinstance(name, str | int) and name in shared]
        if unclear:
            return (
                f"cube {number}: moves with different contents have the id"
                f" {site_text(unclear[0])}, expected [id, number of the move]"
            )
        numbered = {name.move for name in theirs if isinstance(name, NumberedId)}
        names = sorted(_name(_written(path.name(move - 1), move, numbered)) for move in ours)
        if names != sorted(map(_name, theirs)):
            return f"cube {number} has other moves than the certificate"
    if len(cubes) != len(certificate.cubes):
        return f"{len(cubes)} cubes, and the certificate has {len(certificate.cubes)}"
    return None


def _shared_ids(path: NumberedPath, cubes: Iterable[Iterable[int]]) -> set[str | int]:
    """Return the ids that are shared by moves of these cubes with different contents."""
    first: dict[str | int, int] = {}
    shared: set[str | int] = set()
    numbers = path.numbers.tolist()
    for move in chain.from_iterable(cubes):
        name = path.name(move - 1)
        if (
            isinstance(name, str | int)
            and first.setdefault(name, numbers[move - 1]) != numbers[move - 1]
        ):
            shared.add(name)
    return shared


def _written(name: MoveName, move: int, numbered: set[int]) -> CubeName:
    if isinstance(name, str | int) and move in numbered:
        return NumberedId(name, move)
    return name


def _name(name: CubeName) -> str:
    if isinstance(name, GeneratorPlacement):
        return site_text((name.generator, name.at))
    return site_text(name)


def check_recorded_certificate(
    scene: Scene, transcript: Transcript, path: Sequence[Action], fail: Fail
) -> None:
    """Check the certificate of a recording, if it has one, as the check `certificate`.

    It must cover the moves of all complete rounds, and its cubes must be those in the recording.
    """
    certificate = transcript.certificate
    if certificate is None:
        return
    found = check_certificate(certificate, path, scene.start_state)
    for check, why in found.items():
        if why is not None:
            fail("certificate", f"{check}: {why}")
    if found["form"] is not None:
        return
    ours, theirs = certificate.cubes, transcript.result
    for number, (one, other) in enumerate(zip(ours, theirs, strict=False), 1):
        if frozenset(path[move - 1] for move in one) != _actions(scene.system, other.moves):
            fail("certificate", f"cube {number} is another than on record")
            return
    if len(ours) != len(theirs):
        fail("certificate", f"it has {len(ours)} cubes, on record are {len(theirs)}")


def _actions(system: System, moves: Sequence[GeneratorPlacement]) -> frozenset[Action] | None:
    try:
        return frozenset(system.action(move.generator, move.at) for move in moves)
    except InputError:
        return None  # the check `normal` reports it
