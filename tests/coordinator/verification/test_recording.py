"""Verifying: real recordings pass, and each check fails when what it is about is tampered with."""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace as replace_record
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, strategies as st
from msgspec.structs import replace

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.verification import rounds as rederive
from cubepath.coordinator.verification.findings import Verification
from cubepath.coordinator.verification.lockstep import CHECKS
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.actions import Action, admissible, apply
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import RecordingWriter, copy_recording
from cubepath.protocol.wire.messages import Cube, Executed, decode
from samples.recordings import all_edited, edited, first, parts, record_of, recorded, with_records
from tampering import (
    tamperings,
    tamperings_of_certificates,
    tamperings_of_choices,
    tamperings_of_results,
    tamperings_of_runs,
    tamperings_of_schedules,
    tamperings_of_stages,
)
from tampering.tamperings import TAMPERINGS, Tampering, crowd, failing

SUMMARY: dict[str, Any] = {
    "rounds": 1,
    "moves": 1,
    "reduced_moves": -1,
    "max_cube_dimension": 1,
    "path_digest": "0" * 64,
    "goal_reached": None,
}


SAID: dict[str, dict[str, Any]] = json.loads(
    (Path(__file__).parents[2] / "data" / "tamperings.json").read_text()
)
"""What is said of each tampering by the check that it is about, and the checks that fail.

Of the checks in `NUMBERED` a pattern: which message of a round comes first is not the same in each
run.
"""
NUMBERED = ("messages", "batches")


def detail_of(found: Verification, name: str) -> str:
    """Return what is said of the check of this name."""
    return next(check.detail for check in found.checks if check.name == name)


@pytest.mark.parametrize("key", SUMMARY)
def test_every_number_of_the_summary_is_derived(key: str) -> None:
    """Each number of the summary, off by one, fails `summary` alone, which names it."""
    summary = first(crowd(), "summary")
    old, change = getattr(summary, key), SUMMARY[key]
    new = change if isinstance(change, str) else not old if change is None else old + change
    found = verify(edited(crowd(), summary, replace(summary, **{key: new})))
    assert failing(found) == {"summary"}
    assert detail_of(found, "summary").startswith(f"{key} is ")


@pytest.mark.parametrize("kind", ["report", "presence"])
def test_modules_are_numbered_from_0_and_below_their_count(kind: str) -> None:
    """The first number that no module has is refused; what is below 0 is no message at all."""
    message = first(crowd(), kind)
    stray = replace(message, module=len(crowd().scene.start))
    found = verify(edited(crowd(), message, message, stray))
    check = "reports" if kind == "report" else "bundle"
    assert "there is no such module in this run" in detail_of(found, check)
    found = verify(edited(crowd(), message, message, replace(message, module=-1)))
    assert "module" in detail_of(found, "messages")


@pytest.mark.parametrize("number", [10**9, 2**62])
def test_a_count_that_no_memory_holds_is_only_a_wrong_number(number: int) -> None:
    """The first cube that is not there is named, without going through all of them."""
    summary = first(crowd(), "summary")
    found = verify(edited(crowd(), summary, replace(summary, cubes=number)))
    assert f"of {number} is missing" in detail_of(found, "complete")


@pytest.mark.few(25)
@pytest.mark.parametrize(("make", "checks"), TAMPERINGS)
def test_what_is_tampered_with_fails_its_check(make: Tampering, checks: tuple[str, ...]) -> None:
    """The check that a tampering is about fails, in one line that says where; others as known."""
    found = audit(make())
    assert not found.ok
    assert set(checks) <= failing(found)
    detail = detail_of(found, checks[0])
    assert "\n" not in detail
    said = SAID[make.__name__]["said"]
    assert re.fullmatch(said, detail) if checks[0] in NUMBERED else detail == said
    assert [check.name for check in found.checks if not check.ok] == SAID[make.__name__]["failing"]


def test_every_check_can_fail() -> None:
    """No check is there for show: for each there is a tampering that it is about."""
    for module in (
        tamperings_of_certificates,
        tamperings_of_choices,
        tamperings_of_results,
        tamperings_of_runs,
        tamperings_of_schedules,
        tamperings_of_stages,
    ):
        assert module.__doc__  # imported for the tamperings that it adds
    assert {checks[0] for _, checks in (each.values for each in TAMPERINGS)} == set(CHECKS)


def test_the_cubes_of_the_class_are_counted() -> None:
    """One cube fewer, or more, than the moves have fails `class` with both counts."""
    whole = crowd()
    summary = first(whole, "summary")
    count = summary.cubes
    last = first(whole, "cube", lambda message: message.index == count)
    fewer = edited(edited(whole, last), summary, replace(summary, cubes=count - 1))
    more = edited(
        edited(whole, last, last, replace(last, index=count + 1)),
        summary,
        replace(summary, cubes=count + 1),
    )
    for recording, wrong in ((fewer, count - 1), (more, count + 1)):
        found = verify(recording)
        assert "complete" not in failing(found)
        assert found.cubes == count
        assert detail_of(found, "class") == f"{wrong} cubes, the moves have {count}"
        assert detail_of(found, "summary") == f"cubes is {wrong}, derived is {count}"


def test_every_cube_that_the_summary_counts_is_there() -> None:
    """The one that is missing is named, the last one too."""
    whole = crowd()
    cubes: list[Any] = [decode(record.data) for record in whole.of_kind("cube")]
    for cube in cubes:
        said = detail_of(verify(edited(whole, cube)), "complete")
        assert said == f"cube {cube.index} of {len(cubes)} is missing"


def test_where_the_cubes_end_elsewhere_the_site_is_named() -> None:
    """The least that is on after the one and not after the other, not one that is on after both."""
    whole = crowd()
    summary = first(whole, "summary")
    last = first(whole, "cube", lambda message: message.index == summary.cubes)
    assert [move.at for move in last.moves] == [((1, 1), (2, 1))]
    less = edited(whole, last, replace(last, moves=[]))
    one_more = Cube(last.round, last.index + 1, [GeneratorPlacement("edge", ((2, 3), (3, 3)))])
    more = edited(
        edited(whole, last, last, one_more), summary, replace(summary, cubes=one_more.index)
    )
    for recording, where, site in ((less, "cubes", (1, 1)), (more, "moves", (2, 3))):
        said = detail_of(verify(recording), "ends")
        assert said == f"after the {where} {site!r} is on, but not after the other"


def test_edges_are_compared_up_to_the_last_round() -> None:
    """Only where a run was killed may those of the last round be missing, and never be wrong."""
    whole = crowd()
    killed = all_edited(whole, "summary", lambda _: None)
    last = first(whole, "summary").rounds
    edges = first(whole, "edges", lambda message: message.round == last)
    before = first(whole, "edges", lambda message: message.round == last - 1)
    wrong = replace(edges, moves=[Executed(0, "edge", ((0, 0), (0, 1))), *edges.moves])
    assert failing(verify(edited(killed, edges))) == {"complete"}
    for recording, old, new, said in (
        (whole, edges, [], f"round {last}: no edges on record"),
        (whole, edges, [wrong], f"round {last}: the edges are not the moves reported"),
        (killed, edges, [wrong], f"round {last}: the edges are not the moves reported"),
        (killed, before, [], f"round {last - 1}: no edges on record"),
    ):
        assert detail_of(verify(edited(recording, old, *new)), "edges") == said


CHANGES: tuple[Any, ...] = (None, False, True, *range(-3, 40), "", "edge", "presence", [])


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths of the values inside a JSON value."""
    inside: Any = ()
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    else:
        yield path
    for key, each in inside:
        yield from leaves(each, (*path, key))


@pytest.mark.slow
@given(data=st.data())
def test_any_value_changed_in_any_message_is_found(data: st.DataObject) -> None:
    """Whatever single value is changed to whatever else: never a traceback, never ok."""
    whole = crowd()
    kinds = ("bundle", "reports", "go", "ready", "edges", "cube", "summary")
    place = data.draw(
        st.sampled_from([n for n, each in enumerate(whole.records) if each.kind in kinds])
    )
    record = whole.records[place]
    value = json.loads(record.data)
    *path, last = data.draw(st.sampled_from(list(leaves(value))))
    inner = value
    for key in path:
        inner = inner[key]
    old, inner[last] = inner[last], data.draw(st.sampled_from(CHANGES))
    assume(inner[last] != old)
    records = [*whole.records]
    records[place] = replace_record(record, data=msgspec.json.encode(value))
    assert not audit(with_records(whole, records)).ok, (record.data, value)


REAL = [
    ("hex:n=5", "chain"),
    ("hex-open:n=5", "random"),
    ("agv:graph=grid4x4,n=7", "tswap"),
    ("agv:graph=K5,n=2", "random"),
    ("agv-labelled:graph=grid4x4,n=6", "pibt"),
    ("agv-labelled:graph=grid3x3,n=5", "random"),
    ("arm:n=6", "word"),
    ("arm:n=6", "random"),
]


@pytest.mark.few(4)
@pytest.mark.parametrize(("spec", "rule"), REAL)
def test_a_real_recording_passes(spec: str, rule: str) -> None:
    """What really ran passes every check, and the numbers derived are those of the run."""
    recording = recorded(spec, rule, rounds=12, hesitate=0.1)
    found = audit(recording)
    assert found.ok, [check for check in found.checks if not check.ok]
    assert [check.name for check in found.checks] == list(CHECKS)
    assert all(check.detail == "" for check in found.checks)
    summary = first(recording, "summary")
    assert found.moves == summary.moves > 0
    assert (found.rounds, found.cubes) == (summary.rounds, summary.cubes)
    assert found.path_digest == summary.path_digest


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "rule"),
    [
        each if each[1] in ("chain", "pibt") else pytest.param(*each, marks=pytest.mark.thorough)
        for each in REAL
    ],
)
def test_recordings_from_several_processes_pass(spec: str, rule: str) -> None:
    """Several processes interleave what they say; nothing of it is lost or out of place."""
    found = verify(recorded(spec, rule, rounds=20, seed=5, hesitate=0.2, processes=3))
    assert found.ok, [check for check in found.checks if not check.ok]


@pytest.mark.nightly
def test_many_real_recordings_pass() -> None:
    """Over many seeds, with claims lost in most runs, no check raises a false alarm."""
    lost = 0
    for seed in range(4):
        for spec in ("agv:graph=grid3x3,n=5", "hex-open:n=6", "arm:n=7"):
            recording = recorded(spec, "random", seed=seed, rounds=10)
            found = verify(recording)
            assert found.ok, [check for check in found.checks if not check.ok]
            lost += any(b'"claim":"lost"' in record.data for record in recording.records)
    assert lost > 5


@pytest.mark.slow
def test_whatever_is_cut_off_only_the_end_is_missing() -> None:
    """After any message the run may have been killed: `complete` fails, and nothing else."""
    whole = recorded("agv:graph=grid3x3,n=4", "tswap")
    rounds = 0
    for count in range(len(whole.records)):
        found = verify(with_records(whole, whole.records[:count]))
        assert failing(found) == {"complete"}, count
        assert found.rounds >= rounds
        rounds = found.rounds
    assert rounds == first(whole, "summary").rounds


def test_a_run_ended_from_outside_may_stop_in_a_round() -> None:
    """An interrupted run with a summary is complete, though its last round is not."""
    whole = crowd()
    last = parts(whole, "report")[-1]
    before = with_records(
        whole,
        [
            record
            for record in whole.records
            if record.kind not in ("edges", "cube", "certificate", "summary")
            or record.round < last.round
        ],
    )
    cut = verify(edited(before, last))
    summary = first(whole, "summary")
    assert failing(cut) == {"complete"}
    gatherer = gathered(edited(before, last))
    names = {
        action: GeneratorPlacement(move.generator, move.at)
        for step in gatherer.steps
        for move, action in zip(step.executed, step.actions, strict=True)
    }
    cubes = [
        record_of(Cube(gatherer.rounds, index, [names[action] for action in cube]))
        for index, cube in enumerate(gatherer.heap.cube_path(), 1)
    ]
    told = replace(
        summary,
        round=gatherer.rounds,
        rounds=gatherer.rounds,
        ended="interrupted",
        error="interrupted",
        moves=gatherer.heap.moves,
        reduced_moves=gatherer.heap.reduced_moves,
        cubes=gatherer.heap.cubes,
        max_cube_dimension=gatherer.heap.max_cube_dimension,
        path_digest=gatherer.digest,
        goal_reached=gatherer.reached,
    )
    records = [*edited(before, last).records, *cubes, record_of(told)]
    assert verify(with_records(before, records)).ok
    records[-1] = record_of(replace(told, ended="max-rounds"))
    assert "reports" in failing(verify(with_records(before, records)))


def test_what_is_delivered_twice_is_said_once() -> None:
    """The same bytes once more change nothing; that each is recorded once is another check."""
    whole = crowd()
    twice = with_records(whole, [each for each in whole.records for _ in (1, 2)])
    assert failing(verify(twice)) == {"pacing", "edges", "complete", "certificate"}


def in_another_order(recording: Recording, key: Callable[[Record], Any]) -> Recording:
    """Return the recording with the messages of each phase sorted."""
    records: list[Record] = []
    phase: list[Record] = []
    for record in recording.records:
        if record.kind == "go":
            records += [*sorted(phase, key=key), record]
            phase = []
        else:
            phase.append(record)
    return with_records(recording, [*records, *sorted(phase, key=key)])


def test_the_order_of_arrival_within_a_phase_does_not_matter() -> None:
    """Messages of a phase may be on record in any order, and edges before the last report."""
    whole = recorded("agv:graph=grid4x4,n=7", "tswap", rounds=10, processes=3)
    assert verify(in_another_order(whole, lambda each: each.data)).ok
    assert verify(in_another_order(whole, lambda each: each.data[::-1])).ok


@pytest.mark.parametrize(
    "make",
    [
        tamperings.a_move_onto_another_module,
        tamperings.a_lost_claim_is_executed_too,
        tamperings.a_granted_claim_is_not_executed,
    ],
)
def test_what_is_said_does_not_depend_on_the_order_of_arrival(make: Tampering) -> None:
    """Of several things that are wrong the same one is named, whoever reported first."""
    recording = make()
    told = {
        verify(in_another_order(recording, key)).checks
        for key in (lambda each: each.data, lambda each: each.data[::-1], lambda each: each.topic)
    }
    assert told == {verify(recording).checks}


def test_rounds_count_from_1_and_cubes_too() -> None:
    """What stands under another number is named, the least of several."""
    whole = crowd()
    report = first(whole, "report")
    none = with_records(whole, [*whole.records, record_of(replace(report, round=0))])
    assert detail_of(verify(none), "reports") == "round 0: rounds count from 1"
    # Only reports make a round that every module has to report.
    here = first(whole, "presence")
    after = with_records(whole, [*whole.records, record_of(replace(here, round=99))])
    assert "reports" not in failing(verify(after))
    cube, count = first(whole, "cube"), first(whole, "summary").cubes
    for strays, least in (((count + 2, count + 1), count + 1), ((count + 1, 0), 0)):
        more = [record_of(replace(cube, index=index)) for index in strays]
        said = detail_of(verify(with_records(whole, [*whole.records, *more])), "complete")
        assert said == f"cube {least}: the summary counts {count}"


def test_of_several_moves_that_do_not_belong_the_first_is_named() -> None:
    """By its label, among those that are too many in a cube, and those that are missing."""
    whole = crowd()
    said_cubes: list[Any] = [decode(record.data) for record in whole.of_kind("cube")]
    cubes = sorted(said_cubes, key=lambda cube: int(cube.index))[:3]
    moves = [move for cube in cubes for move in cube.moves]

    def labels(placed: Iterable[GeneratorPlacement]) -> list[str]:
        action = whole.scene.system.action
        return [action(move.generator, site_from_json(move.at)).label for move in placed]

    more = edited(whole, cubes[0], replace(cubes[0], moves=moves))
    extra = labels(moves[len(cubes[0].moves) :])
    assert len(set(extra)) > 1
    said = detail_of(verify(more), "class")
    assert said == f"cube 1 is not that of the moves: {min(extra)} is too many"
    wide = next(cube for cube in cubes if len(cube.moves) > 1)
    less = edited(whole, wide, replace(wide, moves=[]))
    said = detail_of(verify(less), "class")
    missing = min(labels(wide.moves))
    assert said == f"cube {wide.index} is not that of the moves: {missing} is missing"


def test_progress_is_told_for_each_round() -> None:
    """Whoever watches is told of every round once."""
    told: list[int] = []
    found = verify(crowd(), told.append)
    assert sum(told) == found.rounds


def test_a_recording_closed_again_without_its_last_messages_is_not_complete(tmp_path: Path) -> None:
    """However many they are; the file itself is whole."""
    whole = crowd()
    for count in (1, 2, 7, 40):
        path = tmp_path / f"{count}.mcap"
        copy_recording(with_records(whole, whole.records[:-count]), path)
        found = read_recording(path)
        assert found.problems == ()
        assert failing(audit(found)) == {"complete"}


def test_what_is_known_to_be_missing_is_counted() -> None:
    """Rounds that were begun, messages by their numbers, and those that were counted."""
    whole = recorded("agv:graph=grid4x4,n=7", "tswap", rounds=10, processes=3)
    assert verify(whole).missing == (0, 0)
    records = list(whole.records)
    last = next(n for n, each in enumerate(records) if each.kind == "go" and each.round == 10)
    begun = with_records(whole, records[: last + 1])
    assert verify(begun).missing == (1, 0)
    # The three messages before one are lost, but not what was written after them.
    holed = replace_record(whole, records=(*records[: last + 1], *records[last + 4 :]))
    found = verify(holed)
    assert found.missing.messages >= 3
    assert detail_of(found, "complete") == "3 messages before the last one are missing"
    said = next(n for n, each in enumerate(records) if n > last and each.kind == "bundle")
    ready = next(n for n, each in enumerate(records) if n > last and each.kind == "go") - 1
    cut = [each for n, each in enumerate(records[: ready + 1]) if n != said]
    assert verify(with_records(whole, cut)).missing == (1, 1)


def test_the_document_has_the_keys_that_are_promised() -> None:
    """`--json` gives ok, complete, checks, moves, rounds, cubes and path_digest."""
    document = verify(crowd()).document()
    keys = ["ok", "complete", "missing", "checks", "moves", "rounds", "cubes", "path_digest"]
    assert list(document) == keys
    assert document["complete"] is True
    assert document["checks"][0] == {"name": "readable", "ok": True, "checked": True, "detail": ""}


def test_admissible_and_applied_as_by_definition() -> None:
    """The plain lines here agree with `actions.py`, guards and free sites included."""
    guarded = Action([1, 2, 3, 4], [1, 2], [1], [2], free=[3, 4], guards=[(3, 4)])
    for action in (guarded, Action([1, 2, 5], [1, 2], [1, 5], [2, 5])):
        for bits in range(32):
            state: set[Site] = {site for site in range(1, 6) if bits >> site - 1 & 1}
            assert (rederive.why_not(action, state) is None) == admissible(action, state)
            if admissible(action, state):
                after = set(state)
                rederive.make(action, after)
                assert after == apply(action, state)


# Recovering.


def damaged(path: Path) -> Path:
    """Write a recording of small chunks whose end is cut off."""
    recording = crowd()
    with RecordingWriter(
        path.with_suffix(".whole"), recording.scene, recording.parameters
    ) as writer:
        for record in recording.records:
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
            if writer.messages % 50 == 0:
                writer.flush()
    data = path.with_suffix(".whole").read_bytes()
    path.write_bytes(data[: len(data) * 2 // 5])
    return path


def test_recovering_writes_what_can_be_read_as_a_proper_recording(tmp_path: Path) -> None:
    """The new file reads without problems and holds the same bytes; only its end is missing."""
    path, out = damaged(tmp_path / "cut.mcap"), tmp_path / "new.mcap"
    found = recover(path, out)
    cut, new = read_recording(path), read_recording(out)
    assert cut.problems == found.problems != ()
    assert new.problems == ()
    assert [each.data for each in new.records] == [each.data for each in cut.records]
    assert found.messages == len(new.records) > 50
    assert found.rounds == verify(new).rounds > 2
    assert failing(verify(new)) == set()
    assert not verify(new).complete
    assert failing(verify(cut)) == {"complete", "readable"}
    assert "truncated" in new.parameters["recovered"]


def test_a_recovered_run_is_fine_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`verify` and `info` say complete: false; 0 is the exit code, also of recovering."""
    path, out = damaged(tmp_path / "cut.mcap"), tmp_path / "new.mcap"
    assert main(["verify", str(path)]) == 1
    capsys.readouterr()
    assert main(["log", "recover", str(path), "--json", "-o", str(out)]) == 0
    assert json.loads(capsys.readouterr().out)["complete"] is False
    assert main(["verify", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["ok"], document["complete"]) == (True, False)
    assert main(["verify", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("complete: false")
    for log, complete in ((path, False), (out, False), (crowd().path, True)):
        assert main(["log", "info", str(log), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["complete"] is complete


def test_what_else_is_wrong_with_a_recovered_run_fails(tmp_path: Path) -> None:
    """A move that was tampered with, and a round that is missing before the cut."""
    path, out = damaged(tmp_path / "cut.mcap"), tmp_path / "new.mcap"
    recover(path, out)
    new = read_recording(out)
    report = first(new, "report", lambda each: each.move is not None)
    assert "sites" in failing(verify(edited(new, report, replace(report, site=[9, 9]))))
    assert failing(verify(edited(new, report, replace(report, move=None))))
    assert "reports" in failing(verify(edited(new, report)))


def test_a_recovered_recording_with_a_summary_has_all_its_cubes(tmp_path: Path) -> None:
    """Where the end is there, what it counts has to be there too."""
    out = tmp_path / "new.mcap"
    recover(crowd(), out)
    assert verify(read_recording(out)).complete
    cube = first(crowd(), "cube")
    assert "complete" in failing(verify(edited(read_recording(out), cube)))


def test_recovering_never_overwrites_its_input(tmp_path: Path) -> None:
    """By its own name, through a link, or by another name of the same file: it is refused."""
    path = damaged(tmp_path / "cut.mcap")
    before = path.read_bytes()
    (tmp_path / "soft.mcap").symlink_to(path)
    os.link(path, tmp_path / "hard.mcap")
    for out in (path, tmp_path / "soft.mcap", tmp_path / "hard.mcap"):
        with pytest.raises(InputError, match="is the recording itself"):
            recover(path, out)
    assert path.read_bytes() == before


def test_a_recording_of_no_rounds_passes(tmp_path: Path) -> None:
    """A start at the goal: no rounds, no moves, no cubes, and all is well."""
    found = verify(recorded("hex:n=3,bend=0,shift=0", "random"))
    assert found.ok
    assert (found.rounds, found.moves, found.cubes) == (0, 0, 0)
    path = tmp_path / "nothing.mcap"
    with RecordingWriter(path, crowd().scene, crowd().parameters):
        pass
    assert failing(verify(read_recording(path))) == {"complete"}
