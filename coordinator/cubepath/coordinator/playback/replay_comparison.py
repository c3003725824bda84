"""A replay compared with its recording: the new results against the ones the coordinator wrote.

How much of its run a recording holds decides what a replay can be compared with.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.coordinator.verification.partial import hole_in, why_partial
from cubepath.coordinator.verification.round_spans import Span, add_to_spans, spans_text
from cubepath.coordinator.verification.transcript import is_cut_off
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.recordings.description import Clock
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.free_messages import FreeMessage, decode_free
from cubepath.protocol.wire.messages import Certified, Cube, Edges, Message, Summary, decode


@dataclass(frozen=True, slots=True)
class MissingRounds:
    """What is missing of a run in its recording."""

    cut_off: bool
    """Whether its end may be missing, as the recording says, or since it is damaged."""
    lacking: str | None
    """Why messages are missing at the start or in between, in a line; None if none are."""


def extent_of(recording: Recording) -> MissingRounds:
    """Return how much of its run a recording holds."""
    lacking = why_partial(recording)
    if lacking is None and (hole := hole_in(recording)) is not None:
        lacking = str(hole)
    cut_off = lacking is not None or bool(recording.problems) or is_cut_off(recording)
    return MissingRounds(cut_off, lacking)


_RESULTS = ("cubes", "summary")
"""What the coordinator says at the end of a whole run."""


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """The result of a replay; `same` says whether all of it was compared, and agrees.

    `differences` has one line for each place where it does not, and where the recording has nothing
    to compare with. Of a replay in parts the numbers are of what was gathered since it last jumped,
    or since rounds are missing, and `not_compared` says what they leave open.
    """

    log: str
    run: str
    endpoint: str
    complete: bool
    """Whether the recording has a result and all messages, and can all be read. What there is of a
    run that was cut off can be the same without."""
    messages: int
    seconds: float
    rounds: int = 0
    moves: int = 0
    reduced_moves: int = 0
    cubes: int = 0
    max_cube_dimension: int = 0
    path_digest: str = ""
    same: bool = False
    compared: bool = False
    """Whether the recording has a result, or says why it has none: it is damaged, was recovered, or
    is a part of another."""
    differences: tuple[str, ...] = ()
    not_compared: tuple[str, ...] = ()
    """What of the recording was not compared, and why; empty if all was."""
    rounds_compared: int = 0
    """How many rounds, or levels, were compared with the recorded moves."""
    left_out: dict[str, int] | None = None
    """By kind, how many messages of the recording were not played."""
    has_end: bool = True
    """Whether the end of the run is recorded."""
    problems: tuple[str, ...] = ()
    """What is damaged of the file, a line each."""
    lacking: str | None = None
    """Why messages are missing at the start or in between, in a line; None if none are."""
    after: int = 0
    """After which round the numbers count: where it last jumped to, or rounds are missing."""
    clock: Clock = "lockstep"
    heard: bool = True
    """Whether anyone subscribed to what was put, of messages on any keys."""

    @property
    def steps(self) -> str:
        """Return what the clock counts: rounds, or levels."""
        return "levels" if self.clock == "free" else "rounds"

    @property
    def agrees(self) -> bool:
        """Return whether nothing that was compared differs."""
        return self.same or bool(self.not_compared and not self.differences)

    @property
    def result(self) -> str:
        """Return in words how the replay compares with the recording."""
        return self._found + ("; the file is damaged" if self.problems else "")

    @property
    def _found(self) -> str:
        if self.not_compared:
            found = "differs from the recording; " if self.differences else ""
            if not self.differences and "summary" not in self.not_compared:
                found = "the same as recorded; "
            elif not self.differences and self.rounds_compared:
                found = (
                    f"the same as recorded in {counted(self.rounds_compared, self.steps[:-1])}; "
                )
            return f"{found}not compared: {', '.join(self.not_compared)}"
        if self.same:
            return "the same as recorded" + ("" if self.has_end else ", as far as it goes")
        return "differs from the recording" if self.compared else "nothing to compare it with"

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath replay --json``."""
        return asdict(self) | {"left_out": self.left_out or {}}


def not_compared_of(
    recording: Recording, rounds: set[int], last: int, results: Iterable[str] = _RESULTS
) -> list[str]:
    """Return what was not compared if these rounds, or levels, were, of those up to the last."""
    missing = _spans(rounds, last)
    steps = "levels" if recording.clock == "free" else "rounds"
    return [*([f"{steps} {missing}"] if missing else []), *results]


def _spans(numbers: set[int], last: int) -> str:
    """Return the numbers from 1 to the last one that are missing: "1 to 3, 7", "" for none."""
    found: list[Span] = []
    for number in range(1, last + 1):
        if number not in numbers:
            add_to_spans(found, number)
    return spans_text(found)


class SegmentResult(NamedTuple):
    """The result of comparing some rounds, or levels, with the recorded edges."""

    rounds: set[int]
    """Those that were compared, whether they agree or not."""
    differences: list[str]


class Comparison:
    """What was gathered of a whole recording from its start on, beside what is recorded.

    Of a recording that lacks messages only what is there is compared.
    """

    def __init__(self, recording: Recording, gathered: Gathered, extent: MissingRounds) -> None:
        self._recording = recording
        self._gatherer = gathered
        self._extent = extent
        self._step = "level" if recording.clock == "free" else "round"
        self.differences: list[str] = []
        """A line for each difference between the gathered run and the one in the recording."""
        self.not_compared: list[str] = []
        """What of the results there is nothing to compare with."""
        self.rounds: set[int] = set()
        """The rounds, or levels, whose moves were compared."""
        self._compare()

    def _compare(self) -> None:
        edges, cubes, summary = self._on_record()
        differences, lacking = self.differences, self._extent.lacking
        cut_off = self._extent.cut_off and summary is None
        rounds = self._gatherer.rounds
        if not cut_off and not lacking and self._gatherer.unfinished is not None:
            differences.append(self._gatherer.unfinished)
        differences += self._other_edges(edges, cut_off=cut_off)
        if summary is None and not self._extent.cut_off:
            differences.append("no summary is on record, so there is no result to compare with")
            return
        if lacking and (summary is None or rounds < summary.rounds):
            last = max(rounds, *edges, 0 if summary is None else summary.rounds)
            self.not_compared += not_compared_of(self._recording, self.rounds, last)
            return
        # A run that is cut off may have had no time to write the edges of its last round, and
        # without rounds those of any level.
        if (lacking or cut_off) and not {*range(1, rounds)} <= self.rounds:
            results = _RESULTS if summary is None else ()
            self.not_compared += not_compared_of(self._recording, self.rounds, rounds, results)
        if lacking and not cubes:
            self.not_compared.append("cubes")
        else:
            differences += self._other_cubes(cubes, all_of_them=summary is not None)
        if summary is not None:
            differences += self._other_numbers(summary)
        differences += self._not_proved()

    def _on_record(self) -> tuple[dict[int, Edges], dict[int, Cube], Summary | None]:
        """Return the edges by round, the cubes by index, and the summary if there is one."""
        edges: dict[int, Edges] = {}
        cubes: dict[int, Cube] = {}
        summary: Summary | None = None
        for record in self._recording.of_kind("edges", "cube", "summary"):
            match recorded_message(self._recording, record):
                case Edges() as message:
                    edges[message.round] = message
                case Cube() as message:
                    cubes[message.index] = message
                case Summary() as message:
                    summary = message
                case _:
                    pass
        return edges, cubes, summary

    def _other_edges(self, recorded: dict[int, Edges], *, cut_off: bool) -> Iterator[str]:
        lacking = bool(self._extent.lacking)
        found = _edges_compared(
            self._gatherer, recorded, 0, self._step, lacking=lacking, whole=not cut_off
        )
        self.rounds |= found.rounds
        yield from found.differences
        if lacking:
            return
        stray = recorded.keys() - range(1, self._gatherer.rounds + 1)
        if stray:
            free = self._recording.clock == "free"
            why = "no keeper reported a move of it" if free else "not all modules reported it"
            yield f"{self._step} {min(stray)}: edges on record, but {why}"

    def _other_cubes(self, recorded: dict[int, Cube], *, all_of_them: bool) -> Iterator[str]:
        found = self._gatherer.heap.cube_path()
        # Of a run that was cut off the first cubes may be recorded, or none.
        most = len(found) if all_of_them else max(recorded, default=0)
        for index in sorted({*recorded, *range(1, most + 1)}):
            cube = recorded.get(index)
            recorded_cube = None if cube is None else self._actions(cube)
            if not 1 <= index <= len(found) or recorded_cube != frozenset(found[index - 1]):
                yield f"cube {index} is another than on record"

    def _actions(self, cube: Cube) -> frozenset[Action]:
        system = self._recording.scene.system
        return frozenset(system.read_action(move) for move in cube.moves)

    def _not_proved(self) -> Iterator[str]:
        path = [action for step in self._gatherer.steps for action in step.actions]
        start = self._recording.scene.start_state
        for record in self._recording.of_kind("certificate"):
            message = recorded_message(self._recording, record)
            if not isinstance(message, Certified):
                continue
            for check, why in check_certificate(message.certificate, path, start).items():
                if why is not None:
                    yield f"the certificate does not prove what was gathered: {check}: {why}"

    def _other_numbers(self, summary: Summary) -> Iterator[str]:
        for key, value in self._gatherer.figures.items():
            if getattr(summary, key) != value:
                yield f"{key} is {value}, on record is {getattr(summary, key)}"


def rounds_compared(
    recording: Recording, gathered: Gathered, base: int, *, lacking: bool
) -> SegmentResult:
    """Compare rounds that were gathered from a state after round `base` with those on record.

    Edges that are not there are a difference if later ones are, unless messages are `lacking`.
    """
    rounds = range(base + 1, base + len(gathered.steps) + 1)
    by_wall = recording.parameters.get("log_time") == "wall"
    recorded: dict[int, Edges] = {}
    for record in recording.written({"edges"}, None if by_wall else rounds):
        message = recorded_message(recording, record)
        if isinstance(message, Edges) and message.round in rounds:
            recorded[message.round] = message
    return _edges_compared(gathered, recorded, base, "round", lacking=lacking)


def _edges_compared(
    gathered: Gathered,
    recorded: Mapping[int, Edges],
    base: int,
    step_name: str,
    *,
    lacking: bool,
    whole: bool = False,
) -> SegmentResult:
    """Compare moves with the recorded edges.

    Those that are not there are a difference if all have to be (`whole`), or if later ones are,
    since a run that was killed may have had no time to write the last.
    """
    found = SegmentResult(set(), [])
    last = max(recorded, default=0)
    for step in gathered.steps:
        number = base + step.round
        known = recorded.get(number)
        if known is None:
            if not lacking and (whole or number < last):
                found.differences.append(
                    f"{step_name} {number}: gathered, but its edges are not on record"
                )
            continue
        found.rounds.add(number)
        if known.moves != list(step.executed):
            found.differences.append(
                f"{step_name} {number}: other moves were gathered than are on record"
            )
    return found


def recorded_message(recording: Recording, record: Record) -> Message | FreeMessage:
    """Return what a record holds; InputError with its place if it is malformed."""
    try:
        return (decode_free if recording.clock == "free" else decode)(record.data)
    except CubepathError as error:
        where = f"{recording.path}: message {record.sequence} ({record.topic})"
        raise InputError(f"{where}: {error}") from None
