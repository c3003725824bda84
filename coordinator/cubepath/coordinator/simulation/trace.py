"""What happened on a simulated wire, in order: the same seed gives the same trace.

Pictures are drawn from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Fate: TypeAlias = Literal["arrived", "lost", "second"]
"""What became of a message on its way to one receiver; "second" is the copy of another."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """One message on its way to one receiver; a message lost before the router has no receiver.

    `end_us` is when it arrived, or when it was lost.
    """

    begin_us: int
    end_us: int
    sender: str
    receiver: str | None
    key: str
    data: bytes
    fate: Fate


@dataclass(frozen=True, slots=True)
class Span:
    """A fault of a process or of the router, from when to when; without an end it is a crash."""

    begin_us: int
    end_us: int | None
    who: str
    kind: str


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that a process did at one moment, as its end."""

    at_us: int
    who: str
    text: str


@dataclass(slots=True)
class Trace:
    """Everything that happened, in the order in which it was known."""

    arrows: list[Arrow] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
