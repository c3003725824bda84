"""What was heard is put in an order in which the coordinator can have heard it."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from random import Random

import msgspec
import pytest

from cubepath.coordinator.runs.run import start
from cubepath.coordinator.tools.recorder.backlog import ReceivedMessage
from cubepath.coordinator.tools.recorder.losses import Head
from cubepath.coordinator.tools.recorder.turns import MessageOrder, OrderedMessage
from cubepath.coordinator.verification.pacing import Pacing
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.messages import decode

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Return a run of three processes from its first round on, as who attaches then hears it."""
    log = tmp_path_factory.mktemp("run") / "in.mcap"
    with start("agv:graph=grid4x4,n=5", processes=3, seed=2, log=log) as run:
        run.play()
    whole = read_recording(log)
    heard = tuple(each for each in whole.records if each.round)
    return replace(whole, records=heard, parameters={**whole.parameters, "attached": "1"})


def item(record: Record) -> OrderedMessage:
    """Return a message as it comes."""
    head = msgspec.json.decode(record.data, type=Head)
    return OrderedMessage(
        record.topic, ReceivedMessage("", record.data, record.wall_ns, None), head, wanted=True
    )


def by_links(records: Sequence[Record], random: Random, ahead: int) -> Iterator[Record]:
    """Yield messages as a router may: in order for each who speaks, but not between them.

    Each time any of the next few may come that is the first of who speaks it.
    """
    left = list(records)
    while left:
        heads: dict[str, int] = {}
        for number, each in enumerate(left[:ahead]):
            heads.setdefault(each.topic.rpartition("/")[2], number)
        yield left.pop(random.choice(list(heads.values())))


def told_of(ready: Record) -> int:
    """Return the process that has answered."""
    return msgspec.json.decode(ready.data, type=Head).process


def wrong(recording: Recording, items: Sequence[OrderedMessage]) -> list[str]:
    """Return what verification finds of the pace of a run."""
    found: list[str] = []
    pacing = Pacing(recording, lambda _, detail: found.append(detail))
    for each in items:
        pacing.take(decode(each.heard.data))
    return found


@pytest.mark.parametrize("ahead", [1, 4, 12])
def test_whatever_comes_first_the_pace_is_kept(recording: Recording, ahead: int) -> None:
    """Nothing is left, nothing is doubled, and who speaks is heard in order."""
    astray = 0
    for seed in range(25):
        came = [*map(item, by_links(recording.records, Random(seed), ahead))]  # noqa: S311
        astray += bool(wrong(recording, came))
        turns = MessageOrder(3, from_start=True)
        found = [each for one in came for each in turns.put(one)]
        assert wrong(recording, found) == []
        assert [*turns.rest()] == []
        assert Counter(each.heard for each in found) == Counter(each.heard for each in came)
        for sender in {each.topic.rpartition("/")[2] for each in came}:
            of = [[e.heard for e in some if e.topic.endswith(sender)] for some in (came, found)]
            assert of[0] == of[1]
    assert bool(astray) == (ahead > 1)  # as they came verification refuses them


def test_what_waits_for_something_lost_comes_after_a_second(recording: Recording) -> None:
    """As it came; and from the next phase on all is in order again."""
    now = [0.0]
    turns = MessageOrder(3, from_start=True, clock=lambda: now[0])
    lost = next(each for each in recording.records if each.kind == "ready" and each.round == 2)
    found: list[OrderedMessage] = []
    for record in recording.records:
        if record is not lost:
            found += turns.put(item(record))
            found += turns.due()
            now[0] += 0.3
    assert not [*turns.rest()]  # nothing waits any more for what is over
    came = Counter(each.data for each in recording.records if each is not lost)
    assert Counter(each.heard.data for each in found) == came
    first, *others = wrong(recording, found)
    assert f"process_{told_of(lost)} has not answered phase sense of round 2" in first
    assert all("round 2" in other for other in others)


def test_after_something_was_lost_nothing_waits_for_it_again(recording: Recording) -> None:
    """What was answered while it was waited for counts: the next phase begins at once."""
    now = [0.0]
    turns = MessageOrder(3, from_start=True, clock=lambda: now[0])
    lost = next(each for each in recording.records if each.kind == "ready" and each.round == 2)
    for record in recording.records:
        if record.round < 3 and record is not lost:
            _ = [*turns.put(item(record))]
    now[0] = 2.0
    assert [*turns.due()]
    later = [item(each) for each in recording.records if each.round >= 3]
    assert [each for one in later for each in turns.put(one)] == later


def test_in_the_middle_of_a_run_messages_pass(recording: Recording) -> None:
    """Until a phase begins; a run without rounds has none."""
    late = [item(each) for each in recording.records if each.round >= 3][5:]
    turns = MessageOrder(3, from_start=False)
    assert [each for one in late for each in turns.put(one)] == late
    free = MessageOrder(None, from_start=True)
    assert [each for one in reversed(late) for each in free.put(one)] == late[::-1]
