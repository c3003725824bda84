"""Senders number what they say, and say it again as long as they have it."""

from itertools import pairwise

from cubepath.protocol.wire.free_messages import (
    Halted,
    Requests,
    RetransmitRange,
    TileQuery,
    Turns,
    decode_free,
)
from cubepath.protocol.wire.nodes import Put
from cubepath.protocol.wire.outgoing_log import KEPT_BYTES_MAX, KEPT_MAX, REPEATED_MAX, OutgoingLog


def number(put: Put) -> tuple[int, int]:
    """Return incarnation and number of what is put."""
    message = decode_free(put.data)
    assert isinstance(message, Turns | Requests | Halted)
    return message.incarnation, message.sequence


def test_all_kinds_are_numbered_in_one_sequence() -> None:
    """What only tells the last number takes none."""
    outgoing = OutgoingLog("run", 7)
    put = [
        outgoing.append(Turns(0, [])),
        outgoing.append(Requests(0, 1, [])),
        outgoing.stamp(Halted(0)),
    ]
    assert [number(each) for each in put] == [(7, 1), (7, 2), (7, 2)]
    assert put[1].key == "cubepath/run/requests/1/process_0"


def test_what_is_said_again_is_the_same_byte_for_byte() -> None:
    """Of this incarnation, and between the two numbers."""
    outgoing = OutgoingLog("run", 2)
    put = [outgoing.append(Turns(0, [])) for _ in range(6)]
    assert outgoing.retransmit(RetransmitRange("process_0", 2, 1, 4)) == put[1:4]
    assert outgoing.retransmit(RetransmitRange("process_0", 1, 0, 6)) == []
    assert outgoing.retransmit(RetransmitRange("process_0", 2, 6, 99)) == []


def test_each_part_is_said_once() -> None:
    """Whoever asks for a thing twice in one message has asked for it once."""
    one, two = TileQuery("0", 1), TileQuery("1", 1)
    said = decode_free(OutgoingLog("run", 1).append(Requests(0, 1, [one, two, one])).data)
    assert isinstance(said, Requests)
    assert said.parts == [one, two]


def test_what_is_kept_is_bounded() -> None:
    """In number and in bytes, and so is one answer."""
    outgoing = OutgoingLog("run", 1)
    for _ in range(KEPT_MAX + 10):
        outgoing.append(Turns(0, []))
    found = [
        number(put)[1] for put in outgoing.retransmit(RetransmitRange("process_0", 1, 0, 10**6))
    ]
    assert len(found) == REPEATED_MAX
    assert found[0] == 11
    assert all(two == one + 1 for one, two in pairwise(found))
    large = Requests(0, 0, [TileQuery("0" * 300, number) for number in range(200)])
    size = len(outgoing.append(large).data)
    for _ in range(40):
        outgoing.append(large)
    kept = outgoing.retransmit(RetransmitRange("process_0", 1, 0, 10**6))
    assert sum(len(put.data) for put in kept) <= KEPT_BYTES_MAX < (len(kept) + 1) * size * 1.1
