"""Verifying a run with rounds: everything derived again from the start, round by round.

Part of `cubepath verify`; `cubepath.coordinator.verification.rounds` derives the rounds.
"""

from collections.abc import Callable, Iterable
from functools import partial

from cubepath.coordinator.verification import findings, parameters
from cubepath.coordinator.verification.choices import Moment, RoundPlayer
from cubepath.coordinator.verification.ending import OutcomeCheck, check_schedule
from cubepath.coordinator.verification.pacing import Pacing
from cubepath.coordinator.verification.results import Derived, concluded
from cubepath.coordinator.verification.rounds import Rederivation
from cubepath.coordinator.verification.transcript import RECOVERED, RecordedRound, Sorting
from cubepath.protocol.recordings.cutting import left_out
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record

CHECKS = {
    "readable": "the file is whole",
    "parameters": "they are those of a run, and fit the scene",
    "messages": "each message decodes, and stands under its own topic and round",
    "batches": "what modules say comes in batches, none of them empty",
    "pacing": "each phase begins once, in order, when all processes have said what they count",
    "complete": "the run came to its end, unless recovered: a summary, and all cubes it counts",
    "reports": "each round has one report of each module",
    "bundle": "modules say that they are here, and speak from where they stand",
    "admissible": "every move was admissible when it was made",
    "commuting": "the moves of a round commute pairwise",
    "sites": "modules stand where the moves have taken them",
    "claims": "a claim is executed iff every claim that outranks and conflicts with it is lost",
    "deliveries": "what a module heard was said to it, from within its sensing radius",
    "hearing": "no module missed what was said to it",
    "choices": "each module chose, noted and gave up as its rule does, with the seed's randomness",
    "schedule": "the rounds are the cubes of the schedule, if there is one, up to where it stopped",
    "stages": "a run that continues a recording names the rule of each module from each round on",
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


def verify_lockstep(
    recording: Recording,
    blocks: Iterable[tuple[Iterable[Record], float]],
    progress: findings.Progress | None,
    player: Callable[[], RoundPlayer] | None,
) -> findings.Verification:
    """Derive everything in the recording of a run with rounds, and compare.

    Its messages come in blocks, each with the round before which nothing more of it can come;
    OutOfOrder if something does.
    """
    failures = findings.Failures(CHECKS)
    for problem in recording.problems:
        failures.stage(0)("readable", problem)
    pacing = Pacing(recording, failures.stage(0))
    sorting = Sorting(recording, failures.stage(0), pacing.take)
    transcript = sorting.found
    parameters.check_parameters(recording, failures.stage(0))
    recorded = recording.parameters
    stages = parameters.stages_in(recording)
    seed = parameters.seed_in(recorded)
    seed_lost = "seed" not in recorded and bool(recording.problems or RECOVERED in recorded)
    if seed is None and not seed_lost:
        failures.stage(1)("claims", "the recording names no seed, so no rank is known")
    derived = Rederivation(recording.scene, seed, failures.stage(1), stages)
    course = OutcomeCheck(recording, failures.stage(2))
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
        last = _moment(transcript.complete_rounds + 1, derived, RecordedRound())
        playing.end(last, transcript, another_choice)
    fail = failures.stage(2)
    course.check(transcript, pacing)
    check_schedule(recording, transcript, fail)
    parameters.check_stages(recording, transcript, fail)
    derived.check_edges(transcript)
    missing = findings.MissingMessages(
        max(0, pacing.round - transcript.complete_rounds),
        max(transcript.gap + pacing.missing(), left_out(recording)),
    )
    end = Derived(
        derived.actions,
        derived.ends,
        transcript.complete_rounds,
        derived.state,
        frozenset(derived.sites) == recording.scene.goal,
        derived.digest,
    )
    unchecked = _unchecked(playing, seed_lost=seed_lost)
    return concluded(
        recording, transcript, end, failures, stage=2, missing=missing, unchecked=unchecked
    )


def _moment(number: int, derived: Rederivation, recorded: RecordedRound) -> Moment:
    return Moment(number, tuple(derived.sites), frozenset(derived.state), recorded)


def _unchecked(playing: RoundPlayer | None, *, seed_lost: bool) -> dict[str, str]:
    """Return why checks were not made, by name."""
    why = "the rules were not asked again" if playing is None else playing.unchecked()
    found = {} if why is None else {"choices": f"not checked: {why}"}
    if seed_lost:
        found["claims"] = "not checked: the seed is lost, so no rank is known"
    return found
