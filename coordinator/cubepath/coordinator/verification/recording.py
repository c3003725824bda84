"""Verifying: everything in a recording derived again from the start state, by independent code.

It shares only the catalogue, `commute` and the decoding of messages with the code that makes
recordings; `cubepath.coordinator.verification.rounds` derives the rounds. It uses neither the
gatherer nor the heap, nor anything from the agents.
"""

from collections.abc import Callable
from math import inf

from cubepath.coordinator.verification import partial
from cubepath.coordinator.verification.choices import RoundPlayer
from cubepath.coordinator.verification.findings import Progress, Verification
from cubepath.coordinator.verification.free import FREE_CHECKS, verify_free
from cubepath.coordinator.verification.free_turns import FreePlayer
from cubepath.coordinator.verification.lockstep import CHECKS, verify_lockstep
from cubepath.coordinator.verification.transcript import OutOfOrder
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.recordings.recording import Recording, recording_of


def verify(
    recording: Recording | Source,
    progress: Progress | None = None,
    *,
    player: Callable[[], RoundPlayer] | None = None,
    free_player: Callable[[], FreePlayer] | None = None,
) -> Verification:
    """Derive everything in a recording, or in its file, again from its start state, and compare.

    Every check of `CHECKS` is made, whether the others pass or fail. Checks on rounds are made on
    the rounds, from the first on, that all modules have reported. If the end of a recording is
    lost, only `complete` fails, or no check if the recording says that it was recovered; the
    closing messages are not `checked`. Nothing is raised, unless the file cannot be read, or is
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
    why = partial.why_partial(recording)
    if why is not None:
        checks = FREE_CHECKS if recording.clock == "free" else CHECKS
        return partial.verify_partial(recording, checks, why, progress)
    free = recording.clock == "free"
    hole = partial.hole_in(recording)

    def from_the_start(some: Recording) -> Verification:
        if free:
            return verify_free(some, progress, free_player)
        blocks = some.blocks() if hole is None else partial.blocks_before(recording, hole)
        try:
            return verify_lockstep(some, blocks, progress, player)
        except OutOfOrder:
            return verify_lockstep(some, [(some.records, inf)], progress, player)

    if hole is not None:
        return partial.verify_with_hole(recording, hole, from_the_start)
    return from_the_start(recording)
