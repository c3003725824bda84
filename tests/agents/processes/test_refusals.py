"""What is refused: counted, told of once by sender and reason, and how many more there were."""

from cubepath.agents.processes.judge import Refusals, RefusedError
from cubepath.protocol.wire.messages import Reason, Refused, encode
from cubepath.protocol.wire.nodes import Keep


def add(
    refusals: Refusals, who: str = "process_1", reason: Reason = "malformed", number: int = 1
) -> list[Refused]:
    """Refuse a message; return what is told of it."""
    error = RefusedError(reason, f"{reason} it is")
    return told(refusals.add(number, f"cubepath/run/ready/{who}", b"bytes", error))


def told(kept: list[Keep[Refused]]) -> list[Refused]:
    """Return what goes on record, which is what it was kept as."""
    found = [keep.message for keep in kept]
    assert kept == [Keep(encode(each), each) for each in found]
    return found


def first(who: str = "process_1", reason: Reason = "malformed", number: int = 1) -> Refused:
    """Return what is told of the first message of a sender and reason."""
    return Refused(number, f"ready/{who}", who, reason, f"{reason} it is", 1, "bytes")


def more(count: int, who: str = "process_1", number: int = 1) -> Refused:
    """Return what is told of the others."""
    return Refused(number, f"ready/{who}", who, "malformed", "malformed it is", count)


def test_the_first_is_told_at_once_and_how_many_more_when_asked() -> None:
    """Each time those since the last."""
    refusals = Refusals()
    assert (refusals.count, refusals.last) == (0, None)
    assert add(refusals) == [first()]
    assert [add(refusals) for _ in range(3)] == [[], [], []]
    assert told(refusals.new_refusals()) == [more(3)]
    assert told(refusals.new_refusals()) == []
    assert add(refusals) == []
    assert told(refusals.new_refusals()) == [more(1)]
    assert refusals.count == 5
    assert refusals.last == first()


def test_each_sender_and_each_reason_is_told_of() -> None:
    """In the order in which they came."""
    refusals = Refusals()
    assert add(refusals) == [first()]
    assert add(refusals, "process_2") == [first("process_2")]
    assert add(refusals, reason="stale") == [first(reason="stale")]
    assert refusals.last == first(reason="stale")
    add(refusals, "process_2")
    add(refusals)
    assert told(refusals.new_refusals()) == [more(1, "process_2"), more(1)]


def test_a_new_round_begins_anew() -> None:
    """What was left of the one before is told first, of its round."""
    refusals = Refusals()
    add(refusals)
    add(refusals)
    assert add(refusals, number=2) == [more(1), first(number=2)]
    assert told(refusals.new_refusals()) == []
    assert add(refusals, number=2) == []


def test_after_many_senders_all_others_are_one() -> None:
    """Thirty-two, then one for each reason of the others."""
    refusals = Refusals()
    for number in range(32):
        assert add(refusals, f"guest_{number}")[0].sender == f"guest_{number}"
    (other,) = add(refusals, "guest_32")
    assert (other.sender, other.key) == ("others", "ready/guest_32")
    assert add(refusals, "guest_33") == []
    assert add(refusals, "guest_34", "stale")[0].sender == "others"
    assert add(refusals, "guest_0") == []
    assert [(each.sender, each.count) for each in told(refusals.new_refusals())] == [
        ("others", 1),
        ("guest_0", 1),
    ]
    assert add(refusals, "guest_33", number=2)[0].sender == "guest_33"


def test_what_is_told_is_short() -> None:
    """However long the key, the name, the line and the message are; bytes that are no text too."""
    refusals = Refusals()
    error = RefusedError("malformed", "w" * 500)
    (found,) = told(refusals.add(1, f"cubepath/run/{'k' * 300}/{'n' * 99}", b"\xff" * 300, error))
    assert found.key == "k" * 200
    assert found.sender == "n" * 64
    assert found.detail == "w" * 400
    assert found.sample == "\N{REPLACEMENT CHARACTER}" * 200


def test_a_key_of_any_form_has_a_sender() -> None:
    """Its last part."""
    refusals = Refusals()
    for key, topic, who in (("", "", ""), ("hello", "hello", "hello"), ("a/b/c/d", "c/d", "d")):
        (found,) = told(refusals.add(1, key, b"", RefusedError("malformed", "no")))
        assert (found.key, found.sender) == (topic, who)
