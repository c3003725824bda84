"""Keepers and modules in real processes, killed, stopped and cut off: nothing is lost."""

import time
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.free.fleet import FreeFleet
from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import locked_file
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.watched_fleets import PATIENCE_S, Watch, listened, watched

pytestmark = pytest.mark.slow

CHAIN = "hex:n=7"
FREE: dict[str, Any] = {"clock": "free", "processes": 2, "keepers": 2}


def legal(watch: Watch) -> None:
    """Assert that the path gathered is legal from the start on, level by level."""
    found = watch.gatherer
    state = found.scene.start_state
    for step in found.steps:
        assert is_cube(step.actions)
        for action in step.actions:
            state = apply(action, state)
    assert state == frozenset(found.sites) | found.scene.system.filled


def reached(run: RunUnderTest) -> RunLog:
    """Go on to the goal; return the log, on which everything holds."""
    run.until_goal(timeout_s=PATIENCE_S)
    log = run.finish()
    log.assert_legal()
    log.assert_goal()
    return log


@pytest.mark.thorough
def test_modules_reach_the_goal_and_each_move_is_told_once(cubepath_run: RunFixture) -> None:
    log = reached(cubepath_run(CHAIN, **FREE))
    commits = log.messages("commit")
    names = [(each.module, each.epoch, each.number) for each in commits]
    assert len(set(names)) == len(names)
    assert len(log.moves) == sum(each.generator is not None for each in commits)


@pytest.mark.thorough
def test_a_coordinator_that_comes_late_finds_everything(tmp_path: Path) -> None:
    """Nobody listens while modules go to the goal; keepers have it all in their logs."""

    def moves() -> int:
        return sum(log.read_text().count('"committed"') for log in tmp_path.glob("keeper_*.log"))

    scene = scene_from_spec(CHAIN)
    with watched(scene, "chain", processes=1, keepers=2, listening=False, logs=tmp_path) as watch:
        end = time.monotonic() + PATIENCE_S
        while moves() < 5:  # whatever came of it, the rest comes later
            assert time.monotonic() < end, f"{moves()} moves"
            time.sleep(0.02)
        with listened(watch):
            watch.until(watch.reached)
            watch.settle()
            legal(watch)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["process_0", "keeper_1", "router"])
def test_a_process_that_is_killed_and_started_again_takes_its_place(
    name: str, cubepath_run: RunFixture
) -> None:
    run = cubepath_run("hex:n=9", **FREE, on_crash="restart")
    run.until_moves(5)
    run.kill(name)
    reached(run)
    assert [(each.name, each.restarted) for each in run.outcome.crashes] == [(name, True)]


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["process_0", "router"])
def test_a_process_that_is_stopped_for_a_while_goes_on(name: str, cubepath_run: RunFixture) -> None:
    run = cubepath_run(CHAIN, **FREE)
    run.until_moves(3)
    run.pause(name, seconds=1.0)
    reached(run)


@pytest.mark.thorough
def test_modules_join_late_and_leave() -> None:
    """Those that are there move; who comes late takes its place, who leaves stays where it is."""
    scene = scene_from_spec("agv:graph=grid5x5,n=4")
    with watched(scene, "random", begin=[0], processes=2, keepers=2) as watch:
        watch.moves(10)
        first, second = watch.fleet.modules_of
        assert {watch.gatherer.sites[each] for each in second} <= set(scene.start)
        watch.fleet.start_again("process_1")
        watch.until(lambda: watch.has_moved(second))
        watch.fleet.leave(0)
        # What it had begun may still be decided, and what was decided is heard late.
        watch.until(lambda: watch.moves_since(first) >= 20)
        places = [watch.gatherer.sites[each] for each in first]
        watch.moves(20)
        watch.settle()
        legal(watch)
        assert [watch.gatherer.sites[each] for each in first] == places


@pytest.mark.thorough
def test_the_living_do_not_notice_the_dead(cubepath_run: RunFixture) -> None:
    """A process dies with its vehicle, which stays where it is; the others go on."""
    options: dict[str, Any] = {**FREE, "processes": 4, "max_rounds": 10**6}
    run = cubepath_run("agv:graph=grid6x2,n=4", "random", **options)
    run.until_moves(3)
    (dead,) = run.run.modules_of("process_1")
    run.kill("process_1")
    run.until(lambda _: "process_1" not in run.pids)
    run.step(10)  # what it had under way is decided by then
    place = run.sites[dead]
    run.step(20)
    run.finish().assert_legal()
    assert run.sites[dead] == place
    assert [(each.name, each.restarted) for each in run.outcome.crashes] == [("process_1", False)]


@pytest.mark.thorough
def test_a_death_ends_the_run_unless_told_otherwise(cubepath_run: RunFixture) -> None:
    options: dict[str, Any] = {**FREE, "on_crash": "stop", "max_rounds": 10**6}
    run = cubepath_run(CHAIN, "random", **options)
    run.until_moves(2)
    run.kill("keeper_1")
    assert run.play(failing=True).error == "keeper_1 has ended: killed by signal 9"


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "keep"), [("process_0", True), ("keeper_1", False)])
def test_who_is_cut_off_for_a_while_goes_on_where_it_was(
    name: str, keep: bool, cubepath_run: RunFixture
) -> None:
    """What was said meanwhile comes late, or never."""
    run = cubepath_run(CHAIN, **FREE)
    run.until_moves(3)
    run.cut_off(name, seconds=1.5, keep=keep)
    reached(run)
    assert run.link_of(name).up.passed


@pytest.mark.thorough
def test_slow_links_only_take_longer(cubepath_run: RunFixture) -> None:
    run = cubepath_run("hex:n=5", **FREE)
    late = [
        rule
        for name in ("keeper_0", "process_0")
        for rule in (run.delay(0.05, sender=name), run.delay(0.05, to=name))
    ]
    reached(run)
    assert all(rule.count for rule in late)


@pytest.mark.parametrize(("key", "number"), [("processes", 0), ("keepers", 0)])
def test_a_fleet_has_processes_and_keepers(key: str, number: int) -> None:
    with pytest.raises(InputError, match=f"^{key}=0: expected 1 or more$"):
        FreeFleet(scene_from_spec(CHAIN), "chain", **{key: number})  # type: ignore[arg-type]


@pytest.mark.slow
def test_each_keeper_holds_the_lock_of_the_logs(tmp_path: Path) -> None:
    """For as long as it lives, also when its starter holds it no more."""
    path = tmp_path / "lock"
    lock = locked_file(path)
    with FreeFleet(scene_from_spec(CHAIN), "chain", keepers=1, logs=tmp_path, lock=lock):
        lock.close()
        with pytest.raises(BlockingIOError):
            locked_file(path)
    locked_file(path).close()
