"""Recordings that were tampered with, each in one way, and the checks that must find it."""

from collections.abc import Callable
from dataclasses import replace as with_fields
from typing import Any

import pytest
from msgspec.structs import replace

from cubepath.coordinator.verification.findings import Verification
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Bundle, Claim, Cube, Report, decode
from samples.recordings import all_edited, edited, first, parts, record_of, recorded, with_records

Tampering = Callable[[], Recording]
TAMPERINGS: list[Any] = []


def crowd() -> Recording:
    """Return vehicles that talk, claim, lose and wait for verdicts on a small grid."""
    return recorded("agv:graph=grid4x4,n=7", "tswap", rounds=10)


def arm() -> Recording:
    """Return an arm, whose flips take a second module along."""
    return recorded("arm:n=6", "word", rounds=20)


def tampers(*checks: str) -> Callable[[Tampering], Tampering]:
    """Say which checks have to fail, first of all the first; the others may."""

    def keep(make: Tampering) -> Tampering:
        TAMPERINGS.append(pytest.param(make, checks, id=make.__name__))
        return make

    return keep


def failing(found: Verification) -> set[str]:
    """Return the names of the checks that fail."""
    return {check.name for check in found.checks if not check.ok}


def moved(message: Any) -> bool:
    """Tell whether a report is of a move."""
    return message.move is not None


def reports_in(recording: Recording, number: int) -> list[Any]:
    """Return the reports of a round."""
    return [report for report in parts(recording, "report") if report.round == number]


# The file and its messages.


@tampers("readable")
def a_problem_when_reading() -> Recording:
    return with_fields(crowd(), problems=("corrupt: chunk 2 cannot be read",))


@tampers("messages", "claims")
def a_message_that_is_none() -> Recording:
    whole = crowd()
    records = list(whole.records)
    place = next(
        n
        for n, each in enumerate(records)
        if b'"phase":"claim"' in each.data and each.kind == "bundle"
    )
    records[place] = with_fields(records[place], data=b'{"kind":"clam"}')
    return with_records(whole, records)


@tampers("messages")
def a_message_under_the_name_of_another() -> Recording:
    whole = crowd()
    records = [
        with_fields(record, topic="go/module_1") if record.topic == "go/coordinator" else record
        for record in whole.records
    ]
    return with_records(whole, records)


@tampers("messages")
def a_message_logged_in_another_round() -> Recording:
    whole = crowd()
    records = [*whole.records]
    records[9] = with_fields(records[9], round=records[9].round + 1)
    return with_records(whole, records)


@tampers("complete")
def no_summary() -> Recording:
    return all_edited(crowd(), "summary", lambda _: None)


@tampers("complete")
def no_cubes() -> Recording:
    return all_edited(crowd(), "cube", lambda _: None)


@tampers("complete")
def a_cube_more_than_the_summary_counts() -> Recording:
    whole = crowd()
    last = list(whole.of_kind("cube"))[-1]
    message = decode(last.data)
    assert isinstance(message, Cube)
    return edited(whole, message, message, replace(message, index=message.index + 1))


@tampers("complete")
def two_summaries() -> Recording:
    summary = first(crowd(), "summary")
    return edited(crowd(), summary, summary, replace(summary, ended="failed"))


# Reports.


@tampers("reports")
def a_report_is_missing() -> Recording:
    return edited(crowd(), first(crowd(), "report", lambda message: message.round == 3))


@tampers("reports")
def the_last_report_is_missing() -> Recording:
    return edited(crowd(), parts(crowd(), "report")[-1])


@tampers("reports")
def two_reports_that_differ() -> Recording:
    report = first(crowd(), "report")
    return edited(crowd(), report, report, replace(report, failed="I give up"))


@tampers("reports")
def a_report_of_nobody() -> Recording:
    report = first(crowd(), "report")
    return edited(crowd(), report, report, replace(report, module=99))


# Moves.


@tampers("admissible", "claims")
def a_move_from_elsewhere() -> Recording:
    report = first(crowd(), "report", moved)
    system: Any = crowd().scene.system
    ends = next(edge for edge in system.edges if site_from_json(report.before) not in edge)
    return edited(crowd(), report, replace(report, move=GeneratorPlacement("edge", ends)))


@tampers("admissible", "claims")
def a_move_onto_another_module() -> Recording:
    whole = crowd()
    occupied = {site_from_json(report.before): report for report in reports_in(whole, 1)}
    for site, report in occupied.items():
        for move in whole.scene.system.moves(site):
            if move is not None and move.target in occupied:
                placed = GeneratorPlacement(move.generator, move.at)
                return edited(
                    whole, report, replace(report, claim="granted", move=placed, site=move.target)
                )
    raise AssertionError("nobody stands beside another")


@tampers("admissible")
def a_generator_that_is_none() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, move=GeneratorPlacement("hop", report.move.at)))


@tampers("commuting", "claims")
def a_lost_claim_is_executed_too() -> Recording:
    whole = crowd()
    lost = first(whole, "report", lambda message: message.claim == "lost")
    claim = first(whole, "claim", lambda m: (m.round, m.module) == (lost.round, lost.module))
    placed = GeneratorPlacement(claim.generator, claim.at)
    return edited(whole, lost, replace(lost, claim="granted", move=placed))


# Where modules stand.


@tampers("sites")
def a_module_reports_another_site() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, site=report.before))


@tampers("sites")
def a_module_stood_elsewhere() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, before=report.site))


@tampers("sites")
def a_module_taken_along_stays() -> Recording:
    report = first(arm(), "report", lambda m: m.move is None and m.before != m.site)
    return edited(arm(), report, replace(report, site=report.before))


@tampers("messages")
def a_site_that_is_none() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, site={"x": None}))


@tampers("bundle", "deliveries")
def nobody_says_that_it_is_here() -> Recording:
    return edited(crowd(), first(crowd(), "presence", lambda message: message.round == 2))


@tampers("bundle")
def a_module_speaks_from_elsewhere() -> Recording:
    claim = first(crowd(), "claim")
    report = first(crowd(), "report", lambda m: m.module != claim.module)
    return edited(crowd(), claim, replace(claim, site=report.before))


@tampers("bundle")
def a_module_says_two_things() -> Recording:
    note = first(crowd(), "note")
    return edited(crowd(), note, note, replace(note, note=[number + 1 for number in note.note]))


@tampers("bundle")
def nobody_speaks() -> Recording:
    note = first(crowd(), "note")
    return edited(crowd(), note, note, replace(note, module=99))


# Claims.


@tampers("claims")
def a_granted_claim_is_called_lost() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, claim="lost"))


@tampers("claims")
def a_claim_that_nobody_made() -> Recording:
    report = first(crowd(), "report", lambda message: message.claim == "none")
    return edited(crowd(), report, replace(report, claim="lost"))


@tampers("claims")
def a_granted_claim_is_not_executed() -> Recording:
    report = first(crowd(), "report", moved)
    return edited(crowd(), report, replace(report, move=None, site=report.before))


@tampers("claims")
def a_verdict_is_flipped() -> Recording:
    verdict = first(crowd(), "verdict")
    return edited(crowd(), verdict, replace(verdict, granted=not verdict.granted))


@tampers("claims", "deliveries")
def a_verdict_is_missing() -> Recording:
    return edited(crowd(), first(crowd(), "verdict"))


@tampers("claims")
def a_verdict_for_others() -> Recording:
    verdict = first(crowd(), "verdict")
    return edited(crowd(), verdict, replace(verdict, to=[*verdict.to, verdict.site]))


@tampers("claims")
def a_verdict_on_no_claim() -> Recording:
    whole = crowd()
    report = first(whole, "report", lambda message: message.claim == "none")
    verdict = replace(
        first(whole, "verdict"), round=report.round, module=report.module, site=report.before
    )
    before = [
        each
        for each in map(decode, (record.data for record in whole.records))
        if isinstance(each, Bundle) and (each.round, each.phase) == (report.round, "settle")
    ]
    said = Bundle(report.round, "settle", 0, "0,0", len(before), [verdict])
    return with_records(whole, [*whole.records, record_of(said)])


@tampers("claims")
def a_claim_that_is_not_admissible() -> Recording:
    whole = crowd()
    for claim in parts(whole, "claim"):
        assert isinstance(claim, Claim)
        occupied = [site_from_json(report.before) for report in reports_in(whole, claim.round)]
        for move in whole.scene.system.moves(site_from_json(claim.site)):
            if move is not None and move.target in occupied:
                return edited(whole, claim, replace(claim, at=move.at))
    raise AssertionError("nobody who claims stands beside another")


@tampers("claims")
def another_seed() -> Recording:
    # Of two seeds under which ranks differ one at least settles some conflict the other way.
    whole = crowd()
    for seed in range(1, 50):
        found = with_fields(whole, parameters={**whole.parameters, "seed": str(seed)})
        if failing(verify(found)):
            return found
    raise AssertionError("no claim of this recording is in conflict")


@tampers("claims")
def no_seed() -> Recording:
    return with_fields(crowd(), parameters={})


# Deliveries.


@tampers("deliveries")
def heard_from_far_away() -> Recording:
    whole = crowd()
    system = whole.scene.system
    for report in reports_in(whole, 1):
        for other in reports_in(whole, 1):
            far = site_from_json(other.before) not in {
                *system.sensed(site_from_json(report.before))
            }
            if far and other.module != report.module:
                return edited(whole, report, hearing(report, "presence", other.module))
    raise AssertionError("everybody senses everybody")


def hearing(report: Report, kind: str, module: int) -> Report:
    """Return the report with one more delivery."""
    heard = {**report.received, kind: [*report.received.get(kind, []), module]}
    return replace(report, received=heard)


@tampers("deliveries")
def heard_what_nobody_said() -> Recording:
    report = first(crowd(), "report", lambda message: message.received)
    return edited(crowd(), report, hearing(report, "verdict", report.received["presence"][0]))


@tampers("deliveries")
def heard_twice() -> Recording:
    report = first(crowd(), "report", lambda message: message.received)
    kind, module = next(iter(report.deliveries()))
    return edited(crowd(), report, hearing(report, kind, module))


@tampers("deliveries")
def a_verdict_heard_that_was_for_others() -> Recording:
    whole = crowd()
    verdict = first(whole, "verdict")
    report = first(
        whole,
        "report",
        lambda m: (
            m.round == verdict.round and m.module != verdict.module and m.before not in verdict.to
        ),
    )
    return edited(whole, report, hearing(report, "verdict", verdict.module))


@tampers("hearing")
def a_message_missed() -> Recording:
    report = first(crowd(), "report", lambda message: message.received)
    kind = next(iter(report.received))
    heard = {**report.received, kind: report.received[kind][1:]}
    return edited(crowd(), report, replace(report, received=heard))
