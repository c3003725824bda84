"""The pacing node as a pure machine: what it waits for, asks again, keeps, and says of the late."""

from itertools import permutations
from typing import Literal

import pytest

from cubepath.agents.processes.judge import Judge, refuse
from cubepath.agents.processes.pacer import Pacer, ProcessDied
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import key_of, topic_key
from cubepath.protocol.wire.messages import (
    MESSAGE_BYTES_MAX,
    Bundle,
    ChosenAction,
    ChosenActions,
    Claim,
    Edges,
    Go,
    Message,
    ModuleObservation,
    Observations,
    Presence,
    Ready,
    Refused,
    Report,
    Reports,
    Reset,
    Retransmit,
    Waiting,
    decode,
    encode,
)
from cubepath.protocol.wire.nodes import Effect, Keep, Listen, Put, Timer

RUN = "run"


def pacer_of(*modules_of: list[int], hears_all: bool = True, patience_s: float = 60.0) -> Pacer:
    """Return a pacer of processes with these modules, on a path of twenty vertices."""
    judge = Judge(RUN, modules_of, scene_from_spec("agv:graph=P20,n=2").system)
    return Pacer(RUN, modules_of, judge=judge, hears_all=hears_all, patience_s=patience_s)


def paced(*, processes: int = 2, hears_all: bool = True, patience_s: float = 60.0) -> Pacer:
    """Return a pacer whose processes have joined; process p has the module p."""
    pacer = pacer_of(
        *([each] for each in range(processes)), hears_all=hears_all, patience_s=patience_s
    )
    pacer.start()
    for process in range(processes):
        hear(pacer, Ready(0, process, "join"))
    assert pacer.idle
    return pacer


def hear(pacer: Pacer, *messages: Message) -> list[Effect]:
    """Let it receive messages; return what it does."""
    return [
        effect for each in messages for effect in pacer.receive(key_of(RUN, each), encode(each))
    ]


def put(effects: list[Effect]) -> list[Message]:
    """Return the messages that are put."""
    return [decode(effect.data) for effect in effects if isinstance(effect, Put)]


def kept(effects: list[Effect]) -> list[Message]:
    """Return the messages that go on record."""
    return [effect.message for effect in effects if isinstance(effect, Keep)]


def said(process: int, phase: str = "sense", *, region: str = "0", number: int = 0) -> Bundle:
    """Return a message of round 1."""
    return Bundle(1, phase, process, region, number, [])  # type: ignore[arg-type]


def reports(process: int, *, site: int = 0) -> Reports:
    """Return the report of a process with the module of its number in round 1."""
    return Reports(1, process, [Report(1, process, site, site, "none", None, {})])


def observations(process: int, *modules: int) -> Observations:
    """Return what the modules of a process observe in round 1."""
    return Observations(
        1, process, [ModuleObservation(1, module, [], [], []) for module in modules]
    )


def refusals(effects: list[Effect]) -> list[tuple[str, str]]:
    """Return who was refused, and why in a word; nothing else may have come of it."""
    found = kept(effects)
    assert len(found) == len(effects)
    assert all(isinstance(each, Refused) for each in found)
    return [(each.sender, each.reason) for each in found if isinstance(each, Refused)]


def ready(process: int, phase: str = "sense", **counts: int) -> Ready:
    """Return the answer of a process in round 1."""
    return Ready(1, process, phase, counts)  # type: ignore[arg-type]


@pytest.mark.parametrize("hears_all", [True, False])
def test_it_listens_to_all_or_to_answers_alone(hears_all: bool) -> None:
    """One key for everything; otherwise those of `ready` and `waiting`."""
    listen, timer = pacer_of([0], hears_all=hears_all).start()
    assert isinstance(listen, Listen)
    assert len(listen.keys) == (1 if hears_all else 2)
    assert timer == Timer(1.0)


def test_a_round_has_its_phases_in_order() -> None:
    """Each begins when all have answered, with the counts of the one before; then it is idle."""
    pacer = paced()
    assert put(pacer.begin_round()) == [Go(1, "sense")]
    assert put(hear(pacer, said(0), ready(0, r0=0), said(1))) == []
    assert put(hear(pacer, Ready(1, 1, "sense", {"0": 1}))) == [Go(1, "claim", {"r0": 0, "0": 1})]
    assert put(hear(pacer, ready(0, "claim"), ready(1, "claim"))) == [Go(1, "settle")]
    done = hear(pacer, reports(0), ready(0, "settle"), reports(1))
    assert not pacer.idle
    assert put(done) == []
    assert hear(pacer, ready(1, "settle"))[-1] == Timer(None)
    assert pacer.idle


def test_a_phase_waits_for_all_that_was_said_in_it() -> None:
    """An answer that counts more than has arrived does not end the phase."""
    pacer = paced(processes=1)
    pacer.begin_round()
    answer = Ready(1, 0, "sense", {"a": 1, "b": 1, "c": 1})
    assert put(hear(pacer, answer, said(0, region="a"), said(0, region="b"))) == []
    assert put(hear(pacer, said(0, region="c"))) == [Go(1, "claim", answer.sent)]


def test_the_round_waits_for_reports() -> None:
    """Answers alone do not end it."""
    pacer = paced(processes=1)
    pacer.begin_round()
    hear(pacer, ready(0), ready(0, "claim"), ready(0, "settle"))
    assert not pacer.idle
    hear(pacer, reports(0))
    assert pacer.idle


def test_what_it_asks_does_not_depend_on_the_order_of_arrival() -> None:
    """The counts are the same bytes whoever answers first."""
    asked: set[bytes] = set()
    answers = [Ready(1, process, "sense", {f"r{process}": 0, "0": 0}) for process in range(3)]
    for order in permutations(answers):
        pacer = paced(processes=3)
        pacer.begin_round()
        asked |= {each.data for each in hear(pacer, *order) if isinstance(each, Put)}
    assert asked == {encode(Go(1, "claim", {"r0": 0, "0": 0, "r1": 0, "r2": 0}))}


def test_each_message_is_kept_once() -> None:
    """What it puts and what it hears; doubles are refused, unless somebody has asked again."""
    pacer = paced()
    assert kept(pacer.begin_round()) == [Go(1, "sense")]
    answer = Ready(1, 0, "sense", {"0": 1, "1": 1})
    messages: list[Bundle | Ready] = [said(0), said(0, region="1"), said(1), answer]
    for number, message in enumerate(messages):
        assert kept(hear(pacer, message)) == [message]
        told = refusals(hear(pacer, message))
        assert told == ([(f"process_{message.process}", "doubled")] if number in (0, 2) else [])
    assert pacer.refused == 4
    assert put(hear(pacer, ready(1))) == [Go(1, "claim", answer.sent)]
    hear(pacer, ready(0, "claim"), ready(1, "claim"))
    assert kept(hear(pacer, reports(0))) == []
    assert kept(hear(pacer, ready(0, "settle"))) == [reports(0), ready(0, "settle")]
    pacer.tick()
    assert hear(pacer, reports(0)) == []
    assert pacer.refused == 4


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (ready(0, "claim"), "out of place"),
        (Ready(2, 0, "sense"), "out of place"),
        (said(0, "claim"), "out of place"),
        (Bundle(2, "sense", 0, "0", 0, []), "out of place"),
        (said(0, number=1), "out of place"),
        (reports(0), "out of place"),
        (observations(0, 0), "out of place"),
        (Waiting(2, 0, "sense"), "out of place"),
        (ready(2), "foreign"),
        (said(2), "foreign"),
        (Waiting(1, 2, "sense"), "foreign"),
        (Retransmit(1, 2, "sense", "0"), "foreign"),
        (Go(1, "stop"), "foreign"),
        (Reset(1, 0), "foreign"),
        (Bundle(1, "sense", 0, "0", 0, [Presence(1, 1, 4)]), "foreign"),
        (Bundle(1, "sense", 0, "0", 0, [Presence(2, 0, 4)]), "out of place"),
        (Bundle(1, "sense", 0, "0", 0, [Claim(1, 0, 4, "edge", (4, 5))]), "out of place"),
        (Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, 4)] * 2), "doubled"),
        (Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, 99)]), "impossible"),
        (Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, ((),))]), "impossible"),
        (Ready(-1, 0, "sense"), "malformed"),
        (Ready(1, 0, "sense", {"0": -1}), "malformed"),
        (Retransmit(1 << 80, 0, "sense", "0"), "malformed"),
        (Waiting(1, 0, "x" * 300), "malformed"),
        (Edges(1, []), "out of place"),
    ],
)
def test_what_cannot_be_is_refused_with_who_and_why(message: Message, reason: str) -> None:
    """It has no effect but that it is told of on record, with where it came and how it begins."""
    pacer = paced()
    pacer.begin_round()
    told_of = ("_refusals", "_false")
    before = repr({key: value for key, value in vars(pacer).items() if key not in told_of})
    effects = hear(pacer, message)
    assert [why for _, why in refusals(effects)] == [reason]
    (told,) = kept(effects)
    assert isinstance(told, Refused)
    assert told.sender == key_of(RUN, message).rpartition("/")[2]
    assert told.sample.encode() == encode(message)[:200]
    after = repr({key: value for key, value in vars(pacer).items() if key not in told_of})
    assert after == before


def test_what_is_no_message_or_on_a_wrong_key_is_refused() -> None:
    """Any bytes on any key; one that is too large is not even read."""
    pacer = paced()
    pacer.begin_round()
    for key, data, reason in (
        ("cubepath/run/hello/me", b"{}", "malformed"),
        ("hello", b"\xff\x00", "malformed"),
        ("cubepath/run/ready/process_0", b"x" * (MESSAGE_BYTES_MAX + 1), "too large"),
        ("cubepath/run/ready/process_1", encode(ready(0)), "wrong key"),
        ("cubepath/other/reports/process_2", encode(reports(2)), "wrong key"),
        ("cubepath/run/to/0/process_3", encode(said(0)), "wrong key"),
    ):
        assert [why for _, why in refusals(pacer.receive(key, data))] == [reason]
    assert pacer.refused == 6


def test_a_process_that_joins_again_later_is_refused() -> None:
    """It says that it is there until it is heard; two rounds later it has lost its memory."""
    pacer = pacer_of([0], [1])
    pacer.start()
    joins = Ready(0, 0, "join")
    assert kept(hear(pacer, joins, joins)) == [joins]
    hear(pacer, Ready(0, 1, "join"))
    pacer.begin_round()
    assert hear(pacer, joins) == []
    phases: tuple[Literal["sense", "claim", "settle"], ...] = ("sense", "claim", "settle")
    for phase in phases:
        hear(pacer, *(Ready(1, each, phase) for each in (0, 1)))
    hear(pacer, reports(0), reports(1))
    pacer.begin_round()
    assert refusals(hear(pacer, joins)) == [("process_0", "out of place")]


def test_what_contradicts_what_came_before_is_refused() -> None:
    """The first counts."""
    pacer = paced()
    pacer.begin_round()
    hear(pacer, said(0), ready(0))
    other = Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, 3)])
    assert refusals(hear(pacer, other)) == [("process_0", "contradicts")]
    pacer.tick()
    assert hear(pacer, Ready(1, 0, "sense", {"0": 7})) == []  # of the same sender and reason
    assert pacer.refused == 2


def test_a_flood_takes_few_lines_of_the_record() -> None:
    """One at once for each sender and reason, thirty at most, and one with how many more."""
    pacer = paced()
    pacer.begin_round()
    told: list[Effect] = []
    for number in range(5000):
        told += pacer.receive(f"cubepath/run/x/guest_{number % 100}", b"no message")
    assert len(told) == 33
    found = [each for each in kept(pacer.tick()) if isinstance(each, Refused)]
    assert len(found) == 33
    assert len(found) + sum(each.count for each in found) == 5000 == pacer.refused
    assert not [each for each in kept(pacer.tick()) if isinstance(each, Refused)]


def test_what_was_refused_last_is_told_where_a_process_is_late() -> None:
    """It may be why nothing came of it."""
    pacer = paced(patience_s=1.0)
    pacer.begin_round()
    hear(pacer, said(0, number=1))
    with pytest.raises(ProcessDied, match="; last refused, on to/0/process_0: a second message of"):
        pacer.tick()


def test_what_modules_report_is_checked_by_whoever_knows_where_they_stand() -> None:
    """A line says why not; then the report is not taken, and a true one may still come."""
    judge = Judge(RUN, [[0]], scene_from_spec("agv:graph=P20,n=2").system)
    pacer = Pacer(RUN, [[0]], judge=judge, check=nobody_at_7)
    pacer.start()
    hear(pacer, Ready(0, 0, "join"))
    pacer.begin_round()
    hear(pacer, ready(0), ready(0, "claim"))
    assert refusals(hear(pacer, reports(0, site=7))) == [("process_0", "impossible")]
    assert kept(hear(pacer, reports(0), ready(0, "settle")))[0] == reports(0)


def nobody_at_7(message: Message) -> None:
    """Refuse reports from the vertex 7."""
    if isinstance(message, Reports) and message.parts[0].site == 7:
        refuse("impossible", "nobody is at 7")


def test_to_ask_again_without_end_ends() -> None:
    """A thousand times in a phase; more is refused."""
    pacer = paced()
    pacer.begin_round()
    message = Retransmit(1, 0, "sense", "0")
    for _ in range(1000):
        assert kept(hear(pacer, message)) == [message]
    assert refusals(hear(pacer, message)) == [("process_0", "too many")]


def test_those_who_have_not_answered_are_asked_again_each_by_itself() -> None:
    """On a key of their own, after 1, 2, 4 and again 4 seconds; the others are left alone."""
    pacer = paced(processes=3)
    begun = pacer.begin_round()
    assert begun[-1] == Timer(1.0)
    hear(pacer, ready(1), said(2), Ready(1, 2, "sense", {"0": 2}))
    for seconds in (2.0, 4.0, 4.0, 4.0):
        *asked, timer = pacer.tick()
        assert asked == [
            Put(topic_key(RUN, "go", f"process_{each}"), encode(Go(1, "sense"))) for each in (0, 2)
        ]
        assert timer == Timer(seconds)
    hear(pacer, ready(0), said(2, region="1"))
    assert pacer.phase == "claim"


def test_it_asks_nothing_while_idle_or_joining() -> None:
    """Processes join by themselves; between two rounds no timer runs."""
    pacer = pacer_of([0], [1])
    pacer.start()
    assert pacer.tick() == [Timer(2.0)]
    assert paced().tick() == []


def test_patience_begins_anew_with_each_new_message_and_not_with_doubles() -> None:
    """After 3 s without anything new it is over; what passed before something new is forgotten."""
    pacer = paced(processes=3, patience_s=3.0)
    pacer.begin_round()
    assert pacer.tick()[-1] == Timer(2.0)
    hear(pacer, ready(1))
    assert pacer.tick()[-1] == Timer(3.0)
    hear(pacer, ready(1), Waiting(1, 0, "sense"))
    with pytest.raises(ProcessDied):
        pacer.tick()


def test_the_late_are_named_and_those_who_wait_for_them_are_not() -> None:
    """Who said since the last time that it waits is not blamed while another is silent."""
    pacer = paced(processes=3, patience_s=3.0)
    pacer.begin_round()
    hear(pacer, ready(1))
    pacer.tick()
    pacer.tick()
    assert kept(hear(pacer, Waiting(1, 0, "sense"))) == [Waiting(1, 0, "sense")]
    with pytest.raises(ProcessDied) as caught:
        pacer.tick()
    line = "no answer within 3 s to phase sense of round 1 from module_2 (process 2)"
    assert str(caught.value) == line


def test_where_all_say_that_they_wait_all_are_named() -> None:
    """The line says that they wait for others."""
    pacer = paced(patience_s=3.0)
    pacer.begin_round()
    hear(pacer, ready(1))
    pacer.tick()
    pacer.tick()
    hear(pacer, Waiting(1, 0, "sense"))
    with pytest.raises(ProcessDied, match=r"from module_0 \(process 0\), waiting for others$"):
        pacer.tick()


def test_who_waited_long_ago_is_named_with_that() -> None:
    """What it said before it was asked again is told as such; who never waited is blamed."""
    pacer = paced(patience_s=3.0)
    pacer.begin_round()
    hear(pacer, ready(1), Waiting(1, 0, "sense"))
    pacer.tick()
    pacer.tick()
    with pytest.raises(
        ProcessDied, match=r"module_0 \(process 0\), waiting for others when last heard of$"
    ):
        pacer.tick()
    pacer = paced(patience_s=3.0)
    pacer.begin_round()
    hear(pacer, Waiting(1, 0, "sense"))
    pacer.tick()
    with pytest.raises(ProcessDied, match=r"from module_1 \(process 1\)$"):
        pacer.tick()


def test_who_asked_in_a_round_before_has_got_it() -> None:
    """It is not kept; in its own round it is."""
    pacer = paced()
    pacer.begin_round()
    assert hear(pacer, Waiting(0, 0, "sense"), Retransmit(0, 0, "sense", "0")) == []
    assert kept(hear(pacer, Retransmit(1, 1, "sense", "0"))) == [Retransmit(1, 1, "sense", "0")]


def test_processes_have_time_to_start_and_none_is_asked_too_late() -> None:
    """A short patience does not count while they join; the first wait is no longer than it."""
    pacer = pacer_of([0], [1], patience_s=0.5)
    assert pacer.start()[-1] == Timer(0.5)
    for _ in range(7):
        pacer.tick()
    hear(pacer, Ready(0, 0, "join"), Ready(0, 1, "join"))
    assert pacer.begin_round()[-1] == Timer(0.5)
    with pytest.raises(ProcessDied, match=r"no answer within 0\.5 s to phase sense"):
        pacer.tick()


def test_actions_from_outside_go_with_the_claims_and_are_repeated_first() -> None:
    """Each process gets those of its modules, before `go`, and again before it is asked again."""
    pacer = pacer_of([0, 2], [1])
    pacer.start()
    hear(pacer, Ready(0, 0, "join"), Ready(0, 1, "join"))
    pacer.begin_round(driven=True)
    assert put(hear(pacer, ready(0), ready(1))) == [Go(1, "observe", {})]
    hear(pacer, observations(0, 0, 2), ready(0, "observe"), ready(1, "observe"))
    assert not pacer.idle
    hear(pacer, observations(1, 1))
    assert pacer.idle
    acts = [ChosenAction(1, module, 0, []) for module in (2, 1, 0)]
    own = [ChosenActions(1, 0, [acts[2], acts[0]]), ChosenActions(1, 1, [acts[1]])]
    begun = pacer.act(acts)
    assert put(begun) == kept(begun) == [*own, Go(1, "claim", {})]
    hear(pacer, ready(0, "claim"))
    assert put(pacer.tick()) == [own[1], Go(1, "claim", {})]
    hear(pacer, ready(1, "claim"))
    assert pacer.phase == "settle"
    assert put(pacer.tick()) == [Go(1, "settle", {})] * 2


def test_a_reset_is_a_round_of_its_own_and_is_repeated() -> None:
    """Processes join anew; who does not is told again on a key of its own."""
    pacer = paced()
    begun = pacer.reset(5)
    assert put(begun) == kept(begun) == [Reset(1, 5)]
    hear(pacer, Ready(0, 0, "join"), Ready(1, 1, "join"))
    assert not pacer.idle
    again = Put(topic_key(RUN, "reset", "process_0"), encode(Reset(1, 5)))
    assert pacer.tick() == [again, Timer(2.0)]
    hear(pacer, Ready(1, 0, "join"))
    assert pacer.idle
    assert put(pacer.begin_round()) == [Go(2, "sense")]


def test_a_schedule_ends_between_two_rounds() -> None:
    """All are asked, and it is over when all have answered."""
    pacer = paced()
    assert put(pacer.end_schedule()) == [Go(0, "over")]
    hear(pacer, Ready(0, 0, "over"))
    assert not pacer.idle
    hear(pacer, Ready(0, 1, "over"))
    assert pacer.idle


def test_without_a_record_answers_are_enough() -> None:
    """A pacer that does not hear all waits for no messages of modules and no reports."""
    pacer = paced(processes=1, hears_all=False)
    pacer.begin_round()
    assert put(hear(pacer, Ready(1, 0, "sense", {"0": 3}))) == [Go(1, "claim", {"0": 3})]
    hear(pacer, ready(0, "claim"), ready(0, "settle"))
    assert pacer.idle


def test_to_ask_for_what_is_missing_is_on_record() -> None:
    """It may come more than once, each time by another's wish."""
    pacer = paced()
    message = Retransmit(0, 1, "sense", "0")
    assert hear(pacer, message, message) == [Keep(encode(message), message)] * 2


def test_to_stop_ends_the_timer() -> None:
    """All processes are told once."""
    go = Go(0, "stop")
    stop = [Put(key_of(RUN, go), encode(go)), Keep(encode(go), go), Timer(None)]
    assert paced().stop() == stop


def test_a_process_is_named_by_its_modules() -> None:
    """Eight at most; and who died is named with the round and how."""
    pacer = pacer_of(list(range(8)), list(range(8, 18)))
    first = ", ".join(f"module_{module}" for module in range(8))
    assert pacer.name(0) == f"{first} (process 0)"
    assert pacer.name(1).endswith("module_15, 2 more (process 1)")
    assert str(pacer.died(0, "exit code 1")) == f"{first} (process 0) died in round 0: exit code 1"
