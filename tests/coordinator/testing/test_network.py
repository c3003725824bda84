"""Zenoh processes of others on a private router: what is done to them, and what the log knows."""

import json
import re
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from cubepath.coordinator.testing import network_log
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.network import NetworkFault, NetworkUnderTest
from cubepath.coordinator.testing.network_log import MessageLog
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.messages import Ready, encode
from cubepath.protocol.wire.sessions import open_client, put, subscribe
from processes.living import is_there

pytestmark = pytest.mark.slow
UNKNOWN: Any = "loss"
PROGRAM = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", json.dumps(sys.argv[2]))
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
for number in range(int(sys.argv[3])):
    session.put("robot/arm/pose", str(number))
    time.sleep(0.01)
sys.exit(int(sys.argv[4]))
"""


def arm(messages: int, code: int = 0, mode: str = "client") -> list[str]:
    """Return a command that puts this many messages, one each 10 ms, and ends with this code."""
    return [sys.executable, "-c", PROGRAM, "{endpoint}", mode, str(messages), str(code)]


class Ends:
    """A network with two sessions of the test, ``a`` and ``b``, and what ``b`` has heard."""

    def __init__(self, network: NetworkUnderTest, resources: ExitStack) -> None:
        self.network = network
        self.a, self.b = (open_client(network.endpoint(name)) for name in "ab")
        for each in (self.a, self.b):
            resources.callback(each.close)
        self.heard: list[tuple[str, str]] = []
        subscribe(self.b, "robot/**", self._hear)
        network.until(lambda _: network.link_of("b").listens("robot/arm"))

    def _hear(self, sample: zenoh.Sample) -> None:
        deleted = sample.kind == zenoh.SampleKind.DELETE
        text = "deleted" if deleted else sample.payload.to_string()
        self.heard.append((str(sample.key_expr), text))

    def say(self, *texts: str, key: str = "robot/arm") -> None:
        for text in texts:
            put(self.a, key, text.encode())

    def until_heard(self, *texts: str) -> None:
        """Wait until these were heard since the last time, and no others."""
        self.network.until(lambda _: len(self.heard) >= len(texts))
        assert [text for _, text in self.heard] == list(texts)
        self.heard.clear()


@pytest.fixture
def ends(cubepath_network: NetworkUnderTest) -> Iterator[Ends]:
    with ExitStack() as resources:
        yield Ends(cubepath_network, resources)


def test_rules_go_by_key(ends: Ends) -> None:
    """What another key has passes; a rule without `to` is there for processes that come later."""
    ends.network.drop("robot/*/pose", times=1)
    ends.network.delay(0.2, key="robot/arm", to="b", times=1)
    ends.say("lost", key="robot/arm/pose")
    ends.say("late")
    ends.say("here", key="robot/leg")
    ends.until_heard("late", "here")
    log = ends.network.log
    assert log.count("robot/arm/pose") == log.count("robot/arm/pose", sender="a") == 0
    assert (log.count("robot/**"), log.count("robot/**", to="b")) == (2, 2)
    assert [seen.data for seen in log.messages("robot/leg", to="b")] == [b"here"]
    log.assert_order("robot/arm", Pattern(key="robot/leg", to="b"))
    with pytest.raises(AssertionError, match=r"^'robot/leg' does not come before 'robot/arm'$"):
        log.assert_order("robot/leg", "robot/arm")
    with pytest.raises(AssertionError, match=r"^'robot/leg' does not come before 'robot/tail'$"):
        log.assert_order("robot/leg", "robot/tail")


def test_deletes_queries_and_what_is_with_a_message_pass(ends: Ends) -> None:
    """A process that asks another over two links has its answer."""
    given = {"encoding": "text/plain", "attachment": b"mine"}
    ends.a.put("robot/arm", "x", **given)  # type: ignore[arg-type]
    ends.a.delete("robot/arm")
    ends.until_heard("x", "deleted")
    first, second = ends.network.log.messages("robot/arm", to="b")
    assert (first.encoding, first.attachment, first.deletes) == ("text/plain", b"mine", False)
    assert second.deletes

    def answer(query: zenoh.Query) -> None:
        query.reply("robot/is", "well")

    ends.b.declare_queryable("robot/is", zenoh.handlers.Callback(answer, indirect=False))
    deadline = time.monotonic() + 30
    while not (found := [reply.ok for reply in ends.a.get("robot/is") if reply.ok]):
        assert time.monotonic() < deadline
    assert found[0].payload.to_string() == "well"


def test_a_cut_comes_at_a_message(ends: Ends) -> None:
    """The message at which it comes is the first that is lost; after healing all arrive."""
    seen = Pattern(key="robot/arm", where=lambda message: message.data == b"2")
    cut = ends.network.cut_off("b", at=seen)
    ends.say("1")
    ends.until_heard("1")
    ends.say("2", "3")
    ends.network.until("robot/arm", times=3)
    assert getattr(cut.at, "data", b"") == b"2"
    ends.network.until(lambda network: str(network.log).count("  lost ") == 2)
    ends.network.heal("b")
    ends.say("4")
    ends.until_heard("4")
    assert ends.network.log.count("robot/arm", to="b") == 2


def test_faults_are_counted_in_messages(ends: Ends) -> None:
    """A cut loses as many in both ways together; the others as many of their way."""
    cut = NetworkFault("cut", "a", nth=1, count=2)
    ends.network.inject([cut, NetworkFault("double", "b", nth=2, way="down", seconds=0)])
    ends.say("0", "1", "2", "3", "4", "5")
    ends.until_heard("0", "3", "4", "4", "5")


def test_faults_may_count_one_key(ends: Ends) -> None:
    """Messages on other keys pass, and are not counted; a receiver can be struck as well."""
    network = ends.network
    network.endpoint("leg")
    network.inject([NetworkFault("drop", "a", nth=1, count=1, key="robot/*/set")])
    network.inject([NetworkFault("restart", "leg", nth=1, way="down", key="robot/*/set")])
    leg = network.start("leg", listener("robot/*/set"), listens="robot/arm/set")
    pid = leg.pid
    for key in ("robot/arm/set", "robot/arm", "robot/arm/set", "robot/arm", "robot/arm/set"):
        ends.say(key, key=key)
    ends.until_heard("robot/arm/set", "robot/arm", "robot/arm", "robot/arm/set")
    network.until(lambda _: leg.pid != pid)


def test_the_log_has_the_times_of_delivery(ends: Ends) -> None:
    """And says which messages were lost, and which are copies; rows stand in their order."""
    began = time.time()
    ends.network.delay(0.3, "robot/arm", to="b", times=1)
    ends.network.double("robot/arm", seconds=0.2, after=1, times=1)
    ends.network.drop("robot/arm", after=2)
    ends.say("late")
    ends.until_heard("late")
    (late,) = ends.network.log.messages("robot/arm", to="b")
    assert late.at_s - began > 0.25
    ends.say("twice", "lost")
    ends.until_heard("twice", "twice")
    log = ends.network.log
    found = log.messages("robot/arm")
    assert [(each.data, each.copied) for each in found[1:]] == [(b"twice", False), (b"twice", True)]
    assert found[2].at_s - found[1].at_s > 0.15
    assert [each.data for each in log.messages("robot/arm", lost=True)] == [b"lost"]
    assert (log.count("robot/arm"), log.count("robot/arm", lost=True)) == (3, 1)
    rows = str(log).partition("the last messages on each key:")[2].splitlines()[2:]
    assert [row.split()[0] for row in rows if row.split()[0].isalpha()] == ["lost", "copy"]
    times = [float(re.search(r"\d+\.\d{3}", row)[0]) for row in rows]  # type: ignore[index]
    assert times == sorted(times)


def test_the_report_shows_faults(ends: Ends) -> None:
    """What was done to whom stands among the messages, and each rule with what it met."""
    network = ends.network
    network.start("arm", arm(1000))
    network.until("robot/arm/pose")
    lost = network.drop("robot/arm", to="b", times=1)
    ends.say("lost", "here")
    lost.wait()
    network.kill("arm", at="robot/arm/pose")
    network.until(lambda _: network.commands["arm"].returncode is not None)
    network.restart("arm")
    again = network.restart("arm", at="robot/arm/pose")
    network.until(lambda _: again.done)
    network.pause("arm")
    network.resume("arm")
    network.cut_off("a", seconds=0.01)
    network.inject([NetworkFault("cut", "arm", nth=9999, key="robot/arm")])
    network.until(lambda _: "a healed" in network.seen())
    (report,) = network.report_lines()
    order = ["arm started", "arm killed", "arm started", "arm paused", "arm resumed", "a cut off"]
    places = [report.index(order[0])]
    for each in order[1:]:
        places.append(report.index(each, places[-1] + 1))
    assert "\n  drop to=b, key=robot/arm: met 1\n  kill arm at key=robot/arm/pose: done\n" in report
    assert "\n  restart arm at key=robot/arm/pose: done\n" in report
    assert "\n  NetworkFault('cut', 'arm', nth=9999, key='robot/arm'): met 0\n" in report


def test_what_was_never_met_is_warned_of() -> None:
    """At the end of a test; what was drawn or counted may come too late."""
    with NetworkUnderTest() as network, ExitStack() as resources:
        ends = Ends(network, resources)
        network.drop("robot/amr")
        network.drop("robot/arm", times=1)
        network.cut_off("a", at="robot/amr")
        network.inject([NetworkFault("cut", "a", nth=200), NetworkFault("pause", "a", nth=200)])
        ends.say("lost", "here")
        ends.until_heard("here")
        with pytest.warns(UserWarning, match="met no message") as warned:
            network.close(check=True)
    lines = ["drop key=robot/amr: met no message", "cut off a at key=robot/amr: met no message"]
    assert [str(each.message) for each in warned] == lines


LISTENER = """
import json, sys, time, zenoh
time.sleep(float(sys.argv[2]))
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
if sys.argv[3]:
    session.declare_subscriber(sys.argv[3], print)
print("ready")
time.sleep(60)
"""


def listener(key: str, after_s: float = 0.0) -> list[str]:
    """Return a command that subscribes to a key after this long."""
    return [sys.executable, "-c", LISTENER, "{endpoint}", str(after_s), key]


def test_a_restart_waits_until_the_process_listens(cubepath_network: NetworkUnderTest) -> None:
    """As the start did; at a message it waits for nothing."""
    network = cubepath_network
    ear = network.start("ear", listener("robot/arm", 0.5), listens="robot/arm", timeout_s=20)
    for _ in range(2):
        network.restart("ear")
        assert network.link_of("ear").listens("robot/arm")
    with open_client(network.endpoint("a")) as session:
        network.when("robot/arm", lambda: network.restart("ear"))
        pid = ear.pid
        put(session, "robot/arm", b"again")
        network.until(lambda _: ear.pid != pid)
        assert not network.link_of("ear").listens("robot/arm")


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (listener("robot/leg"), "is connected, and subscribes to other keys"),
        (listener(""), "is connected, and subscribes to nothing"),
        (listener("", 60), "has not connected"),
    ],
)
def test_a_start_says_why_it_waits_in_vain(
    command: list[str], why: str, cubepath_network: NetworkUnderTest
) -> None:
    """It has its own time for that."""
    with pytest.raises(
        CheckError, match=rf"^ear listens to robot/arm: it did not within 2 s; it {why};"
    ):
        cubepath_network.start("ear", command, listens="robot/arm", timeout_s=2)


def test_messages_of_others_are_not_decoded(ends: Ends) -> None:
    """Bytes that are a message of cubepath are bytes; what only such messages have is refused."""
    ends.say(encode(Ready(1, 0, "sense")).decode(), key="cubepath/r/ready/process_0")
    ends.network.until("cubepath/**")
    (seen,) = ends.network.log.messages("cubepath/**")
    assert (seen.kind, seen.message, seen.sender) == ("unknown", None, "a")


@pytest.mark.parametrize(
    ("act", "line"),
    [
        (lambda n: n.drop("robot//arm"), "key='robot//arm': expected a key expression of zenoh"),
        (lambda n: n.drop(Pattern(round=3)), "round: expected one of key, sender, to, where"),
        (lambda n: n.drop(kind="claim"), "kind: expected one of key, sender, to, where"),
        (lambda n: n.kill("a", at=3), "at=3: expected a key, as 'robot/\\*\\*', or a Pattern"),
        (lambda n: n.drop(to="a", sender="a"), "sender and to: a receiver does not know"),
        (lambda n: n.log.count(sender="arm"), "arm: not started yet, expected one of a, or "),
        (lambda n: n.kill("b"), r"b: not started yet, .*network\.endpoint\('b'\) before$"),
        (lambda n: n.inject([NetworkFault("cut", "b")]), "b: not started yet"),
        (lambda n: n.drop(time=1), "time: expected one of key, sender, to, where, times, "),
        (lambda n: n.log.count(time=1), "time: expected one of key, sender, to, where$"),
        (lambda n: n.start("b", "true", listens="k//"), "key='k//': expected a key expression"),
        (lambda n: n.start("router", "true"), "name='router': expected a name for a process"),
        (lambda n: n.restart("a"), "restart: a: expected one of none$"),
        (lambda _: NetworkFault(UNKNOWN, "a"), "kind=loss: expected one of drop, "),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(act: object, line: str, cubepath_network: NetworkUnderTest) -> None:
    """That says what was expected."""
    cubepath_network.endpoint("a")
    with pytest.raises(InputError, match=f"^{line}"):
        act(cubepath_network)  # type: ignore[operator]


def test_processes_are_killed_paused_and_started_again(cubepath_network: NetworkUnderTest) -> None:
    """And one that fails by itself fails the test that waits."""
    network = cubepath_network
    network.endpoint("arm")
    network.inject([NetworkFault("restart", "arm", nth=3)])
    first = network.start("arm", arm(1000), cwd=Path("/"))
    pid = first.pid
    network.until("robot/arm/pose", times=4)
    network.until(lambda _: first.pid != pid)
    assert not is_there(pid)
    again = network.commands["arm"]
    assert again is first
    network.until("robot/arm/pose", where=lambda seen: seen.data == b"0", times=2)
    network.pause("arm")
    stat = Path(f"/proc/{again.pid}/stat")
    network.until(lambda _: stat.read_text().rpartition(")")[2].split()[0] == "T")
    assert "arm: paused, process id" in network.seen()
    network.resume("arm")
    network.until("robot/arm/pose", times=network.log.count("robot/arm/pose") + 5)
    network.kill("arm")
    assert again.wait() == -9
    network.until("robot/arm/pose")  # who was killed by the test has not failed
    network.start("leg", arm(2, code=3))
    with pytest.raises(AssertionError, match=r"^while waiting for .*leg failed \(3\); stdout: not"):
        network.until("robot/leg")


def test_a_peer_is_warned_of() -> None:
    """It may reach other peers past its link; the report says so, and a warning at the end."""
    line = "arm: is a peer, which may go past its link, expected mode client"
    with NetworkUnderTest() as network:
        network.start("arm", arm(1, mode="peer")).wait()
        network.until("robot/arm/pose")
        assert line in network.seen()
        with pytest.warns(UserWarning, match=f"^{line}$"):
            network.close(check=True)


def test_a_wait_in_vain_says_what_is_near(ends: Ends) -> None:
    """Of a key on which nothing ever came; not of one that came too rarely."""
    ends.say("1")
    ends.until_heard("1")
    for key, times, hint in (
        ("robot/amr", 2, r" \(did you mean 'robot/arm'\?\)"),
        ("robot/arm", 3, ""),
    ):
        line = rf"^not within 0.1 s: {times} messages with key={key}{hint}$"
        with pytest.raises(AssertionError, match=line):
            ends.network.until(key, times=times, timeout_s=0.1)


def test_a_flood_takes_bounded_memory() -> None:
    """Of 600 MB over a link that keeps them some are lost, and the end of the test says so."""
    line = r"^the link of b lost \d+ messages on the way down: more than 65536, or 32 MiB, waited$"
    with (
        pytest.raises(CheckError, match=line),
        NetworkUnderTest() as network,
        ExitStack() as resources,
    ):
        ends = Ends(network, resources)
        network.cut_off("b", keep=True)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(6000):
            put(ends.a, f"robot/{number % 10}", bytes(100_000))
        network.until("robot/**", times=6000)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 250_000
        with pytest.raises(CheckError, match=r"the log has forgotten \d+ of 6000 such"):
            network.log.count("robot/**", where=lambda seen: bool(seen.data))
        network.until(lambda _: network.link_of("b").down.overflowed)


def test_a_log_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """It never says a wrong number."""
    monkeypatch.setattr(network_log, "KEPT_MAX", 4)
    monkeypatch.setattr(network_log, "KEYS_MAX", 3)
    log = MessageLog({"a"})
    for number in range(8):
        log.add(WireMessage(f"k/{number % 2}", b"\xff", link="a", lost=number == 7))
    assert (log.count("k/*"), log.count("k/0", sender="a")) == (7, 4)
    assert 0 < len(log.messages()) <= 4
    assert (log.count("k/*", lost=True), log.count("k/0", lost=True)) == (1, 0)
    log.assert_order("k/0", "k/1")
    with pytest.raises(
        CheckError, match=r"forgotten 3 of 3 such messages, expected fewer .* it keeps 4,"
    ):
        log.assert_order("k/1", Pattern(key="k/0", where=lambda _: True))
    log.add(WireMessage("k/2", b"", link="a"))
    with pytest.raises(
        CheckError, match=r"^key=k/0: the log has forgotten 1 of 5 .* counts 3 keys$"
    ):
        log.count("k/0")


def passed(*messages: tuple[str, bytes], **more: Any) -> MessageLog:
    """Return a log of these messages of ``a``."""
    log = MessageLog({"a"})
    for key, data in messages:
        log.add(WireMessage(key, data, link="a", **more))
    return log


def test_a_flood_drives_out_no_other_key() -> None:
    """Of messages, or of bytes; a condition on a flood that is forgotten is refused in one line."""
    rare = [("house/set", b"on"), ("house/set", b"off")]
    flood = [(f"house/temp/{number % 7}", b"%d" % number) for number in range(7000)]
    for messages in (rare + flood, rare + [("house/image", bytes(1 << 16))] * 700):
        log = passed(*messages)
        assert log.count("house/set", where=lambda seen: seen.data == b"on") == 1
        assert [seen.data for seen in log.messages()[:2]] == [b"on", b"off"]
        assert log.messages()[-1].data == messages[-1][1]
    with pytest.raises(
        CheckError, match=r"^key=house/image, where=<lambda>: the log has forgotten \d+ of 700 "
    ) as e:
        log.count("house/image", where=lambda seen: bool(seen.data))
    assert "\n" not in str(e.value)
    assert log.has(3, log.pattern("house/image", where=lambda seen: bool(seen.data)))


def test_the_report_keeps_what_is_rare_and_what_was_lost() -> None:
    """Lost messages are counted and shown; a flood is cut, and what is repeated is one row."""
    log = passed(*[("house/set", b"%d" % number) for number in range(3)], lost=True)
    for number in range(3000):
        log.add(WireMessage(f"house/temp/{number % 3}", b"%d" % number, link="a"))
    for data in (b"once", *[b"again"] * 30):
        log.add(WireMessage("house/ack", data, link="a", down=True))
    text = str(log)
    assert "\n       0 (3 lost) house/set\n" in text
    assert re.findall(r"  lost .* house/set +(\d)\n", text) == ["0", "1", "2"]
    rows = re.findall(r" house/ack +(.*)", re.sub(r", until [\d.-]+\)", ", until)", text))
    assert rows == ["once", "again (30 times, until)"]
    assert len(text.splitlines()) < 60


def test_the_log_is_a_note_of_what_ends_a_block() -> None:
    """And nothing is left; it can be used no more."""
    network = NetworkUnderTest()
    with pytest.raises(ZeroDivisionError) as raised, network:
        network.start("arm", arm(1000))
        network.until("robot/arm/pose")
        raise ZeroDivisionError
    assert "robot/arm/pose" in raised.value.__notes__[0]
    assert not is_there(network.commands["arm"].pid)
    with pytest.raises(InputError, match=r"^the network is not open"):
        network.start("leg", arm(1))


def test_rules_of_our_own_runs_go_by_key_too(cubepath_run: RunFixture) -> None:
    """A session at the run's endpoint hears it."""
    run = cubepath_run("hex:n=4", listen="tcp/127.0.0.1:0")
    with pytest.raises(InputError, match=r"^key='//': expected a key expression"):
        run.drop(key="//")
    twice = run.double(key="**/reports/process_1")
    heard: list[str] = []
    with open_client(run.endpoint) as session:
        subscribe(session, "**", lambda sample: heard.append(str(sample.key_expr)))
        run.until("reports", key="cubepath/*/reports/process_1")
    run.until_goal()
    assert {seen.key.partition("/reports/")[2] for seen in twice.met} == {"process_1"}
    assert json.dumps(heard)
