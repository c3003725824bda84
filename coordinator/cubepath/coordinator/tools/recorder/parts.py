"""Which messages are recorded, under which topic, and in which files.

Of a run the topic is KIND/SENDER; of messages on any keys it is their key.

Each of several files is a complete recording, closed before the next begins.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import zenoh

from cubepath.coordinator.runs.asking import RunInfo
from cubepath.coordinator.tools.recorder.backlog import ReceivedMessage, RecordedMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.cutting import MessageSelection
from cubepath.protocol.recordings.description import ATTACHED, KEYS, KEYS_FORMAT, PART
from cubepath.protocol.recordings.plain_messages import ATTACHMENT, DELETE
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.messages import KINDS

_KINDS = {*KINDS, *FREE_KINDS}
_SAID_TO = "to"
"""The first part of the keys of messages to regions; the messages are of the kind `bundle`."""
_COORDINATOR = "coordinator"


def topic_in(key: str) -> str | None:
    """Return the topic of what is put on a key; None if no message of a run is put there.

    What the coordinator puts for one process alone repeats what it has sent to all.

    >>> topic_in("cubepath/0123456789ab/to/0,1/process_3")
    'bundle/process_3'
    """
    parts = key.split("/")
    if len(parts) < 4:
        return None
    kind = "bundle" if parts[2] == _SAID_TO else parts[2]
    if kind not in _KINDS or (kind in ("go", "reset") and parts[-1] != _COORDINATOR):
        return None
    return f"{kind}/{parts[-1]}"


class Topics:
    """Topics by key: None for what is not recorded."""

    def __init__(self, topics: Sequence[str] = (), exclude: Sequence[str] = ()) -> None:
        """Record what `MessageSelection` takes; InputError for a pattern of no kind of messages."""
        self.has = MessageSelection(tuple(topics), tuple(exclude)).takes_topic
        """Returns whether messages of a topic are recorded."""
        for each in (*topics, *exclude):
            kind = each.partition("/")[0]
            if not any(fnmatchcase(known, kind) for known in _KINDS):
                near = did_you_mean(kind, _KINDS)
                raise InputError(f"topics {each}: no kind of messages matches{near}")
        self._known: dict[str, tuple[str | None, bool]] = {}

    def of(self, key: str) -> tuple[str | None, bool]:
        """Return the topic of a key, and whether it is recorded."""
        known = self._known.get(key)
        if known is None:
            topic = topic_in(key)
            known = self._known[key] = topic, topic is not None and self.has(topic)
        return known


def about_keys(keys: str) -> RunInfo:
    """Return how a recording of these keys begins; InputError if they are no key expression."""
    try:
        zenoh.KeyExpr(keys)
    except zenoh.ZError:
        raise InputError(
            f"keys={keys}: no key expression, expected parts with / in between, as robot/**"
        ) from None
    return RunInfo("", KEYS_FORMAT, {KEYS: keys, "log_time": "wall"}, "")


class KeyTopics:
    """The topics of messages on any keys, which are their keys."""

    def __init__(self, topics: Sequence[str] = (), exclude: Sequence[str] = ()) -> None:
        """Record what `MessageSelection` takes."""
        self.has = MessageSelection(tuple(topics), tuple(exclude)).takes_topic

    def of(self, key: str) -> tuple[str, bool]:
        """Return the topic of a key, and whether it is recorded."""
        return key, self.has(key)


def stored_messages(topic: str, heard: ReceivedMessage) -> Iterator[RecordedMessage]:
    """Yield what stands in a recording for a message on any key: its attachment, and itself."""
    plain = heard.plain
    if plain is None:
        raise AssertionError("a message of a run")  # it has a round or a level
    if plain.attachment is not None:
        yield _stored(topic + ATTACHMENT, plain.attachment, heard)
    yield _stored(topic + DELETE if plain.deleted else topic, heard.data, heard)


def _stored(topic: str, data: bytes, heard: ReceivedMessage) -> RecordedMessage:
    plain, at = heard.plain, heard.wall_ns
    sent_ns = at if plain is None or plain.sent_ns is None else plain.sent_ns
    return RecordedMessage(topic, data, at, at, 0, sent_ns, None if plain is None else plain.put)


NOTES = "cubepath-attached"
"""The name of the metadata record that tells what is missing."""
_PARTS_MAX = 1_000_000
_OVER_S, _OVER_BYTES = 1.0, 1 << 20
"""A full file continues until a round begins, at most for this long and by this many bytes."""


@dataclass(frozen=True, slots=True)
class SplitLimits:
    """When a file is full; None means never."""

    bytes: int | None = None
    seconds: float | None = None

    def __bool__(self) -> bool:
        """Return whether there may be several files."""
        return self.bytes is not None or self.seconds is not None


class RecordingParts:
    """Writes messages to a file, or to one file after another."""

    def __init__(
        self,
        about: RunInfo,
        path: Path,
        splitting: SplitLimits,
        notes: Callable[[], Mapping[str, str]],
        parameters: Mapping[str, str],
    ) -> None:
        """Begin no file yet; `notes` is asked for the last record of each.

        InputError if the first file exists already.
        """
        self.paths: list[Path] = []
        self.messages = 0
        self._about = about
        self._path = path
        self._splitting = splitting
        self._notes = notes
        self._parameters = parameters
        self._scene: Scene | None = None
        if about.format != KEYS_FORMAT:
            self._scene = scene_from_toml(about.scene, f"run {about.run} (scene)")
        self._writer: RecordingWriter | None = None
        self._until = 0.0
        first = self._next()
        if first.exists():
            raise InputError(f"{first}: exists already, expected a new file")

    def _next(self) -> Path:
        if not self._splitting:
            return self._path
        return numbered(self._path, len(self.paths))

    def write(self, message: RecordedMessage, *, round_begins: bool = False) -> None:
        """Write a message at its log time; CheckError if it cannot be written."""
        writer = self._writer
        if writer is not None and self._is_full(writer, round_begins=round_begins):
            self._end(writer)
            writer = None
        if writer is None:
            writer = self._begin(message.begins)
        sent_ns = message.wall_ns if message.sent_ns is None else message.sent_ns
        writer.write(
            message.topic, message.data, round_number=message.at, wall_ns=sent_ns, put=message.put
        )
        self.messages += 1

    def _is_full(self, writer: RecordingWriter, *, round_begins: bool) -> bool:
        most, splitting = self._splitting.bytes, self._splitting
        if most is not None and writer.has(most):
            return round_begins or writer.has(most + _OVER_BYTES)
        if splitting.seconds is None:
            return False
        over = time.monotonic() - self._until
        return over >= 0 and (round_begins or over >= _OVER_S)

    def _begin(self, begins: int) -> RecordingWriter:
        path = self._next()
        parameters = {**self._about.parameters, **self._parameters}
        if self._scene is not None:
            parameters[ATTACHED] = str(begins)
        if self._splitting:
            parameters[PART] = str(len(self.paths))
        schedule = self._about.schedule
        writer = self._writer = RecordingWriter(
            path,
            self._scene,
            parameters,
            None if schedule is None else schedule.encode(),
            written_as=self._about.format,
        )
        self.paths.append(path)
        self._until = time.monotonic() + (self._splitting.seconds or 0.0)
        return writer

    def _end(self, writer: RecordingWriter) -> None:
        self._writer = None
        try:
            writer.note(NOTES, self._notes())
        finally:
            writer.close()

    def flush_if_due(self) -> None:
        """Write what has waited for long."""
        if self._writer is not None:
            self._writer.flush_if_due()

    def close(self) -> None:
        """End the last file; if nothing came there is one without messages."""
        writer = self._writer
        if writer is None and not self.paths:
            writer = self._begin(0)
        if writer is not None:
            self._end(writer)


def numbered(path: Path, number: int) -> Path:
    """Return the path of a file of several, as NAME-000.mcap."""
    if number >= _PARTS_MAX:
        raise InputError(f"{path}: expected fewer than {_PARTS_MAX} files")
    return path.with_name(f"{path.stem}-{number:03}{path.suffix}")
