"""A player over a real router: what listeners hear, and orders from Python and over zenoh."""

import json
import threading
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec
import pytest
import zenoh

from cubepath.coordinator.playback.machine import Position
from cubepath.coordinator.playback.player import Player, replay
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.messages import Edges
from cubepath.protocol.wire.sessions import open_client, subscribe
from processes.command_line import GOLDEN
from processes.ears import wait_for_subscriber
from samples.recordings import edited, first, parts, recorded

HEX = GOLDEN / "hex-5.mcap"


class Ears:
    """What a guest hears of a run, in order."""

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self.session = session
        self.run = run
        self._came: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self.subscriber = subscribe(session, f"cubepath/{run}/**", self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        self._came.put((str(sample.key_expr).split("/", 2)[2], sample.payload.to_bytes()))

    def take(self, number: int) -> list[tuple[str, bytes]]:
        """Return the next messages that come."""
        return [self._came.get(timeout=10) for _ in range(number)]

    def ask(self, order: str) -> Any:
        """Give an order over zenoh; return the reply, an error as a text."""
        (reply,) = self.session.get(f"cubepath/{self.run}/player/{order}", timeout=10)
        if reply.ok is not None:
            return json.loads(reply.ok.payload.to_bytes())
        assert reply.err is not None
        return json.loads(reply.err.payload.to_bytes())["error"]


@contextmanager
def listened(player: Player) -> Generator[Ears]:
    """Listen to a player as a guest, whom everybody knows of when it begins."""
    with ExitStack() as opened:
        ears = Ears(opened.enter_context(open_client(player.endpoint)), player.run)
        opened.callback(ears.subscriber.undeclare)
        with open_client(player.endpoint) as third:
            wait_for_subscriber(third, f"cubepath/{player.run}/probe")
        yield ears


@pytest.mark.slow
def test_steps_and_jumps_are_heard() -> None:
    """A round as it was on the wire; a jump with where modules stand; and on from there."""
    recording = read_recording(HEX)
    said = [record for record in recording.records if record.kind == "reports"]
    gatherer = Gatherer(recording.scene)
    for report in parts(recording, "report"):
        if report.round < 12:
            gatherer.receive(report)
    with Player(HEX, topics=["reports"], run="mine") as player, listened(player) as ears:
        assert player.run == "mine"
        assert player.step("round").round == 2
        assert ears.take(2) == [(each.topic, each.data) for each in said[:2]]
        assert player.seek(12).state == "paused"
        ((key, data),) = ears.take(1)
        position = msgspec.json.decode(data, type=Position, dec_hook=site_hook)
        assert key == "player/position"
        assert (position.why, position.round, position.after) == ("seek", 12, 11)
        assert position.modules == gatherer.sites
        assert set(position.sites) == set(position.modules)
        twelfth = next(each for each in said if each.round == 12)
        assert player.step().message > position.message == twelfth.sequence
        assert ears.take(1) == [(twelfth.topic, twelfth.data)]
        player.play()
        found = player.wait(30)
        assert found.differences == ()
        assert found.rounds_compared == 1 + 18
        assert found.left_out is not None
        assert found.left_out["reports"] == 10 * 2
        assert player.position.state == "ended"
        player.back("round")
        player.play()
        assert player.wait(30).left_out == found.left_out


@pytest.mark.slow
def test_orders_come_over_zenoh_and_errors_are_one_line() -> None:
    """From a guest of the private router; what cannot be changes nothing."""
    with Player(HEX, rate=5) as player, listened(player) as ears:
        assert ears.ask("status")["state"] == "paused"
        assert ears.ask("seek?to=0.02s")["time_s"] >= 0.02
        assert (
            ears.ask("step?unit=round;count=2")["round"]
            == 2 + ears.ask("back?unit=round")["round"] - 1
        )
        assert ears.ask("rate?rate=2x")["rate"] == "2x"
        assert ears.ask("rate?times=2")["rate"] == "4x"
        assert ears.ask("seek?to=99").startswith("to 99: not on record, which ends with round 29")
        assert ears.ask("seek?to=x").startswith("to=x: expected a round or level")
        assert ears.ask("seke?to=3").startswith("order seke: expected one of ")
        assert "expected one of unit, count" in ears.ask("step?untt=round")
        assert ears.ask("step?count=0") == "count=0: expected 1 to 1000000000"
        assert ears.ask("rate").startswith("rate: expected either")
        assert ears.ask("status")["rate"] == "4x"
        assert ears.ask("stop")["state"] == "stopped"
        assert player.wait(10).not_compared
    assert player.over


@pytest.mark.slow
def test_a_player_is_of_one_use_and_leaves_nothing() -> None:
    """Before it begins and after its end orders are refused; threads are gone in any case."""
    before = threading.active_count()
    player = Player(HEX)
    with pytest.raises(CheckError, match="has not begun"):
        player.play()
    with player:
        with pytest.raises(InputError, match="to=x: expected"):
            player.seek("x")
        with pytest.raises(InputError, match="unit=hour"):
            player.step("hour")  # type: ignore[arg-type]
        with pytest.raises(CheckError, match=r"has not ended within 0.1 s: it is paused"):
            player.wait(0.1)
        player.stop()
        assert player.wait(10).messages == 0
        with pytest.raises(CheckError, match="the replay is over"):
            player.play()
    with pytest.raises(CheckError, match="the replay is over"), player:
        pass
    with pytest.raises(RuntimeError), Player(HEX) as left:
        left.play()
        raise RuntimeError
    assert threading.active_count() == before


@pytest.mark.slow
def test_what_goes_wrong_ends_the_replay_where_it_is_waited_for() -> None:
    """A recording that contradicts itself: its error, in every call that follows."""
    recording = recorded("hex:n=4", "chain", rounds=5)
    report = first(recording, "report")
    twice = edited(recording, report, report, msgspec.structs.replace(report, failed="no"))
    with Player(twice) as player:
        player.play()
        for _ in range(2):
            with pytest.raises(CheckError, match="twice, and differently"):
                player.wait(10)


@pytest.mark.thorough
def test_it_waits_for_others_who_listen() -> None:
    """It begins when another session subscribes to a part of the run, and not for ever."""
    for endpoint in (None, "tcp/127.0.0.1:0"):
        with Player(HEX, wait_for_subscribers=60, paused=False, endpoint=endpoint) as player:
            assert player.position.message == 3
            with open_client(player.endpoint) as session:
                # Kept: a subscriber that nobody holds is undeclared at once.
                ears = [subscribe(session, "elsewhere/**", lambda _: None)]
                assert player.position.message == 3
                ears.append(subscribe(session, f"cubepath/{player.run}/reports/**", lambda _: None))
                assert player.wait(20).same
    with pytest.raises(CheckError, match=r"no subscriber to cubepath/\w+/\*\* within 0.1 s"):
        replay(HEX, wait_for_subscribers=0.1)


def changed(recording: Recording, number: int) -> Recording:
    """Return the recording with other edges in a round."""
    edges = [each for each in parts(recording, "edges") if each.round == number]
    return edited(recording, edges[0], Edges(number, []))


@pytest.mark.thorough
def test_parts_are_compared_as_far_as_they_go() -> None:
    """Round by round where they are whole, also from the middle of a round; the rest is named."""
    recording = recorded("agv:graph=grid4x4,n=7", "tswap", rounds=10)
    last = first(recording, "summary").rounds
    assert replay(recording, begin=3, until=5).rounds_compared == 3
    found = replay(changed(recording, 4), begin=3)
    assert found.differences == ("round 4: other moves were gathered than are on record",)
    assert not found.agrees
    assert replay(changed(recording, 2), begin=3).agrees
    assert (
        f"rounds 1 to 2, 6 to {last}, cubes, summary" in replay(recording, begin=3, until=5).result
    )
    # Part of the reports of a round may lie before: they are on record.
    message = next(each for each in recording.records if each.kind == "reports" and each.round == 4)
    with Player(recording) as player:
        player.step("round", 3)
        while player.position.message <= message.sequence:
            player.step()
        player.seek(2)
        player.play()
        assert player.wait(30).rounds_compared == last
    none = replay(recording, exclude=["reports"])
    assert (none.rounds_compared, none.same, none.agrees) == (0, False, True)
    assert none.result.startswith(f"not compared: rounds 1 to {last}")
    assert replay(recording, topics=["*"]).result == "the same as recorded"
    moved = replay(recording, remap=["reports=elsewhere"])
    assert moved.not_compared
    assert moved.messages == replay(recording).messages


@pytest.mark.slow
def test_what_is_not_played_is_counted() -> None:
    """By kind, and nothing twice that was played twice."""
    recording = read_recording(HEX)
    total = Counter(record.kind for record in recording.records)
    plain = replay(recording)
    said = ("bundle", "reports")
    assert plain.left_out == {kind: total[kind] for kind in sorted(total) if kind not in said}
    with Player(recording, topics=["*"]) as player:
        player.step("message", 100)
        player.back("message", 60)
        player.step("message", 80)
        player.stop()
        left_out = player.wait(10).left_out or {}
    assert sum(left_out.values()) == total.total() - 120


@pytest.mark.slow
def test_without_rounds_a_part_is_played_and_not_compared() -> None:
    """Jumps tell where modules stand; the whole is compared as before."""
    path = GOLDEN / "hex-free-5.mcap"
    found = replay(path, begin=3)
    assert (found.same, found.agrees, found.rounds_compared) == (False, True, 0)
    assert found.result == "not compared: levels 1 to 19, cubes, summary"
    with Player(path, topics=["commit"]) as player, listened(player) as ears:
        assert player.seek(19).round == 19
        position = msgspec.json.decode(ears.take(1)[0][1], type=Position, dec_hook=site_hook)
        assert position.after == 18
        assert len(position.modules) == 5
        player.play()
        assert player.wait(10).left_out is not None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rate": "fast"}, "rate=fast: expected rounds or levels a second"),
        ({"begin": -1}, "from=-1: expected a round"),
        ({"topics": "reports"}, "topics='reports': expected a list"),
        ({"run": "a/b"}, "run=a/b: expected a name"),
        ({"remap": ["reports=/x"]}, "remap=reports=/x: a private router has keys below cubepath"),
    ],
)
def test_bad_options_are_refused_before_anything_is_started(
    options: dict[str, Any], said: str
) -> None:
    """In one line that names the option."""
    with pytest.raises(InputError, match=said) as caught:
        Player(HEX, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_what_is_left_of_a_damaged_recording_is_played(tmp_path: Path) -> None:
    """Cut off in the middle, with chunks gone: what can be read is put, sought and compared."""
    path = tmp_path / "cut.mcap"
    path.write_bytes(HEX.read_bytes()[:25000])
    recording = read_recording(path)
    assert recording.problems
    whole = replay(path)
    assert (whole.agrees, whole.same, whole.rounds_compared) == (
        True,
        True,
        gathered(recording).rounds,
    )
    assert whole.problems == recording.problems
    assert whole.result == "the same as recorded, as far as it goes; the file is damaged"
    found = replay(path, begin=3, until=12)
    assert (found.agrees, found.rounds_compared, found.complete) == (True, 10, False)
    with Player(path, topics=["*"]) as player:
        stands = player.seek(14)
        assert stands.round == 14
        with pytest.raises(InputError, match="to 20: not on record, which ends with round 1"):
            player.seek(20)
        player.play()
        assert player.wait(10).messages == len(recording.records) - stands.message
        assert player.seek(14).message == stands.message
