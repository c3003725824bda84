"""Whether a run carried out its schedule, up to where the schedule stopped.

Part of `cubepath verify`: it reads the schedule on record and the reports, and uses none of the
code that assigned the moves.
"""

from __future__ import annotations

from collections.abc import Iterable

from cubepath.coordinator.verification.transcript import Carried, Fail, Made, Transcript, site_in
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.path_files.schedules import Cubes, schedule_from_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Stopped, Summary

_NOTHING = Carried(frozenset(), ())


def check_schedule(recording: Recording, transcript: Transcript, fail: Fail) -> None:
    """Check that the rounds are the cubes of the schedule, and that its stop fits the reports.

    In a round in which one module cannot make its move, the others make theirs. Rounds after the
    schedule are not checked here.
    """
    summary = transcript.summary
    if recording.schedule is None:
        told = summary is not None and (summary.schedule_cubes, summary.schedule_stopped)
        if "schedule" in recording.parameters or told not in (False, (None, None)):
            fail("schedule", "there was one, but it is not on record")
        return
    try:
        cubes = schedule_from_jsonl(recording.schedule)
    except InputError as error:
        fail("schedule", str(error))
        return
    over = transcript.schedule_over
    last = transcript.complete_rounds if over is None else min(over, transcript.complete_rounds)
    for number in range(1, last + 1):
        if number > len(cubes):
            fail("schedule", f"round {number}: the schedule has {len(cubes)} cubes")
            return
        _check_round(
            number, cubes[number - 1], transcript.carried[number], fail, last=number == last
        )
    if summary is not None:
        _check_told(summary, cubes, transcript, last, fail)
        if summary.schedule_stopped is None and last != len(cubes):
            if over is not None:
                fail(
                    "schedule", f"it was over after {over} of {len(cubes)} cubes, and did not stop"
                )
            elif summary.ended == "goal":
                fail("schedule", f"the run ended after {last} of {len(cubes)} cubes")


def _moves(placed: Iterable[GeneratorPlacement]) -> Made:
    return frozenset((move.generator, site_in(move.at)) for move in placed)


def _check_round(
    number: int, cube: tuple[GeneratorPlacement, ...], carried: Carried, fail: Fail, *, last: bool
) -> None:
    due, made, gave_up = _moves(cube), carried.made, carried.gave_up
    for what, moves in (("is not in its cube", made - due), ("is not made", due - made)):
        if moves and not (gave_up and moves <= due):
            generator, at = min(moves, key=repr)
            fail("schedule", f"round {number}: {generator} at {site_text(at)} {what}")
    if gave_up and not last:
        fail("schedule", f"it went on after round {number}, where module_{gave_up[0][0]} gave up")


def _check_told(
    summary: Summary, cubes: Cubes, transcript: Transcript, last: int, fail: Fail
) -> None:
    """Check what the summary says about the schedule."""
    if summary.schedule_cubes != len(cubes):
        fail(
            "schedule",
            f"the summary counts {summary.schedule_cubes} cubes, on record are {len(cubes)}",
        )
    gave_up = transcript.carried.get(last, _NOTHING).gave_up
    stopped = summary.schedule_stopped
    if gave_up:
        due = (last, *gave_up[0])
        told = None if stopped is None else (stopped.round, stopped.module, stopped.reason)
        if told != due:
            fail("schedule", f"module_{due[1]} gave up in round {last}: {due[2]}")
    elif stopped is not None and (stopped.round, stopped.module) != (last + 1, None):
        fail("schedule", f"the summary says it stopped at round {stopped.round}, nobody else does")
    if stopped is not None and not _was_due(stopped, cubes, transcript):
        fail("schedule", f"it did not stop for {stopped.move.generator}: not due, or it was made")


def _was_due(stopped: Stopped, cubes: Cubes, transcript: Transcript) -> bool:
    cube = cubes[stopped.round - 1] if 1 <= stopped.round <= len(cubes) else ()
    move = _moves([stopped.move])
    return move <= _moves(cube) and not move <= transcript.carried.get(stopped.round, _NOTHING).made
