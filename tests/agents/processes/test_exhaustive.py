"""Short runs of three modules in every order in which messages can arrive, also with one fault."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec.structs import replace as replaced

from cubepath.agents.processes.node import HostNode
from cubepath.coordinator.runs.conductor import Conductor, RunEnd
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Bundle, Go, Message, Report, Reports, Retransmit, encode
from cubepath.protocol.wire.nodes import Effect, Put, Timer
from exploration.explorer import FAULTS, BrokenError, Explored, Explorer, Fault
from samples.short_runs import RUN, Coordinator, ShortRun


def _from(spec: str, *start: Site) -> Scene:
    return replace(scene_from_spec(spec), start=start, goal=None, goals=())


STAR = ShortRun(_from("agv:graph=S3,n=3", 1, 2, 3), "random", seed=7, processes=3)
"""Three vehicles that all want the vertex between them, so that verdicts wait for verdicts."""
RUNS = {
    "star": STAR,
    "row": ShortRun(_from("agv:graph=grid12x1,n=3", (6, 0), (7, 0), (8, 0)), "random", 15, 3),
    "notes": ShortRun(scene_from_spec("agv-labelled:graph=grid2x2,n=3"), "pibt", 8, 3),
    "hex": ShortRun(_from("hex:n=3", (2, 3), (3, 3), (4, 3)), "random", 25, 3),
    "arm": ShortRun(scene_from_spec("arm:n=3"), "random", 13, 3),
    "sliding": ShortRun(scene_from_spec("sliding:p=2,q=1,n=3"), "random", 1, 3),
}
"""Runs with conflicts; "row" crosses from one region to another, moves of the last two take others
along."""


def explored(run: ShortRun, *faults: Fault, kind: type[HostNode] = HostNode) -> Explored:
    """Explore a run, and hold every end of it to what it must come to."""
    found = Explorer(run.nodes(kind), faults).explore()
    records: set[frozenset[bytes]] = set()
    for end in found.ends:
        assert isinstance(end, Coordinator)
        assert reports_in(end) == run.reports()
        records.add(frozenset(end.kept))
    assert len(records) == 1
    last = found.ends[-1]
    assert isinstance(last, Coordinator)
    checks = verify(recording_of(run, list(last.kept.items()))).checks
    assert [f"{check.name}: {check.detail}" for check in checks if not check.ok] == []
    return found


def reports_in(end: Coordinator) -> list[Report]:
    """Return all reports that a coordinator has kept, in order of rounds and modules."""
    found = [part for each in end.kept.values() if isinstance(each, Reports) for part in each.parts]
    return sorted(found, key=lambda report: (report.round, report.module))


def recording_of(run: ShortRun, kept: Sequence[tuple[bytes, Message]]) -> Recording:
    """Return the recording of a run: what was kept, and what came of it."""
    records: list[Record] = []

    def record(message: Message, data: bytes) -> None:
        at = len(records)
        records.append(Record(topic_of(message), data, message.round, at, at))

    conductor = Conductor(
        run.scene, max_rounds=run.rounds, record=lambda message: record(message, encode(message))
    )
    for data, message in kept:
        record(message, data)
        conductor.hear(message)
    ending = conductor.between(run.rounds, lambda: None)
    assert isinstance(ending, RunEnd)
    assert ending.ended != "failed"
    for message in conductor.results(ending):
        record(message, encode(message))
    parameters = {
        "system": run.scene.spec,
        "family": run.scene.family,
        "rule": run.rule,
        "seed": str(run.seed),
        "hesitate": str(run.hesitate),
        "processes": str(run.processes),
        "modules": str(len(run.scene.start)),
        "max_rounds": str(run.rounds),
    }
    return Recording(Path(f"{RUN}.mcap"), parameters, run.scene, tuple(records), ())


def test_the_runs_have_something_to_settle() -> None:
    """In each some claim is lost, a verdict is told, and something is moved."""
    for run in RUNS.values():
        reports = run.reports()
        assert {report.claim for report in reports} >= {"granted", "lost"}
        assert any("verdict" in report.received for report in reports)
    told = [report.received for report in RUNS["notes"].reports()]
    assert any("note" in heard for heard in told)


NIGHTLY = pytest.mark.nightly


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "processes"),
    [
        *((name, 2) for name in RUNS if name not in ("hex", "sliding")),
        ("star", 3),
        *(pytest.param(name, 2, marks=NIGHTLY) for name in ("hex", "sliding")),
        *(pytest.param(name, 3, marks=NIGHTLY) for name in ("row", "hex", "notes")),
    ],
)
def test_two_rounds_come_to_the_same_in_every_order(name: str, processes: int) -> None:
    """No order breaks a node or keeps a run from its end; reports and record are the same."""
    found = explored(replace(RUNS[name], processes=processes))
    assert found.states > (400 if processes == 2 else 15_000)


@pytest.mark.slow
@pytest.mark.parametrize("fault", [pytest.param("loss", marks=pytest.mark.thorough), "double"])
def test_two_processes_bear_any_one_fault(fault: Fault) -> None:
    """Any one message lost or doubled at any time; the next test has every fault."""
    run = replace(STAR, processes=2, rounds=1)
    assert explored(run, fault).states > 1.5 * explored(run).states


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("star", marks=pytest.mark.thorough),
        *(pytest.param(name, marks=NIGHTLY) for name in ("row", "notes")),
    ],
)
def test_two_processes_bear_any_fault_in_every_run(name: str) -> None:
    """Two rounds, with moves from region to region, notes, and moves that take others along."""
    explored(replace(RUNS[name], processes=2), *FAULTS)


@pytest.mark.slow
@NIGHTLY
@pytest.mark.timeout(900)
def test_three_processes_bear_a_message_lost_late_or_doubled() -> None:
    """In a round: every message, and every moment at which it or its double may come."""
    explored(replace(RUNS["notes"], rounds=1), "loss", "late", "double")


class _Forgetful(HostNode):
    """Says nothing again."""

    def _repeated(self, again: Retransmit) -> Iterable[Put]:
        del again
        return ()


class _Credulous(HostNode):
    """Takes every double for another message."""

    def _hear(self, bundle: Bundle) -> list[Effect]:
        self._copies = getattr(self, "_copies", 0) + 1
        return super()._hear(replaced(bundle, number=self._copies))


class _Hasty(HostNode):
    """Begins each phase with what it has heard so far."""

    def _missing(self, go: Go) -> list[str]:
        del go
        return []


class _Patient(HostNode):
    """Never asks for what is missing."""

    def tick(self) -> list[Effect]:
        return [Timer(1.0)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "faults"),
    [(_Forgetful, ["loss"]), (_Credulous, ["double"]), (_Hasty, []), (_Patient, ["late"])],
)
def test_a_node_with_a_bug_is_found(kind: type[HostNode], faults: list[Fault]) -> None:
    """In one round of two processes; the way there is told message by message."""
    run = replace(STAR, processes=2, rounds=1)
    with pytest.raises(AssertionError) as caught:
        explored(run, *faults, kind=kind)
    assert caught.type is not BrokenError or "\nafter\nstart\nnode " in str(caught.value)
