"""Runs with messages, as they were gathered: their paths, lost claims and messages."""

from __future__ import annotations

import numpy as np

from cubepath.coordinator.experiments.facts import Change, SceneFacts
from cubepath.coordinator.experiments.outcomes import GOAL, PlayedRun
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.sites import Ordinals
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report, decode

_RESULTS = ("edges", "cube", "certificate", "summary")
"""Messages on record that were not said by anybody, but found by the coordinator."""


def gathered_run(found: Gathered, facts: SceneFacts, ended: str, reason: str | None) -> PlayedRun:
    """Return a run as it was gathered; at its goal it has ended there, otherwise as it is said."""
    numbers = Ordinals[Change]()
    state = set(found.scene.start_state)
    moves: list[int] = []
    ends: list[int] = []
    for step in found.steps:
        for action in step.actions:
            one, other = action.ends
            off, on = one - other, other - one
            if not (off <= state and not on & state):
                off, on = on, off
            state -= off
            state |= on
            moves.append(numbers[off, on])
        ends.append(len(moves))
    heap = found.heap
    return PlayedRun(
        moves=np.array(moves, np.int64),
        measures=facts.measures(numbers),
        ends=np.array(ends, np.int64),
        sites=tuple(found.sites),
        reduced=heap.reduced_moves,
        cubes=heap.cubes,
        largest_cube=heap.max_cube_dimension,
        digest=found.digest,
        ended=GOAL if found.reached else ended,
        reason=None if found.reached else reason,
    )


def recorded_run(
    recording: Recording, facts: SceneFacts, ended: str, reason: str | None
) -> PlayedRun:
    """Return a run from its recording; CheckError or InputError if that cannot be gathered."""
    found = gathered_run(gathered(recording), facts, ended, reason)
    found.messages = sum(record.kind not in _RESULTS for record in recording.records)
    if recording.clock == "lockstep":
        lost = [0] * len(found.ends)
        for record in recording.of_kind("report"):
            report = decode(record.data)
            # Of a round that not all have reported nothing is gathered.
            if isinstance(report, Report) and report.claim == "lost" and report.round <= len(lost):
                lost[report.round - 1] += 1
        found.conflicts = np.array(lost, np.int64)
    return found
