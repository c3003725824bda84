"""Verifying part of a run: one recorded from the middle, of some topics only, or cut, or damaged.

Part of `cubepath verify`. The recording of such a part says neither where modules stood when it
begins, nor what rules remembered. So each message is checked separately, and what would have to be
derived is reported as not checked.

A recording that damage has left with a hole is verified as usual up to the hole. Messages are
numbered in the order of writing, and recovered ones keep their numbers. Where modules stand and
what they remember follows from everything before, so after the hole each message is checked
separately too.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, overload

from cubepath.coordinator.verification import findings
from cubepath.coordinator.verification.parameters import check_parameters
from cubepath.coordinator.verification.transcript import RECOVERED, Fail
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.cutting import FILTERED, SPLIT, is_beginning, left_out, whole_of
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.free_messages import Commit, CommitLog, decode_free, free_topic
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Cube, Go, Report, decode, parts_of

_CHECKED = frozenset({"readable", "parameters", "messages"})


def why_partial(recording: Recording) -> str | None:
    """Return in a line why a recording is a part of a run; None if it begins at the start.

    What is missing at the end alone does not make it one.
    """
    parameters = recording.parameters
    for key in LEFT_OUT:
        if key in parameters:
            return f"messages were left out ({key} {parameters[key]})"
    whole = whole_of(recording)
    if whole is not None and not is_beginning(recording):
        what = [parameters[FILTERED]] if FILTERED in parameters else []
        what += [f"part {parameters[SPLIT]}"] if SPLIT in parameters else []
        details = f" ({'; '.join(what)})" if what else ""
        return f"{len(recording.records)} of {whole} messages{details}"
    begins = parameters.get(ATTACHED, "1")
    if begins == "1":
        return None
    what_begins = "level" if recording.clock == "free" else "round"
    return f"the recording begins in {what_begins} {begins}, when the run was attached to"


def verify_partial(
    recording: Recording, checks: Iterable[str], why: str, progress: findings.Progress | None
) -> findings.Verification:
    """Check each message by itself; `rounds` counts the whole ones, of which all have reported.

    Without rounds it counts the levels of which there are commits. The moves and cubes are those in
    the recording: nothing is derived.
    """
    failures = findings.Failures(checks)
    fail = failures.stage(0)
    for problem in recording.problems:
        fail("readable", problem)
    check_parameters(recording, fail)
    whole = WholeRounds(recording)
    cubes = count = 0
    last = -1
    for record in recording.records:
        if record.sequence <= last:
            where = f"message {record.sequence} ({record.topic})"
            fail("messages", f"{where} stands after message {last}")
        count, last = count + 1, max(last, record.sequence)
        for part in parts_checked(recording, record, fail):
            cubes += isinstance(part, Cube)
            if whole.take(part) and progress is not None:
                progress(1)
    unchecked = {name: f"not checked: {why}" for name in checks if name not in _CHECKED}
    made = failures.checks(unchecked)
    return findings.Verification(
        ok=all(check.ok for check in made),
        complete=False,
        missing=findings.MissingMessages(0, max(last + 1 - count, left_out(recording))),
        checks=made,
        moves=moves_in(recording),
        rounds=whole.count,
        cubes=cubes,
        path_digest="",
    )


class WholeRounds:
    """Counts the rounds that all modules have reported, wherever a recording begins.

    Without rounds it counts the levels of which there are commits.
    """

    def __init__(self, recording: Recording) -> None:
        self._modules = len(recording.scene.start)
        self._reported: dict[int, set[int]] = {}
        self._levels: set[int] = set()
        self._whole = 0
        self.last = 0
        """The last round that was begun."""

    @property
    def count(self) -> int:
        """Return how many there are so far."""
        return self._whole or len(self._levels)

    def take(self, part: Any) -> bool:
        """Take a message, or a part of a batch; return whether it was the last of its round."""
        match part:
            case Report() if part.module < self._modules:
                self.last = max(self.last, part.round)
                known = self._reported.setdefault(part.round, set())
                known.add(part.module)
                if len(known) == self._modules:
                    del self._reported[part.round]
                    self._whole += 1
                    return True
            case Go(phase="sense"):
                self.last = max(self.last, part.round)
            case Commit():
                before = len(self._levels)
                self._levels |= {part.level} - {0}  # those of no move
                return len(self._levels) > before
            case CommitLog():
                before = len(self._levels)
                self._levels |= {each.level for each in part.parts} - {0}
                return len(self._levels) > before
            case _:
                pass
        return False


def whole_rounds(recording: Recording) -> int:
    """Return how many rounds are whole, wherever the recording begins; without rounds levels."""
    found = WholeRounds(recording)
    for record in recording.records:
        for part in parts_checked(recording, record, lambda _check, _detail: None):
            found.take(part)
    return found.count


def parts_checked(recording: Recording, record: Record, fail: Fail) -> Iterable[Any]:
    """Check a message by itself; return it and its parts, or nothing if it is none."""
    where = f"message {record.sequence} ({record.topic})"
    parts: tuple[Any, ...]
    try:
        if recording.clock == "free":
            free = decode_free(record.data)
            topic, parts = free_topic(free), (free,)
        else:
            message = decode(record.data)
            topic, parts = topic_of(message), tuple(parts_of(message))
            found = (message.round, *(part.round for part in parts))
            other = next((each for each in found if each != record.round), None)
            if other is not None:
                fail("messages", f"{where} of round {record.round} is of round {other}")
    except InputError as error:
        fail("messages", f"{where}: {error}")
        return ()
    if topic != record.topic:
        fail("messages", f"{where}, round {record.round}: is {topic}")
    return parts


def moves_in(recording: Recording) -> int:
    """Return how many moves are recorded; 0 if a message that carries one is malformed."""
    try:
        return len(recording.moves()["round"])
    except InputError:  # told by `messages`
        return 0


_AHEAD_MAX = 10_000
"""Messages that may stand before one with a lower number: recorders that were merged do so."""
Blocks = Iterable[tuple[Iterable[Record], float]]
"""Messages some at a time, each time with the least round of those to come."""


@dataclass(frozen=True, slots=True)
class Hole:
    """Where messages are missing for the first time that were recorded once."""

    begins: int
    """The number of the first that is missing."""
    messages: int
    """How many are missing, in this hole and in later ones."""

    def __str__(self) -> str:
        are = "message is" if self.messages == 1 else "messages are"
        return f"{self.messages} {are} missing from message {self.begins} on"


def hole_in(recording: Recording) -> Hole | None:
    """Return the first hole that damage has left in a recording; None if there is none.

    That is in one that is damaged, or was recovered from one that is. What was left out on purpose
    is no hole, nor what is missing at the end.
    """
    if not recording.problems and RECOVERED not in recording.parameters:
        return None
    due = 0
    ahead: set[int] = set()
    last = -1
    for record in recording.records:
        last = max(last, record.sequence)
        if record.sequence != due:
            if len(ahead) < _AHEAD_MAX:
                ahead.add(record.sequence)
            continue
        due += 1
        while due in ahead:
            ahead.remove(due)
            due += 1
    missing = last + 1 - len(recording.records)
    return Hole(due, missing) if ahead and missing > 0 else None


def lacks(recording: Recording) -> bool:
    """Return whether messages of the run are known not to be in its recording.

    Of a whole recording nothing is read for it.
    """
    if whole_of(recording) is not None or why_partial(recording) is not None:
        return True
    return hole_in(recording) is not None


class _Before(Sequence[Record]):
    """The messages of a recording with numbers below some, read whenever they are asked for."""

    def __init__(self, records: Sequence[Record], end: int) -> None:
        self._records = records
        self._end = end

    def __iter__(self) -> Iterator[Record]:
        return (record for record in self._records if record.sequence < self._end)

    def __len__(self) -> int:
        return self._end

    @overload
    def __getitem__(self, index: int) -> Record: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Record, ...]: ...

    def __getitem__(self, index: int | slice) -> Record | tuple[Record, ...]:
        return tuple(self)[index]


def before(recording: Recording, hole: Hole) -> Recording:
    """Return what stands before a hole, as a recording that says that it was cut off there."""
    return replace(
        recording,
        records=_Before(recording.records, hole.begins),
        parameters={RECOVERED: str(hole), **recording.parameters},
        problems=(),
    )


def blocks_before(recording: Recording, hole: Hole) -> Blocks:
    """Yield the messages before a hole, as `Recording.blocks` does."""
    for records, least in recording.blocks():
        yield [record for record in records if record.sequence < hole.begins], least
    yield (), inf


def verify_with_hole(
    recording: Recording, hole: Hole, verified: Callable[[Recording], findings.Verification]
) -> findings.Verification:
    """Verify what stands before a hole by `verified`, and the messages behind it one by one.

    Moves, rounds and cubes are derived, and so are those before the hole.
    """
    found = verified(before(recording, hole))
    failures = findings.Failures(check.name for check in found.checks)
    fail = failures.stage(0)
    for problem in recording.problems:
        fail("readable", problem)
    whole = WholeRounds(recording)
    for record in recording.records:
        for part in parts_checked(recording, record, fail):
            whole.take(part)
    what = "level" if recording.clock == "free" else "round"
    why = f"not checked{f' after {what} {found.rounds}' if found.rounds else ''}: {hole}"
    again = {check.name: check for check in failures.checks({})}
    checks = tuple(_joined(check, again[check.name], why) for check in found.checks)
    begun = 0 if recording.clock == "free" else whole.last - whole.count
    return replace(
        found,
        ok=all(check.ok for check in checks),
        complete=False,
        missing=findings.MissingMessages(max(begun, 0), found.missing.messages + hole.messages),
        checks=checks,
    )


def _joined(before: findings.Check, message_by_message: findings.Check, why: str) -> findings.Check:
    """Return a check of the whole recording."""
    if not before.ok or not message_by_message.ok:
        return message_by_message if before.ok else before
    if before.name in ("readable", "parameters", "messages"):
        return before
    detail = before.detail.removeprefix("not checked: ")
    # The closing messages may stand behind the hole.
    details = [why] if before.checked or before.detail == findings.NO_END else [why, detail]
    return findings.Check(
        before.name, ok=True, detail="; ".join(filter(None, details)), checked=False
    )
