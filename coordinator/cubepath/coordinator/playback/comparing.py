"""A replay compared with the record: what was gathered anew is what the coordinator once wrote.

Room: coordinator.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Record, Recording
from cubepath.protocol.wire.messages import (
    Certified,
    Cube,
    Edges,
    Message,
    Summary,
    decode,
)


@dataclass(frozen=True, slots=True)
class Replayed:
    """The result of a replay; `same` says whether all of it was compared, and agrees.

    `differences` has one line for each place where it does not, where the recording has nothing to
    compare with, and for what could not be read of the recording. Of a replay in parts the numbers
    are of what was gathered since it last jumped, and `not_compared` says what they leave open.
    """

    log: str
    run: str
    endpoint: str
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    path_digest: str
    same: bool
    compared: bool
    """Whether the recording has a result, or says that it was recovered; otherwise it is cut off,
    and there may be more of it elsewhere."""
    complete: bool
    """Whether the recording has a result and can all be read. What was recovered of a run that was
    cut off can be the same without."""
    differences: tuple[str, ...]
    messages: int
    seconds: float
    not_compared: tuple[str, ...] = ()
    """What of the recording was not compared, and why; empty if all was."""
    rounds_compared: int = 0
    """How many rounds were compared one by one, if not all was."""
    left_out: dict[str, int] | None = None
    """By kind, how many messages of the recording were not played."""

    @property
    def agrees(self) -> bool:
        """Return whether nothing that was compared differs."""
        return self.same or bool(self.not_compared and not self.differences)

    @property
    def result(self) -> str:
        """Return in words how the replay compares with the recording."""
        if self.not_compared:
            found = "differs from the recording; " if self.differences else ""
            if self.rounds_compared and not self.differences:
                found = f"the same as recorded in {self.rounds_compared} rounds; "
            return f"{found}not compared: {', '.join(self.not_compared)}"
        if self.same:
            return "the same as recorded" + ("" if self.complete else ", as far as it goes")
        return "differs from the recording" if self.compared else "nothing to compare it with"

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath replay --json``."""
        found = {key: getattr(self, key) for key in self.__slots__}
        return found | {
            "differences": list(self.differences),
            "not_compared": list(self.not_compared),
            "left_out": self.left_out or {},
        }


def is_recovered(recording: Recording) -> bool:
    """Return whether the recording says that it holds what could be read of another."""
    return RECOVERED in recording.parameters


class Comparison:
    """What was gathered of a whole recording, beside what is on record."""

    def __init__(self, recording: Recording, gathered: Gathered) -> None:
        """Compare nothing yet."""
        self._recording = recording
        self._gatherer = gathered
        self._free = recording.clock == "free"
        self._recovered = is_recovered(recording)

    def differences(self) -> Iterator[str]:
        """Yield each difference between the gathered run and the one on record."""
        yield from self._recording.problems
        edges: dict[int, Edges] = {}
        cubes: dict[int, Cube] = {}
        summary: Summary | None = None
        for record in self._recording.of_kind("edges", "cube", "summary"):
            match _message(self._recording, record):
                case Edges() as message:
                    edges[message.round] = message
                case Cube() as message:
                    cubes[message.index] = message
                case Summary() as message:
                    summary = message
                case _:
                    pass
        cut_off = self._recovered and summary is None
        if not cut_off and self._gatherer.unfinished is not None:
            yield self._gatherer.unfinished
        yield from self._other_edges(edges, cut_off=cut_off)
        if summary is None and not self._recovered:
            yield "no summary is on record, so there is no result to compare with"
            return
        yield from self._other_cubes(cubes, all_of_them=summary is not None)
        if summary is not None:
            yield from self._other_numbers(summary)
        yield from self._not_proved()

    def _other_edges(self, recorded: dict[int, Edges], *, cut_off: bool) -> Iterator[str]:
        steps, step_name = self._gatherer.steps, "level" if self._free else "round"
        for step in steps:
            known = recorded.pop(step.round, None)
            # A run that was killed may have had no time to write the edges of its last round.
            if known is None and not (cut_off and step is steps[-1]):
                yield f"{step_name} {step.round}: gathered, but its edges are not on record"
            elif known is not None and known.moves != list(step.executed):
                yield f"{step_name} {step.round}: other moves were gathered than are on record"
        if recorded:
            why = "no keeper reported a move of it" if self._free else "not all modules reported it"
            yield f"{step_name} {min(recorded)}: edges on record, but {why}"

    def _other_cubes(self, recorded: dict[int, Cube], *, all_of_them: bool) -> Iterator[str]:
        found = self._gatherer.heap.cube_path()
        # Of a run that was cut off the first cubes may be on record, or none.
        most = len(found) if all_of_them else max(recorded, default=0)
        for index in sorted({*recorded, *range(1, most + 1)}):
            cube = recorded.get(index)
            told = None if cube is None else self._actions(cube)
            if not 1 <= index <= len(found) or told != frozenset(found[index - 1]):
                yield f"cube {index} is another than on record"

    def _actions(self, cube: Cube) -> frozenset[Action]:
        system = self._recording.scene.system
        return frozenset(
            system.action(move.generator, site_from_json(move.at)) for move in cube.moves
        )

    def _not_proved(self) -> Iterator[str]:
        path = [action for step in self._gatherer.steps for action in step.actions]
        start = self._recording.scene.start_state
        for record in self._recording.of_kind("certificate"):
            message = _message(self._recording, record)
            if not isinstance(message, Certified):
                continue
            for check, why in check_certificate(message.certificate, path, start).items():
                if why is not None:
                    yield f"the certificate does not prove what was gathered: {check}: {why}"

    def _other_numbers(self, summary: Summary) -> Iterator[str]:
        gatherer = self._gatherer
        found = {
            "rounds": gatherer.rounds,
            "moves": gatherer.heap.moves,
            "reduced_moves": gatherer.heap.reduced_moves,
            "cubes": gatherer.heap.cubes,
            "max_cube_dimension": gatherer.heap.max_cube_dimension,
            "goal_reached": gatherer.reached,
            "path_digest": gatherer.digest,
        }
        for key, value in found.items():
            if getattr(summary, key) != value:
                yield f"{key} is {value}, on record is {getattr(summary, key)}"


def rounds_that_differ(recording: Recording, gathered: Gathered, base: int) -> Iterator[str]:
    """Yield each round that was gathered from a state after round `base` and is not as recorded."""
    steps = gathered.steps
    rounds = range(base + 1, base + len(steps) + 1)
    by_wall = recording.parameters.get("log_time") == "wall"
    told: dict[int, Edges] = {}
    for record in recording.written({"edges"}, None if by_wall else rounds):
        message = _message(recording, record)
        if isinstance(message, Edges) and message.round in rounds:
            told[message.round] = message
    for step in steps:
        known = told.get(base + step.round)
        if known is None:
            if told and base + step.round < max(told):
                yield f"round {base + step.round}: gathered, but its edges are not on record"
        elif known.moves != list(step.executed):
            yield f"round {base + step.round}: other moves were gathered than are on record"


def _message(recording: Recording, record: Record) -> Message:
    try:
        return decode(record.data)
    except CubepathError as error:
        raise InputError(f"{_where(recording, record)}: {error}") from None


def _where(recording: Recording, record: Record) -> str:
    return f"{recording.path}: message {record.sequence} ({record.topic})"
