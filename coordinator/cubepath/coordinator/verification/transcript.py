"""A transcript: the messages of a recording by round and sender, before any of it is checked.

Part of `cubepath verify`: it shares only the decoding of messages with a run.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple, TypeAlias

from msgspec.structs import replace

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.recordings.cutting import whole_of
from cubepath.protocol.recordings.description import ATTACHED
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.keys import topic_of

ModuleMessage: TypeAlias = wire.Presence | wire.Note | wire.Claim | wire.Verdict
"""The messages that a module sends to its neighbours."""
_IN_ROUNDS = (wire.Bundle, wire.Reports)
_PARTS = (
    wire.Presence,
    wire.Note,
    wire.Claim,
    wire.Verdict,
    wire.Report,
    wire.ModuleObservation,
    wire.ChosenAction,
)
RECOVERED = "recovered"
"""The parameter that says what a recording was recovered from."""
Fail = Callable[[str, str], None]
"""Called with the name of a check that fails, and one line on where and why."""


def is_cut_off(recording: Recording) -> bool:
    """Return whether a recording says itself that its end may be missing.

    It was recovered from a damaged one, has some messages of another, or was made from outside by
    somebody who may leave before the run ends.
    """
    parameters = recording.parameters
    return RECOVERED in parameters or ATTACHED in parameters or whole_of(recording) is not None


class OutOfOrder(Exception):  # noqa: N818 - a state of affairs, not an error
    """A message is of a round that was closed, since it stands where that round is over.

    Recordings with such messages are wrong, but what else is wrong with them can still be reported:
    all rounds have to be kept to the end.
    """


@dataclass(slots=True)
class RecordedRound:
    """The messages of modules in a round, by kind and speaker, and their reports at its end.

    When the round is closed, both are in the order of their keys. `edges` are the coordinator's.
    """

    messages: dict[tuple[str, int], ModuleMessage] = field(default_factory=dict)
    reports: dict[int, wire.Report] = field(default_factory=dict)
    edges: wire.Edges | None = None
    batches: list[wire.Bundle | wire.Reports] = field(default_factory=list)
    """What the parts came in."""


Made: TypeAlias = frozenset[tuple[str, Site | None]]
"""Moves by generator and place."""


class ScheduledRound(NamedTuple):
    """What a round did of a schedule: the moves made, and the modules that gave up, with why."""

    made: Made
    gave_up: tuple[tuple[int, str], ...]


@dataclass(slots=True)
class Transcript:
    """Everything in a recording that counts for its result, but for the rounds themselves."""

    cubes: dict[int, wire.Cube] = field(default_factory=dict)
    certificate: Certificate | None = None
    summary: wire.Summary | None = None
    gap: int = 0
    """The number of messages that are missing before the last one, by their numbers."""
    complete_rounds: int = 0
    """The number of rounds, from the first on, that every module has reported.

    Where the first that counts is a later one, or those behind a gap count too, it is the last of
    them.
    """
    stray_edges: list[int] = field(default_factory=list)
    """The rounds of the coordinator's edges that not every module has reported."""
    refused: int = 0
    """How many messages were refused, as far as the record tells."""
    own_rules: dict[int, str] = field(default_factory=dict)
    """By module the rule that its process named, if that is not the rule of the run."""
    schedule_over: int | None = None
    """The last round of the schedule if the rule took over after it."""
    carried: dict[int, ScheduledRound] = field(default_factory=dict)
    """What each round did, if a schedule was to be carried out."""

    def take(self, message: wire.Cube | wire.Certified | wire.Summary, fail: Fail) -> None:
        """Take what the coordinator says at the end, which it says once."""
        match message:
            case wire.Cube(index=index):
                if index in self.cubes:
                    fail("complete", f"cube {index} comes twice")
                self.cubes.setdefault(index, message)
            case wire.Certified(certificate=certificate):
                if self.certificate is not None:
                    fail("certificate", "the certificate comes twice")
                self.certificate = certificate
            case wire.Summary():
                if self.summary is not None:
                    fail("complete", "the summary comes twice")
                self.summary = message

    @property
    def result(self) -> tuple[wire.Cube, ...]:
        """Return the cubes in order of their index."""
        return tuple(self.cubes[index] for index in sorted(self.cubes))


class SharedMoves:
    """Keeps one object for equal moves: there are few of them in many cubes."""

    def __init__(self) -> None:
        self._placed: dict[tuple[str, Site], GeneratorPlacement] = {}

    def cube(self, cube: wire.Cube) -> wire.Cube:
        """Return an equal cube of such moves."""
        return replace(cube, moves=[*map(self._shared, cube.moves)])

    def _shared(self, placed: GeneratorPlacement) -> GeneratorPlacement:
        at = placed.at
        return placed if at is None else self._placed.setdefault((placed.generator, at), placed)


class Sorting:
    """Sorts the messages of a recording; `fail` is called for what is wrong without any derivation.

    That is `messages` (each decodes, and stands under its own topic and round), messages that come
    twice and differ (`bundle`, `reports`, `edges`, `certificate`), missing reports, and `complete`.

    A round is closed when none of its messages is still to come. It is dropped then, so that memory
    holds only the rounds in progress.
    """

    def __init__(
        self,
        recording: Recording,
        fail: Fail,
        watch: Callable[[wire.Message], object] | None = None,
        *,
        first: int = 1,
        gaps: bool = False,
    ) -> None:
        """Begin before the first message; `watch` is given all that decode, as they stand.

        `first` is the first round that counts: of those before it nothing is yielded. With `gaps`
        the complete rounds behind one that is not complete count too.
        """
        self.found = Transcript(complete_rounds=first - 1)
        self._watch = watch
        self._gaps = gaps
        self._fail = fail
        self._modules = len(recording.scene.start)
        self._everyone = set(range(self._modules))
        self._undamaged = not recording.problems
        self._cut_off = is_cut_off(recording)
        self._scheduled = recording.schedule is not None
        self._own_rules: dict[int, str] = {}
        self._rounds: dict[int, RecordedRound] = {}
        self._count, self._highest = 0, -1
        self._closed = -inf
        self._moves = SharedMoves()
        # The rounds with reports, and who has reported the first that is not complete.
        self._first, self._last = inf, -inf
        self._known: frozenset[int] = frozenset()

    def take(self, records: Iterable[Record]) -> None:
        """Sort some records; OutOfOrder if one is of a round that is closed."""
        for record in records:
            self._count += 1
            self._highest = max(self._highest, record.sequence)
            message = _message(record, self._fail)
            if message is None:
                continue
            self._check_form(record, message)
            if isinstance(message, _IN_ROUNDS):
                self._round(message.round).batches.append(message)
                own_rule = self._own_rules.get(message.process)
                if own_rule is not None:
                    modules = (part.module for part in message.parts)
                    self.found.own_rules |= dict.fromkeys(modules, own_rule)
            if self._watch is not None:
                self._watch(message)
            for part in _parts(record, message, self._fail):
                self._sort(part)

    def _check_form(self, record: Record, message: wire.Message) -> None:
        """Check that what modules say is in batches, none of them empty."""
        if not wire.parts_of(message):
            self._fail("batches", f"{_place(record)} is empty")
        elif isinstance(message, _PARTS):
            self._fail("batches", f"{_place(record)} is in no batch")

    def close(self, least: float) -> Iterator[tuple[int, RecordedRound]]:
        """Yield the rounds that count, once each, in order; none below `least` is to come."""
        self._closed = max(self._closed, least)
        found = self.found
        for number in sorted(number for number in self._rounds if number < least):
            this = self._rounds.pop(number)
            # The report on them is the same whatever the order of arrival.
            this.messages = dict(sorted(this.messages.items()))
            this.reports = dict(sorted(this.reports.items()))
            if self._scheduled and this.reports:
                found.carried[number] = _carried(this.reports)
            after = found.complete_rounds + 1
            counts = number == after or (self._gaps and number > after)
            if counts and this.reports.keys() == self._everyone:
                found.complete_rounds = number
                self._known = frozenset()
                yield number, this
                continue
            if number == after:
                self._known = frozenset(this.reports)
            if this.edges is not None:
                found.stray_edges.append(number)

    def end(self) -> None:
        """Check what can be known only at the end, when all rounds are closed."""
        self.found.gap = max(0, self._highest + 1 - self._count)
        if self.found.gap and self._undamaged:
            self._fail("complete", f"{self.found.gap} messages before the last one are missing")
        self._check_reports()
        last = f"round {self.found.complete_rounds}"
        check_complete(self.found, self._fail, last, cut_off=self._cut_off)

    def _sort(self, message: wire.Message) -> None:
        match message:
            case wire.Presence() | wire.Note() | wire.Claim() | wire.Verdict() | wire.Report():
                self._sort_message(message)
            case wire.Edges(round=number):
                this = self._round(number)
                if this.edges is not None:
                    self._fail("edges", f"round {number}: its edges come twice")
                this.edges = this.edges or message
            case wire.Go(phase="over", round=number) if self.found.schedule_over is None:
                self.found.schedule_over = number
            case wire.Ready(phase="join", process=process, rule=str(rule)):
                self._own_rules[process] = rule
            case wire.Refused(count=count):
                self.found.refused += count
            case wire.Cube():
                self.found.take(self._moves.cube(message), self._fail)
            case wire.Certified() | wire.Summary():
                self.found.take(message, self._fail)
            case _:
                pass

    def _round(self, number: int) -> RecordedRound:
        if number < self._closed:
            raise OutOfOrder
        found = self._rounds.get(number)
        if found is None:
            found = self._rounds[number] = RecordedRound()
        return found

    def _sort_message(self, message: ModuleMessage | wire.Report) -> None:
        check = "reports" if isinstance(message, wire.Report) else "bundle"
        if not 0 <= message.module < self._modules:
            self._fail(check, f"{named(message)}: there is no such module in this run")
            return
        this = self._round(message.round)
        known: ModuleMessage | wire.Report
        if isinstance(message, wire.Report):
            known = this.reports.setdefault(message.module, message)
            self._first = min(self._first, message.round)
            self._last = max(self._last, message.round)
        else:
            known = this.messages.setdefault((wire.kind_of(message), message.module), message)
        # A message sent twice counts once: a part stands in a batch for each region that it goes
        # to.
        if known is not message and known != message:
            self._fail(check, f"{named(message)} comes twice, and differs")

    def _check_reports(self) -> None:
        found = self.found
        after = found.complete_rounds + 1
        # A run that was interrupted may stop between two reports of its last round.
        ended_well = found.summary is not None and found.summary.ended in ("goal", "max-rounds")
        if self._last > after or (self._last == after and ended_well):
            absent = next(module for module in range(self._modules) if module not in self._known)
            self._fail("reports", f"round {after}, module_{absent}: no report")
        if self._first < 1:
            self._fail("reports", f"round {self._first}: rounds count from 1")


def _carried(reports: Mapping[int, wire.Report]) -> ScheduledRound:
    moves = (report.move for report in reports.values())
    return ScheduledRound(
        frozenset((move.generator, move.at) for move in moves if move is not None),
        tuple((n, each.failed) for n, each in reports.items() if each.failed is not None),
    )


def _message(record: Record, fail: Fail) -> wire.Message | None:
    """Return the message of a record; None if it does not decode."""
    try:
        message = wire.decode(record.data)
    except InputError as error:
        fail("messages", f"message {record.sequence} ({record.topic}): {error}")
        return None
    topic = topic_of(message)
    if topic != record.topic or message.round != record.round:
        fail("messages", f"{_place(record)} is {topic} of round {message.round}")
    return message


def _parts(record: Record, message: wire.Message, fail: Fail) -> Sequence[wire.Message]:
    """Return the parts of a batch, or the message itself."""
    parts = wire.parts_of(message)
    if len(parts) > 1 and len(
        {(type(part), getattr(part, "module", None)) for part in parts}
    ) < len(parts):
        fail("batches", f"{_place(record)} holds two parts of a kind of one module")
    for part in parts:
        if part.round != message.round:
            fail("messages", f"{_place(record)} holds {topic_of(part)} of round {part.round}")
    return parts


def _place(record: Record) -> str:
    return f"message {record.sequence} ({record.topic}, round {record.round})"


def named(message: ModuleMessage | wire.Report) -> str:
    """Return the name of a module's message in error messages."""
    return f"round {message.round}, module_{message.module}: {wire.kind_of(message)}"


def check_complete(found: Transcript, fail: Fail, last: str, *, cut_off: bool) -> None:
    """Check that there is a summary, and as many cubes as it counts.

    `last` is the last round or level in the recording.
    """
    summary = found.summary
    if summary is None:
        if cut_off:
            return  # the recording says so itself, and is fine as far as it goes
        fail("complete", f"no summary: the run did not end, or its end is lost after {last}")
        return
    # One by one: the number is whatever the file says.
    absent = next((n for n in range(1, summary.cubes + 1) if n not in found.cubes), None)
    if absent is not None:
        fail("complete", f"cube {absent} of {summary.cubes} is missing")
    stray = [index for index in sorted(found.cubes) if not 1 <= index <= summary.cubes]
    if stray:
        fail("complete", f"cube {stray[0]}: the summary counts {summary.cubes}")
