"""The simulated wire: what arrives, in which order, and what faults do, with a toy protocol."""

from functools import partial
from random import Random

import pytest

from cubepath.coordinator.simulation.faults import (
    KINDS,
    ROUTER,
    SECOND_US,
    DrawnFaults,
    Fault,
    Faults,
    ListedFaults,
)
from cubepath.coordinator.simulation.network import EndlessRun, NodeError, SimulatedNetwork
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Listen, Node, Put, Timer
from exploration.counting import PATIENCE_US, RUN, Counter, counted


class Talker:
    """Does what it is told at its start, and keeps what it receives, with the time."""

    def __init__(
        self, network: list[SimulatedNetwork], *effects: Effect, ends: bytes | None = None
    ) -> None:
        self.received: list[tuple[int, bytes]] = []
        self._network = network
        self._effects = list(effects)
        self._ends = ends

    def start(self) -> list[Effect]:
        return self._effects

    def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
        self.received.append((self._network[0].now_us, data))
        return [End()] if data == self._ends else []

    def tick(self) -> list[Effect]:
        return [End()]


def talked(
    faults: Faults, *effects: Effect, keys: tuple[str, ...], for_s: float = 9
) -> list[bytes]:
    """Return what one process hears of another that does as it is told a second after the start."""
    box: list[SimulatedNetwork] = []
    network = SimulatedNetwork(faults.at, 0)
    box.append(network)

    class Late(Talker):
        def start(self) -> list[Effect]:
            return [Timer(1)]

        def tick(self) -> list[Effect]:
            return list(effects)

    ear = Talker(box, Listen(keys), Timer(for_s))
    network.add("coordinator", lambda: ear)
    network.add("process_0", lambda: Late(box))
    network.run(1000, PATIENCE_US)
    return [data for _, data in ear.received]


def test_who_listens_receives() -> None:
    """A put reaches who listens to its key or to all below it, once; nobody else."""
    puts = [Put("a/b", b"1"), Put("a/c", b"2"), Put("b/a", b"3")]
    nothing = ListedFaults(())
    assert talked(nothing, *puts, keys=("a/b",)) == [b"1"]
    assert talked(nothing, *puts, keys=("a/**",)) == [b"1", b"2"]
    assert talked(nothing, *puts, keys=("a/b", "a/**")) == [b"1", b"2"]
    assert talked(nothing, *puts, keys=("a",)) == []


def test_who_puts_does_not_receive() -> None:
    """A node that listens to a key does not receive what it puts there itself."""
    box: list[SimulatedNetwork] = []
    network = SimulatedNetwork(ListedFaults(()).at, 0)
    box.append(network)
    own = Talker(box, Listen(("a",)), Put("a", b"1"), Timer(1))
    network.add("coordinator", lambda: own)
    network.run(100, PATIENCE_US)
    assert own.received == []


def test_listening_takes_effect_when_the_router_hears_of_it() -> None:
    """What is put before the router knows a listener is not delivered; nor after it ignores."""
    box: list[SimulatedNetwork] = []
    network = SimulatedNetwork(ListedFaults(()).at, 0)
    box.append(network)
    ear = Talker(box, Listen(("a",)), Timer(1))
    mouth = Talker(box, Put("a", b"1"))
    network.add("coordinator", lambda: ear)
    network.add("process_0", lambda: mouth)
    other = Talker(box, Listen(("b",)), Ignore(("b",)), Put("c", b""))
    network.add("process_1", lambda: other)

    class Answer(Talker):
        def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
            return [Put("b", b"2"), Put("a", b"3")]

    network.add("process_2", lambda: Answer(box, Listen(("c",))))
    network.run(100, PATIENCE_US)
    assert b"1" not in [data for _, data in ear.received]
    assert other.received == []


def test_a_wildcard_in_the_middle_is_refused() -> None:
    """Nodes listen to keys, and to all keys below one; no other expression is simulated."""
    with pytest.raises(NodeError, match=r"process_0 listens to a/\*/b"):
        talked(ListedFaults(()), Listen(("a/*/b",)), keys=("a",))


def test_a_timer_ticks_once_and_the_last_one_counts() -> None:
    """A timer takes the place of the one set before; None takes it away."""

    class Clock(Talker):
        def tick(self) -> list[Effect]:
            self.received.append((self._network[0].now_us, b""))
            return [Timer(3)] if len(self.received) == 1 else [End()]

    box: list[SimulatedNetwork] = []
    network = SimulatedNetwork(ListedFaults(()).at, 0)
    box.append(network)
    clock = Clock(box, Timer(1), Timer(2))
    network.add("coordinator", lambda: clock)
    network.add("process_0", lambda: Talker(box, Timer(1), Timer(None)))
    network.run(100, PATIENCE_US)
    first, second = (time / SECOND_US for time, _ in clock.received)
    assert first == pytest.approx(2, abs=0.01)
    assert second == pytest.approx(5, abs=0.01)


def test_without_faults_everything_arrives_in_order() -> None:
    """Each worker counts each number once, and nothing is lost or put twice."""
    network, counter, workers, trace = counted(ListedFaults(()))
    assert [worker.counted for worker in workers] == [20] * 3
    assert len(counter.heard) == 60
    assert {arrow.fate for arrow in trace.arrows} == {"arrived"}
    assert not network.fired


def faults_of(seed: int) -> DrawnFaults:
    """Return random faults for a run of three workers."""
    names = [f"process_{number}" for number in range(3)]
    return DrawnFaults(Random(seed), "coordinator", names, PATIENCE_US)  # noqa: S311 - not for secrets


@pytest.mark.parametrize("seed", range(8))
def test_the_same_seed_gives_the_same_trace(seed: int) -> None:
    """Every arrow, fault and moment is the same, drawn again or from the list of what happened."""
    network, _, _, trace = counted(faults_of(seed), seed=seed)
    again = counted(faults_of(seed), seed=seed)
    listed = counted(ListedFaults(network.fired), seed=seed)
    assert again[3] == trace == listed[3]
    assert again[0].fired == network.fired == listed[0].fired


def test_other_seeds_give_other_traces() -> None:
    """Without any fault two seeds differ in the small delays."""
    assert counted(ListedFaults(()), seed=1)[3] != counted(ListedFaults(()), seed=2)[3]


@pytest.mark.slow
def test_each_kind_of_fault_happens_and_the_rest_is_tolerated() -> None:
    """Over some hundred seeds each kind fires; only ending kinds end the run, with a line."""
    fired: dict[str, int] = dict.fromkeys(KINDS, 0)
    for seed in range(300):
        network, counter, workers, _ = counted(faults_of(seed), seed=seed)
        kinds = [fault.kind for fault in network.fired]
        for kind in kinds:
            fired[kind] += 1
        if network.ended is None:
            assert counter.number == 21
        else:
            assert {*kinds} & {"crash", "return", "stall"}, seed
        if not {*kinds} & {"crash", "return", "stall"}:
            assert [worker.counted for worker in workers] == [20] * 3
    assert all(fired.values()), fired


def one(kind: str, where: str, nth: int, amount_us: int = 0) -> ListedFaults:
    """Return a single fault."""
    return ListedFaults([Fault(where, nth, kind, amount_us)])


def test_a_lost_message_is_put_again_by_the_protocol() -> None:
    """The second answer of a worker is lost on its way up: it is asked again, and answers."""
    network, counter, workers, trace = counted(one("loss", "process_1 up", 2))
    assert [fault.kind for fault in network.fired] == ["loss"]
    lost = [arrow for arrow in trace.arrows if arrow.fate == "lost"]
    assert [(arrow.sender, arrow.receiver) for arrow in lost] == [("process_1", None)]
    assert workers[1].counted == 20
    assert len(counter.heard) == 60 + 2  # the two others answer twice


def test_a_doubled_message_arrives_twice() -> None:
    """The copy arrives later, and is marked."""
    _, counter, _, trace = counted(one("duplicate", "process_1 up", 2, 500))
    assert counter.heard.count(b"1 2") == 2
    assert [arrow.data for arrow in trace.arrows if arrow.fate == "second"] == [b"1 2"]


def test_a_delay_holds_back_what_comes_behind() -> None:
    """Over a link messages stay in their order, unless one is overtaken."""
    puts = [Put("a", b"1"), Put("a", b"2")]
    assert talked(one("delay", "process_0 up", 0, 900), *puts, keys=("a",)) == [b"1", b"2"]
    assert talked(one("reorder", "process_0 up", 0, 900), *puts, keys=("a",)) == [b"2", b"1"]


@pytest.mark.parametrize("who", ["coordinator", "process_2"])
def test_a_pause_takes_its_time_and_loses_nothing(who: str) -> None:
    """Who pauses takes all that has come meanwhile, and the run ends later by the pause."""
    plain, *_ = counted(ListedFaults(()))
    network, _, workers, trace = counted(one("pause", who, 3, 7 * SECOND_US))
    assert 6.99 * SECOND_US < network.now_us - plain.now_us < 8 * SECOND_US
    assert [worker.counted for worker in workers] == [20] * 3
    assert [(span.process, span.kind) for span in trace.spans] == [(who, "pause")]


def test_a_slow_receiver_takes_longer_for_some_messages() -> None:
    """Twenty messages take their time each."""
    plain, *_ = counted(ListedFaults(()))
    network, *_ = counted(one("slow", "process_0", 0, 50_000))
    assert 0.8 * SECOND_US < network.now_us - plain.now_us < 1.1 * SECOND_US


def test_a_crash_is_told() -> None:
    """The coordinator learns who has died, and how."""
    network, *_ = counted(one("crash", "process_1", 5))
    assert isinstance(network.ended, CheckError)
    assert str(network.ended) == "process_1 died: killed by signal 9"


def test_a_process_comes_back_without_memory() -> None:
    """A new node is in the place of the old one, and listens as that did."""
    network, _, workers, trace = counted(one("return", "process_1", 5, SECOND_US))
    assert network.ended is None
    assert [worker.number for worker in workers] == [0, 1, 2, 1]
    assert [worker.counted for worker in workers] == [20, 4, 20, 16]
    assert "back without memory" in [remark.text for remark in trace.remarks]


def test_the_router_comes_back_with_its_subscriptions() -> None:
    """What was under way is lost, what is put after the restart arrives."""
    network, _, workers, trace = counted(one("router", ROUTER, 30, 2 * SECOND_US))
    assert network.ended is None
    assert [worker.counted for worker in workers] == [20] * 3
    assert any(arrow.fate == "lost" for arrow in trace.arrows)
    assert [(span.process, span.kind) for span in trace.spans] == [(ROUTER, "router")]


class Beacon:
    """Puts its name again and again, and keeps whom it hears, with the tenth of a second."""

    def __init__(self, name: str) -> None:
        self.heard: list[tuple[str, int]] = []
        self._name = name
        self._ticks = 0

    def start(self) -> list[Effect]:
        return [Listen(("of/**",)), *self.tick()]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        self.heard.append((key.removeprefix("of/"), int(data)))
        return []

    def tick(self) -> list[Effect]:
        self._ticks += 1
        ends = [End()] if self._ticks == 30 and self._name == "a" else []
        return [Put(f"of/{self._name}", b"%d" % self._ticks), Timer(0.1), *ends]


def heard_apart(kind: str, hosts: int) -> list[str]:
    """Return who misses whom of four, of whom a and c are on one host, while a fault lasts."""
    network = SimulatedNetwork(one(kind, ROUTER, 60, SECOND_US).at, 5, hosts=hosts)
    made = {name: Beacon(name) for name in "abcd"}
    for name in made:
        network.add(name, partial(made.__getitem__, name))
    network.run(5000, PATIENCE_US)
    assert [fault.kind for fault in network.fired] == [kind]
    for own, beacon in made.items():  # before the fault, and after it
        assert {name for name, at in beacon.heard if at < 10} == {*made} - {own}
        assert {name for name, at in beacon.heard if at > 28} == {*made} - {own}
    return [
        f"{one} {other}"
        for one in made
        for other in made
        if one != other and (other, 20) not in made[one].heard
    ]


def test_a_partition_is_between_hosts() -> None:
    """What is on one host hears each other; one-way, one side still hears the other."""
    ways = ["a b", "a d", "c b", "c d"], ["b a", "b c", "d a", "d c"]
    assert sorted(heard_apart("partition", 2)) == sorted([*ways[0], *ways[1]])
    assert sorted(heard_apart("one-way", 2)) in [sorted(way) for way in ways]


def test_each_host_has_a_router() -> None:
    """When that dies, those of its host hear nobody and are not heard; the others are."""
    lost = heard_apart("router", 2)
    assert "a c" in lost or "b d" in lost
    assert len(lost) == 10
    assert len(heard_apart("router", 0)) == 12


def test_the_processes_of_a_host_die_together() -> None:
    """And come back without memory; the first of all, which ends the run, does not."""
    network, _, workers, _ = counted(one("host", ROUTER, 60, SECOND_US))
    assert network.ended is None
    assert [worker.number for worker in workers] == [0, 1, 2, 0, 1, 2]


def test_a_process_that_was_replaced_wakes_up() -> None:
    """Its successor has done its work meanwhile; then it takes all that came for it."""
    network, _, workers, trace = counted(one("twin", "process_1", 5, SECOND_US // 2))
    assert network.ended is None
    assert [worker.number for worker in workers] == [0, 1, 2, 1]
    before, after = workers[1].counted, workers[3].counted
    assert before < 20 <= before + after
    assert any(arrow.fate == "arrived" and arrow.sender == "process_1" for arrow in trace.arrows)


def test_one_that_was_replaced_and_ends_is_not_away() -> None:
    """Its successor has its place, so nothing is to come back."""
    box: list[SimulatedNetwork] = []
    network = SimulatedNetwork(one("twin", "process_0", 0, SECOND_US).at, 0)
    box.append(network)
    made = iter((Talker(box, Timer(1)), Talker(box)))
    network.add("coordinator", lambda: Talker(box, Timer(5)))
    network.add("process_0", lambda: next(made))
    network.run(100, PATIENCE_US)
    assert next(made, None) is None
    assert network.away == ["coordinator"]  # whose end was the end of the run


def test_a_process_that_was_replaced_does_not_come_back() -> None:
    """When its host dies, its successor alone is started again, and nobody waits for it."""
    faults = Fault("process_1", 5, "twin", 9 * SECOND_US), Fault(ROUTER, 60, "host", SECOND_US)
    network, _, workers, _ = counted(ListedFaults(faults))
    assert {*network.fired} == {*faults}
    assert [worker.number for worker in workers] == [0, 1, 2, 1, 0, 1, 2]
    assert "process_1" not in network.away


def test_a_timer_is_early_after_a_clock_jump() -> None:
    """It ticks once more in the same time, and as often afterwards as before."""

    def said(*faults: Fault) -> int:
        network = SimulatedNetwork(ListedFaults(faults).at, 0)
        made = {name: Beacon(name) for name in "ab"}
        for name in made:
            network.add(name, partial(made.__getitem__, name))
        network.run(1000, PATIENCE_US)
        return len(made["a"].heard)

    assert said(Fault("b", 2, "jump")) == said() + 1


def test_a_node_that_raises_is_told_from_one_that_ends() -> None:
    """A CubepathError ends the process, which is told; another exception is the node's bug."""

    class Broken(Talker):
        def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
            raise KeyError(data)

    class Ending(Talker):
        def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
            raise CheckError("that is too much")

    def against(node: type[Talker]) -> SimulatedNetwork:
        box: list[SimulatedNetwork] = []
        network = SimulatedNetwork(ListedFaults(()).at, 0)
        box.append(network)
        counter = Counter(1, 3)
        network.add("coordinator", lambda: counter)
        network.add("process_0", lambda: node(box, Listen((f"{RUN}/number",))))
        network.on_death(counter.died)
        network.run(1000, PATIENCE_US)
        return network

    with pytest.raises(NodeError, match=r"process_0 raised KeyError: b'1'"):
        against(Broken)
    assert str(against(Ending).ended) == "process_0 died: that is too much"


def test_a_run_without_end_is_stopped() -> None:
    """Neither time nor steps run away, and a run where nothing happens any more is no end."""
    box: list[SimulatedNetwork] = []

    class Endless(Talker):
        def tick(self) -> list[Effect]:
            return [Timer(1)]

    def of(node: Node) -> SimulatedNetwork:
        network = SimulatedNetwork(ListedFaults(()).at, 0)
        box[:] = [network]
        network.add("coordinator", lambda: node)
        return network

    with pytest.raises(EndlessRun, match="no end after 101 steps"):
        of(Endless(box, Timer(1))).run(100, 1000 * SECOND_US)
    with pytest.raises(EndlessRun, match=r"no end after 1[0-9] steps"):
        of(Endless(box, Timer(1))).run(1000, 10 * SECOND_US)
    with pytest.raises(EndlessRun, match="nothing more happens"):
        of(Endless(box)).run(100, SECOND_US)
