"""Nodes: the protocol as pure machines, between a wire and the code that decides.

A node receives messages and ticks, and returns effects as data: messages to publish, keys to listen
to, a timer to set. It opens no session, starts no thread and reads no clock, so the same node runs
in a process on zenoh and under a simulator. A shell carries the effects out in their order. Effects
are msgspec's structs since a run makes several for each message.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

import msgspec

M = TypeVar("M")
"""The kinds of messages that a node puts in the recording."""


class Put(msgspec.Struct, frozen=True):
    """Put these bytes on a key; all listeners of the key except the sender receive them."""

    key: str
    data: bytes


class Listen(msgspec.Struct, frozen=True):
    """Receive what is put on these keys from now on."""

    keys: tuple[str, ...]


class Ignore(msgspec.Struct, frozen=True):
    """Receive no longer what is put on these keys."""

    keys: tuple[str, ...]


class Timer(msgspec.Struct, frozen=True):
    """Tick once after this many seconds, instead of at the time set before; None: do not tick."""

    seconds: float | None


class Keep(msgspec.Struct, Generic[M], frozen=True):
    """A message, put or received, that belongs in the recording; each comes once."""

    data: bytes
    message: M


class End(msgspec.Struct, frozen=True):
    """The node has come to its end: it needs no further messages."""


Effect: TypeAlias = Put | Listen | Ignore | Timer | Keep[Any] | End


class Node(Protocol):
    """Messages and ticks in, effects out."""

    @abstractmethod
    def start(self) -> list[Effect]:
        """Begin; called once, before anything else."""

    @abstractmethod
    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take what was put on a key that the node listens to, whatever it is."""

    @abstractmethod
    def tick(self) -> list[Effect]:
        """Note that the timer has run out."""


class BatchNode(Node):
    """A node that answers once what has arrived together: what it says takes fewer messages."""

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message as a batch of one."""
        return self.receive_all([(key, data)])

    @abstractmethod
    def receive_all(self, messages: Sequence[tuple[str, bytes]]) -> list[Effect]:
        """Take messages in their order, each with its key, whatever they are."""
