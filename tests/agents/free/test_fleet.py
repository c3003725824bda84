"""Keepers and modules in real processes, killed, stopped and cut off: nothing is lost."""

import contextlib
import signal
import time
from collections.abc import Callable, Generator
from functools import partial

import pytest

from cubepath.agents.free.fleet import FreeFleet
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Moved
from relay import Relay
from watched_fleets import Watch, listened, watched

pytestmark = pytest.mark.slow

CHAIN = "hex:n=7"
LONG = partial(pytest.param, marks=pytest.mark.thorough)
Ways = dict[str, Callable[[str], str]]


def legal(watch: Watch) -> None:
    """Assert that the path gathered is legal from the start on, level by level."""
    found = watch.gatherer
    state = found.scene.start_state
    for step in found.steps:
        assert is_cube(step.actions)
        for action in step.actions:
            state = apply(action, state)
    assert state == frozenset(found.sites) | found.scene.system.filled


def test_modules_reach_the_goal_and_each_move_is_told_once() -> None:
    with watched(scene_from_spec(CHAIN), "chain", processes=2, keepers=2) as watch:
        watch.until(watch.reached)
        watch.settle()
        legal(watch)
        commits = [each for each in watch.heard if isinstance(each, Moved)]
        names = [(each.module, each.epoch, each.number) for each in commits]
        assert len(set(names)) == len(names)
        assert watch.gatherer.moves == sum(each.generator is not None for each in commits)


def test_a_coordinator_that_comes_late_finds_everything() -> None:
    """Nobody listens while modules go to the goal; keepers have it all in their logs."""
    scene = scene_from_spec(CHAIN)
    with watched(scene, "chain", processes=1, keepers=2, listening=False) as watch:
        time.sleep(1.0)  # whatever came of it, the rest comes later
        with listened(watch):
            watch.until(watch.reached)
            watch.settle()
            legal(watch)


@pytest.mark.parametrize("name", ["process_0", LONG("keeper_0"), LONG("keeper_1"), LONG("router")])
def test_a_process_that_is_killed_and_started_again_takes_its_place(name: str) -> None:
    scene = scene_from_spec("hex:n=9")
    with watched(scene, "chain", processes=2, keepers=2, on_crash="restart") as watch:
        watch.moves(5)
        watch.kill(name)
        watch.until(lambda: bool(watch.crashes))
        assert watch.crashes[0].name == name
        assert watch.crashes[0].restarted
        watch.until(watch.reached)
        watch.settle()
        legal(watch)


@pytest.mark.parametrize("name", [LONG("process_0"), "keeper_0", LONG("router")])
def test_a_process_that_is_stopped_for_a_while_goes_on(name: str) -> None:
    with watched(scene_from_spec(CHAIN), "chain", processes=2, keepers=2) as watch:
        watch.moves(3)
        watch.kill(name, signal.SIGSTOP)
        time.sleep(1.0)
        watch.kill(name, signal.SIGCONT)
        watch.until(watch.reached)
        watch.settle()
        legal(watch)


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


def test_the_living_do_not_notice_the_dead() -> None:
    """A process dies with its vehicle, which stays where it is; the others go on."""
    scene = scene_from_spec("agv:graph=grid6x2,n=4")
    with watched(scene, "random", processes=4, keepers=2, on_crash="continue") as watch:
        watch.moves(3)
        watch.kill("process_1")
        watch.until(lambda: bool(watch.crashes))
        assert not watch.crashes[0].restarted
        dead = watch.fleet.modules_of[1][0]
        watch.moves(10)  # what it had under way is decided by then
        place = watch.gatherer.sites[dead]
        watch.moves(20)
        watch.settle()
        legal(watch)
        assert watch.gatherer.sites[dead] == place


def test_a_death_ends_the_run_unless_told_otherwise() -> None:
    with (
        pytest.raises(ProcessDied, match=r"^keeper_1 has ended: killed by signal 9$"),
        watched(scene_from_spec(CHAIN), "random", processes=1, keepers=2) as watch,
    ):
        watch.moves(2)
        watch.kill("keeper_1")
        watch.moves(10**6)


@contextlib.contextmanager
def relays(names: list[str], delay_s: float) -> Generator[tuple[Ways, dict[str, Relay]]]:
    """Yield the ways of processes through relays of their own."""
    made: dict[str, Relay] = {}
    with contextlib.ExitStack() as stack:

        def way(name: str) -> Callable[[str], str]:
            def through(endpoint: str) -> str:
                made[name] = stack.enter_context(Relay(endpoint, delay_s=delay_s))
                return made[name].endpoint

            return through

        yield {name: way(name) for name in names}, made


@pytest.mark.parametrize("name", ["process_0", LONG("keeper_1")])
def test_who_is_cut_off_for_a_while_goes_on_where_it_was(name: str) -> None:
    with (
        relays([name], 0.0) as (ways, made),
        watched(scene_from_spec(CHAIN), "chain", ways=ways, processes=2, keepers=2) as watch,
    ):
        watch.moves(3)
        made[name].cut()
        time.sleep(1.5)
        made[name].heal()
        watch.until(watch.reached)
        assert made[name].passed
        watch.settle()
        legal(watch)


@pytest.mark.thorough
def test_slow_links_only_take_longer() -> None:
    with (
        relays(["keeper_0", "process_0"], 0.05) as (ways, _),
        watched(scene_from_spec("hex:n=5"), "chain", ways=ways, processes=2, keepers=2) as watch,
    ):
        watch.until(watch.reached)
        watch.settle()
        legal(watch)


@pytest.mark.parametrize(("key", "number"), [("processes", 0), ("keepers", 0)])
def test_a_fleet_has_processes_and_keepers(key: str, number: int) -> None:
    with pytest.raises(InputError, match=f"^{key}=0: expected 1 or more$"):
        FreeFleet(scene_from_spec(CHAIN), "chain", **{key: number})  # type: ignore[arg-type]
