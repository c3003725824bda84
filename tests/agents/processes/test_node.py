"""The node of a module process as a pure machine: messages and ticks in, effects out."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from cubepath.agents.processes.config import OUTSIDE, ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.keys import key_of, to_region, topic_key
from cubepath.protocol.wire.messages import (
    Bundle,
    ChosenAction,
    ChosenActions,
    Go,
    Message,
    Observations,
    Presence,
    Ready,
    Report,
    Reports,
    Reset,
    Retransmit,
    Verdict,
    Waiting,
    decode,
    encode,
)
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Listen, Put, Timer
from oracles.obvious_rounds import rank

RUN = "run"
ROW = "agv:graph=grid12x1,n=2"
"""Vehicles in a row; a region ends between the columns 7 and 8."""
TO_ONE_OR_ALL = ("coordinator", "process_0")
Schedule = dict[int, dict[int, GeneratorPlacement]]


def hosts(
    *start: Site,
    rule: str = "random",
    schedule: Schedule | None = None,
    seed: int = 0,
    started: bool = True,
    together: bool = False,
    note_length: int = 0,
) -> list[HostNode]:
    """Return nodes with a vehicle each, or one with all, on a path of four vertices or in a row."""
    spec = f"agv:graph=P4,n={len(start)}" if isinstance(start[0], int) else ROW
    scene = replace(scene_from_spec(spec), start=start, goal=None, goals=())
    nodes = [
        HostNode(
            ProcessConfig(
                endpoint="",
                run=RUN,
                process=process,
                modules=[*range(len(start))] if together else [process],
                processes=[[*range(len(start))]] if together else [[n] for n in range(len(start))],
                scene=scene_to_toml(scene),
                rule=rule,
                seed=seed,
                hesitate=0.0,
                note_length=note_length,
                schedule=schedule,
            )
        )
        for process in range(1 if together else len(start))
    ]
    if started:
        for node in nodes:
            node.start()
    return nodes


def moving(*moves: tuple[Site, Site]) -> Schedule:
    """Return a schedule in which each module makes this move in round 1."""
    return {
        module: {1: GeneratorPlacement("edge", (one, other))}
        for module, (one, other) in enumerate(moves)
    }


def put(effects: Sequence[Effect]) -> list[Message]:
    """Return the messages that are put."""
    return [decode(effect.data) for effect in effects if isinstance(effect, Put)]


def timers(effects: Sequence[Effect]) -> list[float | None]:
    """Return the timers that are set."""
    return [effect.seconds for effect in effects if isinstance(effect, Timer)]


def begun(node: HostNode, phase: str = "sense", number: int = 1, **said: int) -> list[Effect]:
    """Ask for a phase in which so many messages were said to each region in the one before."""
    go = Go(number, phase, {key.removeprefix("r"): count for key, count in said.items()})  # type: ignore[arg-type]
    return hear(node, go)


def hear(node: HostNode, *messages: Message) -> list[Effect]:
    """Let a node receive messages; return what it does."""
    return [effect for each in messages for effect in node.receive(key_of(RUN, each), encode(each))]


def said(effects: Sequence[Effect]) -> list[Bundle]:
    """Return what is said to places."""
    return [each for each in put(effects) if isinstance(each, Bundle)]


def ready(effects: Sequence[Effect]) -> list[Ready]:
    """Return the answers."""
    return [each for each in put(effects) if isinstance(each, Ready)]


def report(effects: Sequence[Effect]) -> Report:
    """Return the one report of a process with one module."""
    ((found,),) = [each.parts for each in put(effects) if isinstance(each, Reports)]
    return found


def sensed(one: HostNode, other: HostNode, *, number: int = 1) -> None:
    """Take both through the phase `sense`, each with what the other says."""
    said_by = [said(begun(node, number=number)) for node in (one, other)]
    hear(one, *said_by[1])
    hear(other, *said_by[0])


def claimed(one: HostNode, other: HostNode, *, number: int = 1) -> None:
    """Take both through the phases before `settle`."""
    sensed(one, other, number=number)
    said_by = [said(begun(node, "claim", number, r0=2)) for node in (one, other)]
    hear(one, *said_by[1])
    hear(other, *said_by[0])


def driven(node: HostNode, number: int, *targets: Site) -> list[Effect]:
    """Play a round in which each module of a process moves to a site; return how it ends."""
    begun(node, number=number)
    begun(node, "observe", number)
    acts: list[ChosenAction] = []
    for module, target in enumerate(targets):
        moves = node._system.moves(node._cores[module].site)
        action = next(n for n, move in enumerate(moves, 1) if move and move.target == target)
        acts.append(ChosenAction(number, module, action, []))
    hear(node, ChosenActions(number, 0, acts))
    begun(node, "claim", number)
    return begun(node, "settle", number)


def reports(effects: Sequence[Effect]) -> list[Report]:
    """Return the reports of a process."""
    (found,) = [each.parts for each in put(effects) if isinstance(each, Reports)]
    return found


def contest() -> tuple[HostNode, HostNode]:
    """Return two vehicles that want the vertex between them: the winner, settled, and the loser."""
    nodes = hosts(0, 2, schedule=moving((0, 1), (1, 2)))
    claimed(*nodes)
    winner = max((0, 1), key=lambda module: rank(0, 1, module))
    assert report(begun(nodes[winner], "settle", r0=2)).claim == "granted"
    return nodes[winner], nodes[1 - winner]


def test_it_says_that_it_is_there_until_it_is_told_to_begin() -> None:
    """At first at once, then after 1, 2, 4 and again 4 seconds."""
    (node,) = hosts(0, started=False)
    effects = node.start()
    assert isinstance(effects[0], Listen)
    assert set(effects[0].keys) == {
        to_region(RUN, "0"),
        topic_key(RUN, "retransmit"),
        *(topic_key(RUN, kind, who) for kind in ("go", "reset") for who in TO_ONE_OR_ALL),
    }
    for seconds in (1.0, 2.0, 4.0, 4.0):
        assert put(effects) == [Ready(0, 0, "join")]
        assert timers(effects) == [seconds]
        effects = node.tick()
    assert timers(begun(node)) == [None]


def test_each_phase_is_answered_with_what_was_said_in_it() -> None:
    """A module alone senses, claims what it may, and reports."""
    (node,) = hosts(0)
    assert put(begun(node)) == [
        Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, 0)]),
        Ready(1, 0, "sense", {"0": 1}),
    ]
    assert ready(begun(node, "claim", r0=1))[0].phase == "claim"
    effects = begun(node, "settle")
    assert [type(each) for each in put(effects)] == [Reports, Ready]
    assert put(begun(node, number=2))[0] == Bundle(
        2, "sense", 0, "0", 0, [Presence(2, 0, report(effects).site)]
    )


def test_doubles_are_not_counted() -> None:
    """Two more messages are due, and the same one twice is one of them."""
    one, other, third = hosts(0, 1, 2)
    begun(one)
    (here,) = said(begun(other))
    assert hear(one, here, here) == []
    assert ready(begun(one, "claim", r0=3)) == []
    assert hear(one, here) == []
    assert ready(hear(one, *said(begun(third))))


def test_doubles_are_heard_once() -> None:
    """A module is given each message of others once."""
    one, other = hosts(0, 1, schedule={1: {1: GeneratorPlacement("edge", (1, 2))}})
    here = said(begun(other))
    begun(one)
    hear(one, *here, *here)
    begun(one, "claim", r0=2)
    hear(other, Bundle(1, "sense", 0, "0", 0, [Presence(1, 0, 0)]))
    claims = said(begun(other, "claim", r0=2))
    assert len(claims) == 1
    hear(one, *claims, *claims)
    assert report(begun(one, "settle", r0=1)).received == {"claim": [1], "presence": [1]}


def test_what_comes_before_its_phase_is_kept() -> None:
    """Also before its round has begun; when its phase is over nothing is missing."""
    one, other = hosts(0, 1, schedule={1: {1: GeneratorPlacement("edge", (1, 2))}})
    assert hear(one, *said(begun(other))) == []
    hear(other, *said(begun(one)))
    assert hear(one, *said(begun(other, "claim", r0=2))) == []
    assert ready(begun(one, "claim", r0=2))
    assert report(begun(one, "settle", r0=1)).received == {"claim": [1], "presence": [1]}


def test_what_comes_after_its_phase_is_ignored() -> None:
    """It changes nothing, and no module hears it."""
    one, other = hosts(0, 1)
    sensed(one, other)
    begun(one, "claim", r0=2)
    late = Bundle(1, "sense", 1, "0", 1, [Presence(1, 1, 3)])
    before = dict(one._inbox._heard)
    assert hear(one, late) == []
    assert one._inbox._heard == before
    begun(one, "settle")
    for phase in ("sense", "claim", "settle"):
        assert hear(one, Bundle(1, phase, 1, "0", 5, [])) == []
    assert hear(one, Bundle(0, "claim", 1, "0", 0, []), Bundle(3, "sense", 1, "0", 0, [])) == []
    assert one._inbox._heard == {}


def test_what_a_process_says_itself_does_not_count_twice() -> None:
    """Its own messages may come back to it over another way."""
    one, _ = hosts(0, 1)
    own = said(begun(one))
    hear(one, *own)
    assert ready(begun(one, "claim", r0=2)) == []


def test_what_is_missing_is_asked_for_until_it_comes() -> None:
    """After 1, 2, 4 and again 4 seconds; what comes stops the timer."""
    one, other = hosts(0, 1)
    begun(one)
    effects = begun(one, "claim", r0=2)
    for seconds in (1.0, 2.0, 4.0, 4.0):
        assert timers(effects) == [seconds]
        effects = one.tick()
        assert [each for each in effects if isinstance(each, Put)] == [
            Put(topic_key(RUN, "retransmit", "process_0"), encode(Retransmit(1, 0, "sense", "0")))
        ]
    effects = hear(one, *said(begun(other)))
    assert timers(effects) == [None]
    assert ready(effects)


def test_only_regions_of_its_own_modules_can_be_missing() -> None:
    """What was said elsewhere is nothing to it."""
    one, _ = hosts(0, 1)
    begun(one)
    assert ready(begun(one, "claim", r7=5, r0=1))


def test_who_has_said_it_says_it_again() -> None:
    """The same bytes on the same key; other rounds, phases and regions were not said."""
    one, _ = hosts(0, 1)
    spoken = [
        each for each in begun(one) if isinstance(each, Put) and b'"bundle"' in each.data[:20]
    ]
    assert len(spoken) == 1
    assert hear(one, Retransmit(1, 1, "sense", "0")) == spoken
    for other in (
        Retransmit(1, 1, "sense", "1"),
        Retransmit(1, 1, "claim", "0"),
        Retransmit(0, 1, "sense", "0"),
        Retransmit(2, 1, "sense", "0"),
    ):
        assert hear(one, other) == []


def test_who_has_answered_and_is_asked_again_repeats_all() -> None:
    """What it said in the phase and its answer, as often as it is asked."""
    one, _ = hosts(0, 1)
    first = [effect for effect in begun(one) if isinstance(effect, Put)]
    assert [type(each) for each in put(first)] == [Bundle, Ready]
    for _ in range(2):
        assert begun(one) == first


def test_a_flood_of_asking_is_answered_a_thousand_times_for_each_process() -> None:
    """Who floods gets no more in that round, and others still do."""
    one, _, _ = hosts(0, 1, 2)
    begun(one)
    answered = [bool(hear(one, Retransmit(1, 1, "sense", "0"))) for _ in range(1001)]
    assert answered == [True] * 1000 + [False]
    assert hear(one, Retransmit(1, 2, "sense", "0"))


def test_what_is_said_to_a_region_without_own_modules_is_not_kept() -> None:
    """Whatever it is called: nothing grows."""
    one, _ = hosts(0, 1)
    for region in ("1", "x" * 99):
        assert hear(one, Bundle(1, "sense", 1, region, 0, [Presence(1, 1, 1)])) == []
    assert one._inbox._heard == {}


def test_actions_for_another_process_or_with_a_note_of_another_length_are_not_taken() -> None:
    """Nor are they kept; what is not in the mask counts as to stay."""
    one, _ = hosts(0, 1, rule=OUTSIDE)
    begun(one)
    hear(one, Bundle(1, "sense", 1, "0", 0, [Presence(1, 1, 1)]))
    begun(one, "observe", r0=2)
    hear(
        one,
        ChosenActions(1, 1, [ChosenAction(1, 1, 0, [])]),
        ChosenActions(1, 0, [ChosenAction(1, 0, 0, [5])]),
    )
    assert one._given == {}
    hear(one, ChosenActions(1, 0, [ChosenAction(1, 0, 99, [])]))
    effects = begun(one, "claim")
    assert said(effects) == []
    assert ready(effects)
    assert report(begun(one, "settle")).claim == "none"


def test_reports_are_repeated_as_they_were() -> None:
    """Asked again after it has moved, it says the same."""
    winner, _ = contest()
    again = begun(winner, "settle", r0=2)
    assert report(again).claim == "granted"
    assert [type(each) for each in put(again)] == [Bundle, Reports, Ready]
    assert begun(winner, "settle", r0=2) == again


def test_who_waits_for_others_and_is_asked_again_says_so() -> None:
    """Before a phase that cannot begin, and while verdicts are missing."""
    one, _ = hosts(0, 1)
    begun(one)
    assert put(begun(one, "claim", r0=2)) == []
    assert put(begun(one, "claim", r0=2)) == [Waiting(1, 0, "claim")]
    _, loser = contest()
    process = loser._config.process
    assert put(begun(loser, "settle", r0=2)) == []
    assert put(begun(loser, "settle", r0=2)) == [Waiting(1, process, "settle")]


def test_a_missing_verdict_is_asked_for_and_ends_the_round() -> None:
    """The loser waits with a timer, asks, and reports when the winner has said it again."""
    winner, loser = contest()
    effects = begun(loser, "settle", r0=2)
    assert timers(effects) == [1.0]
    process = loser._config.process
    (again,) = put(loser.tick())
    assert again == Retransmit(1, process, "settle", "0")
    (verdict,) = put(hear(winner, again))
    assert isinstance(verdict, Bundle)
    assert [type(part) for part in verdict.parts] == [Verdict]
    effects = hear(loser, verdict)
    assert timers(effects) == [None]
    assert report(effects).claim == "lost"
    assert report(effects).received["verdict"] == [1 - process]
    assert hear(loser, verdict) == []


def test_a_verdict_that_comes_before_its_phase_counts_in_it() -> None:
    """The loser reports as soon as it is told to settle."""
    winner, loser = contest()
    (verdict,) = said(begun(winner, "settle", r0=2))
    assert hear(loser, verdict) == []
    assert report(begun(loser, "settle", r0=2)).claim == "lost"


def test_to_go_where_it_has_been_is_ignored() -> None:
    """An earlier phase or round that comes late."""
    (node,) = hosts(0)
    begun(node)
    begun(node, "claim", r0=1)
    assert begun(node, "sense") == []
    assert begun(node, "settle", number=0) == []
    begun(node, "settle")
    assert begun(node, "claim") == []


@pytest.mark.parametrize(
    ("number", "phase"), [(1, "claim"), (1, "settle"), (1, "observe"), (2, "sense"), (1, "over")]
)
def test_a_process_without_its_memory_takes_no_part(number: int, phase: str) -> None:
    """One that has just begun and is asked for what can only come later goes on joining."""
    (node,) = hosts(0)
    assert begun(node, phase, number) == []
    assert put(node.tick()) == [Ready(0, 0, "join")]


def test_a_phase_cannot_be_left_out() -> None:
    """From `sense` to `settle`, and from an unfinished `settle` to the next round."""
    one, _ = hosts(0, 1)
    begun(one)
    assert begun(one, "settle") == []
    _, loser = contest()
    begun(loser, "settle", r0=2)
    assert begun(loser, number=2) == []


def test_to_stop_ends_it() -> None:
    """At any time."""
    (node,) = hosts(0)
    assert begun(node, "stop", number=0) == [End()]
    begun(node)
    assert begun(node, "stop") == [End()]


def test_what_is_for_others_and_what_is_no_message_has_no_effect() -> None:
    """Answers, reports and what waits are for the coordinator."""
    (node,) = hosts(0)
    for message in (Ready(1, 1, "sense"), Reports(1, 1, []), Waiting(1, 1, "claim")):
        assert hear(node, message) == []
    assert node.receive(topic_key(RUN, "go", "coordinator"), b"[1]") == []


def test_it_listens_at_the_new_place_before_it_reports() -> None:
    """So that what is said in the next round finds it there; it leaves the old region."""
    (node,) = hosts((7, 0), schedule=moving(((7, 0), (8, 0))), started=False)
    first = node.start()[0]
    assert isinstance(first, Listen)
    assert to_region(RUN, "0,0") in first.keys
    here = said(begun(node))
    begun(node, "claim", **{"r0,0": sum(each.region == "0,0" for each in here)})
    effects = begun(node, "settle")
    assert report(effects).site == (8, 0)
    listen, ignore = Listen((to_region(RUN, "1,0"),)), Ignore((to_region(RUN, "0,0"),))
    kinds = [type(each) for each in effects]
    assert {listen, ignore} <= {each for each in effects if isinstance(each, Listen | Ignore)}
    assert kinds.index(Listen) < kinds.index(Put)


def test_after_its_schedule_a_module_follows_the_rule() -> None:
    """It is told between two rounds, answers, repeats its answer, and goes on from there."""
    (node,) = hosts(0, schedule=moving((0, 1)))
    begun(node)
    begun(node, "claim", r0=1)
    assert report(begun(node, "settle")).site == 1
    over = begun(node, "over")
    assert put(over) == [Ready(1, 0, "over")]
    assert begun(node, "over") == over
    assert put(begun(node, number=2))[0] == Bundle(2, "sense", 0, "0", 0, [Presence(2, 0, 1)])


def test_only_a_driven_process_listens_for_actions() -> None:
    """Those for itself."""
    key = topic_key(RUN, "actions", "process_0")
    for rule in (OUTSIDE, "random"):
        (node,) = hosts(0, rule=rule, started=False)
        (listen,) = (each for each in node.start() if isinstance(each, Listen))
        assert (key in listen.keys) == (rule == OUTSIDE)


def test_a_driven_process_sends_what_its_modules_observe() -> None:
    """For each its round, its number, what it senses, what it may do, and the notes of others."""
    (node,) = hosts(0, 1, rule=OUTSIDE, together=True, note_length=2)
    for number in (1, 2):
        begun(node, number=number)
        sent, _ = put(begun(node, "observe", number))
        assert isinstance(sent, Observations)
        assert [(each.round, each.module) for each in sent.parts] == [(number, 0), (number, 1)]
        assert all(sum(each.observation) and each.action_mask[0] for each in sent.parts)
        notes = [[each for each in seen.notes if min(each) >= 0] for seen in sent.parts]
        assert notes == ([[], []] if number == 1 else [[[7, 8]], [[5, 6]]])
        acts = [ChosenAction(number, 0, 0, [5, 6]), ChosenAction(number, 1, 0, [7, 8])]
        hear(node, ChosenActions(number, 0, acts))
        begun(node, "claim", number)
        begun(node, "settle", number)


def test_actions_from_outside_are_waited_for() -> None:
    """The phase `claim` begins with both; the first actions of a round count."""
    (node,) = hosts(0, rule=OUTSIDE)
    begun(node)
    observed = begun(node, "observe", r0=1)
    assert [type(each) for each in put(observed)] == [Observations, Ready]
    assert begun(node, "observe", r0=1) == observed
    assert timers(begun(node, "claim")) == [1.0]
    assert hear(node, ChosenActions(3, 0, []), ChosenActions(0, 0, [])) == []
    effects = hear(node, ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])]))
    assert timers(effects) == [None]
    assert ready(effects) == [Ready(1, 0, "claim")]
    assert hear(node, ChosenActions(1, 0, [ChosenAction(1, 0, 1, [])])) == []
    assert report(begun(node, "settle")).claim == "none"


def test_actions_may_come_first_and_twice() -> None:
    """Before their phase they are kept; another set for the same round is ignored."""
    (node,) = hosts(0, rule=OUTSIDE)
    begun(node)
    begun(node, "observe", r0=1)
    assert (
        hear(
            node,
            ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])]),
            ChosenActions(1, 0, [ChosenAction(1, 0, 1, [])]),
        )
        == []
    )
    assert ready(begun(node, "claim"))
    assert report(begun(node, "settle")).claim == "none"


def test_actions_for_the_next_round_are_kept() -> None:
    """They may come before the round has begun."""
    (node,) = hosts(0, rule=OUTSIDE)
    hear(node, ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])]))
    begun(node)
    begun(node, "observe", r0=1)
    assert ready(begun(node, "claim"))


def test_actions_for_other_modules_have_no_effect() -> None:
    """Neither has one for a module too many, or too few."""
    (node,) = hosts(0, rule=OUTSIDE)
    begun(node)
    begun(node, "observe", r0=1)
    hear(node, ChosenActions(1, 0, [ChosenAction(1, 7, 0, [])]), ChosenActions(1, 0, []))
    assert ready(begun(node, "claim")) == []
    assert ready(hear(node, ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])])))


def test_a_reset_puts_modules_back_and_is_answered_each_time() -> None:
    """The rounds go on counting; it listens where its modules begin; an older one is ignored."""
    (node,) = hosts((7, 0), rule=OUTSIDE)
    assert report(driven(node, 1, (8, 0))).site == (8, 0)
    effects = hear(node, Reset(2, 5))
    assert effects[0] == Timer(None)
    assert Listen((to_region(RUN, "0,0"),)) in effects
    assert Ignore((to_region(RUN, "1,0"),)) in effects
    assert put(effects) == [Ready(2, 0, "join")]
    assert timers(effects) == [None, 1.0]
    assert put(hear(node, Reset(2, 5))) == [Ready(2, 0, "join")]
    assert hear(node, Reset(1, 5)) == []
    assert said(begun(node, number=3))[0].parts == [Presence(3, 0, (7, 0))]


def test_after_a_reset_ranks_count_from_the_first_round() -> None:
    """Who goes before in a contest is the one who would in the first round of a run."""
    seed = next(
        seed
        for seed in range(100)
        if (rank(seed, 1, 0) < rank(seed, 1, 1)) != (rank(seed, 5, 0) < rank(seed, 5, 1))
    )
    (node,) = hosts(0, 2, rule=OUTSIDE, together=True)
    hear(node, Reset(4, seed))
    winner = max((0, 1), key=lambda module: rank(seed, 1, module))
    granted = [each.claim == "granted" for each in reports(driven(node, 5, 1, 1))]
    assert granted == [winner == 0, winner == 1]


def test_it_listens_to_what_is_new_and_leaves_what_is_left() -> None:
    """A region that some module is in before and after is in neither, nor is there an empty one."""
    old, new = to_region(RUN, "0,0"), to_region(RUN, "1,0")
    for start, target, there, back in (
        ((7, 0), (8, 0), Listen((new,)), Ignore((new,))),
        ((8, 0), (7, 0), Ignore((new,)), Listen((new,))),
        ((7, 0), (6, 0), None, None),
    ):
        (node,) = hosts(start, (4, 0), rule=OUTSIDE, together=True, started=False)
        first = node.start()[0]
        assert isinstance(first, Listen)
        assert old in first.keys
        for effects, expected in (
            (driven(node, 1, target, (3, 0)), there),
            (hear(node, Reset(2, 0)), back),
        ):
            found = [each for each in effects if isinstance(each, Listen | Ignore)]
            assert found == [each for each in [expected] if each is not None]


def test_actions_for_the_next_round_are_kept_in_every_round() -> None:
    """Those of round 3 may come in round 2; those of round 4 are too early."""
    (node,) = hosts(0, rule=OUTSIDE)
    hear(node, ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])]))
    for number in (1, 2, 3):
        begun(node, number=number)
        begun(node, "observe", number)
        early = ChosenActions(number + 2, 0, [ChosenAction(number + 2, 0, 1, [])])
        hear(node, ChosenActions(number + 1, 0, [ChosenAction(number + 1, 0, 0, [])]), early)
        assert ready(begun(node, "claim", number))
        assert report(begun(node, "settle", number)).claim == "none"


def test_what_was_kept_for_a_round_is_gone_in_the_next() -> None:
    """Verdicts and actions that came for a round that is over take no memory."""
    winner, loser = contest()
    hear(loser, *said(begun(winner, "settle", r0=2)))
    begun(loser, "settle", r0=2)
    begun(loser, number=2)
    assert loser._inbox._heard == {}
    (node,) = hosts(0, rule=OUTSIDE)
    begun(node)
    begun(node, "observe", r0=1)
    begun(node, "claim")
    acts = ChosenActions(1, 0, [ChosenAction(1, 0, 0, [])])
    hear(node, acts, acts)
    begun(node, "settle")
    begun(node, number=2)
    assert node._given == {}
