"""Gathering: the same result whatever the order of arrival, and however often a report comes."""

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace as replace_scene
from functools import cache

import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import replace

from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.edge_path import Step
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Certified, Cube, Report, decode, encode
from samples.recordings import edited, first, recorded, with_records

SPECS = ("agv:graph=grid4x4,n=7", "hex-open:n=5", "arm:n=6")


@cache
def reports(spec: str) -> tuple[Report, ...]:
    """Return the reports of a real run."""
    found = (decode(record.data) for record in recorded(spec).of_kind("report"))
    return tuple(report for report in found if isinstance(report, Report))


def fed(spec: str, arriving: list[Report]) -> Gatherer:
    """Return a gatherer that has received the reports in this order."""
    gatherer = Gatherer(recorded(spec).scene)
    for report in arriving:
        gatherer.receive(report)
    return gatherer


@settings(max_examples=20)
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
    gatherer = fed(spec, [report, replace(report)])
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
    with pytest.raises(CheckError, match=r"report \d+ \(report/module_\d\): .* differently"):
        gathered(edited(whole, report, report, replace(report, failed="no")))
    broken = [
        type(each)(each.topic, b"{}", each.round, each.wall_ns, each.sequence)
        for each in whole.of_kind("report")
    ]
    with pytest.raises(InputError, match=r"report 0 \(report/module_\d\): not a cubepath message"):
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
def test_only_what_can_be_is_gathered(spec: str) -> None:
    """A report from where the module was, with a move from there that ends where it says."""
    known = reports(spec)
    due = next(n for n, report in enumerate(known) if report.move is not None)
    report = known[due]
    assert report.move is not None
    for wrong, message in (
        (replace(report, before=["nowhere", 99]), r'from \["nowhere",99\]: it is at'),
        (replace(report, site=report.before), "it ends at .*, and the moves take it to"),
        (replace(report, move=None), "it ends at .*, and the moves take it to"),
        (replace(report, move=GeneratorPlacement("no-such", (0, 1))), "no-such at .* no move from"),
        (replace(report, move=GeneratorPlacement(report.move.generator, True)), "no move from"),
    ):
        with pytest.raises(CheckError, match=rf"report of module_{report.module}.*{message}"):
            fed(spec, [*known[:due], wrong, *known[due + 1 :]])


def rotating(rounds: int) -> Iterator[Report]:
    """Yield the reports of ten vehicles that go round a circle, so that no move cancels."""
    for number in range(1, rounds + 1):
        for module in range(10):
            before = (4 * module + number - 1) % 40
            at = tuple(sorted((before, (before + 1) % 40)))
            move = GeneratorPlacement("edge", at)
            yield Report(number, module, before, (before + 1) % 40, "granted", move, {})


def end_of_run(gatherer: Gatherer) -> None:
    """Encode what the coordinator says at the end of a run."""
    for index, cube in enumerate(gatherer.cubes(), 1):
        encode(Cube(gatherer.rounds, index, list(cube)))
    heap, start = gatherer.heap, gatherer.scene.start_state
    proof = certificate_of(gatherer.numbered, start=start, found=heap.normal_form(), as_text=True)
    assert len(proof.chain) == heap.cubes == gatherer.rounds
    encode(Certified(gatherer.rounds, proof))


@pytest.mark.thorough
def test_a_move_takes_some_bytes_until_the_end_of_the_run() -> None:
    """At most 200 bytes for each of 30,000 further moves, with cubes and certificate."""
    scene = circle()
    peaks = []
    for rounds in (1_000, 1_000, 4_000):  # the first time loads what stays
        gatherer = Gatherer(scene)
        tracemalloc.start()
        for report in rotating(rounds):
            gatherer.receive(report)
        end_of_run(gatherer)
        assert gatherer.heap.reduced_moves == 10 * rounds
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[2] - peaks[1]) / 30_000 <= 200, peaks


def test_rounds_cubes_and_path_are_made_when_they_are_asked_for() -> None:
    """By place, from the end and in slices, as in a tuple; the path is that of the rounds."""
    told: list[Step] = []
    gatherer = Gatherer(circle(), told.append)
    for report in rotating(5):
        gatherer.receive(report)
    assert [*gatherer.steps] == told
    assert (gatherer.steps[-1], gatherer.steps[1:3]) == (told[-1], told[1:3])
    last = gatherer.steps
    assert [step is last[-1] for step in last] == [False] * 4 + [True]
    with pytest.raises(IndexError):
        gatherer.steps[5]
    path = [action for step in told for action in step.actions]
    assert ([*gatherer.path], len(gatherer.path), gatherer.path[7]) == (path, 50, path[7])
    assert tuple(gatherer.cubes()) == gatherer.schedule()
    # What was made before does not change when more is gathered.
    steps = gatherer.steps
    for report in rotating(6):
        gatherer.receive(report)
    assert ([*steps], gatherer.rounds) == (told[:5], 6)


@pytest.mark.parametrize("last", [0, 1])
def test_a_cube_has_the_name_that_was_reported_last(last: int) -> None:
    """An edge has two names; the digest and the rounds keep each as it was."""
    scene = circle()
    gatherer = Gatherer(scene)
    names = ((0, 1), (1, 0))
    reported = [names[each] for each in (0, 1, 0, 1, last)]
    for number, at in enumerate(reported, 1):
        for module, start in enumerate(scene.start):
            move = GeneratorPlacement("edge", at) if module == 0 else None
            before, site = (start, start) if module else ((number - 1) % 2, number % 2)
            gatherer.receive(Report(number, module, before, site, "none", move, {}))
    assert [step.executed[0].at for step in gatherer.steps] == reported
    assert gatherer.schedule() == ((GeneratorPlacement("edge", names[last]),),)


@pytest.mark.nightly
def test_more_movers_than_two_bytes_can_number_are_gathered() -> None:
    """The last of 65,537 modules moves, and is the mover on record."""
    gatherer = Gatherer(scene_from_spec("agv:graph=C65538,n=65537"))
    last = 1 << 16
    for module in range(last):
        gatherer.receive(Report(1, module, module, module, "none", None, {}))
    move = GeneratorPlacement("edge", (last, last + 1))
    gatherer.receive(Report(1, last, last, last + 1, "granted", move, {}))
    assert [executed.module for executed in gatherer.steps[0].executed] == [last]


def circle() -> Scene:
    """Return ten vehicles on a circle, in the places from which they can all go on."""
    scene = scene_from_spec("agv:graph=C40,n=10")
    start = tuple(range(0, 40, 4))
    return replace_scene(scene, start=start, goal=frozenset(start), goals=())
