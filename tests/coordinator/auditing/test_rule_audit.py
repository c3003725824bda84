"""Asking the rules of a recording again: what agrees, what does not, and what cannot be asked."""

import json
import re
from collections.abc import Callable
from dataclasses import replace as with_fields
from pathlib import Path

import pytest
from msgspec.structs import replace

from cubepath.agents.rules.registry import BUILT_IN
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule
from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.verification.findings import Check, Verification
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.path_files.durations import schedule_from_jsonl, schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import copy_recording
from samples.recordings import edited, first, new_path, parts, recorded, with_records
from samples.schedules import CHAIN, LABELLED, VEHICLES, carry_out, original
from tampering import tamperings_of_choices
from tampering.tamperings import crowd, failing
from tampering.tamperings_of_choices import LIAR, LIE_IN
from tampering.tamperings_of_schedules import carried_out, not_begun, stopped

GOLDEN = sorted((Path(__file__).parents[3] / "logs" / "golden").glob("*.mcap"))


def choices(found: Verification) -> Check:
    """Return the check of the choices."""
    return next(check for check in found.checks if check.name == "choices")


def with_parameters(recording: Recording, **changes: str | None) -> Recording:
    """Return the recording with other parameters, or without some."""
    told = {**recording.parameters, **changes}
    kept = {key: value for key, value in told.items() if value is not None}
    return with_fields(recording, parameters=kept)


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_golden_recordings_are_what_their_rules_say(path: Path) -> None:
    """Of an earlier version, over several processes, with hesitation; every choice is checked."""
    found = audit(read_recording(path))
    assert found.ok, [check for check in found.checks if not check.ok]
    assert choices(found).checked


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "rule"),
    [
        ("hex:n=5", "chain"),
        ("agv:graph=grid4x4,n=7", "tswap"),
        ("agv-labelled:graph=grid4x4,n=6", "pibt"),
        ("arm:n=6", "word"),
        ("words:presentation=free2", "random"),
        ("sliding:p=3,q=2,n=4", "random"),
    ],
)
def test_a_real_run_is_what_its_rule_says(spec: str, rule: str) -> None:
    """With notes, labels, letters, and hesitation, which has a stream of its own."""
    found = audit(recorded(spec, rule, rounds=12, hesitate=0.3))
    assert choices(found) == Check("choices", ok=True, detail="")


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("spec", [CHAIN, VEHICLES, LABELLED])
def test_a_schedule_is_asked_again(spec: tuple[str, str, int]) -> None:
    """Each module makes the moves that are its own, in their rounds."""
    recording = carry_out(original(*spec).path)[1]
    assert choices(audit(recording)) == Check("choices", ok=True, detail="")


@pytest.mark.slow
@pytest.mark.parametrize("make", [stopped, not_begun, lambda: stopped(repair=True)])
def test_where_a_schedule_stops_its_reason_and_the_rule_after_it_are_asked_again(
    make: Callable[[], Recording],
) -> None:
    """The module that gave up says why as its part of the schedule says."""
    assert choices(audit(make())) == Check("choices", ok=True, detail="")


def test_a_reason_to_give_up_is_that_of_the_schedule() -> None:
    """Also where report, summary and error agree on another."""
    whole = stopped()
    summary = first(whole, "summary")
    stop = summary.schedule_stopped
    report = first(whole, "report", lambda each: each.failed is not None)
    tired = replace(stop, reason="I was tired")
    forged = edited(whole, report, replace(report, failed="I was tired"))
    error = summary.error.replace(stop.reason, "I was tired")
    forged = edited(forged, summary, replace(summary, schedule_stopped=tired, error=error))
    found = audit(forged)
    assert failing(found) == {"choices"}
    assert choices(found).detail.startswith(
        f"round {report.round}, module_{report.module}: it gave up: I was tired, by its rule: "
    )


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "where"),
    [
        (tamperings_of_choices.a_claim_that_the_rule_did_not_make, "its claim is edge at"),
        (tamperings_of_choices.a_claim_that_was_kept_back, "its claim is none, by its rule it is"),
        (tamperings_of_choices.a_module_that_gave_up_for_nothing, "it gave up: I was tired, by"),
    ],
)
def test_a_lie_is_named_where_it_was_told(make: Callable[[], Recording], where: str) -> None:
    """By the round and the module; and nothing else is wrong with the recording."""
    found = audit(make())
    assert failing(found) == {"choices"}
    assert choices(found).detail.startswith(f"round {LIE_IN}, module_{LIAR}: {where}")
    assert "(and" not in choices(found).detail
    assert verify(make()).ok


def test_a_note_is_compared_with_the_choice_of_the_round_before() -> None:
    """The lie is told in one round and heard in the next; what others do then is no lie."""
    found = choices(audit(tamperings_of_choices.a_note_of_another_mind()))
    assert found.detail.startswith(f"round {LIE_IN + 1}, module_{LIAR}: its note is [7")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"rule": "mine"}, "rule 'mine' is not installed"),
        ({"rule": None}, "the recording names no rule"),
        ({"hesitate": None}, "the recording names no hesitate"),
    ],
)
def test_what_cannot_be_asked_again_is_said_not_to_be_checked(
    changes: dict[str, str | None], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the check, in `--json`, and in the text, where it is not called ok."""
    changed = with_parameters(crowd(), **changes)
    found = audit(changed)
    assert found.ok
    detail = f"not checked: {why}"
    assert choices(found) == Check("choices", ok=True, detail=detail, checked=False)
    path = new_path()
    copy_recording(changed, path)
    assert main(["verify", str(path)]) == 0
    lines = [line.split(maxsplit=2) for line in capsys.readouterr().out.splitlines()]
    assert ["-", "choices", detail] in lines
    assert main(["verify", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["checks"]
    (said,) = [each for each in told if not each["checked"]]
    assert said == {"name": "choices", "ok": True, "checked": False, "detail": detail}


def test_a_repair_by_a_rule_that_is_not_installed_is_said_not_to_be_checked() -> None:
    """From which round on; the schedule before it is checked."""
    whole = stopped(repair=True)
    over = first(whole, "go", lambda each: each.phase == "over").round
    for name, why in (
        ("mine", "rule 'mine' is not installed"),
        (None, "the recording names no rule"),
    ):
        found = choices(audit(with_parameters(whole, repair=name)))
        assert (found.ok, found.checked) == (True, False)
        assert found.detail == f"not checked: from round {over + 1} on: {why}"


def test_without_rules_the_choices_are_not_checked() -> None:
    """`verify` alone asks nobody, and says so."""
    found = choices(verify(crowd()))
    assert (found.ok, found.checked) == (True, False)
    assert found.detail == "not checked: the rules were not asked again"


def test_a_rule_that_raises_is_a_failed_check_in_one_line() -> None:
    """Each module that raises is named once, and asked no more."""
    recording = crowd()

    def make(knowledge: InitialKnowledge) -> Rule:
        def choose(_: object) -> Choice:
            raise ValueError(f"on\nstrike {knowledge.module}")

        return choose

    honest = BUILT_IN["tswap"]
    BUILT_IN["tswap"] = with_fields(honest, make=make)
    try:
        found = choices(audit(recording))
    finally:
        BUILT_IN["tswap"] = honest
    modules = len(recording.scene.start)
    line = r"round 1: rule 'tswap', module_0: ValueError: on strike 0 at test_rule_audit.py:\d+"
    assert re.fullmatch(rf"{line} \(and {modules - 1} more\)", found.detail)


def test_a_rule_that_cannot_be_made_is_a_failed_check() -> None:
    """In one line; no choice is compared."""
    recording = crowd()

    def make(_: InitialKnowledge) -> Rule:
        raise KeyError("goal")

    honest = BUILT_IN["tswap"]
    BUILT_IN["tswap"] = with_fields(honest, make=make)
    try:
        found = choices(audit(recording))
    finally:
        BUILT_IN["tswap"] = honest
    assert not found.ok
    assert found.detail.startswith(
        "rule 'tswap', module_0: KeyError: 'goal' at test_rule_audit.py:"
    )


def test_a_run_that_an_error_in_a_rule_ended_is_asked_for_that_error() -> None:
    """The rule raises again in the round that was not completed; an honest one does not."""
    honest = BUILT_IN["tswap"]

    def make(knowledge: InitialKnowledge) -> Rule:
        true, rounds = honest.make(knowledge), 0

        def choose(view: object) -> object:
            nonlocal rounds
            rounds += 1
            if (knowledge.module, rounds) == (LIAR, LIE_IN):
                raise ValueError("on strike")
            return true(view)  # type: ignore[arg-type]

        return choose  # type: ignore[return-value]

    path = new_path()
    BUILT_IN["tswap"] = with_fields(honest, make=make)
    try:
        outcome = run(Plan("agv:graph=grid4x4,n=7", "tswap", processes=0, max_rounds=8, log=path))
        again = choices(audit(read_recording(path)))
    finally:
        BUILT_IN["tswap"] = honest
    error = outcome.error or ""
    blame = f"rule 'tswap', module_{LIAR}, round {LIE_IN}: ValueError: on strike at"
    assert error.startswith(f"{blame} test_rule_audit.py:")
    assert again == Check("choices", ok=True, detail="")
    found = choices(audit(read_recording(path)))
    assert found.detail == f"the run ended with {error!r}, but in round {LIE_IN} it raises nothing"


def test_the_rules_are_asked_anew_where_a_recording_is_read_again() -> None:
    """Messages far from their rounds: all are read a second time, with rules from the start."""
    path = new_path()
    copy_recording(with_records(crowd(), [*reversed(crowd().records)]), path)
    assert choices(audit(read_recording(path))) == Check("choices", ok=True, detail="")


@pytest.mark.few(2)
@pytest.mark.parametrize("at", ["x", [], [["a", "b"], ["c"]], [0.5, 1]])
def test_a_move_of_the_schedule_at_no_place_is_no_crash(at: object) -> None:
    """Whatever its form: nobody had to make it, so that those who moved did not as it says."""
    whole = carried_out()
    first_cube, *rest = schedule_from_jsonl(whole.schedule or b"")
    odd = [GeneratorPlacement("edge", at), *first_cube[1:]]
    found = audit(with_fields(whole, schedule=schedule_to_jsonl([odd, *rest])))
    assert {"choices", "schedule"} <= failing(found)


@pytest.mark.thorough
def test_all_modules_whose_processes_name_rules_of_their_own_are_named() -> None:
    """By rule, also where the rule of the others is not installed."""
    found = recorded("agv:graph=grid6x6,n=6", processes=4)
    named = {0: "own", 1: "their", 3: "own"}
    for join in parts(found, "ready"):
        if join.phase == "join" and join.process in named:
            found = edited(found, join, replace(join, rule=named[join.process]))
    own = "modules 0,4-5, whose processes name a rule of their own: 'own'"
    told = f"{own}; modules 1-2, whose processes name a rule of their own: 'their'"
    assert choices(audit(found)).detail == f"not checked: {told}"
    unknown = choices(audit(with_parameters(found, rule="nonesuch")))
    assert unknown.detail == f"not checked: rule 'nonesuch' is not installed; {told}"
