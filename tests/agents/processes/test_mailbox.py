"""What a process heard and said: each message once, by phase and region, in one order."""

import random

from cubepath.agents.processes.mailbox import Inbox, Outbox
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Bundle, Presence, Verdict, decode
from cubepath.protocol.wire.nodes import Put


def row() -> System:
    """Return a row of vertices in three regions of eight; vertices are near along an edge."""
    return scene_from_spec("agv:graph=grid24x1,n=2").system


def heard(*which: tuple[int, str, int, int]) -> list[Bundle]:
    """Return messages of these rounds, regions, processes and numbers."""
    return [
        Bundle(number, "claim", process, region, count, [])
        for number, region, process, count in which
    ]


def decoded(puts: list[Put]) -> list[Bundle]:
    """Return what is put."""
    found = [decode(each.data) for each in puts]
    assert all(isinstance(each, Bundle) for each in found)
    return [each for each in found if isinstance(each, Bundle)]


def test_a_double_is_told_from_what_is_new() -> None:
    """What has the same region, process and number is known already."""
    inbox = Inbox()
    one, other = heard((1, "0,0", 1, 0), (1, "0,0", 1, 0))
    assert not inbox.knows(other)
    inbox.keep(one)
    assert inbox.knows(other)
    assert inbox.kept(1, "claim") == [one]


def test_what_is_kept_is_in_one_order_however_it_came() -> None:
    """By region, process and number; phases and rounds are kept apart."""
    ordered = heard((1, "a", 1, 0), (1, "a", 1, 1), (1, "a", 2, 0), (1, "b", 0, 0), (1, "b", 1, 0))
    for seed in range(5):
        inbox, shuffled = Inbox(), [*ordered, *heard((2, "a", 1, 0))]
        random.Random(seed).shuffle(shuffled)  # noqa: S311 - a test's own order
        for each in shuffled:
            inbox.keep(each)
        assert inbox.kept(1, "claim") == ordered
        assert inbox.counts(1, "claim") == {"a": 3, "b": 2}
        assert inbox.kept(1, "settle") == []
        assert inbox.take(1, "claim") == ordered
        assert inbox.take(1, "claim") == []
        assert inbox.counts(2, "claim") == {"a": 1}


def test_earlier_rounds_are_forgotten() -> None:
    """The round itself is not."""
    inbox = Inbox()
    for each in heard((1, "a", 0, 0), (2, "a", 0, 0), (3, "a", 0, 0)):
        inbox.keep(each)
    inbox.forget_before(2)
    assert [inbox.counts(number, "claim").get("a", 0) for number in (1, 2, 3)] == [0, 1, 1]


def test_parts_go_to_the_regions_that_they_are_addressed_to() -> None:
    """A message a region, in the order of regions, each with the parts for it in their order."""
    outbox = Outbox(row(), "run", 3, 7)
    near = [Presence(7, module, (column, 0)) for module, column in enumerate((15, 16, 7))]
    puts = outbox.say("sense", near)
    assert [each.key for each in puts] == [
        f"cubepath/run/to/{each}/process_3" for each in ("0,0", "1,0", "2,0")
    ]
    found = decoded(puts)
    assert [[part.module for part in each.parts] for each in found] == [[2], [0, 1, 2], [0, 1]]
    assert {(each.round, each.phase, each.process, each.number) for each in found} == {
        (7, "sense", 3, 0)
    }


def test_what_is_said_later_is_a_message_of_its_own() -> None:
    """It is put alone, has the next number, and is said again with the rest."""
    outbox = Outbox(row(), "run", 0, 1)
    verdicts = [
        Verdict(1, module, (module, 0), granted=True, to=[(6, 0), (17, 0)]) for module in (0, 1)
    ]
    first, second = (outbox.say("settle", [each]) for each in verdicts)
    assert [each.number for each in decoded(first)] == [0, 0]
    assert [each.number for each in decoded(second)] == [1, 1]
    assert [each.parts[0].module for each in decoded(second)] == [1, 1]
    assert outbox.sent_to("settle", "2,0") == [first[1], second[1]]
    assert outbox.sent_to("settle", "1,0") == outbox.sent_to("claim", "2,0") == []
    assert sorted(outbox.sent("settle"), key=str) == sorted(first + second, key=str)
    assert outbox.counts("settle") == {"0,0": 2, "2,0": 2}


def test_nothing_of_the_round_before_is_said_again() -> None:
    """A round begins with nothing said."""
    outbox = Outbox(row(), "run", 0, 1)
    outbox.say("sense", [Presence(1, 0, (0, 0))])
    outbox.begin(2)
    assert (outbox.sent("sense"), outbox.counts("sense")) == ([], {})
    assert decoded(outbox.say("sense", [Presence(2, 0, (0, 0))]))[0].round == 2
