"""The standard instances: every value is computed again, where it can be in two ways."""

from pathlib import Path

import pytest

from cubepath.agents.environments.rollouts import play_in_python
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.instances import FOLDER, StandardInstance, standard
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask
from cubepath.coordinator.theory.proof_checking.optimality import check_optimality
from cubepath.coordinator.theory.satisfiability.proving import SEARCH
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.coordinator.theory.search.lower_bounds import lower_bound
from cubepath.protocol.path_files.optimality_proofs import read_proof
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from marked import some
from standards import EXHAUSTIVE, bound_of, cubes_on_file, goal_of, rounds_in_the_complex, searched

QUICK = {
    "hex-4",
    "hex-tunnel-4",
    "sliding-2",
    "agv-cycle-5",
    "labelled-complete-4",
    "labelled-corridor-4",
    "arm-5",
    "polygon-9",
    "triangulation-grid-9",
    "words-6",
    "assembly-6",
}
"""Computed again every time, all others when there is time."""
PROVED_QUICKLY = {"hex-4", "sliding-2", "words-6"}
"""Of these, whose bounds are proved again every time."""
ALL = {instance.name: instance for instance in standard()}
STATES_MAX = 10_000
SMALL = [
    "hex-base-5",
    "hex-tunnel-4",
    "hex-tunnel-10",
    "sliding-2",
    "sliding-4",
    "sliding-shapes-6",
    "agv-grid-6",
    "agv-cycle-5",
    "labelled-corridor-4",
    "labelled-complete-4",
    "labelled-grid-4",
    "arm-5",
    "arm-12",
    "arm-free-6",
    "arms-2",
    "polygon-9",
    "triangulation-grid-9",
    "words-6",
    "assembly-6",
    "assembly-10",
]
"""Those whose state complex is finite, with at most so many states."""


def test_the_folder_holds_the_instances_and_nothing_else() -> None:
    """Each has a name of its own and a schedule; each file is some instance's; all are small."""
    assert len(ALL) == len(standard()) >= 40
    assert ALL.keys() >= QUICK
    files = {each.schedule.name for each in standard()} | {"standard.toml"}
    files |= {f"{each.name}.toml" for each in standard() if each.system.endswith(".toml")}
    assert {path.name for path in FOLDER.iterdir()} == files
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 200_000


def test_every_family_with_a_goal_that_runs_has_instances() -> None:
    """And each rule that moves towards a goal has several sizes to be compared by."""
    scenes = [scene_from_spec(each.system) for each in standard()]
    runs = [name for name, family in all_families().items() if family.rule]
    families = {name for name in runs if scene_from_spec(name).goal is not None}
    assert {scene.family for scene in scenes} == families
    for rule in ("chain", "tswap", "pibt", "word"):
        mine = [s for s in scenes if all_families()[s.family].rule == rule]
        assert len({len(scene.start) for scene in mine}) >= 3
    assert not [scene.spec for scene in scenes if scene.reached(scene.start)]


@pytest.mark.slow
def test_every_schedule_attains_the_best_known_value() -> None:
    """From the file: cubes that commute and are admissible in turn, to the goal, and as few."""
    for instance in standard():
        scene = scene_from_spec(instance.system)
        cubes = cubes_on_file(instance)
        actions = [action for cube in cubes for action in cube]
        assert end_state(cubes, scene.start_state) == goal_of(scene), instance.name
        assert (len(cubes), len(actions)) == (instance.best, instance.moves)
        assert instance.bound <= instance.best
        assert instance.proved == (instance.bound == instance.best)


BY_SOLVERS = {
    each.name for each in standard() if each.how.endswith(f"improve --prove; bound: {SEARCH}")
}
"""Whose bounds only SAT solvers know."""
LONG = {"hex-12", "hex-slide-12"}
"""Whose bounds take SAT solvers minutes."""


@pytest.mark.slow
@pytest.mark.parametrize("name", some(sorted(ALL.keys() - BY_SOLVERS), QUICK & PROVED_QUICKLY))
def test_bounds_are_proved_again(name: str) -> None:
    """By exhaustive search where that ends, and then by no other search or bound contradicted."""
    instance = ALL[name]
    scene = scene_from_spec(instance.system)
    if instance.how == EXHAUSTIVE:
        at_least, cubes = searched(scene)
        assert cubes is not None
        assert instance.best == instance.bound == at_least == len(cubes)
    else:
        bound = bound_of(scene, instance.best)
        assert bound.cubes == instance.bound
        assert instance.how.endswith(f"; bound: {bound.why}")
    # What holds by other arguments and other searches.
    start, goal = scene.start_state, goal_of(scene)
    assert lower_bound(scene.system, start, goal, within=99).cubes <= instance.best
    path = [action for cube in cubes_on_file(instance) for action in cube]
    better = improve(path, start, scene.system, iterations=10, seed=len(name))
    assert better.cubes >= instance.bound
    assert better.cubes == instance.best


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(BY_SOLVERS - LONG))
def test_bounds_of_solvers_are_proved_again(name: str, tmp_path: Path) -> None:
    """By a solver from the schedule on file on, and its proof is checked by code of its own."""
    instance = ALL[name]
    scene = scene_from_spec(instance.system)
    path = [action for cube in cubes_on_file(instance) for action in cube]
    file = tmp_path / "a.proof"
    found = beyond(
        PathTask(path, scene.start_state, scene.system), max_states=1, prove=600, proof=file
    )
    assert found.optimal
    assert found.lower_bound == found.improved == instance.best == instance.bound
    assert check_optimality(read_proof(file)).optimal


@pytest.mark.parametrize("name", sorted(BY_SOLVERS))
def test_bounds_of_solvers_contradict_no_others(name: str) -> None:
    """They are greater than those that take no solver, and all of them at most the best known."""
    instance = ALL[name]
    scene = scene_from_spec(instance.system)
    other = lower_bound(scene.system, scene.start_state, goal_of(scene), within=99)
    assert other.cubes < instance.bound <= instance.best


@pytest.mark.slow
@pytest.mark.parametrize("name", some(SMALL, QUICK - {"words-6"}))
def test_every_small_optimum_is_that_of_the_state_complex(name: str) -> None:
    """By steps from corner to opposite corner of cubes: no search, and none of its code."""
    instance = ALL[name]
    found = rounds_in_the_complex(scene_from_spec(instance.system), STATES_MAX)
    assert found == instance.best == instance.bound


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.thorough if name in QUICK else pytest.mark.nightly)
        for name in ALL
    ],
)
def test_every_schedule_can_be_carried_out(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: object
) -> None:
    """By the modules of the scene, cube by cube, to the goal."""
    instance = ALL[name]
    words = ["run", instance.system, "--schedule", str(instance.schedule), "--processes", "0"]
    assert main([*words, "--log", f"{tmp_path}/run.mcap"]) == 0
    table = dict(line.split(None, 1) for line in capsys.readouterr().out.splitlines() if line)
    assert table["goal"].strip() == "reached"
    assert int(table["rounds"]) == instance.best


@pytest.mark.parametrize("name", ["hex-6", "agv-grid-6", "labelled-grid-4", "arm-12"])
def test_no_rule_is_better_than_what_is_proved(name: str) -> None:
    """The rule of the family reaches the goal, in at least as many rounds; `word` in as many."""
    instance = ALL[name]
    scene = scene_from_spec(instance.system)
    rule = rule_named(all_families()[scene.family].rule, scene.system)
    run = play_in_python(scene, rule, seed=1, hesitate=0.0, max_rounds=500)
    assert run.reached
    assert len(run.rounds) >= instance.best
    assert (len(run.rounds) == instance.best) == (rule.name == "word")


def test_an_instance_without_a_proof_says_so() -> None:
    """Its best known value exceeds its bound."""
    found = [each for each in standard() if not each.proved]
    assert [each.name for each in found] == ["hex-12"]
    assert all(isinstance(each, StandardInstance) and each.best > each.bound for each in found)
