"""Faults of a network under test, by counts of messages: to be drawn, or written down."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from cubepath.coordinator.testing.rules import Direction
from cubepath.protocol.core.options import known_name, whole_number

NetworkFaultKind: TypeAlias = Literal[
    "drop", "double", "delay", "reorder", "cut", "pause", "restart"
]
NETWORK_FAULTS: tuple[NetworkFaultKind, ...] = get_args(NetworkFaultKind)


@dataclass(frozen=True, slots=True)
class NetworkFault:
    """One fault of a process or its link, for `NetworkUnderTest.inject`.

    Of the messages that the process puts (``way="up"``) or that come to it (``"down"``), `nth` pass
    before it. Then `count` messages are lost (``drop``), repeated (``double``) or late (``delay``)
    after `seconds`, or overtaken by the next (``reorder``). A ``cut`` loses `count` messages, of both
    ways. When the process has put `nth` messages it stands still for `seconds` (``pause``), or is
    killed and started again (``restart``).
    """

    kind: NetworkFaultKind
    process: str
    nth: int = 0
    count: int = 1
    way: Direction = "up"
    seconds: float = 0.1

    def __post_init__(self) -> None:
        """Check it; InputError for what is no fault."""
        known_name("kind=", self.kind, NETWORK_FAULTS)
        known_name("way=", self.way, get_args(Direction))
        whole_number("nth", self.nth, 0)
        whole_number("count", self.count, 1)
