"""What can be, given where modules stand: each kind of lie is refused, and the liar is named.

Four vehicles on a path of twenty vertices, two in each process. Vehicle 0 stands at 0, 1 at 2, and
both want 1; the other two stand apart.
"""

from dataclasses import replace as scene_with
from typing import Any, Literal

import pytest

from cubepath.agents.processes.judge import RefusedError
from cubepath.coordinator.runs.gatherer import Plausibility
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import (
    Bundle,
    Claim,
    Go,
    Message,
    Part,
    Presence,
    Ready,
    Report,
    Reports,
    Verdict,
    decode,
    encode,
)
from oracles.obvious_rounds import rank

START = (0, 2, 9, 11)
MODULES_OF = [[0, 1], [2, 3]]
SEED = next(seed for seed in range(9) if rank(seed, 1, 0) > rank(seed, 1, 1))
"""In the first round vehicle 0 goes before vehicle 1."""
Phase = Literal["sense", "claim", "settle"]
PHASES: tuple[Phase, ...] = ("sense", "claim", "settle")
LEFT, RIGHT = GeneratorPlacement("edge", (1, 2)), GeneratorPlacement("edge", (0, 1))


def edge(one: int) -> GeneratorPlacement:
    """Return the move between two neighbouring vertices."""
    return GeneratorPlacement("edge", (one, one + 1))


def plausibility(seed: int = SEED) -> Plausibility:
    """Return it at the start."""
    scene = scene_from_spec("agv:graph=P20,n=4")
    found = Plausibility(scene_with(scene, start=START, goal=None, goals=()))
    found.know(MODULES_OF, seed)
    return found


def here(*modules: int) -> list[Part]:
    """Return that these are where they are."""
    return [Presence(1, module, START[module]) for module in modules]


def claim(module: int, move: GeneratorPlacement) -> Claim:
    """Return the claim of a vehicle where it is."""
    return Claim(1, module, START[module], move.generator, move.at)


CLAIMS = [claim(0, RIGHT), claim(1, LEFT)]
VERDICT = Verdict(1, 0, 0, True, [2])


def said(process: int, phase: Phase, *parts: Part, number: int = 0, region: str = "0") -> Bundle:
    """Return what a process says in round 1."""
    return Bundle(1, phase, process, region, number, list(parts))


def ready(process: int, phase: Phase, said: int = 1, region: str = "0") -> Ready:
    """Return the answer of a process that has said so many messages."""
    return Ready(1, process, phase, {region: said} if said else {})


def stays(module: int, claim: Literal["none", "lost"] = "none") -> Report:
    """Return the report of a vehicle that stays."""
    return Report(1, module, START[module], START[module], claim, None, {})


def moves(module: int, move: GeneratorPlacement, site: int) -> Report:
    """Return the report of a vehicle that moves."""
    return Report(1, module, START[module], site, "granted", move, {})


ROUND: list[Message] = [
    said(0, "sense", *here(0, 1)),
    said(1, "sense", *here(2, 3)),
    ready(0, "sense"),
    ready(1, "sense"),
    said(0, "claim", *CLAIMS),
    ready(0, "claim"),
    ready(1, "claim", 0),
    said(0, "settle", VERDICT),
    Reports(1, 0, [moves(0, RIGHT, 1), stays(1, "lost")]),
    ready(0, "settle"),
    Reports(1, 1, [stays(2), stays(3)]),
    ready(1, "settle", 0),
]
"""All that is heard in a round in which vehicle 0 moves to 1."""


def told(found: Plausibility, *messages: Message) -> None:
    """Let it hear messages as they come over the wire."""
    for message in messages:
        found.check(decode(encode(message)))


def heard_until(phase: Phase) -> Plausibility:
    """Return it when the phases before this one are over."""
    found = plausibility()
    before = PHASES[: PHASES.index(phase)]
    told(found, *(each for each in ROUND if getattr(each, "phase", "settle") in before))
    return found


def refused(found: Plausibility, message: Message) -> tuple[str, str, int | None]:
    """Return why a message is refused: the reason, the line, and who it is if not the sender."""
    with pytest.raises(RefusedError) as caught:
        told(found, message)
    return caught.value.reason, str(caught.value), caught.value.process


def test_an_honest_round_is_taken() -> None:
    """Everything passes, and at its end vehicle 0 stands at 1."""
    found = plausibility()
    told(found, *ROUND)
    found.carry_out({0: moves(0, RIGHT, 1), **{n: stays(n) for n in (1, 2, 3)}})
    assert found.sites == [1, 2, 9, 11]
    here_now = [Presence(2, 0, 1), Presence(2, 1, 2)]
    told(found, Bundle(2, "sense", 0, "0", 0, [*here_now]), Ready(2, 0, "sense", {"0": 1}))
    told(found, Reports(2, 0, [Report(2, n, n + 1, n + 1, "none", None, {}) for n in (0, 1)]))


def test_the_coordinator_may_say_what_it_likes() -> None:
    """Nothing else is checked: what is not of modules, and answers that they join."""
    told(plausibility(), Go(1, "stop"), Ready(0, 0, "join"), Ready(1, 0, "over", {"0": 7}))


@pytest.mark.parametrize(
    ("phase", "message", "reason", "why"),
    [
        (
            "sense",
            said(0, "sense", Presence(1, 0, 5), Presence(1, 1, 2)),
            "impossible",
            "presence of module_0 from 5: it is at 0",
        ),
        ("sense", said(0, "sense"), "out of place", "no message goes to 0"),
        (
            "sense",
            said(0, "sense", *here(0, 1), region="1"),
            "out of place",
            "presence of module_0 to 1: no module is there to receive it",
        ),
        (
            "claim",
            said(0, "claim", claim(0, LEFT)),
            "impossible",
            "claim of module_0: edge at [1,2] is not admissible",
        ),
        (
            "settle",
            said(1, "settle", Verdict(1, 2, 9, True, [8])),
            "impossible",
            "verdict of module_2, which claims nothing",
        ),
        (
            "settle",
            said(0, "settle", Verdict(1, 0, 0, True, [2, 9])),
            "impossible",
            "verdict of module_0: it goes to modules other than those that wait for it",
        ),
        (
            "settle",
            said(0, "settle", Verdict(1, 1, 2, True, [0])),
            "impossible",
            "verdict of module_1: it goes to modules other than those that wait for it",
        ),
        ("sense", ready(0, "sense"), "contradicts", "process_0 counts other messages than it said"),
        ("sense", ready(0, "sense", 0), "contradicts", "module_0 does not say that it is here"),
        (
            "settle",
            ready(0, "settle", 0),
            "contradicts",
            "no verdict of module_0, and others wait for it",
        ),
    ],
)
def test_a_lie_is_refused(phase: Phase, message: Message, reason: str, why: str) -> None:
    """With its reason and a line; who sent it has lied."""
    assert refused(heard_until(phase), message) == (reason, why, None)


def test_a_claim_must_be_admissible_where_all_stand() -> None:
    """A vertex that is taken is no target."""
    found = plausibility()
    found._state.add(10)
    message = said(1, "claim", claim(2, edge(9)))
    line = "claim of module_2: edge at [9,10] is not admissible"
    assert refused(found, message) == ("impossible", line, None)
    told(plausibility(), message)


def test_more_than_was_counted_is_refused() -> None:
    """Also when the process was through already; it may be said to another region, or again."""
    found = heard_until("settle")
    told(found, said(0, "settle", VERDICT))
    again = said(0, "settle", VERDICT, number=1)
    line = "verdict of module_0 to 0 came before"
    assert refused(found, again) == ("doubled", line, None)
    told(found, ready(0, "settle"))
    assert refused(found, again) == ("contradicts", "more to 0 than process_0 counted", None)


def test_counts_are_by_region_and_none_is_none() -> None:
    """A count of zero says nothing."""
    found = plausibility()
    told(found, said(0, "sense", *here(0, 1)))
    other = Ready(1, 0, "sense", {"1": 1})
    assert refused(found, other)[0] == "contradicts"
    told(found, Ready(1, 0, "sense", {"0": 1, "1": 0}))


ROW = "agv:graph=grid12x1,n=2"
"""A region ends between the columns 7 and 8; both vehicles are heard in both."""


def in_row() -> Plausibility:
    """Return it for two vehicles beside the border of two regions."""
    found = Plausibility(
        scene_with(scene_from_spec(ROW), start=((7, 0), (8, 0)), goal=None, goals=())
    )
    found.know([[0], [1]], 0)
    return found


def in_region(region: str, *parts: Part, phase: Phase = "sense") -> Bundle:
    """Return what vehicle 0 says to a region."""
    return said(0, phase, *parts, region=region)


def test_what_goes_to_two_regions_is_the_same_in_both() -> None:
    """Who says nothing to one of them, or another thing, is refused."""
    one = Presence(1, 0, (7, 0))
    found = in_row()
    told(found, in_region("0,0", one))
    line = "no presence of module_0 to 1,0"
    assert refused(found, Ready(1, 0, "sense", {"0,0": 1})) == ("contradicts", line, None)
    told(found, in_region("1,0", one), Ready(1, 0, "sense", {"0,0": 1, "1,0": 1}))
    claims = [Claim(1, 0, (7, 0), "edge", ((at, 0), (at + 1, 0))) for at in (6, 7)]
    found._state.discard((8, 0))
    told(found, in_region("0,0", claims[0], phase="claim"))
    lie = refused(found, in_region("1,0", claims[1], phase="claim"))
    assert lie == ("contradicts", "claim of module_0 to 1,0: it was another elsewhere", None)


@pytest.mark.parametrize(
    ("report", "why"),
    [
        (Report(1, 1, 5, 5, "lost", None, {}), "report of module_1 from 5: it is at 2"),
        (
            Report(1, 1, 2, 2, "granted", None, {}),
            "report of module_1: a claim that is granted, and a move None",
        ),
        (
            Report(1, 1, 2, 1, "lost", LEFT, {}),
            f"report of module_1: a claim that is lost, and a move {LEFT}",
        ),
        (stays(1, "none"), "report of module_1: its claim is none"),
        (
            Report(1, 1, 2, 3, "lost", None, {}),
            "report of module_1: it ends at 3, where nothing takes it",
        ),
        (
            Report(1, 1, 2, 1, "lost", None, {}),
            "report of module_1: it ends at 1, where nothing takes it",
        ),
        (moves(1, edge(4), 5), "report of module_1: edge at [4,5] is no move from 2"),
        (
            moves(1, GeneratorPlacement("leap", 0), 5),
            "report of module_1: leap at 0 is no move from 2",
        ),
        (moves(1, LEFT, 3), "report of module_1: edge at [1,2] does not end at 3"),
        (moves(1, edge(2), 3), "report of module_1: edge at [2,3] was not claimed"),
    ],
)
def test_a_false_report_is_refused(report: Report, why: str) -> None:
    """It begins where the module was, and tells of the move claimed or of none."""
    found = heard_until("settle")
    told(found, said(0, "settle", VERDICT))
    message = Reports(1, 0, [moves(0, RIGHT, 1), report])
    assert refused(found, message) == ("impossible", why, None)


def test_who_claimed_nothing_has_lost_nothing() -> None:
    """Nor was anything granted."""
    found = heard_until("settle")
    for report in (stays(2, "lost"), moves(2, edge(9), 10)):
        assert refused(found, Reports(1, 1, [report, stays(3)]))[0] == "impossible"


def settled(verdict: Verdict, first: list[Report]) -> tuple[str, str, int | None]:
    """Return who is refused when all have reported, and the first process in this way."""
    found = heard_until("settle")
    told(found, said(0, "settle", verdict), Reports(1, 0, first), ready(0, "settle"))
    told(found, Reports(1, 1, [stays(2), stays(3)]))
    return refused(found, ready(1, "settle", 0))


def test_who_turns_a_verdict_round_is_named_and_not_who_believed_it() -> None:
    """Process 0 is told of when process 1 is through, which is last and honest."""
    turned = Verdict(1, 0, 0, False, [2])
    line = "verdict of module_0: by those before it it is granted"
    for first in ([moves(0, RIGHT, 1), moves(1, LEFT, 1)], [stays(0, "lost"), moves(1, LEFT, 1)]):
        assert settled(turned, first) == ("impossible", line, 0)


def test_who_does_not_keep_to_a_verdict_is_named() -> None:
    """It moves although its claim is lost, or does not although it is granted."""
    line = "report of module_{}: by those before it it is {}"
    both = [moves(0, RIGHT, 1), moves(1, LEFT, 1)]
    assert settled(VERDICT, both) == ("impossible", line.format(1, "lost"), 0)
    none = [stays(0, "lost"), stays(1, "lost")]
    assert settled(VERDICT, none) == ("impossible", line.format(0, "granted"), 0)


def test_ranks_are_those_of_the_seed_and_round() -> None:
    """With another seed vehicle 1 goes before vehicle 0, who waits for it."""
    other = next(seed for seed in range(9) if rank(seed, 1, 0) < rank(seed, 1, 1))
    found = plausibility(other)
    told(found, *ROUND[:7])
    assert refused(found, said(0, "settle", VERDICT))[0] == "impossible"
    told(found, said(0, "settle", Verdict(1, 1, 2, False, [0])))
    told(found, Reports(1, 0, [moves(0, RIGHT, 1), moves(1, LEFT, 1)]), ready(0, "settle"))
    told(found, Reports(1, 1, [stays(2), stays(3)]))
    line = "verdict of module_1: by those before it it is granted"
    assert refused(found, ready(1, "settle", 0)) == ("impossible", line, 0)


def test_who_is_heard_by_nobody_claims_nothing_aloud() -> None:
    """Its move is known by its report alone, and must be one from where it stands."""
    scene = scene_from_spec("agv:graph=P2,n=1")
    found = Plausibility(scene_with(scene, start=(0,), goal=None, goals=()))
    found._system.reach = lambda _place: ()  # type: ignore[method-assign, assignment]
    found.know([[0]], SEED)
    report = Report(1, 0, 0, 1, "granted", edge(0), {})
    told(found, Reports(1, 0, [report]), Ready(1, 0, "settle"))
    found.carry_out({0: report})
    assert found.sites == [1]


def ended(*reports: Report) -> str:
    """Return the line with which a round cannot end."""
    found = plausibility()
    with pytest.raises(CheckError) as caught:
        found.carry_out({report.module: report for report in reports})
    return str(caught.value)


def test_a_round_that_cannot_be_is_not_carried_out() -> None:
    """Also where nothing was judged before, as from a recording."""
    others: list[Any] = [stays(2), stays(3)]
    assert ended(moves(0, RIGHT, 1), moves(1, LEFT, 1), *others) == (
        "report of module_1: its move does not commute with that of module_0"
    )
    assert ended(moves(0, LEFT, 1), stays(1), *others) == (
        "report of module_0: edge at [1,2] is no move from 0"
    )
    assert ended(Report(1, 0, 4, 4, "none", None, {}), stays(1), *others) == (
        "report of module_0 from 4: it is at 0"
    )
    assert ended(moves(0, RIGHT, 0), stays(1), *others) == (
        "report of module_0: it ends at 0, and the moves take it to 1"
    )
