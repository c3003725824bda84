"""Plans for hexagons by way of chains: every move again, with all that must hold after it."""

from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.search import hexagon_plan as planning
from cubepath.coordinator.theory.search.hexagon_plan import hexagon_plan
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.path_lines import write_moves
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.cells import Cell

PLANE = LatticeSystem(page_catalogue("hexagons-3"), connected=True)
RING: set[Cell] = {
    (q, r) for q in range(-3, 4) for r in range(-3, 4) if max(abs(q), abs(r), abs(q + r)) == 3
}
HOOK = RING - {(3, -1)} | {(2, -1)}
HOOKS = HOOK | {(6 - q, -r) for q, r in HOOK}
"""Two rings that are open beside their common corner, each with an end that is turned inwards.

All modules are links of one path, so only its two ends can leave it, and these are shut in: the
opening is too narrow for a pivot, and a monkey move leads past it.
"""


def task(start: set[Cell], goal: set[Cell]) -> Scene:
    ends = tuple(sorted(start)), tuple(sorted(goal))
    system = LatticeSystem(page_catalogue("hexagons-3"))
    return Scene("task", "", system, ends[0], frozenset(ends[1]), (ends[1],) * len(start))


def chain(count: int, first: Cell = (0, 0)) -> set[Cell]:
    return {(first[0] + step, first[1]) for step in range(count)}


def carried_out(plan: list[PathMove], scene: Scene) -> int:
    """Make each move; return how many there are, and fail where something does not hold."""
    state: frozenset[Site] = scene.start_state
    for move in plan:
        assert move.before == move.action.support & state
        state = apply(move.action, state)
        assert PLANE.legal(state)
    assert state == scene.goal
    return len(plan)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    "size",
    [
        *(2, 3, 6),
        *(pytest.param(size, marks=pytest.mark.slow) for size in (11, 18)),
        pytest.param(30, marks=pytest.mark.nightly),
    ],
)
def test_plans_lead_to_the_goal(size: int, seed: int) -> None:
    """Each move can be made and keeps the aggregate connected; there are at most 4 n^2 of them."""
    scene = scene_from_spec(f"hex-shapes:n={size},catalogue=3,box={size + 4},seed={seed}")
    assert carried_out(hexagon_plan(scene), scene) <= 4 * size**2


@pytest.mark.slow
@pytest.mark.parametrize("first", [(q, r) for q in (-7, 0, 7) for r in (-9, -1, 0, 1, 9)])
def test_the_goal_can_be_anywhere(first: Cell) -> None:
    """Above, below and beside the start, and over it."""
    start = {(0, 0), (0, 1), (1, 1), (2, 0), (2, -1)}
    scene = task(start, {(first[0] + r, first[1] + q) for q, r in start})
    carried_out(hexagon_plan(scene), scene)


@pytest.mark.slow
def test_ends_that_are_shut_in_come_free() -> None:
    """No module can reach the chain, until an end has walked to where it closes the ring."""
    scene = task(HOOKS, chain(len(HOOKS)))
    loose = [cell for cell in sorted(HOOKS) if PLANE.legal(HOOKS - {cell})]
    assert loose == [(2, -1), (4, 1)]
    carried_out(hexagon_plan(scene), scene)


def test_the_search_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the number of shapes that is set."""
    monkeypatch.setattr(planning, "_SHAPES", 1)
    with pytest.raises(CheckError, match=r"no module came free for \(.*\) in 1 shapes"):
        hexagon_plan(task(HOOKS, chain(len(HOOKS))))


@pytest.mark.slow
def test_a_plan_is_carried_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written as moves and shortened, it is a schedule of a run."""
    monkeypatch.chdir(tmp_path)
    spec = "hex-shapes:n=6,catalogue=3,box=9"
    write_moves("plan.jsonl", hexagon_plan(scene_from_spec(spec)))
    assert main(["shorten", "plan.jsonl", "--system", spec, "-o", "cubes.jsonl"]) == 0
    assert main(["run", spec, "--schedule", "cubes.jsonl", "--processes", "0"]) == 0
    assert "goal           reached" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hex-shapes:n=4", r"expected hexagons with monkey moves \(catalogue=3\)"),
        ("agv:graph=K4,n=2", "expected hexagons with monkey moves"),
        ("arm:n=4", "expected hexagons with monkey moves"),
        ("hex-shapes:n=4,catalogue=3,density=0.3", "expected a goal, and no obstacles"),
        ("hex-shapes:n=7,catalogue=3,walk=200,seed=1", "the goal is not connected"),
        ("hex-shapes:n=12,catalogue=3,box=4", "no room for a chain at .*, expected a wider box"),
    ],
)
def test_what_has_no_plan_is_refused(spec: str, message: str) -> None:
    """In one line, which says what is missing."""
    with pytest.raises(InputError, match=message):
        hexagon_plan(scene_from_spec(spec))
