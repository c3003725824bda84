"""The player as a pure machine: what it does when, and where orders take it, in virtual time."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.playback.machine import (
    Machine,
    Order,
    PlaybackEnd,
    PositionJump,
    PutMessage,
    WaitForOrder,
    read_order,
)
from cubepath.coordinator.playback.selection import PlayedMessages
from cubepath.coordinator.playback.timeline import Timeline, read_pace, read_spot
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from processes.command_line import GOLDEN
from samples.recordings import with_records

BEGAN = 1000.0


@dataclass
class Driven:
    """A machine with a clock that goes only as far as it is told to, and what it did."""

    machine: Machine
    now: float = BEGAN
    put: list[Record] = field(default_factory=list)
    at: list[float] = field(default_factory=list)
    jumps: list[str] = field(default_factory=list)

    def until(self, now: float) -> Driven:
        """Play until a time."""
        while True:
            match self.machine.next(self.now):
                case PutMessage(record=record):
                    self.put.append(record)
                    self.at.append(self.now)
                case PositionJump(why=why):
                    self.jumps.append(why)
                case WaitForOrder(until=due):
                    if due is None or due > now:
                        break
                    self.now = due
                case PlaybackEnd():
                    break
        self.now = max(self.now, now)
        return self

    def on(self) -> Driven:
        """Play what is to be played at once."""
        return self.until(self.now)

    def tell(self, name: str, **given: object) -> Driven:
        """Give an order, and play what is to be played at once."""
        order: Order = read_order(name, {key: str(each) for key, each in given.items()})
        self.machine.order(order, self.now)
        return self.on()

    @property
    def numbers(self) -> list[int]:
        """The numbers of what was put."""
        return [record.sequence for record in self.put]


@cache
def recording() -> Recording:
    """Return a real recording whose round r is published from second r on; it has 0 to 29."""
    found = read_recording(GOLDEN / "hex-5.mcap")
    records = list(found.records)
    return with_records(
        found,
        [
            Record(each.topic, each.data, each.round, each.round * 10**9 + place, 0)
            for place, each in enumerate(records)
        ],
    )


def driven(**given: Any) -> Driven:
    """Return a machine that plays reports."""
    found = recording()
    options: dict[str, Any] = {"pace": read_pace(given.pop("rate", "max"))}
    for name in ("begin", "until"):
        if name in given:
            options[name] = read_spot(given.pop(name))
    selection = PlayedMessages(found, topics=given.pop("topics", ["reports"]))
    return Driven(Machine(Timeline(found), selection, **options, **given))


@cache
def reports(*rounds: int) -> list[int]:
    """Return the numbers of the reports of these rounds, in order."""
    return [
        record.sequence
        for record in recording().records
        if record.kind == "reports" and record.round in rounds
    ]


def test_all_is_put_in_order_at_once() -> None:
    """Without a rate nothing is waited for."""
    found = driven().on()
    assert found.numbers == reports(*range(1, 30))
    assert set(found.at) == {BEGAN}
    assert found.machine.ended


def test_rounds_come_at_their_rate() -> None:
    """At 4 a second round r begins (r - 1)/4 s after the first."""
    found = driven(rate="4").until(BEGAN + 100)
    assert found.at == [BEGAN + (record.round - 1) / 4 for record in found.put]


def test_real_time_follows_the_publish_times() -> None:
    """Twice as fast as it was: half the time between any two messages."""
    found = driven(rate="2x").until(BEGAN + 100)
    first = found.put[0].wall_ns
    assert found.at == pytest.approx(
        [BEGAN + (record.wall_ns - first) / 2e9 for record in found.put]
    )


@pytest.mark.parametrize("rate", ["2x", "0.5x", "1"])
def test_no_gap_is_longer_than_it_may_be(rate: str) -> None:
    """Longer ones are cut, shorter ones stay, at any rate and also where it was paused in one."""
    whole, cut = driven(rate=rate), driven(rate=rate, max_gap_s=0.2)
    for found in (whole, cut):
        found.until(BEGAN + 100)
    assert cut.numbers == whole.numbers
    assert gaps(cut) == pytest.approx([min(gap, 0.2) for gap in gaps(whole)], abs=1e-6)
    paused = driven(rate=rate, max_gap_s=0.2).until(BEGAN + 0.15).tell("pause").until(BEGAN + 50)
    assert paused.numbers == reports(1)
    assert paused.tell("play").until(BEGAN + 50.04).numbers == reports(1)
    assert paused.until(BEGAN + 50.06).numbers == reports(1, 2)


def gaps(found: Driven) -> list[float]:
    """Return the times between the messages that were put."""
    return [after - before for before, after in pairwise(found.at)]


def test_from_and_until_are_of_what_is_played() -> None:
    """By round, by time, and by both: the ends belong to it; the jump there is told."""
    assert driven(begin="3", until="5").on().numbers == reports(3, 4, 5)
    assert driven(begin="2s", until="4.5s").on().numbers == reports(2, 3, 4)
    found = driven(begin="28").on()
    assert (found.numbers, found.jumps) == (reports(28, 29), ["from"])
    assert driven(until="2").on().jumps == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"begin": "30"}, "from 30: nothing is on record there; it goes from round 0 to 29"),
        ({"begin": "5", "until": "4"}, "from 5 until 4: expected a range upwards"),
        ({"begin": "4.5s", "until": "4s"}, "from 4.5s until 4s: expected a range upwards"),
        ({"begin": "5", "until": "2s"}, "from 5 until 2s: nothing is on record there"),
        ({"until": "0"}, "until 0: nothing that is played is on record there"),
        ({"topics": ["summary"], "until": "4"}, "until 4: nothing that is played is on record"),
        ({"until": "30"}, "until 30: not on record, which ends with round 29 after"),
        ({"begin": "3", "until": "99s"}, "until 99s: not on record"),
        ({"begin": "99s"}, "from 99s: nothing"),
    ],
)
def test_parts_without_messages_are_refused(given: dict[str, str], said: str) -> None:
    """With what there is instead."""
    with pytest.raises(InputError, match=said):
        driven(**given)


def test_a_pause_stops_the_clock_of_the_run() -> None:
    """What was due in 0.4 s is due in 0.4 s when it plays on, however long that takes."""
    found = driven(rate="1").until(BEGAN + 0.6).tell("pause").until(BEGAN + 50)
    assert found.numbers == reports(1)
    found.tell("play").until(BEGAN + 50.3)
    assert found.numbers == reports(1)
    assert found.until(BEGAN + 50.5).numbers == reports(1, 2)
    assert found.tell("toggle").machine.paused
    assert not found.tell("toggle").machine.paused


def test_another_rate_holds_from_then_on() -> None:
    """Half way to a round at 1 a second, the other half takes 0.05 s at 10 a second."""
    found = driven(rate="1").until(BEGAN + 0.5).tell("rate", rate="10")
    assert found.until(BEGAN + 0.54).numbers == reports(1)
    assert found.until(BEGAN + 0.56).numbers == reports(1, 2)
    assert str(found.tell("rate", times="0.5").machine.pace) == "5"
    assert found.tell("rate", rate="max").numbers == reports(*range(1, 30))


def test_slower_than_as_fast_as_possible_is_a_rate() -> None:
    """There has to be some: 10 rounds a second. Nothing is faster than that."""
    found = driven(paused=True).tell("rate", times="2")
    assert str(found.machine.pace) == "max"
    assert str(found.tell("rate", times="0.5").machine.pace) == "10"


def test_steps_go_by_messages_and_by_rounds() -> None:
    """Each puts what it says at once, and stays paused; at the end nothing is left."""
    found = driven(paused=True, rate="1").on()
    assert found.numbers == []
    assert found.tell("step").numbers == reports(1)[:1]
    assert found.tell("step", unit="round").numbers == reports(1)
    assert found.tell("step", unit="round", count=2).numbers == reports(1, 2, 3)
    assert found.tell("step", count=2).numbers == reports(1, 2, 3, 4)
    assert found.until(BEGAN + 99).numbers == reports(1, 2, 3, 4)
    assert found.tell("step", count=1000).machine.ended
    assert found.tell("step").numbers == reports(*range(1, 30))


def test_back_goes_where_the_round_began() -> None:
    """From the middle of a round to its beginning, from there to the one before; it pauses."""
    found = driven(begin="2", rate="1").until(BEGAN + 2).tell("step")
    assert found.numbers == [*reports(2, 3, 4), *reports(5)[:1]]
    found.put.clear()
    assert found.tell("back", unit="round").tell("step", unit="round").numbers == reports(5)
    found.put.clear()
    found.tell("back", unit="round", count=2).tell("step", unit="round")
    assert found.numbers == reports(4)
    found.put.clear()
    assert found.tell("back").tell("step").numbers == reports(4)[1:]
    found.put.clear()
    assert found.tell("back", unit="round", count=99).tell("step").numbers == reports(2)[:1]
    assert found.jumps == ["from", "back", "back", "back", "back"]
    found.put.clear()
    assert found.tell("back", count=99).tell("step").numbers == reports(2)[:1]


def test_a_seek_plays_on_if_it_did() -> None:
    """Playing it goes on from there, paused it stays so; past the end it is refused."""
    found = driven(rate="1", until="20").on().tell("seek", to="20")
    assert found.numbers == reports(1, 20)
    assert found.machine.ended
    found.tell("seek", to="3.5s")
    assert found.put[-1].round == 4
    found.put.clear()
    assert found.tell("pause").tell("seek", to="7").numbers == []
    assert found.tell("play").numbers == reports(7)
    stands = found.machine.mark
    for to, said in (("30", "to 30: not on record"), ("25", "to 25: not in the part")):
        with pytest.raises(InputError, match=said):
            found.tell("seek", to=to)
    assert found.machine.mark == stands


def test_a_loop_begins_again_and_says_so() -> None:
    """With the same pace in every lap."""
    found = driven(begin="3", until="4", loop=True, rate="10")
    found.until(BEGAN + 0.35)
    assert found.numbers[:8] == reports(3, 4) * 2
    assert found.jumps[:3] == ["from", "loop", "loop"]
    assert found.machine.laps >= 2


def test_stop_ends_it() -> None:
    """Nothing is put after that, whatever is asked."""
    found = driven(rate="1").on().tell("stop").tell("play").until(BEGAN + 9)
    assert found.numbers == reports(1)


ORDERS: st.SearchStrategy[tuple[str, dict[str, Any]]] = st.one_of(
    st.tuples(st.just("seek"), st.fixed_dictionaries({"to": st.integers(0, 29)})),
    st.tuples(
        st.sampled_from(["step", "back"]),
        st.fixed_dictionaries(
            {"unit": st.sampled_from(["message", "round"]), "count": st.integers(1, 9)}
        ),
    ),
    st.tuples(st.sampled_from(["play", "pause", "toggle", "status"]), st.just({})),
    st.tuples(st.just("rate"), st.fixed_dictionaries({"rate": st.sampled_from(["2", "1x"])})),
)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(ORDERS, st.floats(0, 3)), max_size=8))
def test_between_jumps_nothing_is_left_out_or_put_twice(
    orders: list[tuple[tuple[str, dict[str, Any]], float]],
) -> None:
    """Whatever is ordered when: what is put between two jumps are neighbours on record."""
    found = driven(rate="3")
    everything = reports(*range(1, 30))
    place = {number: index for index, number in enumerate(everything)}
    jumped = False
    for (name, given_), later in orders:
        before = len(found.put)
        found.until(found.now + later)
        jumped = jumped and len(found.put) == before
        before, jumps = len(found.put), len(found.jumps)
        found.tell(name, **given_)
        jumped = jumped or len(found.jumps) > jumps
        if not jumped and 0 < before < len(found.put):
            assert place[found.numbers[before]] == place[found.numbers[before - 1]] + 1
        jumped = jumped and len(found.put) == before
        run = [place[number] for number in found.numbers[before:]]
        assert run == list(range(run[0], run[0] + len(run))) if run else True
    found.tell("play").tell("rate", rate="max")
    assert found.numbers[-1] == everything[-1]
