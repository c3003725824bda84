"""Judging messages by what every process knows: each reason, and what is taken."""

from typing import Any

import pytest

from cubepath.agents.processes.judge import Judge, RefusedError, refuse
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.messages import (
    MESSAGE_BYTES_MAX,
    Bundle,
    ChosenAction,
    ChosenActions,
    Claim,
    Cube,
    Edges,
    Go,
    Message,
    ModuleObservation,
    Note,
    Observations,
    Part,
    Presence,
    Ready,
    Report,
    Reports,
    Reset,
    Retransmit,
    Verdict,
    Waiting,
    encode,
)

RUN = "run"
MODULES_OF = [[2, 0], [1]]


def judge(spec: str = "agv:graph=P20,n=3", note_length: int | None = None) -> Judge:
    """Return a judge of two processes: one with the modules 0 and 2, and one with module 1."""
    found = Judge(RUN, MODULES_OF, scene_from_spec(spec).system)
    found.note_length = note_length
    return found


def read(message: Message, key: str | None = None) -> Message:
    """Let a message be read that is put on its key, or on another."""
    return judge().read(key_of(RUN, message) if key is None else key, encode(message))


def said(*parts: Part, phase: str = "sense", number: int = 0, process: int = 1) -> Bundle:
    """Return what is said in round 4."""
    return Bundle(4, phase, process, "0", number, list(parts))  # type: ignore[arg-type]


def why_not(message: Any, **given: Any) -> tuple[str, str]:
    """Return the reason why a message of modules is refused, and the line."""
    with pytest.raises(RefusedError) as caught:
        if isinstance(message, Bundle):
            judge(**given).check(message)
        else:
            judge(**given).check_whole(message)
    assert caught.value.process is None
    return caught.value.reason, str(caught.value)


TRUE: list[Message] = [
    Ready(4, 1, "sense", {"0": 1}),
    said(Presence(4, 1, 3)),
    Reports(4, 1, []),
    Observations(4, 0, []),
    ChosenActions(4, 0, []),
    Retransmit(4, 1, "sense", "0"),
    Waiting(4, 1, "sense"),
    Go(4, "claim"),
    Reset(4, 9),
]


@pytest.mark.parametrize("message", TRUE, ids=lambda message: type(message).__name__)
def test_what_is_on_its_own_key_is_read(message: Message) -> None:
    """It comes out as it was."""
    assert read(message) == message


@pytest.mark.parametrize("message", [Go(4, "claim"), Reset(4, 9)])
def test_the_coordinator_may_speak_to_one_process_alone(message: Message) -> None:
    """On a key that names it."""
    kind = "go" if isinstance(message, Go) else "reset"
    assert read(message, f"cubepath/run/{kind}/process_7") == message
    with pytest.raises(RefusedError, match=f"^{kind} put on {kind}/process_x, expected {kind}/"):
        read(message, f"cubepath/run/{kind}/process_x")


@pytest.mark.parametrize(
    ("key", "data", "reason", "why"),
    [
        ("a", b"no", "malformed", "not a cubepath message: "),
        (
            "a",
            encode(said(Presence(4, 1, 3))).replace(b'"site":3', b'"site":[0,null]'),
            "malformed",
            "not a cubepath message: a site is a JSON number, string or list, found null",
        ),
        (
            "a",
            b" " * (MESSAGE_BYTES_MAX + 1),
            "too large",
            "16777217 bytes, expected at most 16777",
        ),
        (
            "cubepath/run/ready/process_0",
            encode(Ready(4, 1, "sense")),
            "wrong key",
            "ready put on ready/process_0, expected ready/process_1",
        ),
        (
            "cubepath/run/ready/process_2",
            encode(Ready(4, 2, "sense")),
            "foreign",
            "this run has no process_2",
        ),
        (
            "cubepath/run/edges/coordinator",
            encode(Edges(4, [])),
            "out of place",
            "edges is on record, and never on the wire",
        ),
    ],
)
def test_what_may_not_be_on_a_key_is_refused(key: str, data: bytes, reason: str, why: str) -> None:
    """Each with its reason, and a line."""
    with pytest.raises(RefusedError) as caught:
        judge().read(key, data)
    assert caught.value.reason == reason
    assert str(caught.value).startswith(why)


def test_the_largest_message_is_read() -> None:
    """One byte more is too large."""
    data = encode(Waiting(4, 1, "sense"))
    data += b" " * (MESSAGE_BYTES_MAX - len(data))
    assert judge().read("cubepath/run/waiting/process_1", data) == Waiting(4, 1, "sense")


@pytest.mark.parametrize("message", [Presence(4, 1, 3), Cube(4, 1, []), ChosenAction(4, 1, 0, [])])
def test_parts_and_results_are_not_on_the_wire(message: Message) -> None:
    """Parts travel in a message of their process."""
    with pytest.raises(RefusedError, match=r"is on record, and never on the wire$"):
        read(message)


def test_two_kinds_of_one_module_are_two_things() -> None:
    """In any order of the parts."""
    judge(note_length=1).check(
        said(Presence(4, 2, 7), Presence(4, 0, 3), Note(4, 0, 3, [5]), process=0)
    )


@pytest.mark.parametrize(
    ("message", "reason", "why"),
    [
        (said(Presence(4, 0, 3)), "foreign", "presence of module_0, which is not in process_1"),
        (said(Presence(4, 3, 3)), "foreign", "presence of module_3, which is not in process_1"),
        (
            said(Presence(5, 1, 3)),
            "out of place",
            "presence of module_1 of round 5, said in phase sense of round 4",
        ),
        (
            said(Presence(4, 1, 3), phase="claim"),
            "out of place",
            "presence of module_1 of round 4, said in",
        ),
        (said(Note(4, 1, 3, []), phase="claim"), "out of place", "note of module_1 of round 4"),
        (said(Claim(4, 1, 3, "edge", (3, 4))), "out of place", "claim of module_1 of round 4"),
        (said(Verdict(4, 1, 3, True, [])), "out of place", "verdict of module_1 of round 4"),
        (
            said(Presence(4, 1, 3), Presence(4, 1, 3)),
            "doubled",
            "process_1 says something twice in one",
        ),
        (
            said(Presence(4, 1, 20)),
            "impossible",
            "presence of module_1: 20 is no place of a module",
        ),
        (
            said(Presence(4, 1, ("x",) * 99)),
            "impossible",
            f"presence of module_1: {('x',) * 99!r:.80}... is",
        ),
        (
            said(Claim(4, 1, 3, "edge", (4, 5)), phase="claim"),
            "impossible",
            "claim of module_1: edge at (4, 5) is no move from there",
        ),
        (
            said(Claim(4, 1, 3, "leap", (3, 4)), phase="claim"),
            "impossible",
            "claim of module_1: leap at (3, 4) is no move from there",
        ),
        (
            said(Verdict(4, 1, 3, True, [4, 99]), phase="settle"),
            "impossible",
            "verdict of module_1: 99 is no place of a module",
        ),
        (said(number=1), "out of place", "a second message of phase sense to 0"),
        (said(number=1, phase="claim"), "out of place", "a second message of phase claim to 0"),
        (
            said(number=1, phase="settle"),
            "out of place",
            "message 1 of 1 modules to 0, expected one each",
        ),
    ],
)
def test_what_modules_cannot_say_is_refused(message: Bundle, reason: str, why: str) -> None:
    """By the run and the system alone."""
    found = why_not(message)
    assert found[0] == reason
    assert found[1].startswith(why)


def test_verdicts_may_be_said_one_by_one() -> None:
    """A message for each module of a process at most, counted from 0."""
    last = said(Verdict(4, 2, 7, True, [8]), phase="settle", number=1, process=0)
    judge().check(last)
    over = said(Verdict(4, 2, 7, True, [8]), phase="settle", number=2, process=0)
    assert why_not(over)[0] == "out of place"


def test_notes_have_their_length_and_no_number_that_stands_for_none() -> None:
    """Of any length until it is known."""
    note = said(Note(4, 1, 3, [1, 2]))
    judge().check(note)
    judge(note_length=2).check(note)
    assert why_not(note, note_length=1) == ("malformed", "note of module_1: 2 numbers, expected 1")
    least = -(1 << 31)
    judge().check(said(Note(4, 1, 3, [least + 1])))
    line = f"note of module_1: {least} stands for no note, expected more"
    assert why_not(said(Note(4, 1, 3, [0, least]))) == ("malformed", line)


@pytest.mark.parametrize("site", [((0, 0), 0), ((0, 0), 2)])
def test_a_label_of_the_scene_belongs_to_a_site(site: object) -> None:
    """A place alone is no site of a labelled system; verdicts go to places."""
    spec = "agv-labelled:graph=grid3x3,n=3"
    judge(spec).check(said(Presence(4, 1, site)))
    judge(spec).check(said(Verdict(4, 1, site, True, [(0, 1)]), phase="settle"))


@pytest.mark.parametrize(
    "site", [(0, 0), ((0, 0), 3), ((0, 0), -1), ((9, 0), 0), ((0, 0), "a"), ((0, 0), 0.5)]
)
def test_another_label_is_none(site: object) -> None:
    """Nor is a place that is not there."""
    found = why_not(said(Presence(4, 1, site)), spec="agv-labelled:graph=grid3x3,n=3")
    assert found == ("impossible", f"presence of module_1: {site!r} is no place of a module")


def report(module: int, *, number: int = 4) -> Report:
    """Return a report of a module that stays."""
    return Report(number, module, 3, 3, "none", None, {})


def test_a_whole_message_has_a_part_of_each_module() -> None:
    """In any order: reports, observations and actions."""
    judge().check_whole(Reports(4, 0, [report(0), report(2)]))
    judge().check_whole(Observations(4, 1, [ModuleObservation(4, 1, [], [], [])]))
    judge(note_length=1).check_whole(
        ChosenActions(4, 0, [ChosenAction(4, 2, 0, []), ChosenAction(4, 0, 1, [5])])
    )


@pytest.mark.parametrize(
    ("message", "reason", "why"),
    [
        (
            Reports(4, 0, [report(0), report(1)]),
            "foreign",
            "report of module_1, which is not in process_0",
        ),
        (Reports(4, 1, [report(1, number=3)]), "out of place", "report of round 3 in 4"),
        (
            Reports(4, 0, [report(0)]),
            "malformed",
            "reports of process_0 for 1 modules, expected one each for its 2",
        ),
        (
            Reports(4, 0, [report(0), report(2), report(2)]),
            "malformed",
            "reports of process_0 for 3 modules, expected one each for its 2",
        ),
        (
            ChosenActions(4, 1, [ChosenAction(4, 1, 0, [1, 2])]),
            "malformed",
            "action for module_1: 2 numbers, expected 1",
        ),
    ],
)
def test_what_is_not_whole_is_refused(message: Message, reason: str, why: str) -> None:
    """A part of each module once, of the round, of the process."""
    assert why_not(message, note_length=1) == (reason, why)


def test_a_refusal_has_its_reason() -> None:
    """And the line."""
    with pytest.raises(RefusedError, match=r"^so it is$") as caught:
        refuse("stale", "so it is")
    assert caught.value.reason == "stale"
