"""A message as a test sees it: its kind, sender, receivers, and the modules it is about.

It is one view of messages with rounds and without, so that rules of links, conditions and tables
need not know the clock. Small tables of messages, for the text of a failure, show what was sent
around a place.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from cubepath.protocol.wire import free_messages, messages as wire
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.keys import topic_in_key

_PHASES = {"reports": "settle", "observations": "observe", "actions": "observe"}
"""The phases of the kinds that do not name theirs."""
RESULTS = ("edges", "cube", "certificate", "summary")
"""What the coordinator finds at the end, which no process sent."""
PARTS = (
    *("attempt", "enter", "tile_query", "forwarded", "decision", "inquiry", "settled"),
    *("place", "entered", "turn"),
)
"""The kinds of parts, in runs without rounds."""
KNOWN = frozenset((*wire.KINDS, *free_messages.FREE_KINDS, *PARTS))
"""Every kind that a rule or a condition may name."""


@dataclass(frozen=True)
class WireMessage:
    """A message with its key, as it was on the wire.

    What follows is read from the bytes when it is asked for; bytes that are no message of cubepath
    have the kind "unknown", and so has everything on a `NetworkUnderTest`.
    """

    key: str
    data: bytes
    at_s: float = 0.0
    """When it was seen, in seconds of the run's clock."""
    encoding: str = ""
    attachment: bytes | None = None
    deletes: bool = False
    """Whether it deletes its key; it has no data then."""
    link: str | None = None
    """The process of yours on whose link it was seen; None in runs."""
    down: bool = False
    """Whether it was on its way to that process, not from it."""
    lost: bool = False
    """Whether it was lost on that link."""
    copied: bool = False
    """Whether it is a further copy, which a rule of that link made."""

    @cached_property
    def message(self) -> wire.Message | free_messages.FreeMessage | None:
        """The message; None if the bytes hold none."""
        if self.link is not None:
            return None
        for read in (wire.decode, free_messages.decode_free):
            try:
                return read(self.data)
            except wire.NoMessageError:
                continue
        return None

    @cached_property
    def kind(self) -> str:
        """The kind of the message, as ``bundle``, ``ready``, ``go``, ``requests`` or ``commit``."""
        found: Any = self.message
        return "unknown" if found is None else wire.kind_of(found)

    @property
    def sender(self) -> str:
        """The sender: ``process_0``, ``keeper_1`` or ``coordinator``; the end of its key.

        On a `NetworkUnderTest` it is your process, and empty on the way to one.
        """
        if self.link is not None:
            return "" if self.down else self.link
        return self.key.rpartition("/")[2]

    @cached_property
    def to(self) -> str:
        """To whom it is put: a process, a keeper, a region or a tile; empty if to everyone."""
        match self.message:
            case wire.Bundle(region=region):
                return region
            case (
                free_messages.Requests(keeper=keeper)
                | free_messages.Forwards(to=keeper)
                | free_messages.CommitQuery(keeper=keeper)
            ):
                return keeper_name(keeper)
            case free_messages.Replies(process=process):
                return process_name(process)
            case free_messages.TileUpdate(tile=tile):
                return tile
            case free_messages.RetransmitRange(to=name):
                return name
            case _:
                topic = topic_in_key(self.key).split("/")
                alone = topic[0] in ("go", "reset") and topic[-1].startswith("process_")
                if self.link is not None:
                    topic, alone = [self.link], self.down
                return topic[-1] if alone else ""

    @cached_property
    def round(self) -> int | None:
        """The round, or without rounds the level that it tells of; None if of neither."""
        found: Any = self.message
        if found is None:
            return None
        number = getattr(found, "round", None)
        return number if number is not None else free_messages.level_of(found) or None

    @cached_property
    def phase(self) -> str:
        """The phase, or empty without one."""
        return str(getattr(self.message, "phase", _PHASES.get(self.kind, "")))

    @cached_property
    def parts(self) -> tuple[tuple[str, int | None], ...]:
        """The kind of each part and the module that it is of or about; of most kinds one part."""
        return tuple(self._parts())

    @cached_property
    def contents(self) -> tuple[Any, ...]:
        """The parts themselves, in the order of `parts`; a message without parts is its own."""
        found: Any = self.message
        return () if found is None else tuple(getattr(found, "parts", wire.parts_of(found)))

    def _parts(self) -> Iterator[tuple[str, int | None]]:
        for part in self.contents:
            about: Any = part.attempt if isinstance(part, free_messages.Forwarded) else part
            module = getattr(about, "module", None)
            yield str(part.__struct_config__.tag), module if isinstance(module, int) else None

    @property
    def modules(self) -> tuple[int, ...]:
        """The modules that it is of or about, in increasing order."""
        return tuple(sorted({module for _, module in self.parts if module is not None}))

    @property
    def what(self) -> str:
        """What it says, in a few words: its parts by kind and module, of a single one also more."""
        kinds: dict[str, list[str]] = {}
        for kind, module in self.parts:
            if kind != self.kind or module is not None:
                kinds.setdefault(kind, []).append("" if module is None else str(module))
        texts = [" ".join([kind, ",".join(filter(None, of))]).strip() for kind, of in kinds.items()]
        alone = _more_of(self.message) if len(self.parts) == 1 else ""
        return "; ".join(texts) + (f" {alone}" if alone else "")


def _more_of(message: Any) -> str:
    """Return what the only part of a message says beyond its kind and module."""
    (part,) = getattr(message, "parts", (message,))
    about = getattr(part, "attempt", None) or getattr(part, "commit", None) or part
    found = []
    if getattr(about, "generator", None) is not None:
        found.append(f"{about.generator} at {about.at}")
    granted = getattr(part, "granted", None)
    if granted is not None:
        found.append("granted" if granted else "lost")
    if isinstance(getattr(part, "claim", None), str):
        found.append(part.claim)
    refused = getattr(part, "commit", part) is None
    details = {
        "refused:" if refused else "reason": getattr(part, "reason", None),
        "ended": getattr(part, "ended", None),
    }
    found += [f"{name} {what}" for name, what in details.items() if what is not None]
    return ", ".join(found)


ROWS_MAX = 12
"""A table has no more rows of messages."""
WHAT_MAX = 60
_LINE_MAX = 300
_TITLES = ("", "round", "phase", "kind", "from", "to", "what")


def short(text: str, most: int = _LINE_MAX) -> str:
    """Return a text in one line that is no longer than this many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 3] + "..."


def table(messages: Sequence[WireMessage], marked: Iterable[int] = (), title: str = "") -> str:
    """Return messages as a table, a line each, those at these places marked with ``>``.

    Of more than `ROWS_MAX` messages those around the first that is marked, or the last, are shown.
    """
    marks = sorted(set(marked))
    around = marks[0] if marks else len(messages) - 1
    first = max(0, min(around - ROWS_MAX // 2, len(messages) - ROWS_MAX))
    shown = range(first, min(first + ROWS_MAX, len(messages)))
    rows = [_TITLES, *(_row(messages[at], marked=at in marks) for at in shown)]
    lines = aligned(rows)
    left_out = len(messages) - len(shown)
    more = [f"  ({left_out} more messages)"] if left_out else []
    head = [f"{title}:"] if title else []
    if not messages:
        return "\n".join([*head, "  no messages"])
    return "\n".join([*head, *("  " + line.rstrip() for line in lines), *more])


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines, with each column but the last as wide as its widest cell."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return [
        " ".join([*(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False)), row[-1]])
        for row in rows
    ]


def _row(seen: WireMessage, *, marked: bool) -> tuple[str, ...]:
    number = "" if seen.round is None else str(seen.round)
    what = short(seen.what, WHAT_MAX)
    return (">" if marked else "", number, seen.phase, seen.kind, seen.sender, seen.to, what)
