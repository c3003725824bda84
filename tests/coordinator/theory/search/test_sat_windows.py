"""A SAT solver beside the search: always legal, never worse, and nothing is left running."""

import importlib.util
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask
from cubepath.coordinator.theory.satisfiability.encoding import encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.coordinator.theory.search.budget import Budget, SearchStage
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.own_ends import OwnEnds, ends_of
from cubepath.coordinator.theory.search.sat_windows import STAGE, CubePath, SatWindows
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.system import Scene
from samples.strategies import random_walk, scene, walks

SYSTEMS = (
    "agv:graph=grid4x4,n=4",
    "agv-labelled:graph=grid3x3,n=3",
    "sliding:p=2,q=1,n=3",
    "arm-free:n=4",
    "polygon:n=8",
    "triangulation:n=9",
    "words:presentation=free2",
    "hex:n=4",
    "hex-open:n=3",
)


def settled(where: Scene, walk: list[Action], **options: Any) -> tuple[CubePath, SearchStage]:
    """Return what windows alone make of a walk, once there is nothing left to ask."""
    best, stage = normal_cube_path(walk), SearchStage(STAGE)
    given: dict[str, Any] = {"own_ends": False, "budget": Budget(), **options}
    with SatWindows(where.system, where.start_state, best, **given, stage=stage) as windows:
        until = time.monotonic() + 60
        while not windows.settled:
            assert time.monotonic() < until
            better = windows.step(best)
            if better is None:
                continue
            assert (len(better), sum(map(len, better))) < (len(best), sum(map(len, best)))
            assert is_normal(better)
            assert end_state(better, where.start_state) == end_state(walk, where.start_state)
            best = better
    return best, stage


@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(spec, marks=pytest.mark.nightly if place % 3 else pytest.mark.thorough)
        for place, spec in enumerate(SYSTEMS)
    ],
)
def test_windows_alone_reach_the_optimum_of_short_paths(spec: str) -> None:
    """Once nothing is left to ask, no path is shorter: exhaustive search agrees."""
    where, walk = scene(spec), random_walk(spec, 40, seed=3)
    found, _ = settled(where, walk)
    steps = Transitions(where.system)
    ends = steps.encode(where.start_state), steps.encode(end_state(walk, where.start_state))
    exact = optimum(steps, *ends, max_states=200_000)
    assert exact.cubes is not None
    assert len(found) == len(exact.cubes)


@pytest.mark.thorough
@settings(max_examples=12)
@given(st.data())
def test_windows_never_make_a_path_worse(data: st.DataObject) -> None:
    """Each path on the way is better than the one before, normal, legal and to the same end."""
    where = scene(data.draw(st.sampled_from(SYSTEMS)))
    settled(where, data.draw(walks(where.spec, max_size=25)))


@pytest.mark.thorough
def test_vehicles_without_labels_keep_their_own_ends_if_they_must() -> None:
    """Each ends where the walk takes it, in fewer cubes."""
    where = scene("agv:graph=grid3x3,n=3")
    walk = random_walk(where.spec, 60, seed=2)
    found, stage = settled(where, walk, own_ends=True)
    path = [action for cube in found for action in cube]
    assert ends_of(path, where.start_state) == ends_of(walk, where.start_state)
    assert len(found) < len(normal_cube_path(walk))
    assert stage.steps > 0


def test_labels_are_put_on_moves_and_taken_off_again() -> None:
    """The labelled path is legal, ends as the plain one, and is the same without labels."""
    where = scene("agv:graph=grid3x3,n=4")
    walk = random_walk(where.spec, 50, seed=1)
    own = OwnEnds.of(where.system, walk, where.start_state)
    cubes = own.labelled(normal_cube_path(walk))
    assert end_state(cubes, own.start) == own.goal
    plain = own.plain([action for cube in cubes for action in cube])
    assert normal_cube_path(plain) == normal_cube_path(walk)


@pytest.mark.parametrize("spec", ["hex:n=4", "agv-labelled:graph=grid3x3,n=3", "triangulation:n=9"])
def test_a_shared_table_of_moves_gives_the_answers_of_one_of_its_own(spec: str) -> None:
    """Between states along a walk, whatever else the table has learned before."""
    where, walk = scene(spec), random_walk(spec, 12, seed=4)
    states = [frozenset(where.start_state)]
    for action in walk:
        states.append(frozenset(end_state([[action]], states[-1])))
    shared = MetMoves(where.system, (), states[0], states[-1])
    with SolverProcess() as solver:
        for first in (0, 5, 2):
            ends = states[first], states[first + 6]
            for rounds in (1, 2, 4):
                problems = [
                    encode(met, rounds)
                    for met in (shared.between(*ends), MetMoves(where.system, (), *ends))
                ]
                one, other = (
                    not each.impossible and solver.solve(each).satisfiable for each in problems
                )
                assert one == other


def test_without_the_library_the_search_goes_on_and_says_so(monkeypatch: Any) -> None:
    """The stage is noted as missing; the path is never worse."""
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "pysat" else find(name)
    )
    where = scene("hex:n=6")
    walk = random_walk(where.spec, 80, seed=3)
    task = PathTask(tuple(walk), frozenset(where.start_state), where.system)
    known = beyond(task, seconds=1.0, max_states=10)
    assert known.improved is not None
    assert known.improved <= len(normal_cube_path(walk))
    assert (known.spent[-1].name, known.spent[-1].steps) == (STAGE, 0)
    assert "left out without python-sat" in (known.spent[-1].why or "")


def test_bounded_by_steps_no_solver_takes_part() -> None:
    """Else the result would not be the same on every machine."""
    where = scene("hex:n=6")
    walk = random_walk(where.spec, 80, seed=3)
    task = PathTask(tuple(walk), frozenset(where.start_state), where.system)
    known = beyond(task, iterations=3, max_states=10)
    assert STAGE not in {stage.name for stage in known.spent}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="lists children by /proc")
def test_an_interrupt_leaves_no_solver_running() -> None:
    """Whether the search ends in time or by an interrupt, the process of the solver is gone."""
    where = scene("hex:n=8")
    walk = random_walk(where.spec, 300, seed=3)
    seen: set[int] = set()

    def interrupt(steps: int) -> None:
        seen.update(children() - before)
        if seen and steps > 20:
            raise KeyboardInterrupt

    before = children()
    with pytest.raises(KeyboardInterrupt):
        improve(walk, where.start_state, where.system, seconds=60, tick=interrupt)
    assert seen
    assert not children() & seen
    improve(walk, where.start_state, where.system, seconds=0.5)
    assert children() <= before


def children() -> set[int]:
    """Return the processes that this one has started and that are still there."""
    lists = Path("/proc/self/task").glob("*/children")
    return {int(child) for each in lists for child in each.read_text().split()}
