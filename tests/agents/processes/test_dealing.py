"""Which modules each process has."""

from dataclasses import replace
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given, strategies as st

from cubepath.agents.processes.dealing import dealt
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graph import GraphSystem

GRID = scene_from_spec("agv:graph=grid8x8,n=64")


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Draw some vehicles anywhere on a grid, in any order."""
    vertices = draw(st.lists(st.sampled_from(GRID.start), unique=True, min_size=1, max_size=64))
    return replace(GRID, start=tuple(vertices), goal=None, goals=())


@given(scenes(), st.integers(1, 80))
def test_every_module_is_in_one_process_and_processes_are_equal_within_one(
    scene: Scene, processes: int
) -> None:
    """No module is left out or doubled; no process is empty or larger by more than one."""
    parts = dealt(scene, processes)
    assert sorted(module for part in parts for module in part) == list(range(len(scene.start)))
    assert len(parts) == min(processes, len(scene.start))
    sizes = {len(part) for part in parts}
    assert max(sizes) - min(sizes) <= 1
    assert all(part == sorted(part) for part in parts)


@given(scenes(), st.integers(1, 80), st.randoms(use_true_random=False))
def test_it_depends_on_places_alone(scene: Scene, processes: int, random: object) -> None:
    """The same scene is dealt alike each time; numbered otherwise, the same places go together."""
    assert dealt(scene, processes) == dealt(scene, processes)
    start = list(scene.start)
    random.shuffle(start)  # type: ignore[attr-defined]
    other = replace(scene, start=tuple(start))

    def places(one: Scene) -> list[list[object]]:
        return [sorted(one.start[module] for module in part) for part in dealt(one, processes)]  # type: ignore[type-var]

    assert places(scene) == places(other)


@pytest.mark.parametrize("spec", ["hex:n=12", "arm:n=9", "polygon:n=9", "words"])
def test_a_chain_is_cut_into_pieces_of_neighbours(spec: str) -> None:
    """The modules of a process follow each other in the chain."""
    scene = scene_from_spec(spec)
    for processes in (2, 3, 4):
        for part in dealt(scene, processes):
            assert all(other == one + 1 for one, other in pairwise(part))


def test_a_grid_is_cut_into_blocks() -> None:
    """Four processes get a quarter each, and eight half a quarter each."""
    for processes, sides in ((4, [3, 3]), (8, [1, 3])):
        for part in dealt(GRID, processes):
            xs, ys = zip(*(GRID.start[module] for module in part), strict=True)
            assert sorted((max(xs) - min(xs), max(ys) - min(ys))) == sides


def test_vertices_without_coordinates_are_dealt_by_number() -> None:
    """On a graph without places neighbours in the canonical order go together."""
    scene = scene_from_spec("agv:graph=C8,n=8")
    assert dealt(scene, 3) == [[0, 1], [2, 3, 4], [5, 6, 7]]


def test_vertices_of_every_form_are_dealt() -> None:
    """Some have coordinates, some are names, some a name with a number."""
    start = ((0, 0), (0, 1), "a", ("a", 0))
    system = GraphSystem(start, [*pairwise(start)])
    scene = replace(GRID, system=system, start=start, goal=None, goals=())
    for processes in (1, 2, 4):
        parts = dealt(scene, processes)
        assert len(parts) == processes
        assert sorted(module for part in parts for module in part) == [0, 1, 2, 3]


@given(scenes(), st.integers(1, 80), st.randoms(use_true_random=False))
def test_some_modules_are_dealt_out_alone(scene: Scene, processes: int, random: Random) -> None:
    """Those that others have left; none at all are no process."""
    count = random.randint(0, len(scene.start))
    left = sorted(random.sample(range(len(scene.start)), count))
    parts = dealt(scene, processes, left)
    assert sorted(module for part in parts for module in part) == left
    assert len(parts) == min(processes, len(left))
    assert all(parts)
