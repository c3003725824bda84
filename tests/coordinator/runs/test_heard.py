"""What the coordinator has heard of each sender, and asks to be said again."""

from random import Random

import pytest

from cubepath.coordinator.runs import collector
from cubepath.coordinator.runs.collector import ASKS_MAX, Collector, SequenceTracker
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Commit,
    CommitLog,
    CommitQuery,
    FreeMessage,
    Halted,
    Requests,
    RetransmitRange,
    Turns,
    decode_free,
    free_key,
)
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import Put
from cubepath.protocol.wire.outgoing_log import OutgoingLog
from samples.free_runs import FreeRun


def turns(*numbers: int, incarnation: int = 1) -> list[FreeMessage]:
    """Return messages of a process with these numbers."""
    return [Turns(0, [], incarnation, number) for number in numbers]


def heard(*messages: FreeMessage) -> SequenceTracker:
    """Return what is known after these."""
    found = SequenceTracker()
    for message in messages:
        found.take(message)
    return found


def asks(found: SequenceTracker) -> list[RetransmitRange]:
    """Return what is asked for, the second time that it is looked at."""
    assert list(found.asks()) == []
    return list(found.asks())


def test_without_a_gap_nothing_is_asked() -> None:
    """In any order, and doubled."""
    found = heard(*turns(2, 1, 4, 3, 3, 1))
    assert found.lacking == 0
    assert asks(found) == []


def test_the_first_gap_of_each_sender_is_asked_for() -> None:
    """Of the last incarnation alone."""
    found = heard(*turns(1, 9), *turns(1, 4, 8, incarnation=2), Requests(3, 0, [], 1, 2))
    assert found.lacking == 2 + 3 + 1
    assert asks(found) == [
        RetransmitRange("process_0", 2, 1, 3),
        RetransmitRange("process_3", 1, 0, 1),
    ]


def test_the_last_messages_are_missed_by_what_tells_their_number() -> None:
    """By `rest` of a process and `tail` of a keeper."""
    found = heard(
        *turns(1), Halted(0, incarnation=1, sequence=3), CommitLog(2, 0, [], [], 0, 0, 1, 1)
    )
    assert asks(found) == [
        RetransmitRange("keeper_2", 1, 0, 1),
        RetransmitRange("process_0", 1, 1, 3),
    ]


def test_what_does_not_come_is_given_up() -> None:
    """A gap after it is asked for in its turn."""
    found = heard(*turns(3, 4, 6))
    assert found.lacking == 3
    for _ in range(ASKS_MAX):
        list(found.asks())
    assert list(found.asks()) == []
    assert found.lacking == 1
    assert asks(found) == [RetransmitRange("process_0", 1, 4, 5)]


def test_whatever_was_lost_comes_in_the_end() -> None:
    """With half of all messages lost, each time anew."""
    random, outgoing, found = Random(3), OutgoingLog("run", 1), SequenceTracker()  # noqa: S311 - a seeded one
    for _ in range(500):
        put = outgoing.append(Turns(0, []))
        if random.random() < 0.5:
            found.take(decode_free(put.data))
    found.take(decode_free(outgoing.stamp(Halted(0)).data))
    for _ in range(2000):
        for asked in found.asks():
            for put in outgoing.retransmit(asked):
                if random.random() < 0.5:
                    found.take(decode_free(put.data))
    assert found.lacking == 0


def test_an_answer_to_an_earlier_order_does_not_count() -> None:
    """It was on its way when the modules were told to go on, and they may have moved since."""
    gatherer = FreeGatherer(scene_from_spec("agv:graph=grid4x4,n=1"), 1)
    collector = Collector("run", gatherer, 1, [[0]])
    rested = []
    for order in (collector.halt, collector.resume, collector.halt):
        assert order() == collector.repeat_order()
        late = Halted(0, 1, incarnation=1)
        collector.receive(free_key("run", late), encode(late))
        rested.append(set(collector.resting))
    assert rested == [{0}, set(), set()]
    answer = Halted(0, 3, incarnation=1)
    collector.receive(free_key("run", answer), encode(answer))
    assert collector.resting == {0}


def test_keepers_are_told_what_is_in_the_file_once_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """After many commits of one, and before whatever else is fetched; what is missing is kept."""
    monkeypatch.setattr(collector, "RECORDED_STEP", 3)
    scene = scene_from_spec("hex:n=5")
    run = FreeRun("hex:n=5", keepers=2, seed=1)
    commits = [each for each in run.play(12) if isinstance(each, Commit) and each.keeper == 0]
    hears = Collector("run", FreeGatherer(scene, 2), 2, [range(5)])
    flushed: list[int] = []

    def said(*numbers: int) -> list[FreeMessage]:
        for number in numbers:
            moved = commits[number - 1]
            hears.receive(free_key("run", moved), encode(moved))
        effects = hears.record(lambda: flushed.append(hears.gatherer.known(0)))
        return [decode_free(each.data) for each in effects if isinstance(each, Put)]

    assert said(1, 2, 4, 5) == []
    assert flushed == []
    assert said(3) == [CommitQuery(0, 5, 5)]
    assert flushed == [5]
    assert said(6) == []
    fetched = [decode_free(each.data) for each in hears.fetch() if isinstance(each, Put)]
    assert fetched == [CommitQuery(0, 6, 5), CommitQuery(1, 0, 0)]


def test_a_process_rests_only_if_its_last_incarnation_does() -> None:
    """The one before it may wake when its successor is at work, and is told to halt too."""
    gatherer = FreeGatherer(scene_from_spec("agv:graph=grid4x4,n=1"), 1)
    collector = Collector("run", gatherer, 1, [[0]])
    collector.halt()
    rested = []
    for message in (*turns(1, incarnation=2), Halted(0, 1, 1, 3), Halted(0, 1, 2, 1)):
        collector.receive(free_key("run", message), encode(message))
        rested.append(set(collector.resting))
    assert rested == [set(), set(), {0}]
