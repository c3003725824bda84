"""The messages of a run without rounds, by subject, before any of it is derived.

Part of `cubepath verify`: it shares only the decoding of messages with a run.

Only results are kept whole: of a commit its numbers are kept, of other messages a few numbers and
hashes each. Once all commits are known the messages are read again, and checked one by one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import msgspec

from cubepath.coordinator.verification import free_asked
from cubepath.coordinator.verification.free_losses import Losses
from cubepath.coordinator.verification.free_units import NO_SITE
from cubepath.coordinator.verification.number_table import Name, NumberTable, PackedCommits
from cubepath.coordinator.verification.parameters import keepers_of, processes_of
from cubepath.coordinator.verification.transcript import Fail, SharedMoves, Transcript, is_cut_off
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import free_messages as free, messages as wire
from cubepath.protocol.wire.keys import Tiles

AttemptId: TypeAlias = Name
"""Which attempt: module, epoch, number."""
_LIMITED = ("keeper", "process", "to", "module")


class KeeperPart(NamedTuple):
    """A part of a message, with its position, sender and receiver."""

    where: Record
    keeper: int
    """The keeper that says it."""
    to: int
    """The keeper or the process to which it is sent."""
    part: free.Forwarded | free.Decision | free.Inquiry | free.Settled | free.Entered
    to_process: bool
    """Whether it is sent to a process."""


@dataclass(slots=True)
class FreeTranscript:
    """What the messages of a run without rounds say, as far as others are compared with it."""

    attempts: free_asked.AskedAttempts
    asked_by: dict[int, set[int]] = field(default_factory=dict)
    """By module the processes that spoke for it."""
    commits: PackedCommits = field(default_factory=PackedCommits)
    acknowledged: set[tuple[AttemptId, int]] = field(default_factory=set)
    """The attempts whose commit a keeper reports to know, with that keeper."""
    shown: dict[Site, free_asked.ShownVersions] = field(default_factory=dict)
    """By place what was shown of it."""
    turns: free_asked.HashedNames = field(default_factory=free_asked.HashedNames)
    """Each with the number of its attempt, -1 if it makes none."""
    gave_up: set[str] = field(default_factory=set)
    """Which modules gave up, with their reasons."""
    entered: set[tuple[int, int]] = field(default_factory=set)
    """The modules with their incarnations that asked where they stand."""
    stands: dict[tuple[int, int], tuple[int, Site]] = field(default_factory=dict)
    """By module and epoch, its first version of which it was told, and where it stood then."""
    looks: set[tuple[int, str]] = field(default_factory=set)
    """Tiles of which all was asked for, with the keeper that was asked."""
    losses: Losses = field(default_factory=Losses)
    edges: NumberTable = field(default_factory=NumberTable)
    """By level the hash of the coordinator's edges."""
    results: Transcript = field(default_factory=Transcript)

    @property
    def broken_off(self) -> bool:
        """Return whether the run ended before everything was known, or did not wait for it long."""
        summary = self.results.summary
        return summary is not None and summary.ended in ("failed", "interrupted")

    def after_the_end(self, decision: free.Decision) -> bool:
        """Return whether a commit may have come too late for the record of a run that broke off."""
        moved = decision.commit
        if moved is None or not self.broken_off:
            return False
        return moved.serial > self.commits.serials(moved.keeper).last


class FreeReading:
    """Reads a recording; `fail` is called for what is wrong without any derivation."""

    def __init__(self, recording: Recording, fail: Fail) -> None:
        self._system = system = recording.scene.system
        self._modules = len(recording.scene.start)
        self._keepers = keepers_of(recording)
        self._processes = processes_of(recording)
        tiles = None if self._keepers is None else Tiles(system, self._keepers)
        self.found = FreeTranscript(free_asked.AskedAttempts(system, tiles))
        self._fail = fail
        limits = (self._keepers, self._processes, self._keepers, self._modules)
        self._most = {
            name: most for name, most in zip(_LIMITED, limits, strict=True) if most is not None
        }
        self._limits: dict[type[msgspec.Struct], tuple[tuple[str, int], ...]] = {}
        """The numbers of modules, processes and keepers that messages and parts of a kind name."""
        self._by_wall = recording.parameters.get("log_time") == "wall"
        self._whole = not recording.problems and not is_cut_off(recording)
        self._level = 0
        self._highest = self._count = 0
        self._moves = SharedMoves()
        self._topics: dict[tuple[type[free.FreeMessage], int, int], tuple[str, str]] = {}

    def read(self, recording: Recording) -> FreeTranscript:
        """Read all messages."""
        for record in recording.records:
            self._count += 1
            self._highest = max(self._highest, record.sequence + 1)
            self._take(record)
        self.found.results.gap = max(0, self._highest - self._count)
        attempts = self.found.attempts
        for name in attempts.passed_alone():
            if self.found.losses.of_attempt(name):
                attempts.believe(name)
        return self.found

    def _take(self, record: Record) -> None:
        try:
            message = free.decode_free(record.data)
        except InputError as error:
            self._fail("messages", f"{record}: {error}")
            return
        topic, sender = self._topic(message)
        if topic != record.topic:
            self._fail("messages", f"{record} is {topic}")
        self._check_time(record, message)
        self._check_names(record, message)
        self.found.losses.take(record, message, sender, self._fail)
        self._sort(record, message)

    def _topic(self, message: free.FreeMessage) -> tuple[str, str]:
        """Return the topic of a message, and the sender in it."""
        key = type(message), getattr(message, "keeper", 0), getattr(message, "process", 0)
        known = self._topics.get(key)
        if known is None:
            sender = free.free_sender(message)
            known = self._topics[key] = f"{free.free_kind(message)}/{sender}", sender
        return known

    def _check_time(self, record: Record, message: free.FreeMessage) -> None:
        before = self._level
        if isinstance(message, free.Commit | free.CommitLog):
            commits = message.parts if isinstance(message, free.CommitLog) else (message,)
            self._level = max([before, *(moved.level for moved in commits)])
        due = record.wall_ns if self._by_wall else self._level
        if self._whole and record.round != due:
            what = "its wall time" if self._by_wall else f"the greatest level so far, {due}"
            self._fail("messages", f"{record} has log time {record.round}, expected {what}")
        if not self._whole and not self._by_wall and record.round < before:
            self._fail("messages", f"{record} has log time {record.round} after level {before}")

    def _check_names(self, where: Record, message: free.FreeMessage) -> None:
        """Check that keepers, processes and modules are some of the run."""
        parts: Sequence[msgspec.Struct] = getattr(message, "parts", ())
        if self._strays((message, *parts)):
            for name, most in self._most.items():
                for each in (message, *parts):
                    value = getattr(each, name, None)
                    if isinstance(value, int) and value >= most:
                        self._fail(
                            "messages", f"{where}: {name} {value}, expected less than {most}"
                        )
        if isinstance(message, free.Forwards) and message.to == message.keeper:
            self._fail("messages", f"{where} says something to itself")
        if isinstance(
            message, free.Requests | free.Forwards | free.Replies | free.Turns | free.CommitLog
        ):
            if not parts and not isinstance(message, free.CommitLog):
                self._fail("messages", f"{where} is empty")
            if len(parts) > 1 and len(set(map(wire.encode, parts))) < len(parts):
                self._fail("messages", f"{where} holds a part twice")

    def _strays(self, parts: Iterable[msgspec.Struct]) -> bool:
        """Return whether any of these names a keeper, process or module of no run."""
        for part in parts:
            kind = type(part)
            limits = self._limits.get(kind)
            if limits is None:
                named = (each for each in self._most.items() if each[0] in kind.__struct_fields__)
                limits = self._limits[kind] = tuple(named)
            for name, most in limits:
                value = getattr(part, name)
                if isinstance(value, int) and value >= most:
                    return True
        return False

    def _sort(self, where: Record, message: free.FreeMessage) -> None:
        if isinstance(message, free.Commit):
            self._moved(where, message, announced=True)
        elif isinstance(message, free.Turns):
            for turn in message.parts:
                name = turn.module, turn.epoch, turn.turn
                attempt = -1 if turn.number is None else turn.number
                if not self.found.turns.take(name, hash(wire.encode(turn)), attempt):
                    self._fail("turns", f"{where}: {turn_text(turn)} comes twice, and differs")
                if turn.failed is not None:
                    self.found.gave_up.add(f"module_{turn.module}: {turn.failed}")
        elif isinstance(
            message, free.Requests | free.Forwards | free.Replies | free.TileUpdate | free.CommitLog
        ):
            self._sort_message(where, message)
        elif not isinstance(message, free.Halted):
            if isinstance(message, wire.Cube | wire.Certified):
                self._check_level(where, message)
            self._result(message)

    def _sort_message(
        self,
        where: Record,
        message: free.Requests | free.Forwards | free.Replies | free.TileUpdate | free.CommitLog,
    ) -> None:
        if not self._whole:
            self._told_early(where, message.parts)
        match message:
            case free.Requests():
                self._asked(where, message)
            case free.Forwards():
                self._passed(message)
            case free.Replies():
                self._take_replies(message)
            case free.TileUpdate(parts=places):
                self._shown(places, once=True)
            case free.CommitLog(keeper=keeper, parts=commits):
                for moved in commits:
                    if moved.keeper != keeper:
                        self._fail("serials", f"{where} tells a commit of keeper_{moved.keeper}")
                    self._moved(where, moved)

    def _passed(self, message: free.Forwards) -> None:
        for part in message.parts:
            if isinstance(part, free.Forwarded):
                self.found.attempts.take(part.attempt, asked=False)
            elif isinstance(part, free.Settled):
                name = part.module, part.epoch, part.number
                self.found.acknowledged.add((name, message.keeper))

    def _take_replies(self, message: free.Replies) -> None:
        for part in message.parts:
            if isinstance(part, free.Entered):
                occupant, site = part.occupant, part.site
                if site is not None:
                    name = occupant.module, occupant.epoch
                    known = self.found.stands.get(name)
                    if known is None or occupant.version < known[0]:
                        self.found.stands[name] = occupant.version, site

    def _shown(self, parts: Iterable[free.PlaceState], *, once: bool = False) -> None:
        """Note the versions shown; `once` each place counts in a message."""
        seen: set[Site] = set()
        for part in parts:
            place = part.place
            try:
                if place is None or not self._system.has_place(place) or place in seen:
                    continue
            except NO_SITE:
                return
            if once:
                seen.add(place)
            known = self.found.shown.get(place)
            if known is None:
                known = self.found.shown[place] = free_asked.ShownVersions()
            known.add(part.version, part.module_version)

    def _told_early(self, where: Record, parts: Iterable[object]) -> None:
        """Take commits from decisions, where the record ends before the commits themselves."""
        for part in parts:
            if isinstance(part, free.Decision) and part.commit is not None:
                self._moved(where, part.commit)

    def _asked(self, where: Record, message: free.Requests) -> None:
        found = self.found
        for part in message.parts:
            if isinstance(part, free.TileQuery):
                found.looks.add((message.keeper, part.tile))
                continue
            found.asked_by.setdefault(part.module, set()).add(message.process)
            if isinstance(part, free.EnterRequest):
                found.entered.add((part.module, part.incarnation))
            elif not found.attempts.take(part, asked=True):
                name = attempt_text(free_asked.attempt_name(part))
                self._fail("attempts", f"{where}: {name} comes twice, and differs")

    def _moved(self, where: Record, moved: free.Commit, *, announced: bool = False) -> None:
        if not self.found.commits.add(moved, announced=announced):
            name = f"commit {moved.serial} of keeper_{moved.keeper}"
            self._fail("serials", f"{where}: {name} comes twice, and differs")

    def _check_level(self, where: Record, message: wire.Cube | wire.Certified) -> None:
        if self._whole and message.round != self._level:
            self._fail("messages", f"{where} is of level {message.round}, of {self._level}")

    def _result(self, message: free.FreeMessage) -> None:
        found, results = self.found, self.found.results
        match message:
            case wire.Edges(round=level):
                if found.edges.get(level) is not None:
                    self._fail("edges", f"level {level}: its edges come twice")
                found.edges.setdefault(level, edges_hash(message.moves))
            case wire.Cube():
                results.take(self._moves.cube(message), self._fail)
            case wire.Certified() | wire.Summary():
                results.take(message, self._fail)
            case wire.Refused(count=count):
                results.refused += count
            case _:
                pass


def edges_hash(moves: Sequence[wire.Executed]) -> int:
    """Return a number that stands for the coordinator's edges of a level, within this process."""
    return hash(wire.encode(moves))


def attempt_text(name: AttemptId) -> str:
    """Return the name of an attempt in error messages."""
    module, epoch, number = name
    return f"attempt {number} of module_{module} in epoch {epoch}"


def turn_text(turn: free.Turn) -> str:
    """Return the name of a turn in error messages."""
    return f"turn {turn.turn} of module_{turn.module} in epoch {turn.epoch}"


def commit_text(moved: free.Commit) -> str:
    """Return the name of a commit in error messages."""
    return f"commit {moved.serial} of keeper_{moved.keeper} (module_{moved.module})"
