"""The messages of a run without rounds, by what they are about, before any of it is derived.

Room: coordinator. Part of `cubepath verify`: it shares only the decoding of messages with a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import msgspec

from cubepath.coordinator.verification.free_losses import Losses
from cubepath.coordinator.verification.parameters import keepers_of, processes_of
from cubepath.coordinator.verification.transcript import Fail, Transcript, is_cut_off
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.wire.free_messages import (
    Asks,
    Attempt,
    Decision,
    Enter,
    Entered,
    FreeMessage,
    Held,
    Hold,
    Inquiry,
    Look,
    Moved,
    Passed,
    Passes,
    Rest,
    Settled,
    Shows,
    Tail,
    Tells,
    Turn,
    Turns,
    decode_free,
    free_topic,
)
from cubepath.protocol.wire.messages import Certified, Cube, Edges, Refused, Summary, encode

AttemptId: TypeAlias = tuple[int, int, int]
"""Which attempt: module, epoch, number."""


class Said(NamedTuple):
    """A part of a message, with where it stands and who says it to whom."""

    where: str
    keeper: int
    """The keeper that says it."""
    to: int
    """The keeper or the process that it is said to."""
    part: Passed | Decision | Inquiry | Settled | Entered
    told: bool
    """Whether it is said to a process."""


class Shown(NamedTuple):
    """A message that shows a tile, with where it stands."""

    where: str
    message: Shows


@dataclass(slots=True)
class FreeTranscript:
    """Everything in the recording of a run without rounds."""

    attempts: dict[AttemptId, Attempt] = field(default_factory=dict)
    passed: dict[AttemptId, Attempt] = field(default_factory=dict)
    """Attempts as keepers pass them on."""
    asked_of: dict[AttemptId, set[int]] = field(default_factory=dict)
    """The keepers that each attempt was asked of."""
    asked_by: dict[int, set[int]] = field(default_factory=dict)
    """By module the processes that spoke for it."""
    commits: dict[int, dict[int, Moved]] = field(default_factory=dict)
    """By keeper and serial number."""
    said: list[Said] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    turns: dict[int, dict[tuple[int, int], Turn]] = field(default_factory=dict)
    """By module, then by epoch and turn."""
    entered: set[tuple[int, int]] = field(default_factory=set)
    """The modules with their births that asked where they stand."""
    holds: dict[AttemptId, tuple[int, Hold]] = field(default_factory=dict)
    """By module, epoch and number what was asked to be held, and of which keeper."""
    held: list[tuple[str, int, Held]] = field(default_factory=list)
    """What keepers hold, with where that stands and which keeper says it."""
    looks: list[tuple[str, int, Look]] = field(default_factory=list)
    tails: list[tuple[str, Tail]] = field(default_factory=list)
    announced: set[tuple[int, int]] = field(default_factory=set)
    """The commits, by keeper and serial number, that did not come by a tail alone."""
    losses: Losses = field(default_factory=Losses)
    edges: dict[int, Edges] = field(default_factory=dict)
    results: Transcript = field(default_factory=Transcript)

    @property
    def broken_off(self) -> bool:
        """Return whether the run ended before everything was known, or did not wait for it long."""
        summary = self.results.summary
        return summary is not None and summary.ended in ("failed", "interrupted")

    def after_the_end(self, decision: Decision) -> bool:
        """Return whether a commit may have come too late for the record of a run that broke off."""
        moved = decision.moved
        if moved is None or not self.broken_off:
            return False
        return moved.serial > max(self.commits.get(moved.keeper, ()), default=0)

    def of_keepers(self) -> Iterator[Moved]:
        """Yield the commits by keeper, then by serial number."""
        for keeper in sorted(self.commits):
            for serial in sorted(self.commits[keeper]):
                yield self.commits[keeper][serial]


class FreeReading:
    """Reads a recording; `fail` is called for what is wrong without any derivation."""

    def __init__(self, recording: Recording, fail: Fail) -> None:
        """Begin before the first message."""
        self.found = FreeTranscript()
        self._fail = fail
        self._modules = len(recording.scene.start)
        self._keepers = keepers_of(recording)
        self._processes = processes_of(recording)
        self._by_wall = recording.parameters.get("log_time") == "wall"
        self._whole = not recording.problems and not is_cut_off(recording)
        self._level = 0
        self._highest = self._count = 0

    def read(self, recording: Recording) -> FreeTranscript:
        """Read all messages."""
        for record in recording.records:
            self._count += 1
            self._highest = max(self._highest, record.sequence + 1)
            self._take(record)
        self.found.results.gap = max(0, self._highest - self._count)
        for name, attempt in self.found.passed.items():
            if name not in self.found.attempts and self._lost(attempt):
                self.found.attempts[name] = attempt
        return self.found

    def _lost(self, attempt: Attempt) -> bool:
        losses = self.found.losses
        return losses.of_module(attempt.module) or losses.before(attempt.module, attempt.epoch)

    def _take(self, record: Record) -> None:
        where = f"message {record.sequence} ({record.topic})"
        try:
            message = decode_free(record.data)
        except InputError as error:
            self._fail("messages", f"{where}: {error}")
            return
        if free_topic(message) != record.topic:
            self._fail("messages", f"{where} is {free_topic(message)}")
        self._check_time(where, record, message)
        self._check_names(where, message)
        self.found.losses.take(where, message, record.data, self._fail)
        self._sort(where, message)

    def _check_time(self, where: str, record: Record, message: FreeMessage) -> None:
        told = message.parts if isinstance(message, Tail) else ()
        if isinstance(message, Moved):
            told = [message]
        before = self._level
        self._level = max([self._level, *(moved.level for moved in told)])
        due = (record.wall_ns,) if self._by_wall else (self._level,)
        if self._whole and record.round not in due:
            what = "its wall time" if self._by_wall else f"the greatest level so far, {due[0]}"
            self._fail("messages", f"{where} has log time {record.round}, expected {what}")
        if not self._whole and not self._by_wall and record.round < before:
            self._fail("messages", f"{where} has log time {record.round} after level {before}")

    def _check_names(self, where: str, message: FreeMessage) -> None:
        """Check that keepers, processes and modules are some of the run."""
        for name, most in (
            ("keeper", self._keepers),
            ("process", self._processes),
            ("to", self._keepers),
            ("module", self._modules),
        ):
            for value in _named(message, name):
                if most is not None and value >= most:
                    self._fail("messages", f"{where}: {name} {value}, expected less than {most}")
        if isinstance(message, Passes) and message.to == message.keeper:
            self._fail("messages", f"{where} says something to itself")
        if isinstance(message, Asks | Passes | Tells | Turns | Tail):
            parts = message.parts
            if not parts and not isinstance(message, Tail):
                self._fail("messages", f"{where} is empty")
            if len(parts) > 1 and len(set(map(encode, parts))) < len(parts):
                self._fail("messages", f"{where} holds a part twice")

    def _sort(self, where: str, message: FreeMessage) -> None:
        if isinstance(message, Moved):
            self.found.announced.add((message.keeper, message.serial))
            self._moved(where, message)
        elif isinstance(message, Turns):
            for turn in message.parts:
                self._turn(where, turn)
        elif isinstance(message, Asks | Passes | Tells | Shows | Tail):
            self._sort_said(where, message)
        elif not isinstance(message, Rest):
            if isinstance(message, Cube | Certified):
                self._check_level(where, message)
            self._result(message)

    def _sort_said(self, where: str, message: Asks | Passes | Tells | Shows | Tail) -> None:
        found = self.found
        self._told_early(where, message.parts)
        match message:
            case Asks():
                self._asked(where, message)
            case Passes(keeper=keeper, to=to, parts=parts):
                self._passed(where, keeper, to, parts)
            case Tells(keeper=keeper, process=process, parts=told):
                for part in told:
                    if isinstance(part, Held):
                        found.held.append((where, keeper, part))
                    else:
                        found.said.append(Said(where, keeper, process, part, told=True))
            case Shows():
                found.shown.append(Shown(where, message))
            case Tail(keeper=keeper, parts=commits):
                found.tails.append((where, message))
                for moved in commits:
                    if moved.keeper != keeper:
                        self._fail("serials", f"{where} tells a commit of keeper_{moved.keeper}")
                    self._moved(where, moved)

    def _passed(
        self,
        where: str,
        keeper: int,
        to: int,
        parts: Iterable[Passed | Decision | Inquiry | Settled],
    ) -> None:
        for part in parts:
            self.found.said.append(Said(where, keeper, to, part, told=False))
            if isinstance(part, Passed):
                self.found.passed.setdefault(attempt_name(part.attempt), part.attempt)

    def _told_early(self, where: str, parts: Iterable[object]) -> None:
        """Take commits from decisions, where the record ends before the commits themselves."""
        for part in parts:
            if not self._whole and isinstance(part, Decision) and part.moved is not None:
                self._moved(where, part.moved)

    def _asked(self, where: str, message: Asks) -> None:
        found = self.found
        for part in message.parts:
            if isinstance(part, Look):
                found.looks.append((where, message.keeper, part))
                continue
            found.asked_by.setdefault(part.module, set()).add(message.process)
            if isinstance(part, Enter):
                found.entered.add((part.module, part.birth))
                continue
            name = part.module, part.epoch, part.number
            if isinstance(part, Hold):
                asked = message.keeper, part
                if found.holds.setdefault(name, asked) != asked:
                    self._fail("shown", f"{where}: hold {part.number} comes twice, and differs")
                continue
            found.asked_of.setdefault(name, set()).add(message.keeper)
            if found.attempts.setdefault(name, part) != part:
                self._fail("attempts", f"{where}: {attempt_text(name)} comes twice, and differs")

    def _moved(self, where: str, moved: Moved) -> None:
        known = self.found.commits.setdefault(moved.keeper, {}).setdefault(moved.serial, moved)
        if known != moved:
            name = f"commit {moved.serial} of keeper_{moved.keeper}"
            self._fail("serials", f"{where}: {name} comes twice, and differs")

    def _turn(self, where: str, turn: Turn) -> None:
        name = turn.epoch, turn.turn
        if self.found.turns.setdefault(turn.module, {}).setdefault(name, turn) != turn:
            self._fail("turns", f"{where}: {turn_text(turn)} comes twice, and differs")

    def _check_level(self, where: str, message: Cube | Certified) -> None:
        if self._whole and message.round != self._level:
            self._fail("messages", f"{where} is of level {message.round}, of {self._level}")

    def _result(self, message: FreeMessage) -> None:
        found, results = self.found, self.found.results
        match message:
            case Edges(round=level):
                if level in found.edges:
                    self._fail("edges", f"level {level}: its edges come twice")
                found.edges.setdefault(level, message)
            case Cube() | Certified() | Summary():
                results.take(message, self._fail)
            case Refused(count=count):
                results.refused += count
            case _:
                pass


def attempt_name(attempt: Attempt) -> AttemptId:
    """Return which attempt this is."""
    return attempt.module, attempt.epoch, attempt.number


def _named(message: FreeMessage, name: str) -> Iterator[int]:
    """Yield the numbers of keepers, processes or modules that a message and its parts name."""
    for each in (message, *(getattr(message, "parts", None) or ())):
        value = getattr(each, name, None)
        if isinstance(each, msgspec.Struct) and isinstance(value, int):
            yield value


def attempt_text(name: AttemptId) -> str:
    """Return the name of an attempt in error messages."""
    module, epoch, number = name
    return f"attempt {number} of module_{module} in epoch {epoch}"


def turn_text(turn: Turn) -> str:
    """Return the name of a turn in error messages."""
    return f"turn {turn.turn} of module_{turn.module} in epoch {turn.epoch}"


def commit_text(moved: Moved) -> str:
    """Return the name of a commit in error messages."""
    return f"commit {moved.serial} of keeper_{moved.keeper} (module_{moved.module})"
