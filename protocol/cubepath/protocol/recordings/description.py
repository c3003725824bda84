"""What is in a recording: parameters, scene, and counts of messages, bytes and parts.

A recording ends with its counts, so they are known without reading it all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.mcap_file import checksum, kind_in
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.on_record import SHOWN

if TYPE_CHECKING:
    from cubepath.protocol.recordings.salvaging import Salvage


COUNTS = "cubepath-counts"
"""The name of the metadata record that closes a recording."""
BATCHES = {
    "bundle": frozenset({"presence", "note", "claim", "verdict"}),
    "reports": frozenset({"report"}),
    "observations": frozenset({"observation"}),
    "actions": frozenset({"action"}),
    "requests": frozenset({"attempt", "enter", "tile_query"}),
    "forwards": frozenset({"forwarded", "decision", "inquiry", "settled"}),
    "replies": frozenset({"decision", "entered"}),
    "tile": frozenset({SHOWN}),
    "turns": frozenset({"turn"}),
}
"""The kinds of messages that are batches, with the kinds of their parts."""


class _Part(msgspec.Struct, gc=False):
    kind: str = SHOWN


class _Batch(msgspec.Struct, gc=False):
    parts: list[_Part]


_batch = msgspec.json.Decoder(_Batch).decode


class KindCount(msgspec.Struct):
    """How many messages of a kind there are, and how many bytes they have."""

    messages: int = 0
    bytes: int = 0


_Known: TypeAlias = tuple[KindCount, bool]
"""Of a topic: its kind, and whether its messages are batches."""


@dataclass(slots=True)
class Counts:
    """The counts of a recording; `parts` counts what batches hold, by kind.

    With `by_topic` the kinds are topics, and nothing is a batch.
    """

    messages: int = 0
    kinds: dict[str, KindCount] = field(default_factory=dict)
    parts: dict[str, int] = field(default_factory=dict)
    topics: int = 0
    first_wall_ns: int | None = None
    last_wall_ns: int | None = None
    by_topic: bool = False
    _known: dict[str, _Known] = field(default_factory=dict)

    def add(self, topic: str, data: bytes, wall_ns: int) -> None:
        """Count a message."""
        kind, is_batch = self._known.get(topic) or self._know(topic)
        self.messages += 1
        kind.messages += 1
        kind.bytes += len(data)
        if self.first_wall_ns is None or self.last_wall_ns is None:
            self.first_wall_ns = self.last_wall_ns = wall_ns
        elif wall_ns < self.first_wall_ns:
            self.first_wall_ns = wall_ns
        elif wall_ns > self.last_wall_ns:
            self.last_wall_ns = wall_ns
        if is_batch:
            counted = self.parts
            for part in _parts(data):
                name = part.kind
                counted[name] = counted.get(name, 0) + 1

    def _know(self, topic: str) -> _Known:
        name = topic if self.by_topic else kind_in(topic)
        kind = self.kinds.setdefault(name, KindCount())
        known = kind, not self.by_topic and name in BATCHES
        self._known[topic] = known
        self.topics += 1
        return known

    def to_metadata(self) -> dict[str, str]:
        """Return the counts as a metadata record holds them."""
        values = {
            "messages": str(self.messages),
            "kinds": msgspec.json.encode(self.kinds).decode(),
            "parts": msgspec.json.encode(self.parts).decode(),
            "topics": str(self.topics),
            "first_wall_ns": _text(self.first_wall_ns),
            "last_wall_ns": _text(self.last_wall_ns),
        }
        return {**values, "checksum": checksum(values)}


def _parts(data: bytes) -> Iterable[_Part]:
    try:
        return _batch(data).parts
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ()


def _text(number: int | None) -> str:
    return "" if number is None else str(number)


def counts_of(found: Salvage) -> Counts | None:
    """Return the counts that a recording ends with; None if they are missing or do not fit."""
    stored = [each.metadata for each in found.metadata if each.name == COUNTS]
    counts = _counts_in(stored[0]) if len(stored) == 1 else None
    return counts if counts is not None and counts.messages == found.messages else None


def _counts_in(values: Mapping[str, str]) -> Counts | None:
    fields = {key: value for key, value in values.items() if key != "checksum"}
    if values.get("checksum") != checksum(fields):
        return None
    try:
        return Counts(
            messages=int(fields["messages"]),
            kinds=msgspec.json.decode(fields["kinds"], type=dict[str, KindCount]),
            parts=msgspec.json.decode(fields["parts"], type=dict[str, int]),
            topics=int(fields["topics"]),
            first_wall_ns=_number(fields["first_wall_ns"]),
            last_wall_ns=_number(fields["last_wall_ns"]),
        )
    except (KeyError, ValueError, msgspec.DecodeError):
        return None


def _number(text: str) -> int | None:
    return int(text) if text else None


FORMAT = "cubepath-recording-4"
"""The format of runs with rounds: modules say messages in batches, `said` and `reports`."""
FREE_FORMAT = "cubepath-recording-5"
"""The format of runs without rounds, which have keepers, versions and levels."""
KEYS_FORMAT = "cubepath-recording-6"
"""The format of messages on any keys: log time is when they were received, publish time when they
were sent, both the wall clock."""
FORMATS = (FORMAT, FREE_FORMAT, KEYS_FORMAT)
"""The formats that are read."""
KEYS = "keys"
"""The parameter with the key expressions that were recorded, separated by spaces."""
Clock: TypeAlias = Literal["lockstep", "free"]
METADATA = "cubepath"
"""The name of the metadata record with the parameters."""
ATTACHED = "attached"
"""The parameter of a recording from outside: the first round, or level, that is whole in it."""
PART = "part"
"""The parameter that numbers the files of one recorder from 0."""
LEFT_OUT = ("topics", "exclude")
"""The parameters that tell which topics were recorded, and which were not."""
SCENE = "scene.toml"
SCHEDULE = "schedule.jsonl"


def format_of(parameters: Mapping[str, str]) -> str:
    """Return the format that a new recording has, by the clock of its run."""
    return FREE_FORMAT if parameters.get("clock") == "free" else FORMAT


def clock_of(written_as: str) -> Clock:
    """Return the clock of the runs that a format is for; messages on any keys have no rounds."""
    return "lockstep" if written_as == FORMAT else "free"


def has_wall_times(written_as: str, parameters: Mapping[str, str]) -> bool:
    """Return whether log times are the wall clock, though the run has rounds.

    Then the round of a message is the one that it tells itself.
    """
    return clock_of(written_as) == "lockstep" and parameters.get("log_time") == "wall"


def wall_times_in(found: Salvage) -> bool:
    """Return whether a file says of itself that it `has_wall_times`, whatever else it says."""
    entries = (record.metadata for record in found.metadata if record.name == METADATA)
    return any(has_wall_times(each.get("format", ""), each) for each in entries)


def metadata_of(parameters: Mapping[str, str], written_as: str) -> dict[str, str]:
    """Return the metadata record of a new recording in a format."""
    return {**parameters, "format": written_as, "checksum": checksum(parameters)}


def parameters_in(path: Path, found: Salvage, problems: list[str]) -> tuple[str, dict[str, str]]:
    """Return the format and the parameters; InputError if there are none in a known format."""
    named = [record.metadata for record in found.metadata if record.name == METADATA]
    ours = [values for values in named if values.get("format") in FORMATS]
    if not ours:
        shown = repr(named[0].get("format")) if named else "none"
        detail = f" ({problems[0]})" if problems else ""
        expected = " or ".join(map(repr, FORMATS))
        raise InputError(
            f"{path}: no cubepath recording: format {shown}, expected {expected}{detail}"
        )
    read = [(metadata, without_format(metadata)) for metadata in ours]
    right = [each for each in read if each[0].get("checksum") == checksum(each[1])]
    if not right:
        problems.append("corrupt: the parameters are not those of their checksum")
    metadata, values = (right or read)[0]
    return metadata["format"], values


def without_format(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters that a metadata record tells."""
    return {key: value for key, value in metadata.items() if key not in ("format", "checksum")}


def scene_in(path: Path, found: Salvage) -> Scene:
    """Return the scene; InputError if it is lost or none."""
    for attachment in found.attachments:
        if attachment.name == SCENE:
            where = f"{path} ({SCENE})"
            try:
                text = attachment.data.decode()
            except UnicodeDecodeError as error:
                raise InputError(f"{where}: not UTF-8 text (byte {error.start})") from None
            return scene_from_toml(text, where)
    raise InputError(f"{path}: the attachment {SCENE} is lost, so nothing can be checked")
