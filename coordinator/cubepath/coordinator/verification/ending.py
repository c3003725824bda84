"""How a run ended: whether it ran as long as it had to, and no longer, and gave the reason.

Part of `cubepath verify`. After each round it derives whether the run had to end there: a module
gave up, the schedule stopped, the goal was reached, or the rounds were over. A recorded schedule is
compared with the reports, up to where it stopped, without any of the code that assigned the moves.
"""

import re
from collections.abc import Iterable
from typing import NamedTuple

from cubepath.coordinator.verification.pacing import Pacing
from cubepath.coordinator.verification.parameters import max_rounds_in, processes_of
from cubepath.coordinator.verification.transcript import (
    Fail,
    Made,
    RecordedRound,
    ScheduledRound,
    Transcript,
)
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files.durations import Cubes, schedule_from_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Stopped, Summary

CHECK = "ended"
_GAVE_UP = re.compile(r"module_\d+: ")
_DIED = re.compile(r"\(process (\d+)\) died in round (\d+): ")
_NOTHING = ScheduledRound(frozenset(), ())
_LATE = re.compile(r"no answer within \S+ s to phase (\w+) of round (\d+) from ")


class _Outcome(NamedTuple):
    """What a round came to, as far as it decides whether the run ends."""

    round: int
    gave_up: tuple[int, str] | None
    """The first module that gave up, with its reason."""
    reached: bool


class OutcomeCheck:
    """The course of a run: at the end, whether it ended where and how it had to."""

    def __init__(self, recording: Recording, fail: Fail) -> None:
        self._scene = recording.scene
        self._processes = processes_of(recording)
        self._most = max_rounds_in(recording.parameters)
        self._repair = "repair" in recording.parameters
        self._cubes = _cubes(recording)
        self._fail = fail
        self._ends: list[_Outcome] = []
        """The rounds after which something may have ended the run: few, in a run that is sound."""
        self._last = _Outcome(0, None, self._scene.reached(self._scene.start))
        self._note()

    def _note(self) -> None:
        last = self._last
        if last.gave_up or last.reached or last.round in (self._most, self._cubes, 0):
            self._ends.append(last)

    def round(self, number: int, recorded: RecordedRound, sites: Iterable[Site]) -> None:
        """Take a complete round, with where the modules stand after it."""
        gave_up = (
            (module, report.failed)
            for module, report in sorted(recorded.reports.items())
            if report.failed is not None
        )
        self._last = _Outcome(number, next(gave_up, None), self._scene.reached(sites))
        self._note()

    def check(self, transcript: Transcript, pacing: Pacing) -> None:
        """Check the end of the run, when all of it is known."""
        summary = transcript.summary
        last = self._last.round
        # A round that was finished is looked at once, and if it does not end the run the next one
        # is begun.
        went_on = pacing.round > last or pacing.phase == "over"
        for each in self._ends:
            due = self._due(each, transcript)
            if due is not None and (each.round < last or went_on):
                self._fail(CHECK, f"it continues after round {each.round}: {_text(due)}")
        if summary is None:
            return
        due = None if went_on else self._due(self._last, transcript)
        self._check_recorded(summary, due, pacing)
        self._check_line(summary, pacing)

    def _due(self, at: _Outcome, transcript: Transcript) -> tuple[str, str | None] | None:
        """Return how the run has to end after a round, with its error; None if it continues."""
        over, summary = transcript.schedule_over, transcript.summary
        stopped = None if summary is None else summary.schedule_stopped
        if self._cubes is not None and (over is None or at.round <= over):
            stop = self._stop(at, stopped)
            if stop is not None and not self._repair:
                return "failed", stop
            is_over = stop is not None or at.round == self._cubes
            if is_over and at.reached:
                return "goal", None
        elif at.gave_up is not None:
            module, reason = at.gave_up
            before = "" if stopped is None else f"{_stop_text(stopped)}; then "
            return "failed", f"{before}module_{module}: {reason}"
        elif at.reached:
            return "goal", None
        return ("max-rounds", None) if self._most is not None and at.round >= self._most else None

    def _stop(self, at: _Outcome, stopped: Stopped | None) -> str | None:
        """Return the message about a schedule that stopped after a round, None if it did not."""
        if at.gave_up is not None:
            module, reason = at.gave_up
            return f"the schedule stopped at round {at.round}: module_{module}: {reason}"
        if stopped is not None and stopped.module is None and stopped.round == at.round + 1:
            return _stop_text(stopped)
        return None

    def _check_recorded(
        self, summary: Summary, due: tuple[str, str | None] | None, pacing: Pacing
    ) -> None:
        why = pacing.unfinished() if pacing.is_begun else None
        recorded: tuple[str, str | None] = (summary.ended, summary.error)
        finished = why is None and pacing.phase in ("settle", "join")
        if summary.ended in ("goal", "max-rounds"):
            # Without the parameter it is not known how many rounds there may be.
            free = summary.ended == "max-rounds" and self._most is None and due is None
            if recorded != due and not (free and summary.error is None):
                self._fail(CHECK, f"it says {_text(recorded)}, derived is {_text(due)}")
            elif not finished:
                self._fail(CHECK, f"it says {summary.ended}, but {why or 'a phase was begun'}")
        elif finished and due is not None and due != recorded:
            self._fail(CHECK, f"it says {_text(recorded)}, derived is {_text(due)}")
        elif summary.ended == "failed" and due != recorded:
            error = summary.error or ""
            stopped = summary.schedule_stopped
            if stopped is not None:
                error = error.removeprefix(f"{_stop_text(stopped)}; then ")
            if _GAVE_UP.match(error) or error.startswith("the schedule stopped at "):
                self._fail(CHECK, f"it says {error!r}, which no module says")

    def _check_line(self, summary: Summary, pacing: Pacing) -> None:
        """Check what an error says of the process and the round that ended the run."""
        error = summary.error
        if summary.ended == "interrupted" and error != "interrupted":
            self._fail(CHECK, f"it was interrupted, and says {error!r}")
        if summary.ended == "failed" and (not error or "\n" in error):
            self._fail(CHECK, f"it failed, and says {error!r}, expected one line")
        died, late = _DIED.search(error or ""), _LATE.search(error or "")
        hosts = self._processes
        if died and (int(died[2]) != pacing.round or (hosts is not None and int(died[1]) >= hosts)):
            self._fail(CHECK, f"it says {error!r}, in round {pacing.round}")
        if late and (late[1], int(late[2])) != (pacing.phase, pacing.round):
            self._fail(CHECK, f"it says {error!r}, in phase {pacing.phase} of round {pacing.round}")


def _cubes(recording: Recording) -> int | None:
    """Return the number of cubes of the recorded schedule; None if there is none."""
    if recording.schedule is None:
        return None
    try:
        return len(schedule_from_jsonl(recording.schedule))
    except InputError:
        return None


def _stop_text(stopped: Stopped) -> str:
    module = "" if stopped.module is None else f"module_{stopped.module}: "
    return f"the schedule stopped at round {stopped.round}: {module}{stopped.reason}"


def _text(ending: tuple[str, str | None] | None) -> str:
    if ending is None:
        return "no end"
    ended, error = ending
    return ended if error is None else f"{ended} ({error})"


def check_schedule(recording: Recording, transcript: Transcript, fail: Fail) -> None:
    """Check that the rounds are the cubes of the schedule, and that its stop fits the reports.

    In a round in which one module cannot make its move, the others make theirs. Rounds after the
    schedule are not checked here.
    """
    summary = transcript.summary
    if recording.schedule is None:
        recorded = summary is not None and (summary.schedule_cubes, summary.schedule_stopped)
        if "schedule" in recording.parameters or recorded not in (False, (None, None)):
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
        _check_cube(
            number, cubes[number - 1], transcript.carried[number], fail, last=number == last
        )
    if summary is not None:
        _check_recorded_schedule(summary, cubes, transcript, last, fail)
        if summary.schedule_stopped is None and last != len(cubes):
            if over is not None:
                fail(
                    "schedule", f"it was over after {over} of {len(cubes)} cubes, and did not stop"
                )
            elif summary.ended == "goal":
                fail("schedule", f"the run ended after {last} of {len(cubes)} cubes")


def _moves(placed: Iterable[GeneratorPlacement]) -> Made:
    return frozenset((move.generator, move.at) for move in placed)


def _check_cube(
    number: int,
    cube: tuple[GeneratorPlacement, ...],
    carried: ScheduledRound,
    fail: Fail,
    *,
    last: bool,
) -> None:
    due, made, gave_up = _moves(cube), carried.made, carried.gave_up
    for what, moves in (("is not in its cube", made - due), ("is not made", due - made)):
        if moves and not (gave_up and moves <= due):
            generator, at = min(moves, key=repr)
            fail("schedule", f"round {number}: {generator} at {site_text(at)} {what}")
    if gave_up and not last:
        fail("schedule", f"it went on after round {number}, where module_{gave_up[0][0]} gave up")


def _check_recorded_schedule(
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
        recorded = None if stopped is None else (stopped.round, stopped.module, stopped.reason)
        if recorded != due:
            fail("schedule", f"module_{due[1]} gave up in round {last}: {due[2]}")
    elif stopped is not None and (stopped.round, stopped.module) != (last + 1, None):
        fail(
            "schedule",
            f"the summary says it stopped at round {stopped.round}, no other module does",
        )
    if stopped is not None and not _was_due(stopped, cubes, transcript):
        fail("schedule", f"it did not stop for {stopped.move.generator}: not due, or it was made")


def _was_due(stopped: Stopped, cubes: Cubes, transcript: Transcript) -> bool:
    cube = cubes[stopped.round - 1] if 1 <= stopped.round <= len(cubes) else ()
    move = _moves([stopped.move])
    return move <= _moves(cube) and not move <= transcript.carried.get(stopped.round, _NOTHING).made
