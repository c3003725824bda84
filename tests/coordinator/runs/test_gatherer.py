"""Gathering: the same result whatever the order of arrival, and however often a report comes."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.gatherer import Gatherer, gathered
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.wire.messages import Report
from recordings import edited, first, parts, recorded, with_records

SPECS = ("agv:graph=grid4x4,n=7", "hex-open:n=5", "arm:n=6")


@cache
def reports(spec: str) -> tuple[Report, ...]:
    """Return the reports of a real run."""
    return tuple(parts(recorded(spec), "report"))


def fed(spec: str, arriving: list[Report]) -> Gatherer:
    """Return a gatherer that has received the reports in this order."""
    gatherer = Gatherer(recorded(spec).scene)
    for report in arriving:
        gatherer.receive(report)
    return gatherer


@given(spec=st.sampled_from(SPECS), data=st.data())
def test_order_and_duplicates_do_not_matter(spec: str, data: st.DataObject) -> None:
    """Any permutation, with any reports twice, gives the same edge path, cubes and digest."""
    known = reports(spec)
    again = data.draw(st.lists(st.sampled_from(known), max_size=20))
    found = fed(spec, data.draw(st.permutations([*known, *again])))
    summary = first(recorded(spec), "summary")
    assert found.digest == summary.path_digest
    assert (found.rounds, found.heap.moves) == (summary.rounds, summary.moves)
    assert found.heap.cube_path() == fed(spec, [*known]).heap.cube_path()
    assert found.begun == found.rounds


@given(data=st.data())
def test_a_round_is_released_when_all_have_reported(data: st.DataObject) -> None:
    """Whatever has arrived so far, the rounds released are those complete from the first on."""
    spec = SPECS[0]
    arriving = data.draw(st.permutations(reports(spec)))
    arrived = arriving[: data.draw(st.integers(0, len(arriving)))]
    found = fed(spec, arrived)
    modules = len(recorded(spec).scene.start)
    complete = 0
    while sum(report.round == complete + 1 for report in arrived) == modules:
        complete += 1
    assert found.rounds == complete
    assert [step.round for step in found.steps] == [*range(1, complete + 1)]


def test_a_step_is_told_once_and_in_order() -> None:
    """Whoever watches is told of each round when it is complete, movers in increasing order."""
    spec = SPECS[0]
    told: list[int] = []

    gatherer = Gatherer(recorded(spec).scene, lambda step: told.append(step.round))
    for report in [*reversed(reports(spec)), *reports(spec)]:
        gatherer.receive(report)
    assert told == [*range(1, gatherer.rounds + 1)]
    for step in gatherer.steps:
        movers = [executed.module for executed in step.executed]
        assert movers == sorted(movers)
    path = [action for step in gatherer.steps for action in step.actions]
    assert gatherer.heap.cube_path() == normal_cube_path(path)


def test_what_contradicts_is_refused() -> None:
    """Two reports of a module for a round that differ, and a report of no module of the run."""
    spec = SPECS[0]
    report = reports(spec)[0]
    gatherer = fed(spec, [report])
    with pytest.raises(CheckError, match=r"module_\d+ reports round 1 twice, and differently"):
        gatherer.receive(replace(report, failed="no"))
    for stranger in (-1, 7):
        with pytest.raises(CheckError, match="no such module"):
            gatherer.receive(replace(report, module=stranger))


def test_gathering_a_recording_names_what_is_wrong_in_it() -> None:
    """The same from a recording; what is no report is named by its number and topic."""
    whole = recorded(SPECS[0])
    assert gathered(whole).digest == first(whole, "summary").path_digest
    report = first(whole, "report")
    with pytest.raises(CheckError, match=r"report \d+ \(reports/process_0\): .* differently"):
        gathered(edited(whole, report, report, replace(report, failed="no")))
    broken = [
        type(each)(each.topic, b"{}", each.round, each.wall_ns, each.sequence)
        for each in whole.of_kind("reports")
    ]
    with pytest.raises(InputError, match=r"report 0 \(reports/process_0\): not a cubepath message"):
        gathered(with_records(whole, broken))


@pytest.mark.parametrize("spec", SPECS)
def test_a_gathered_move_is_a_look_up(spec: str) -> None:
    """Its action is the one object that the system has; gathering again makes no other."""
    scene = recorded(spec).scene
    one, other = (Gatherer(scene), Gatherer(scene))
    for report in reports(spec):
        one.receive(report)
        other.receive(report)
    first = [action for step in one.steps for action in step.actions]
    second = [action for step in other.steps for action in step.actions]
    assert first
    assert all(a is b for a, b in zip(first, second, strict=True))
    assert all(action is move.action for action in first for move in scene.system.moves_of(action))


@pytest.mark.parametrize("spec", SPECS)
def test_gathering_believes_the_name_of_a_move_and_not_where_its_mover_was(spec: str) -> None:
    """A wrong `before` changes nothing here (verify tells); a move that is none is refused."""
    known = reports(spec)
    true = fed(spec, [*known])
    strayed = [replace(report, before=["nowhere", 99]) for report in known]
    found = fed(spec, strayed)
    assert (found.digest, found.sites) == (true.digest, true.sites)
    assert found.heap.cube_path() == true.heap.cube_path()
    due = next(n for n, report in enumerate(known) if report.move is not None)
    for placed, message in (
        (GeneratorPlacement("no-such", [0, 1]), "unknown generator 'no-such', expected"),
        (GeneratorPlacement(known[due].move.generator, True), "'at'"),  # type: ignore[union-attr]
    ):
        wrong = [*known]
        wrong[due] = replace(known[due], move=placed)
        with pytest.raises(InputError, match=message):
            fed(spec, wrong)
