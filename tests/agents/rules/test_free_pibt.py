"""The rule pibt without rounds: the same promise as with them, and it fails in one line."""

import pytest
from hypothesis import given, settings

from cubepath.agents.environments.free_world import ActionResult, FreeWorld
from cubepath.agents.rules.pibt import PIBT
from cubepath.agents.rules.pibt_free import AT_GOAL, PushRegister, patience
from cubepath.protocol.core.system import Scene
from samples.free_plays import Pace, paces
from samples.vehicle_scenes import labelled_scene_on, random_labelled_scene, without_cut_vertices


class Kept(Exception):  # noqa: N818 - no error: it ends a play
    """Everybody has been at its goal."""


def check_promise(scene: Scene, pace: Pace) -> None:
    """Check that every vehicle is at its goal at some time, though not all at one time."""
    goals = [(known[0], label) for label, known in enumerate(scene.goals)]
    missing = {label for label, goal in enumerate(goals) if scene.start[label] != goal}

    def watch(world: FreeWorld, acted: ActionResult) -> None:
        del acted
        missing.difference_update([each for each in missing if world.sites[each] == goals[each]])
        if not missing:
            raise Kept

    if missing:
        with pytest.raises(Kept):
            pace.play(scene, PIBT, watch=watch)


@pytest.mark.slow
@settings(max_examples=8, derandomize=True)
@given(without_cut_vertices(), paces())
def test_each_gets_to_its_goal_where_no_vertex_cuts(scene: Scene, pace: Pace) -> None:
    """With one empty vertex and no cut vertex everybody is at its goal at some time."""
    check_promise(scene, pace)


@pytest.mark.nightly
@settings(max_examples=120, derandomize=True)
@given(without_cut_vertices(), paces())
def test_each_gets_to_its_goal_in_many_more_instances(scene: Scene, pace: Pace) -> None:
    """The same, on many more."""
    check_promise(scene, pace)


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("graph", "vehicles"), [("K5", 4), ("grid3x3", 4), ("grid4x4", 6), ("grid8x8", 12)]
)
@pytest.mark.parametrize("scheduler", ["random", "unfair", "turns"])
def test_roomy_graphs_are_reached(graph: str, vehicles: int, scheduler: str) -> None:
    """Where there is room all vehicles get to their goals, and none gives up."""
    for seed in range(2):
        pace = Pace(scheduler, seed=seed, lag=(0, 5)[seed % 2], restarts=((20, seed), (60, seed)))
        played = pace.play(random_labelled_scene(graph, vehicles, seed), PIBT)
        assert played.failed is None
        assert played.reached


def test_a_row_is_pushed_back_from_its_end() -> None:
    """The strongest pushes a whole row, and the last of the row goes first."""
    row = [(vertex - 1, vertex) for vertex in range(1, 9)]
    played = Pace("turns").play(labelled_scene_on(row, [0, 1, 2, 3], [3, 4, 5, 6]), PIBT)
    assert played.reached
    assert played.moves[0].motion[0][0] == 3


@pytest.mark.thorough
def test_who_is_full_gives_up_in_the_end() -> None:
    """Two that want to pass on a path cannot: somebody says so in one line."""
    row = [(0, 1), (1, 2)]
    played = Pace("turns").play(labelled_scene_on(row, [0, 2], [2, 0]), PIBT)
    assert played.failed is not None
    assert f"more than {patience(3)} moves for the goal" in played.failed


def test_a_vehicle_without_a_way_gives_up() -> None:
    """In one line, in its first turn."""
    played = Pace().play(labelled_scene_on([(0, 1), (2, 3)], [0], [3]), PIBT)
    assert played.failed == "module_0: no way from 0 to the goal 3"


def test_whoever_leaves_its_goal_is_weaker_than_all_it_knew_of() -> None:
    """Times only grow, and go past those within reach."""
    scene = random_labelled_scene("grid4x4", 6, 1)
    times: dict[int, int] = {}

    def watch(world: FreeWorld, acted: ActionResult) -> None:
        if acted.moved is None or not world.registers[acted.module]:
            return
        time = PushRegister(*world.registers[acted.module]).time
        assert time >= times.get(acted.module, 0)
        times[acted.module] = time
        goal = scene.goals[acted.module][0], acted.module
        said = PushRegister(*world.registers[acted.module])
        if world.sites[acted.module] == goal and said.key_vehicle == acted.module:
            assert said.key_time == AT_GOAL

    Pace("random", seed=5).play(scene, PIBT, watch=watch)
    assert times
