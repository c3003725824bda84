"""Which messages of a run are recorded, under which topic KIND/SENDER, and in which files.

Each of several files is a complete recording, closed before the next begins.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from cubepath.coordinator.runs.asking import RunInfo
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.description import ATTACHED, PART
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
        """Record what fits one of the globs `topics` (all, if there is none) and none of `exclude`.

        A glob without a slash is of the kind, and stands for all senders. InputError if one is
        empty, or matches no kind that there can be.
        """
        for each in (*topics, *exclude):
            if not each:
                raise InputError(
                    "topics: found an empty glob, expected one as 'bundle/*' or 'ready'"
                )
            kind = each.partition("/")[0]
            if not any(fnmatchcase(known, kind) for known in _KINDS):
                near = did_you_mean(kind, _KINDS)
                raise InputError(f"topics {each}: no kind of messages matches{near}")
        self._topics = [_whole(each) for each in topics]
        self._exclude = [_whole(each) for each in exclude]
        self._known: dict[str, tuple[str | None, bool]] = {}

    def __bool__(self) -> bool:
        """Return whether some topics are left out."""
        return bool(self._topics or self._exclude)

    def of(self, key: str) -> tuple[str | None, bool]:
        """Return the topic of a key, and whether it is recorded."""
        known = self._known.get(key)
        if known is None:
            topic = topic_in(key)
            known = self._known[key] = topic, topic is not None and self.has(topic)
        return known

    def has(self, topic: str) -> bool:
        """Return whether messages of a topic are recorded."""
        wanted = not self._topics or any(fnmatchcase(topic, each) for each in self._topics)
        return wanted and not any(fnmatchcase(topic, each) for each in self._exclude)


def _whole(glob: str) -> str:
    return glob if "/" in glob else f"{glob}/*"


NOTES = "cubepath-attached"
"""The name of the metadata record that tells what is missing."""
_PARTS_MAX = 1_000_000
_OVER_S, _OVER_BYTES = 1.0, 1 << 20
"""A file that is full goes on until a round begins, for so long, and by so many bytes at most."""


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
        *,
        clock: Callable[[], float] = time.monotonic,
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
        self._clock = clock
        self._scene: Scene = scene_from_toml(about.scene, f"run {about.run} (scene)")
        self._writer: RecordingWriter | None = None
        self._until = 0.0
        first = self._next()
        if first.exists():
            raise InputError(f"{first}: exists already, expected a new file")

    def _next(self) -> Path:
        if not self._splitting:
            return self._path
        return numbered(self._path, len(self.paths))

    def write(
        self, topic: str, data: bytes, *, at: int, wall_ns: int, begins: int, round_begins: bool
    ) -> None:
        """Write a message at its log time; CheckError if it cannot be written.

        `begins` is the first whole round of a file that begins with it.
        """
        writer = self._writer
        if writer is not None and self._is_full(writer, round_begins=round_begins):
            self._end(writer)
            writer = None
        if writer is None:
            writer = self._begin(begins)
        writer.write(topic, data, round_number=at, wall_ns=wall_ns)
        self.messages += 1

    def _is_full(self, writer: RecordingWriter, *, round_begins: bool) -> bool:
        most, splitting = self._splitting.bytes, self._splitting
        if most is not None and writer.has(most):
            return round_begins or writer.has(most + _OVER_BYTES)
        if splitting.seconds is None:
            return False
        over = self._clock() - self._until
        return over >= 0 and (round_begins or over >= _OVER_S)

    def _begin(self, begins: int) -> RecordingWriter:
        path = self._next()
        parameters = {**self._about.parameters, **self._parameters, ATTACHED: str(begins)}
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
        self._until = self._clock() + (self._splitting.seconds or 0.0)
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
