"""On the wire: real processes over zenoh do what the environment in one process does."""

import os
import signal
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from queue import SimpleQueue

import numpy as np
import pytest
import zenoh
from msgspec.structs import replace

from cubepath.agents import parallel_env
from cubepath.agents.environments.rollouts import Rollout, play
from cubepath.agents.environments.wire_world import WireWorld
from cubepath.agents.local.module import ProtocolError
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import everything
from cubepath.protocol.wire.messages import Message, Report, decode, parts_of
from cubepath.protocol.wire.nodes import Keep
from cubepath.protocol.wire.sessions import open_client, subscribe
from marked import some
from samples.local_families import LOCAL_FAMILIES

Path = list[tuple[int, int, str, object]]

SPECS = [
    "hex:n=7",
    "hex-open:n=6",
    "agv:graph=grid4x4,n=8",
    "agv-labelled:graph=grid3x3,n=5",
    "arm:n=7",
    "sliding:p=2,q=2,n=5",
    "arms:n=1",
    "polygon:n=7",
    "words:presentation=free2",
    "assembly:n=3",
]


def path_of(played: Rollout) -> Path:
    """Return the edge path of a run in the environment."""
    return [
        (done.number, module, move.generator, move.at)
        for done in played.rounds
        for module, move in done.moves.items()
    ]


def reports_of(
    scene: Scene, rule: str, *, seed: int, hesitate: float, processes: int, rounds: int
) -> list[Report]:
    """Return all reports of a run on the wire, in order of round and module."""
    found: list[Report] = []

    def sink(kept: Keep[Message], wall_ns: int) -> None:
        found.extend(part for part in parts_of(kept.message) if isinstance(part, Report))

    with LockstepFleet(
        scene, rule, seed=seed, hesitate=hesitate, processes=processes, sink=sink
    ) as fleet:
        for _ in fleet.rounds(rounds):
            pass
    return sorted(found, key=lambda report: (report.round, report.module))


def wire_path(reports: list[Report]) -> Path:
    """Return the edge path that the reports tell."""
    return [
        (report.round, report.module, report.move.generator, site_from_json(report.move.at))
        for report in reports
        if report.move is not None
    ]


SOME = some(SPECS, ("agv:graph=grid4x4,n=8",))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "seeds"),
    [
        ("agv:graph=grid4x4,n=8", 4),
        *(pytest.param(spec, 4, marks=pytest.mark.thorough) for spec in SPECS[1::2]),
    ],
)
def test_same_seed_same_path_over_many_seeds(spec: str, seeds: int) -> None:
    """Random modules that hesitate: environment, 0 and 2 processes agree for each seed."""
    scene = scene_from_spec(spec)
    rule = rule_named("random", scene.system)
    played = [play(scene, rule, seed=s, hesitate=0.3, max_rounds=20) for s in range(seeds)]
    lost = 0
    for processes in (0, 2):
        for seed, reports in enumerate(
            reports_of_seeds(scene, "random", played, hesitate=0.3, processes=processes)
        ):
            assert wire_path(reports) == path_of(played[seed])
            lost += sum(report.claim == "lost" for report in reports)
    assert len({repr(path_of(one)) for one in played}) == seeds
    assert lost > 0


def reports_of_seeds(
    scene: Scene, rule: str, played: list[Rollout], *, hesitate: float, processes: int
) -> Iterator[list[Report]]:
    """Yield the reports of the seeds 0, 1, ... on one fleet, each as many rounds as were played."""
    found: list[Report] = []

    def sink(kept: Keep[Message], wall_ns: int) -> None:
        found.extend(part for part in parts_of(kept.message) if isinstance(part, Report))

    with LockstepFleet(
        scene, rule, seed=0, hesitate=hesitate, processes=processes, sink=sink
    ) as fleet:
        for seed, one in enumerate(played):
            fleet.reset(seed)
            before = fleet.round
            for _ in fleet.rounds(len(one.rounds)):
                pass
            # On the wire rounds go on counting.
            yield sorted(
                (replace(report, round=report.round - before) for report in found),
                key=lambda report: (report.round, report.module),
            )
            found.clear()


@pytest.mark.thorough
@pytest.mark.parametrize("spec", SOME[::2])
def test_same_path_with_a_process_for_each_module(spec: str) -> None:
    """Three processes, and one a module, give the path of the environment."""
    scene = scene_from_spec(spec)
    for seed, processes in ((20, 3), (21, len(scene.start))):
        played = play(
            scene, rule_named("random", scene.system), seed=seed, hesitate=0.1, max_rounds=20
        )
        reports = reports_of(
            scene, "random", seed=seed, hesitate=0.1, processes=processes, rounds=len(played.rounds)
        )
        assert wire_path(reports) == path_of(played)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("family", some(LOCAL_FAMILIES, ("hex", "agv-labelled", "arm")))
def test_the_rule_of_the_family_takes_the_same_path_on_the_wire(family: str) -> None:
    """The rule that reaches the goal does so with the same moves, also when modules hesitate."""
    scene = scene_from_spec(family)
    rule = all_families()[family].rule
    for hesitate in (0.0, 0.4):
        played = play(
            scene, rule_named(rule, scene.system), seed=3, hesitate=hesitate, max_rounds=150
        )
        reports = reports_of(
            scene, rule, seed=3, hesitate=hesitate, processes=0, rounds=len(played.rounds)
        )
        assert wire_path(reports) == path_of(played)
        assert path_of(played)


@pytest.mark.slow
def test_orders_of_a_leader_take_the_same_path_in_two_processes() -> None:
    """Notes lead to the same moves on the wire, in the same rounds, also when modules hesitate."""
    scene = scene_from_spec("sliding-shapes:n=6,walk=60")
    played = play(scene, rule_named("leader", scene.system), seed=3, hesitate=0.4, max_rounds=150)
    reports = reports_of(
        scene, "leader", seed=3, hesitate=0.4, processes=2, rounds=len(played.rounds)
    )
    assert played.reached
    assert wire_path(reports) == path_of(played)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(each, marks=pytest.mark.thorough if n % 3 else [])
        for n, each in enumerate(SPECS)
    ],
)
def told(request: pytest.FixtureRequest) -> tuple[Scene, list[Report]]:
    """Return a scene, and the reports of 20 rounds of it in two processes."""
    scene = scene_from_spec(request.param)
    return scene, reports_of(scene, "random", seed=5, hesitate=0.0, processes=2, rounds=20)


@pytest.mark.few(2)
@pytest.mark.slow
def test_nothing_is_delivered_from_beyond_the_radius(told: tuple[Scene, list[Report]]) -> None:
    """Every delivery is from a place that the hearer senses, or within reach of its claims."""
    scene, reports = told
    system = scene.system
    heard = 0
    stood = {(report.round, report.module): report.before for report in reports}
    for report in reports:
        place = system.place_of(site_from_json(report.before))
        near = {"presence": system.sensed(place)}
        for kind, speaker in report.deliveries():
            sender = system.place_of(site_from_json(stood[report.round, speaker]))
            assert sender in near.get(kind, system.reach(place))
            heard += 1
    assert heard > 100


@pytest.mark.few(1)
@pytest.mark.slow
def test_everyone_sensed_is_heard(told: tuple[Scene, list[Report]]) -> None:
    """Each round every module hears of exactly the modules at the places that it senses."""
    scene, reports = told
    system = scene.system
    for number in range(1, 21):
        there = {
            r.module: system.place_of(site_from_json(r.before))
            for r in reports
            if r.round == number
        }
        for report in reports:
            if report.round != number:
                continue
            sensed = set(system.sensed(there[report.module]))
            expected = {module for module, place in there.items() if place in sensed}
            assert {m for kind, m in report.deliveries() if kind == "presence"} == expected


@contextmanager
def eavesdropper(fleet: LockstepFleet) -> Generator[SimpleQueue[bytes]]:
    """Join a fleet's run with a session of one's own and hear everything."""
    found: SimpleQueue[bytes] = SimpleQueue()

    def enqueue(sample: zenoh.Sample) -> None:
        found.put(sample.payload.to_bytes())

    with open_client(fleet.endpoint) as session:
        subscriber = subscribe(session, everything(fleet.run), enqueue)
        time.sleep(0.2)  # a subscriber tells nobody when it has been declared everywhere
        yield found
        subscriber.undeclare()


@pytest.mark.thorough
def test_a_coordinator_that_hears_nothing_changes_nothing() -> None:
    """The barrier carries no state: fed nothing but `ready`, modules choose as ever."""
    scene = scene_from_spec("hex:n=6")
    told = reports_of(scene, "random", seed=8, hesitate=0.2, processes=2, rounds=15)
    with (
        LockstepFleet(scene, "random", seed=8, hesitate=0.2, processes=2, sink=None) as fleet,
        eavesdropper(fleet) as found,
    ):
        for _ in fleet.rounds(15):
            pass
        overheard: list[Report] = []
        while len(overheard) < len(told):
            message = decode(found.get(timeout=10))
            overheard += [part for part in parts_of(message) if isinstance(part, Report)]
    overheard.sort(key=lambda report: (report.round, report.module))
    assert overheard == told
    assert wire_path(told)


@pytest.mark.slow
def test_a_killed_process_is_named_and_the_others_end() -> None:
    """kill -9 of a module process raises with its modules and the signal; nothing stays."""
    scene = scene_from_spec("hex:n=4")
    pids: list[int] = []
    with (
        pytest.raises(ProcessDied, match=r"module_2, module_3 \(process 1\) died .*signal 9"),
        LockstepFleet(scene, "random", processes=2, sink=lambda *_: None) as fleet,
    ):
        pids += fleet.pids.values()
        for number in fleet.rounds(10_000):
            if number == 5:
                os.kill(pids[1], signal.SIGKILL)
    assert len(pids) == 3
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_processes_end_properly_when_they_are_told_to() -> None:
    """After a run every module process has ended by itself, with exit code 0."""
    scene = scene_from_spec("hex:n=3")
    with LockstepFleet(scene, "random", processes=2, sink=lambda *_: None) as fleet:
        children = list(fleet._children.by_name.values())
        for _ in fleet.rounds(3):
            pass
    assert [child.returncode for child in children] == [0, 0]


@pytest.mark.slow
def test_processes_end_when_their_parent_is_gone() -> None:
    """A module process whose standard input closes ends by itself, with all of its group."""
    scene = scene_from_spec("hex:n=2")
    with LockstepFleet(scene, "random", processes=2, sink=lambda *_: None) as fleet:
        child = fleet._children.by_name["process_0"]
        assert child.stdin is not None
        child.stdin.close()
        assert child.wait(timeout=10) == -signal.SIGKILL


@pytest.mark.slow
def test_runs_side_by_side_do_not_hear_each_other() -> None:
    """Two fleets at once, each with its own router and run id, give their own paths."""
    scene = scene_from_spec("hex:n=4")
    alone = [
        wire_path(reports_of(scene, "random", seed=s, hesitate=0.0, processes=0, rounds=12))
        for s in (1, 2)
    ]
    both: list[list[Report]] = [[], []]

    def sink_to(found: list[Report]) -> object:
        def sink(kept: Keep[Message], wall_ns: int) -> None:
            found.extend(part for part in parts_of(kept.message) if isinstance(part, Report))

        return sink

    with (
        LockstepFleet(scene, "random", seed=1, processes=0, sink=sink_to(both[0])) as one,  # type: ignore[arg-type]
        LockstepFleet(scene, "random", seed=2, processes=0, sink=sink_to(both[1])) as two,  # type: ignore[arg-type]
    ):
        for _ in zip(one.rounds(12), two.rounds(12), strict=True):
            pass
    for found, path in zip(both, alone, strict=True):
        assert wire_path(sorted(found, key=lambda r: (r.round, r.module))) == path


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "processes"), [("hex:n=5", 2), ("arm:n=4", 3), ("agv-labelled", 0)]
)
def test_the_environment_over_zenoh_is_the_environment(spec: str, processes: int) -> None:
    """`transport="zenoh"` gives the same observations, rewards, ends and infos."""
    here = parallel_env(spec, max_cycles=20)
    there = parallel_env(spec, max_cycles=20, transport="zenoh", processes=processes)
    try:
        seen, _ = here.reset(seed=9)
        told, _ = there.reset(seed=9)
        assert repr(seen) == repr(told)
        random = np.random.default_rng(1)
        choices = here.scene.system.move_slots + 1
        while here.agents:
            actions = {name: int(random.integers(choices)) for name in here.agents}
            one, other = here.step(actions), there.step(actions)
            assert repr(one) == repr(other)
            assert (here.state() == there.state()).all()
        assert there.agents == []
        again, _ = here.reset(seed=10)
        told, _ = there.reset(seed=10)
        assert repr(again) == repr(told)
    finally:
        there.close()


@pytest.mark.slow
def test_a_report_of_a_move_that_is_none_is_refused() -> None:
    """By name from where it says it stood, and to where it says it stands."""
    world = WireWorld(scene_from_spec("agv:graph=P3,n=1"), seed=0, processes=0)
    try:
        told = Report(1, 0, 0, 1, "granted", GeneratorPlacement("edge", (0, 1)), {})
        assert world._made(told) == world.scene.system.move_named(0, "edge", (0, 1))
        assert world._made(replace(told, move=None)) is None
        for wrong in (
            replace(told, move=GeneratorPlacement("edge", (1, 2))),
            replace(told, before=1),
            replace(told, site=2),
        ):
            with pytest.raises(ProtocolError, match=r"module_0 reports edge at .* no move from"):
                world._made(wrong)
    finally:
        world.close()
