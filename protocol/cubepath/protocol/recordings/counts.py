"""How much is in a recording: messages, bytes and parts by kind, and when they were written.

A recording ends with its counts, so that they are known without reading it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from cubepath.protocol.recordings.mcap_file import checksum, kind_in
from cubepath.protocol.wire.on_record import SHOWN

if TYPE_CHECKING:
    from cubepath.protocol.recordings.salvaging import Salvage

METADATA = "cubepath-counts"
"""The name of the metadata record that closes a recording."""
BATCHES = {
    "said": frozenset({"here", "note", "claim", "verdict"}),
    "reports": frozenset({"report"}),
    "observations": frozenset({"observed"}),
    "acts": frozenset({"act"}),
    "ask": frozenset({"attempt", "enter", "hold", "look"}),
    "pass": frozenset({"passed", "decision", "inquiry", "settled"}),
    "tell": frozenset({"decision", "entered", "held"}),
    "shows": frozenset({SHOWN}),
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
    """The counts of a recording; `parts` counts what batches hold, by kind."""

    messages: int = 0
    kinds: dict[str, KindCount] = field(default_factory=dict)
    parts: dict[str, int] = field(default_factory=dict)
    topics: int = 0
    first_wall_ns: int | None = None
    last_wall_ns: int | None = None
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
                said = part.kind
                counted[said] = counted.get(said, 0) + 1

    def _know(self, topic: str) -> _Known:
        name = kind_in(topic)
        kind = self.kinds.setdefault(name, KindCount())
        known = kind, name in BATCHES
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
    told = [each.metadata for each in found.metadata if each.name == METADATA]
    counts = _counts_in(told[0]) if len(told) == 1 else None
    return counts if counts is not None and counts.messages == found.messages else None


def _counts_in(values: Mapping[str, str]) -> Counts | None:
    told = {key: value for key, value in values.items() if key != "checksum"}
    if values.get("checksum") != checksum(told):
        return None
    try:
        return Counts(
            messages=int(told["messages"]),
            kinds=msgspec.json.decode(told["kinds"], type=dict[str, KindCount]),
            parts=msgspec.json.decode(told["parts"], type=dict[str, int]),
            topics=int(told["topics"]),
            first_wall_ns=_number(told["first_wall_ns"]),
            last_wall_ns=_number(told["last_wall_ns"]),
        )
    except (KeyError, ValueError, msgspec.DecodeError):
        return None


def _number(text: str) -> int | None:
    return int(text) if text else None
