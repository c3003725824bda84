"""One run in three cores: the same path, and what is measured of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.environments.rollouts import Rollouts, play_in_python, play_many
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.experiments import compiled_core
from cubepath.coordinator.experiments.batch_runs import play_batch
from cubepath.coordinator.experiments.rows import FinishedRun
from cubepath.coordinator.experiments.setting import FaultRates
from cubepath.coordinator.experiments.spec import Sweep, expand
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

DIFFER = {"core", "processes", "messages", "time", "seconds", "id", "configuration"}
"""Columns in which the same run in two cores may differ."""


def runs(system: str, rule: str, **given: Any) -> list[FinishedRun]:
    """Play the runs of one setting."""
    more: dict[str, Any] = {"seeds": (1, 4), "max_rounds": 40} | given
    sweep = Sweep((system,), rules=(rule,), **more)
    return [each for batch in expand(sweep).batches for each in play_batch(batch)]


def same(one: FinishedRun, other: FinishedRun) -> bool:
    """Return whether two runs are alike in all that must be."""
    kept = [{key: run.run[key] for key in run.run.keys() - DIFFER} for run in (one, other)]
    rounds = [[row | {"id": ""} for row in run.round_rows()] for run in (one, other)]
    return kept[0] == kept[1] and rounds[0] == rounds[1] and bool(rounds[0])


def in_arrays(system: str, rule: str, **given: Any) -> list[FinishedRun]:
    """Play the runs of one setting side by side in arrays, however few they are."""
    played: list[int] = []

    def noted(*args: Any, **more: Any) -> Rollouts:
        played.append(len(args[2]))
        return play_many(*args, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_core, "_FEW", 0)
        patch.setattr(compiled_core, "play_many", noted)
        found = runs(system, rule, **given)
    plain = rule_named(rule, scene_from_spec(system).system).vectorised is None
    assert sum(played) == (0 if plain else len(found))
    return found


SCENES = [
    ("hex:n=5", "chain", 0.3),
    ("hex-open:n=5", "random", 0.2),
    ("agv:n=3", "tswap", 0.2),
    ("agv-labelled:graph=grid3x3,n=3", "pibt", 0.3),
    ("arm:n=4", "word", 0.4),
    ("polygon:n=6", "random", 0.1),
]


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize(("system", "rule", "hesitate"), SCENES)
def test_compiled_and_simulated_runs_are_the_same(system: str, rule: str, hesitate: float) -> None:
    """Path, digest, lost claims and all else but messages and time, also when modules hesitate."""
    compiled = runs(system, rule, hesitate=(hesitate,))
    many = in_arrays(system, rule, hesitate=(hesitate,))
    simulated = runs(system, rule, hesitate=(hesitate,), core="simulated", processes=3)
    for one, two, other in zip(compiled, many, simulated, strict=True):
        assert same(one, two)
        assert same(one, other)
        assert (one.run["messages"], other.run["messages"] > 0) == (None, True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "rule", "hesitate"),
    [SCENES[0], pytest.param(*SCENES[3], marks=pytest.mark.thorough)],
)
def test_runs_over_the_wire_are_the_same(system: str, rule: str, hesitate: float) -> None:
    """Real processes make the moves that the compiled core makes."""
    given: dict[str, Any] = {"hesitate": (hesitate,), "seeds": (4,)}
    (wire,) = runs(system, rule, core="wire", processes=2, **given)
    (compiled,) = runs(system, rule, **given)
    assert same(wire, compiled)
    assert wire.run["messages"] > 0


@pytest.mark.slow
def test_without_rounds_nothing_is_played_in_any_core() -> None:
    """A run that may have no round ends where it starts, as after all its rounds."""
    given: dict[str, Any] = {"seeds": (4,), "max_rounds": 0}
    (compiled,) = runs("hex:n=4", "chain", **given)
    (simulated,) = runs("hex:n=4", "chain", core="simulated", **given)
    (wire,) = runs("hex:n=4", "chain", core="wire", processes=2, **given)
    found = [
        {key: each.run[key] for key in each.run.keys() - DIFFER}
        for each in (compiled, simulated, wire)
    ]
    assert found[0] == found[1] == found[2]
    assert (found[0]["ended"], found[0]["rounds"], found[0]["moves"]) == ("max-rounds", 0, 0)


def test_many_seeds_in_compiled_code_are_the_runs_of_each() -> None:
    """Together they are so many that compiled code is worth its loading."""
    together = in_arrays("hex:n=5", "chain", hesitate=(0.3,), seeds=tuple(range(50)))
    alone = runs("hex:n=5", "chain", hesitate=(0.3,), seeds=(7, 31))
    assert same(together[7], alone[0])
    assert same(together[31], alone[1])


def test_many_small_runs_come_to_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once all batches together are worth it, also amid one; each run is the same."""
    plain = runs("hex:n=4", "chain", seeds=tuple(range(60)))
    sizes: list[int] = []

    def noted(*args: Any, **more: Any) -> Rollouts:
        sizes.append(len(args[2]))
        return play_many(*args, **more)

    monkeypatch.setattr(compiled_core, "play_many", noted)
    monkeypatch.setattr(compiled_core, "_done_in_python", compiled_core._DoneInPython())
    monkeypatch.setattr(compiled_core, "_LOADING_STEPS", 35 * 14 * 4)
    monkeypatch.setattr(compiled_core, "_COMPILING_STEPS", 0)
    found = runs("hex:n=4", "chain", seeds=tuple(range(60)))
    assert all(same(one, other) for one, other in zip(plain, found, strict=True))
    assert sizes == [15, 10]


def test_what_is_measured_is_what_the_rounds_say() -> None:
    """Counts, the normal cube path by the reference heap, how many sites of the goal are off."""
    scene = scene_from_spec("agv:n=3")
    rule = rule_named("random", scene.system)
    played = play_in_python(scene, rule, seed=4, hesitate=0.0, max_rounds=40)
    (found,) = runs("agv:n=3", "random", seeds=(4,))
    heap = Heap()
    state, missing = set(scene.start), []
    for each in played.rounds:
        for move in each.moves.values():
            heap.append(move.action)
            state = (state - {site for site, _ in move.motion}) | {site for _, site in move.motion}
        missing.append(len((scene.goal or frozenset()) - state))
    run = found.run
    assert (run["rounds"], run["cubes"]) == (len(played.rounds), heap.cubes)
    assert (run["reduced"], run["largest_cube"]) == (heap.reduced_moves, heap.max_cube_dimension)
    assert run["conflicts"] == sum(len(each.lost) for each in played.rounds)
    assert [row["moves"] for row in found.round_rows()] == [len(r.moves) for r in played.rounds]
    assert [row["conflicts"] for row in found.round_rows()] == [len(r.lost) for r in played.rounds]
    assert [row["missing"] for row in found.round_rows()] == missing


@pytest.mark.parametrize(("system", "rule", "_"), SCENES)
def test_the_distance_is_zero_at_the_goal_alone(system: str, rule: str, _: float) -> None:
    """As is the number of sites of it that are off; a lower bound is no more than the cubes."""
    (found,) = runs(system, rule, seeds=(2,), max_rounds=60)
    rounds = found.round_rows()
    assert all((row["distance"] == 0) == (row["missing"] == 0) for row in rounds)
    assert found.run["goal"] == (rounds[-1]["missing"] == 0)
    assert not found.run["goal"] or 0 < found.run["bound"] <= found.run["cubes"]


def test_the_optimum_is_looked_for_if_asked() -> None:
    """It is proved by a search that keeps so many states; with too few there is a bound alone."""
    (found,) = runs("hex:n=5", "chain", seeds=(0,), optimum=20_000)
    assert (found.run["bound"], found.run["optimum"]) == (13, 13)
    (found,) = runs("hex:n=5", "chain", seeds=(0,), optimum=3)
    assert found.run["optimum"] is None


@pytest.mark.parametrize("core", ["compiled", pytest.param("simulated", marks=pytest.mark.slow)])
def test_runs_without_rounds(core: str) -> None:
    """They have levels in the place of rounds; slow modules take more time and reach the goal."""
    given: dict[str, Any] = {"clocks": ("free",), "core": core, "seeds": (3,), "max_rounds": 300}
    (plain,) = runs("hex:n=4", "chain", **given)
    (slow,) = runs("hex:n=4", "chain", faults=(FaultRates(slow=0.5, slow_factor=20),), **given)
    for found in (plain, slow):
        assert (found.run["ended"], found.run["goal"]) == ("goal", True)
        assert found.run["rounds"] == len(found.round_rows()) >= found.run["cubes"]
        assert found.round_rows()[-1]["distance"] == 0
    assert slow.run["time"] > 3 * plain.run["time"]


@pytest.mark.slow
def test_modules_think_where_some_are_slow() -> None:
    """Also if the share comes to nobody; and what takes too long ends, with a line on that."""
    given: dict[str, Any] = {"clocks": ("free",), "core": "simulated", "seeds": (3,)}
    asked = [FaultRates(), FaultRates(slow=0.1), FaultRates(slow=1.0, slow_factor=1)]
    plain, nobody, all_alike = (
        runs("hex:n=3", "chain", faults=(rates,), **given)[0] for rates in asked
    )
    for column in ("digest", "time", "messages"):
        assert nobody.run[column] == all_alike.run[column]
    assert nobody.run["time"] > plain.run["time"]
    (late,) = runs("hex:n=3", "chain", faults=(FaultRates(slow=1.0, slow_factor=5000),), **given)
    assert (late.run["goal"], late.run["ended"]) == (False, "max-rounds")
    assert late.run["reason"] == "no end within 120 virtual seconds"


def test_with_rounds_all_wait_for_the_slow() -> None:
    """The path is the same, and it takes so many times longer."""
    (plain,) = runs("hex:n=4", "chain", seeds=(3,))
    (slow,) = runs("hex:n=4", "chain", seeds=(3,), faults=(FaultRates(slow=0.5, slow_factor=20),))
    assert slow.run["digest"] == plain.run["digest"]
    assert slow.run["time"] == 20 * plain.run["time"] == 20 * plain.run["rounds"]


@pytest.mark.slow
def test_lost_messages_cost_time_and_change_nothing() -> None:
    """With rounds; the same seed has the same faults."""
    (plain,) = runs("hex:n=4", "chain", core="simulated", seeds=(3,))
    lossy = [
        runs("hex:n=4", "chain", faults=(FaultRates(loss=0.1),), seeds=(3,))[0] for _ in range(2)
    ]
    assert replaced(lossy[0]) == replaced(lossy[1])
    assert lossy[0].run["digest"] == plain.run["digest"]
    assert lossy[0].run["time"] > 10 * plain.run["time"]


def replaced(found: FinishedRun) -> dict[str, Any]:
    """Return the row of a run without the seconds it took."""
    return found.run | {"seconds": 0}


@pytest.mark.slow
def test_a_crash_ends_a_run_with_rounds_alone() -> None:
    """It is a fault, which the reason names, and no failure of the code."""
    faults = (FaultRates(crash=0.05),)
    (found,) = runs("hex:n=4", "chain", faults=faults, seeds=(3,))
    assert (found.run["ended"], found.failed) == ("fault", False)
    assert "died" in found.run["reason"]
    (found,) = runs("hex:n=4", "chain", faults=faults, seeds=(3,), clocks=("free",))
    assert found.run["ended"] == "goal"


def test_how_a_run_ends_without_its_goal(tmp_path: Path) -> None:
    """After all its rounds it is stuck; so it is where no move is admissible any more."""
    (found,) = runs("hex:n=5", "random", seeds=(0,), max_rounds=3)
    assert (found.run["ended"], found.run["stuck"]) == ("max-rounds", True)
    scene = scene_from_spec("hex:n=5")
    (tmp_path / "aimless.toml").write_text(scene_to_toml(replace(scene, goal=None, goals=())))
    (found,) = runs(str(tmp_path / "aimless.toml"), "random", seeds=(0,), max_rounds=3)
    assert (found.run["ended"], found.run["stuck"]) == ("max-rounds", False)
    assert {row["missing"] for row in found.round_rows()} == {None}
    goal = frozenset({(0, 1), (0, 2)})
    alone = replace(scene, start=((0, 0), (5, 5)), goal=goal, goals=())
    (tmp_path / "alone.toml").write_text(scene_to_toml(alone))
    (found,) = runs(str(tmp_path / "alone.toml"), "random", seeds=(0,), max_rounds=3)
    assert (found.run["ended"], found.run["stuck"]) == ("blocked", True)
    assert found.run["last_move"] == 0


def test_a_run_of_other_code_is_refused() -> None:
    """A worker with another version says so in a row, and plays nothing."""
    (batch,) = expand(Sweep(("hex:n=4",), seeds=(0,))).batches
    (found,) = play_batch(replace(batch, code="0.0.1+abc"))
    assert found.run["ended"] == "prevented"
    assert "expected 0.0.1+abc" in found.run["reason"]
