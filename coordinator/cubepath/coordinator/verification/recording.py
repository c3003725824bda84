"""Verifying: everything in a recording derived again from the start state, by independent code.

It shares only the catalogue, `commute` and the decoding of messages with the code that makes
recordings; `cubepath.coordinator.verification.rounds` derives the rounds. It uses neither the
gatherer nor the heap, nor anything from the agents.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path

from cubepath.coordinator.verification.certificate import check_recorded_certificate
from cubepath.coordinator.verification.choices import Moment, Player
from cubepath.coordinator.verification.dependencies import check_dependencies
from cubepath.coordinator.verification.ending import Course
from cubepath.coordinator.verification.findings import Failures, Missing, Progress, Verification
from cubepath.coordinator.verification.free import FREE_CHECKS, verify_free
from cubepath.coordinator.verification.free_turns import FreePlayer
from cubepath.coordinator.verification.normal_form import cubes_of
from cubepath.coordinator.verification.pacing import Pacing
from cubepath.coordinator.verification.parameters import check_parameters, seed_in
from cubepath.coordinator.verification.partial import (
    blocks_before,
    hole_in,
    verify_partial,
    verify_with_hole,
    whole_rounds,
    why_partial,
)
from cubepath.coordinator.verification.results import (
    check_cubes,
    check_summary,
    recorded_cubes,
    without_end,
)
from cubepath.coordinator.verification.rounds import Rederivation
from cubepath.coordinator.verification.schedule import check_schedule
from cubepath.coordinator.verification.stages import check_stages, stages_in
from cubepath.coordinator.verification.told_scene import with_told_scene
from cubepath.coordinator.verification.transcript import (
    RECOVERED,
    OutOfOrder,
    Round,
    Sorting,
    is_cut_off,
)
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.cuts import left_out
from cubepath.protocol.recordings.recording import Recording, recording_of
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.recordings.remains import Remains, remains_of
from cubepath.protocol.recordings.writing import copy_recording

CHECKS = {
    "readable": "the file is whole",
    "parameters": "they are those of a run, and fit the scene",
    "messages": "each message decodes, and stands under its own topic and round",
    "batches": "what modules say comes in batches, none of them empty",
    "pacing": "each phase begins once, in order, when all processes have said what they count",
    "complete": "the run came to its end, unless recovered: a summary, and all cubes it counts",
    "reports": "each round has one report of each module",
    "said": "modules say that they are here, and speak from where they stand",
    "admissible": "every move was admissible when it was made",
    "commuting": "the moves of a round commute pairwise",
    "sites": "modules stand where the moves have taken them",
    "claims": "a claim is executed iff every claim that outranks and conflicts with it is lost",
    "deliveries": "what a module heard was said to it, from within its sensing radius",
    "hearing": "no module missed what was said to it",
    "choices": "each module chose, noted and gave up as its rule does, with the seed's randomness",
    "schedule": "the rounds are the cubes of the schedule, if there is one, up to where it stopped",
    "stages": "a run that goes on from a recording names who followed which rule from which round",
    "dependencies": "what is not undone finds its sites at the same versions in rounds and cubes",
    "edges": "the coordinator's edges are the moves reported",
    "normal": "no action of a cube is in the cube before or commutes with all of it",
    "ends": "the cubes are admissible from the start on, and end where the moves end",
    "class": "the cubes are the normal form of the moves: the same homotopy class",
    "certificate": "the certificate, if there is one, proves that none in the class is shorter",
    "summary": "the numbers and the digest of the summary are those of the moves",
    "ended": "the run went on as long as it had to, and ended as the summary says",
}
"""The checks by name, with what holds if they pass."""


@dataclass(frozen=True, slots=True)
class Recovered:
    """The readable part of a damaged recording, written to a new file."""

    out: Path
    messages: int
    rounds: int
    """The number of rounds that every module has reported, or of levels with commits."""
    problems: tuple[str, ...]


def verify(
    recording: Recording | Source,
    progress: Progress | None = None,
    *,
    player: Callable[[], Player] | None = None,
    free_player: Callable[[], FreePlayer] | None = None,
) -> Verification:
    """Derive everything in a recording, or in its file, again from its start state, and compare.

    Every check of `CHECKS` is made, whether the others pass or fail. Checks on rounds are made on
    the rounds, from the first on, that all modules have reported. If the end of a recording is
    lost, only `complete` fails, or no check if the recording says that it was recovered; what is
    said at the end is not `checked`. Nothing is raised, unless the file cannot be read, or is
    changed while it is read.

    The rules of the modules are asked again by a `player`, a new one of which is made for each
    pass, or by a `free_player` if the run had no rounds; without one, `choices` is not checked.
    `cubepath.coordinator.auditing` has both.

    A recording of a run without rounds has other checks: `FREE_CHECKS`. Of one that was made from
    outside, or cut from another, and begins on the way or lacks messages in between, each message
    is checked by itself; what would have to be derived is not `checked`. The same holds of what
    stands behind a hole that damage has left.

    Messages stand in the order of their rounds, more or less: a round is checked and dropped as
    soon as nothing of it can be still to come.

    >>> found = verify("logs/golden/hex-5.mcap")
    >>> found.ok, found.moves, found.rounds, found.cubes
    (True, 28, 29, 19)
    >>> [check.checked for check in found.checks if check.name in ("choices", "class")]
    [False, True]
    """
    recording = recording_of(recording)
    why = why_partial(recording)
    if why is not None:
        checks = FREE_CHECKS if recording.clock == "free" else CHECKS
        return verify_partial(recording, checks, why, progress)
    free = recording.clock == "free"
    hole = hole_in(recording)

    def from_the_start(some: Recording) -> Verification:
        if free:
            return verify_free(some, progress, free_player)
        blocks = some.blocks() if hole is None else blocks_before(recording, hole)
        try:
            return _verified(some, blocks, progress, player)
        except OutOfOrder:
            return _verified(some, [(some.records, inf)], progress, player)

    if hole is not None:
        return verify_with_hole(recording, hole, from_the_start)
    return from_the_start(recording)


def _verified(
    recording: Recording,
    blocks: Iterable[tuple[Iterable[Record], float]],
    progress: Progress | None,
    player: Callable[[], Player] | None,
) -> Verification:
    failures = Failures(CHECKS)
    for problem in recording.problems:
        failures.stage(0)("readable", problem)
    pacing = Pacing(recording, failures.stage(0))
    sorting = Sorting(recording, failures.stage(0), pacing.take)
    transcript = sorting.found
    check_parameters(recording, failures.stage(0))
    told = recording.parameters
    stages = stages_in(recording)
    seed = seed_in(told)
    seed_lost = "seed" not in told and bool(recording.problems or RECOVERED in told)
    if seed is None and not seed_lost:
        failures.stage(1)("claims", "the recording names no seed, so nobody's rank is known")
    derived = Rederivation(recording.scene, seed, failures.stage(1), stages)
    course = Course(recording, failures.stage(2))
    playing = None if player is None else player()
    another_choice = partial(failures.stage(1), "choices")
    for records, least in blocks:
        sorting.take(records)
        for number, this in sorting.close(least):
            if playing is not None:
                playing.round(_moment(number, derived, this), transcript, another_choice)
            derived.round(number, this)
            course.round(number, this, derived.sites)
            if progress is not None:
                progress(1)
    sorting.end()
    if playing is not None:
        last = _moment(transcript.complete_rounds + 1, derived, Round())
        playing.end(last, transcript, another_choice)
    fail = failures.stage(2)
    course.check(transcript, pacing)
    check_schedule(recording, transcript, fail)
    check_stages(recording, transcript, fail)
    derived.check_edges(transcript)
    normal_form = cubes_of(derived.actions)
    cubes = recorded_cubes(recording.scene, transcript, fail)
    whole = transcript.summary is not None
    check_dependencies(derived.actions, derived.ends, cubes, fail, whole=whole)
    if cubes is not None:  # without all actions nothing more can be checked
        check_cubes(recording.scene, cubes, derived.state, normal_form, fail, whole=whole)
    check_recorded_certificate(recording.scene, transcript, derived.actions, fail)
    if transcript.summary is not None:
        expected = {
            "round": transcript.complete_rounds,
            "rounds": transcript.complete_rounds,
            "moves": derived.moves,
            "reduced_moves": sum(map(len, normal_form)),
            "cubes": len(normal_form),
            "max_cube_dimension": max(map(len, normal_form), default=0),
            "goal_reached": frozenset(derived.sites) == recording.scene.goal,
            "path_digest": derived.digest,
            "refused": transcript.refused,
        }
        check_summary(transcript.summary, expected, fail)
    ending = without_end(transcript, cut_off=is_cut_off(recording))
    checks = failures.checks({**_unchecked(playing, seed_lost=seed_lost), **ending})
    sound = all(check.ok for check in checks if check.name in ("readable", "complete"))
    return Verification(
        ok=all(check.ok for check in checks),
        complete=sound and whole,
        missing=Missing(
            max(0, pacing.round - transcript.complete_rounds),
            max(transcript.gap + pacing.missing(), left_out(recording)),
        ),
        checks=checks,
        moves=derived.moves,
        rounds=transcript.complete_rounds,
        cubes=len(normal_form),
        path_digest=derived.digest,
    )


def recover(
    source: Recording | Remains | Source, out: Path | str, *, scene: Scene | None = None
) -> Recovered:
    """Write what can be read of a recording, or was read already, as a whole recording to `out`.

    Its parameter `recovered` says what it comes from. `scene` is that of the run, for a recording
    that has lost its own; without one, the messages are written alone, which other tools can read,
    and which is a recording again when it is recovered with the scene. InputError if no message can
    be read, if they cannot be of the scene, if `out` is the recording itself, or if it cannot be
    written.

    >>> found = recover("logs/golden/hex-5.mcap", "copy.mcap")
    >>> found.rounds, found.problems, verify("copy.mcap").ok
    (29, (), True)
    """
    given = source if isinstance(source, Recording | Remains) else remains_of(source)
    out = Path(out)
    if isinstance(given, Remains):
        given = given if scene is None else with_told_scene(given, scene)
        given = given.recording() or given
    rounds = 0 if isinstance(given, Remains) else whole_rounds(given)
    count = len(given.records)
    last = max((record.sequence for record in given.records), default=-1)
    gap = max(0, last + 1 - count)
    problems = "; ".join(given.problems) or "no problems"
    lost = f"; at least {gap} more are missing" if gap else ""
    note = f"{count} messages of {given.path.name}: {problems}{lost}"
    messages = copy_recording(given, out, {RECOVERED: note})
    return Recovered(out, messages, rounds, given.problems)


def _moment(number: int, derived: Rederivation, said: Round) -> Moment:
    return Moment(number, tuple(derived.sites), frozenset(derived.state), said)


def _unchecked(playing: Player | None, *, seed_lost: bool) -> dict[str, str]:
    """Return why checks were not made, by name."""
    why = "the rules were not asked again" if playing is None else playing.unchecked()
    found = {} if why is None else {"choices": f"not checked: {why}"}
    if seed_lost:
        found["claims"] = "not checked: the seed is lost, so nobody's rank is known"
    return found
