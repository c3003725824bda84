"""Assertions on the log: what holds passes, what does not is shown with the messages around it."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace as with_fields

from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import ROWS_MAX, table
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.messages import Claim, Report
from processes.command_line import GOLDEN
from samples.free_runs import free_recorded
from samples.recordings import all_edited, parts, recorded, with_records

pytestmark = pytest.mark.slow

LOGS = sorted(GOLDEN.glob("*.mcap"))
LINES_MAX, LINE_MAX = 2 * ROWS_MAX, 400


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_a_golden_log_is_legal_and_the_same_as_itself(path: Path) -> None:
    """With rounds and without; its claims are the moves that were executed, and those lost."""
    log = RunLog.read(path)
    log.assert_legal()
    log.assert_same_run(RunLog.read(path))
    log.assert_same_run(RunLog.read(path), homotopic=True)
    granted = {(each.round, each.module, each.generator) for each in log.grants()}
    assert granted == {(each.round, each.module, each.generator) for each in log.moves}
    assert len(log.claims()) == len(log.grants()) + len(log.claims(result="lost"))
    if log.goal_reached:
        log.assert_goal()


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_every_message_has_a_line(path: Path) -> None:
    """Its kind is that of its topic, its sender that of its key, and what it says is short."""
    log = RunLog.read(path)
    for seen, record in zip(log.all_deliveries, log.recording.records, strict=True):
        assert f"{seen.kind}/{seen.sender}" == record.topic
        assert len(table([seen]).splitlines()) == 2


def test_claims_are_those_of_the_reports() -> None:
    """Another way to them: module by module, from what each reported at the end of each round."""
    recording = recorded("agv:graph=grid4x4,n=6", rounds=12)
    log = RunLog(recording)
    reported = {
        (each.round, each.module, each.claim)
        for each in parts(recording, "report")
        if isinstance(each, Report) and each.claim != "none"
    }
    assert log.claims(result="lost")
    assert {(each.round, each.module, each.result) for each in log.claims()} == reported
    for module in range(6):
        assert log.claims(module) == [each for each in log.claims() if each.module == module]
    first = log.claims()[0]
    assert log.claims(first.module, first.round, first.result) == [first]


def fails(check: Callable[[], object], line: str) -> str:
    """Check that something fails with this line first, and shows a table of bounded size."""
    with pytest.raises(AssertionError) as found:
        check()
    text = str(found.value)
    assert re.search(line, text.splitlines()[0]), text
    assert len(text.splitlines()) <= LINES_MAX
    assert max(map(len, text.splitlines())) <= LINE_MAX
    assert re.search(r"^ +round +phase +kind +from +to +what$", text, re.MULTILINE)
    return text


def test_what_is_not_legal_is_shown_where_it_is() -> None:
    """A verdict that was changed, with the messages of that module in that round."""
    recording = recorded("agv:graph=grid4x4,n=6", rounds=12)
    lost = RunLog(recording).claims(result="lost")[0]

    def elsewhere(part: Claim) -> Claim:
        chosen = (part.round, part.module) == (lost.round, lost.module)
        return with_fields(part, at=[0, 99]) if chosen else part

    text = fails(
        RunLog(all_edited(recording, "claim", elsewhere)).assert_legal, "the log is not legal"
    )
    assert f"round {lost.round}" in text
    assert re.search(rf"^  > {lost.round} .* process_\d", text, re.MULTILINE)


def test_a_goal_that_is_not_reached_names_who_stands_elsewhere() -> None:
    """After how many rounds, and where they stand."""
    log = RunLog(recorded("hex:n=4", "chain", rounds=2))
    fails(log.assert_goal, r"^the goal is not reached after 2 rounds: module_0 at ")


def test_runs_that_differ_are_shown_where_they_first_do() -> None:
    """The moves of both in that round."""
    one, other = (RunLog(recorded("agv:graph=grid4x4,n=6", seed=seed, rounds=6)) for seed in (0, 1))
    text = fails(lambda: one.assert_same_run(other), r"^not the same run: ")
    assert re.search(r"^  round \d+, first: module_\d edge at", text, re.MULTILINE)
    assert re.search(r"^  they part in round \d+, with a choice of module_\d$", text, re.MULTILINE)
    assert "why: it sensed and heard the same in both, in this round and all before" in text
    assert "why: seed is 0 in a, and 1 in b" in text
    fails(lambda: one.assert_same_run(other, homotopic=True), r"^not homotopic: ")


def test_runs_that_have_nothing_in_common_on_record() -> None:
    """Why it is not told where they part, in a line."""
    recording = free_recorded("agv:graph=grid3x3,n=4", seed=4, moves=12)
    kept = [each for each in recording.records if each.kind not in ("commit", "commits", "summary")]
    one, other = RunLog(recording), RunLog(with_records(recording, kept))
    text = fails(lambda: one.assert_same_run(other), r"^not the same run: ")
    assert "nothing to compare, as its first commits are not on record" in text


def test_rounds_that_commute_may_be_swapped() -> None:
    """The same moves in other rounds are the same run."""
    one = RunLog(recorded("hex:n=6", "chain", rounds=100))
    other = RunLog(recorded("hex:n=6", "chain", hesitate=0.4, seed=3, rounds=200))
    assert one.rounds != other.rounds
    one.assert_same_run(other)


def test_order_and_counts() -> None:
    """By kinds or patterns; what is missing is told."""
    log = RunLog(recorded("agv:graph=grid4x4,n=6", rounds=4))
    log.assert_order("claim", Pattern(kind="report", round=1))
    log.assert_count(4, "report", module=3)
    log.assert_count(range(1, 7), "claim", round=1)
    fails(lambda: log.assert_order("report", "claim"), "^'claim' comes before 'report': message ")
    fails(lambda: log.assert_order("action", "claim"), "^no message is 'action', expected one")
    fails(
        lambda: log.assert_count(3, "report", module=3),
        "^4 messages are 'kind=report, module=3', expected 3$",
    )
    fails(lambda: log.assert_count(range(5, 9), "reset"), "^0 messages .*, expected 5 to 8$")
    fails(
        lambda: log.assert_claimed(2, 99),
        r"^module_2 made no claim in round 99: round \d+: edge at ",
    )
    found = log.claims(2)[0]
    log.assert_claimed(2, found.round, found.result)
    with pytest.raises(InputError, match=r"^kind=reports_: expected one of"):
        log.count("reports_")


@pytest.mark.thorough
def test_the_same_run_has_the_same_messages_of_modules_in_any_number_of_processes() -> None:
    """Deliveries differ: a process puts all that its modules say to a region into one."""
    logs = [
        RunLog(recorded("agv:graph=grid10x4,n=8", "random", processes=processes, rounds=5))
        for processes in (1, 2, 4)
    ]
    for kind in ("presence", "claim", "verdict", "report"):
        texts = [sorted(map(str, log.messages(kind))) for log in logs]
        assert texts[0] == texts[1] == texts[2]
        (count,) = {log.count(kind) for log in logs}
        assert count == len(set(texts[0])) > 0
        for log in logs:
            log.assert_count(count, kind)
    assert len({len(log.deliveries("claim")) for log in logs}) == 3
    fails(lambda: logs[0].assert_count(0, "claim"), r"^\d+ messages are 'kind=claim', expected 0$")
    one = logs[0].claims()[0]
    assert {log.count("claim", module=one.module, round=one.round) for log in logs} == {1}


@given(st.integers(0, 200), st.integers(0, 250))
def test_a_table_has_few_lines_and_those_around_the_place(count: int, place: int) -> None:
    """However many messages there are; the one that is marked is among them."""
    messages = (RunLog.read(LOGS[0]).all_deliveries * 5)[:count] if count else ()
    marked = [place] if place < count else []
    lines = table(messages, marked).splitlines()
    assert len(lines) <= ROWS_MAX + 2
    assert sum(line.startswith("  >") for line in lines) == len(marked)


def test_what_could_never_be_on_record_is_refused() -> None:
    """In one line, with the nearest name, rather than counted as none."""
    log = RunLog.read(LOGS[0])
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: log.count("claim", phase="sens"), "phase=sens: .*did you mean 'sense'"),
        (lambda: log.count("claim", module="1"), "module='1': expected 0 or more"),
        (lambda: log.count("claim", module=99), r"module=99: expected 0 to \d+$"),
        (lambda: log.count("claim", modul=1), r"modul: .* \(did you mean 'module'\?\)"),
        (lambda: log.count("claim", sender="proces_0"), "sender=proces_0: .*mean 'process_0'"),
        (lambda: log.count("claim", kind="bundle"), "kind=bundle: expected one kind, found claim"),
        (lambda: log.assert_claimed(1, 2, anything("grantd")), "result=grantd: .*'granted'"),
        (lambda: log.assert_count(anything("x"), "claim"), "expected='x': expected 0 or more"),
        (lambda: log.messages(anything(5)), "5: expected a kind of message, or a Pattern"),
        (lambda: log.assert_same_run(anything(None)), "None: expected another Log"),
    ]
    for act, line in wrong:
        with pytest.raises(InputError, match=f"^{line}"):
            act()


def anything(value: Any) -> Any:
    """Return what no type checker lets pass."""
    return value


def test_keys_beside_a_pattern_narrow_it() -> None:
    """They are not passed over."""
    log = RunLog(recorded("agv:graph=grid4x4,n=4", rounds=4))
    claims = Pattern(kind="claim")
    assert log.messages(claims, module=1, round=2) == log.messages("claim", module=1, round=2)
    assert log.count(claims) > log.count(claims, round=2)
