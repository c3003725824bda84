"""What two runs have to do with each other, before any of their messages is compared.

Of systems of two families nothing fits together: neither places nor modules nor moves. One run can
also be the outcome of a what-if of the other.
"""

from __future__ import annotations

from collections.abc import Iterator

from cubepath.coordinator.tools.comparison.compared import Compared
from cubepath.coordinator.tools.comparison.results import NAMES
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.plurals import counted
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Summary, decode


def compare_families(
    a: Recording,
    b: Recording,
    parameters: dict[str, tuple[str | None, str | None]],
    scene: str | None,
) -> Compared:
    """Compare how runs of systems of two families ended; nothing else would make sense."""
    told = _ended(a), _ended(b)
    return Compared(
        str(a.path),
        str(b.path),
        clock=a.clock if a.clock == b.clock else "moves",
        same=False,
        identical=False,
        parameters=parameters,
        scene=scene,
        compared="how the runs ended; sites and moves of two such systems have nothing in common",
        notes=tuple(_damage(a, b)),
        ends=told,
    )


def _damage(a: Recording, b: Recording) -> Iterator[str]:
    for name, recording in zip(NAMES, (a, b), strict=True):
        for problem in recording.problems:
            yield f"{name} is damaged: {problem}"


def _ended(recording: Recording) -> str:
    for record in recording.of_kind("summary"):
        try:
            found = decode(record.data)
        except InputError:
            continue
        if isinstance(found, Summary):
            after = "" if recording.clock == "free" else f" after {counted(found.rounds, 'round')}"
            moves, cubes = counted(found.moves, "move"), counted(found.cubes, "cube")
            return f"{found.ended}{after}, {moves} in {cubes}"
    return "not on record"


def parent_notes(a: Recording, b: Recording) -> Iterator[str]:
    """Yield in words how one run goes on from the other, or both from a third."""
    parents = [each.parameters.get("parent_sha256") for each in (a, b)]
    runs = (a, b)
    for side, parent in enumerate(parents):
        if parent is not None and runs[1 - side].sha256() == parent:
            yield f"{NAMES[side]} goes on from {NAMES[1 - side]}{_since(runs[side])}"
            return
    if parents[0] is not None and parents[0] == parents[1]:
        name = a.parameters.get("parent", "one recording")
        for which, run in zip(NAMES, runs, strict=True):
            yield f"{which} goes on from {name}{_since(run)}"


def _since(run: Recording) -> str:
    rule, number = (run.parameters.get(key) for key in ("what_if", "from_round"))
    return "" if rule is None or number is None else f", with rule {rule} from round {number} on"
