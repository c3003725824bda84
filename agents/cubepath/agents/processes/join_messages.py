"""What a process that joins from elsewhere asks, and what it is answered.

It asks by a zenoh get on ``cubepath/RUN/orders/process_N``, or ``.../any``. The answer is an
`Offer`, or an error of one line. Neither is on record.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from cubepath.agents.processes.orders import Orders
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.messages import Count, Name

PROTOCOL = 2
"""Changes with whatever must be the same in all processes of a run: messages, keys, phases."""
ANY = "any"
"""In place of a name: whatever number is free."""
_NOT_DECODED = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
ENDED = "the run has ended"
"""The error that those are answered who wait for a run that will not begin."""


class Request(msgspec.Struct, frozen=True):
    """A process asks to join with these modules."""

    modules: Annotated[list[Count], msgspec.Meta(max_length=1 << 16)]
    joiner: Name
    """Who asks: made up once, and the same when it asks again."""
    protocol: Count = 0


class Offer(msgspec.Struct, frozen=True):
    """The orders of a process, to be read if the protocol is the reader's."""

    protocol: Count
    orders: msgspec.Raw


def orders_key(run: str, name: str = "*") -> str:
    """Return the key on which a process of this name asks for orders."""
    return topic_key(run, "orders", name)


def alive_key(run: str, name: str = "*") -> str:
    """Return the key of the liveliness token of a process, or of the coordinator."""
    return topic_key(run, "alive", name)


def read_request(data: bytes) -> Request:
    """Return a request; InputError if it is none, or of another protocol."""
    try:
        found = msgspec.json.decode(data, type=Request)
    except _NOT_DECODED as error:
        raise InputError(f"not a request to join: {error}") from None
    if found.protocol != PROTOCOL:
        raise InputError(_other(found.protocol, PROTOCOL))
    return found


def read_offer(data: bytes) -> Orders:
    """Return the orders of an offer; InputError if it is of another protocol, CheckError if bad."""
    try:
        found = msgspec.json.decode(data, type=Offer)
        if found.protocol != PROTOCOL:
            raise InputError(_other(PROTOCOL, found.protocol))
        return msgspec.json.decode(found.orders, type=Orders)
    except _NOT_DECODED as error:
        raise CheckError(f"not the orders of a process: {error}") from None


def offer(orders: Orders) -> bytes:
    """Return an offer as bytes."""
    return msgspec.json.encode(Offer(PROTOCOL, msgspec.Raw(msgspec.json.encode(orders))))


def _other(joiner: int, coordinator: int) -> str:
    return (
        f"the process that joins speaks protocol {joiner} of cubepath, the coordinator"
        f" {coordinator}: expected the same version of cubepath on both"
    )
