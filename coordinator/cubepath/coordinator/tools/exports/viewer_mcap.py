"""Log times for the time lines of other tools: rounds that last some time, or the wall clock.

Such a file is for viewers: it is no recording, and no command reads it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import IO, Literal, NamedTuple, TypeAlias

import msgspec

from cubepath.coordinator.runs.states import states_of
from cubepath.coordinator.tools.exports.foxglove import SceneEncoder
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.appending import McapAppender
from cubepath.protocol.recordings.cutting import MessageSelection
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import CHUNK_BYTES, TOPICS_MAX
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.free_messages import Commit, CommitLog, decode_free
from cubepath.protocol.wire.on_record import schema_of

LogTime: TypeAlias = Literal["round", "level", "wall"]
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ExportTimes:
    """How log times are made: from rounds or levels, each `round_ns` nanoseconds, or `by_wall`."""

    by_wall: bool
    round_ns: int

    def at(self, number: int, wall_ns: int) -> int:
        """Return the log time of a round or level, and of a wall time, in nanoseconds.

        InputError if it has more than 63 bits.
        """
        found = wall_ns if self.by_wall else number * self.round_ns
        if not 0 <= found < 1 << 63:
            raise InputError(f"log time {found}: expected less than 2^63 nanoseconds")
        return found


def times_of(
    recording: Recording, log_time: LogTime | None, round_seconds: float | None
) -> ExportTimes:
    """Return how log times are made; by default from rounds, or without rounds from levels.

    InputError if the run has none of what is asked for, or a round lasts no time.
    """
    logical = "level" if recording.clock == "free" else "round"
    if log_time not in (None, logical, "wall"):
        raise InputError(f"{recording.path}: log time {log_time!r}, expected '{logical}' or 'wall'")
    if log_time == "wall" and round_seconds is not None:
        raise InputError(
            f"a round of {round_seconds:g} s: by the wall clock a round lasts as long as it took,"
            f" expected log time '{logical}'"
        )
    round_seconds = 1.0 if round_seconds is None else round_seconds
    if not (isfinite(round_seconds) and round_seconds * _NS >= 1):
        raise InputError(f"a round of {round_seconds:g} s: expected at least 1e-09 s")
    return ExportTimes(log_time == "wall", round(round_seconds * _NS))


def numbered(recording: Recording) -> Iterator[tuple[int, Record]]:
    """Yield the messages in the order of writing, each with its round or the greatest level so far.

    InputError if a commit cannot be decoded.
    """
    if recording.clock != "free" or recording.parameters.get("log_time") != "wall":
        for record in recording.written():
            yield record.round, record
        return
    level = 0
    for record in recording.written():
        if record.kind in ("commit", "commits"):
            level = max([level, *_levels(recording, record)])
        yield level, record


def _levels(recording: Recording, record: Record) -> list[int]:
    try:
        said: msgspec.Struct = decode_free(record.data)
    except InputError as error:
        where = f"{recording.path}: message {record.sequence} ({record.topic})"
        raise InputError(f"{where}: {error}") from None
    told = said.parts if isinstance(said, CommitLog) else [said] if isinstance(said, Commit) else []
    return [moved.level for moved in told]


PROFILE = "cubepath-export"


class _Timed(NamedTuple):
    """A message with its log time and its publish time in nanoseconds."""

    log_time: int
    wall_ns: int
    topic: str
    data: bytes


def write_viewer_mcap(
    stream: IO[bytes],
    recording: Recording,
    *,
    times: ExportTimes,
    selection: MessageSelection,
    in_space: bool,
) -> int:
    """Write the messages that are taken, and with `in_space` the robot; return their number.

    Topics of a recording are as they are there, as JSON; those of the robot are protobuf.
    """
    stage = SceneEncoder(recording.scene) if in_space else None
    said = _said(recording, times, selection)
    robot = iter(()) if stage is None else _robot(recording, times, selection, stage)
    appender = McapAppender(stream, PROFILE)
    told = {"format": PROFILE, "recorded_as": recording.format}
    appender.add_metadata("cubepath", {**recording.parameters, **told})
    appender.add_attachment(
        "scene.toml", "application/toml", scene_to_toml(recording.scene).encode()
    )
    channels = _Channels(appender, {} if stage is None else stage.schemas())
    count = 0
    for timed in heapq.merge(robot, said, key=lambda timed: timed.log_time):
        appender.add_message(
            channels.of(timed.topic), count, timed.log_time, timed.wall_ns, timed.data
        )
        count += 1
        if appender.size > CHUNK_BYTES:
            appender.close_chunk()
    appender.finish()
    return count


def _said(
    recording: Recording, times: ExportTimes, selection: MessageSelection
) -> Iterator[_Timed]:
    for number, record in numbered(recording):
        if selection.keeps(record):
            log_time = times.at(number, record.wall_ns)
            yield _Timed(log_time, record.wall_ns, record.topic, record.data)


def _robot(
    recording: Recording, times: ExportTimes, selection: MessageSelection, stage: SceneEncoder
) -> Iterator[_Timed]:
    begun = False
    for state in states_of(recording):
        if selection.until is not None and state.round > selection.until:
            return
        if selection.first is not None and state.round < selection.first:
            continue
        log_time = times.at(state.round, state.wall_ns)
        if not begun:
            ground = stage.ground(log_time)
            yield _Timed(log_time, state.wall_ns, *ground)
            begun = True
        for encoded in stage.state(state, log_time):
            yield _Timed(log_time, state.wall_ns, *encoded)


class _Channels:
    """The channels of a file by topic, added when they are first used."""

    def __init__(
        self, appender: McapAppender, protobuf: Mapping[str, tuple[str, str, bytes]]
    ) -> None:
        self._appender = appender
        self._protobuf = protobuf
        self._known: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def of(self, topic: str) -> int:
        return self._known.get(topic) or self._add(topic)

    def _add(self, topic: str) -> int:
        if len(self._known) == TOPICS_MAX:
            raise InputError(f"{topic}: one more topic than a file can have, {TOPICS_MAX}")
        schema = self._protobuf.get(topic)
        if schema is None:
            kind = topic.partition("/")[0]
            number = self._schema(
                f"cubepath.{kind}", "jsonschema", lambda: msgspec.json.encode(schema_of(kind))
            )
            encoding = "json"
        else:
            name, how, data = schema
            number = self._schema(name, how, lambda: data)
            encoding = "protobuf"
        found = self._known[topic] = self._appender.add_channel(topic, encoding, number)
        return found

    def _schema(self, name: str, encoding: str, data: Callable[[], bytes]) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._appender.add_schema(name, encoding, data())
        return self._schemas[name]
