"""The non-local system: its scenes fail the link condition, and nothing that runs takes it."""

import json
import pickle
from collections import deque
from itertools import combinations
from pathlib import Path

import pytest

from cubepath.agents import parallel_env
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.complexes.links import unfilled
from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.cells import cells_of

SPECS = ["hex-connected", "hex-connected:scene=ring", "hex-connected:scene=hub"]
Pivot = tuple[Site, Site]


def beside(one: Site, other: Site) -> bool:
    """Two hexagons are neighbours iff their centres are as near as centres get."""
    (q, r), (s, t) = cells_of((one, other))
    return (q - s) ** 2 + (q - s) * (r - t) + (r - t) ** 2 == 1


def connected(state: State) -> bool:
    """Spread from one cell until nothing is added; all must then be there."""
    reached = {in_order(state)[0]}
    while True:
        more = {cell for cell in state for near in reached if beside(cell, near)} - reached
        if not more:
            return reached == state
        reached |= more


def pivots_at(scene: Scene, state: State) -> dict[Pivot, Action]:
    """Return the legal actions at a state by where the module goes from and to, in one way each."""
    found = {
        (move.source, move.target): move.action
        for site in in_order(state)
        for move in scene.system.moves(site)
        if move is not None and admissible(move.action, state)
    }
    return {pivot: action for pivot, action in found.items() if connected(apply(action, state))}


def after(state: State, actions: list[Action]) -> State:
    for action in actions:
        state = apply(action, state)
    return state


def failures(scene: Scene) -> set[frozenset[Pivot]]:
    """Return what is no cube at the start, of three moves or more, while all its parts are."""
    pivots = pivots_at(scene, scene.start_state)
    simplices = {frozenset({pivot}) for pivot in pivots}
    layer, missing = set(simplices), set()
    while layer:
        size = len(next(iter(layer))) + 1
        larger = {simplex | {pivot} for simplex in layer for pivot in pivots} - layer
        layer = set()
        for chosen in larger:
            if any(chosen - {pivot} not in simplices for pivot in chosen):
                continue
            actions = [pivots[pivot] for pivot in chosen]
            if size == 2 and not commute(*actions):
                continue
            if connected(after(scene.start_state, actions)):
                layer.add(chosen)
            elif size > 2:  # two moves that span no square are just not joined in the link
                missing.add(chosen)
        simplices |= layer
    return missing


def test_the_ring_fails_with_exactly_its_link_its_double_and_a_corner() -> None:
    """The link condition fails at the ring with 16 triples, and each is as the paper describes."""
    scene = scene_from_spec("hex-connected:scene=ring")
    assert len(scene.start) == 12
    state, pivots = scene.start_state, pivots_at(scene, scene.start_state)
    inwards = ((2, 0), (2, 1))
    outwards = [((3, -1), (3, -2)), ((3, -1), (4, -1))]
    corners = [pivot for pivot in pivots if pivot[0] in {(0, 0), (0, 3), (1, 3), (1, -1)}]
    assert len(corners) == 8
    witnesses = {frozenset({inwards, out, corner}) for out in outwards for corner in corners}
    for witness in witnesses:
        actions = [pivots[pivot] for pivot in witness]
        for number in (1, 2):
            for some in combinations(actions, number):
                assert connected(after(state, list(some)))
        assert all(commute(one, other) for one, other in combinations(actions, 2))
        assert not connected(after(state, actions))
    assert failures(scene) == witnesses
    found = {frozenset(actions) for actions in unfilled(scene, state)}
    assert found == {frozenset(pivots[pivot] for pivot in witness) for witness in witnesses}


def test_the_hub_is_cut_off_by_its_three_bridges() -> None:
    """Among the failures at the hub is the triple of its bridges, after which it stands alone."""
    scene = scene_from_spec("hex-connected:scene=hub")
    found = failures(scene)
    assert len(found) == 45
    bridges = (((0, 1), (0, 2)), ((-1, 0), (-2, 0)), ((1, -1), (2, -2)))
    assert frozenset(bridges) in found
    pivots = pivots_at(scene, scene.start_state)
    apart = after(scene.start_state, [pivots[pivot] for pivot in bridges])
    assert not any(beside((0, 0), cell) for cell in apart)
    assert connected(apart - {(0, 0)})


def test_a_chain_has_no_failure_at_its_start() -> None:
    """At a straight chain only the ends can move, and the link is flag."""
    assert failures(scene_from_spec("hex-connected:n=6")) == set()


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_the_chain_reaches_its_goal_through_connected_states(count: int) -> None:
    """The default scene's goal can be reached, and every state on the way is legal."""
    scene = scene_from_spec(f"hex-connected:n={count}")
    seen, queue = {scene.start_state}, deque([scene.start_state])
    while queue:
        state = queue.popleft()
        assert scene.system.legal(state)
        for action in pivots_at(scene, state).values():
            following = apply(action, state)
            if following not in seen:
                seen.add(following)
                queue.append(following)
    assert scene.goal in seen


def test_filled_obstacles_count_for_connectedness() -> None:
    """Two modules that only an obstacle joins are connected; without it they are not."""
    catalogue = page_catalogue("hexagons-2")
    floor = LatticeSystem(catalogue, filled=[(1, 0)], connected=True)
    assert Scene("floor", "", floor, start=((0, 0), (2, 0))).start_state == {(0, 0), (1, 0), (2, 0)}
    with pytest.raises(InputError, match="gap: the start breaks the rule for the whole aggregate"):
        Scene("gap", "", LatticeSystem(catalogue, connected=True), start=((0, 0), (2, 0)))
    assert LatticeSystem(catalogue).legal({(0, 0), (2, 0)})


@pytest.mark.parametrize("spec", SPECS)
def test_the_rule_outlives_files_and_pickling(spec: str) -> None:
    """Written as TOML, read back and pickled, the system is the same and still not local."""
    scene = scene_from_spec(spec)
    text = scene_to_toml(scene)
    assert "connected = true" in text
    for again in (scene_from_toml(text, "text"), pickle.loads(pickle.dumps(scene))):  # noqa: S301
        assert not again.system.local
        assert scene_to_toml(again) == text
        assert not again.system.legal({(0, 0), (2, 0)})


def test_a_shape_that_is_none_is_refused() -> None:
    """The scenes are named where another is asked for."""
    with pytest.raises(InputError, match="scene=disc: expected one of chain, ring, hub"):
        scene_from_spec("hex-connected:scene=disc")


def test_no_environment() -> None:
    """The environment refuses it in one line."""
    with pytest.raises(InputError, match=r"not a local system .* so it has no environment"):
        parallel_env("hex-connected")


@pytest.mark.parametrize(
    ("command", "what"),
    [(["run", "hex-connected"], "runs"), (["run", "SCENE"], "runs"), (["shorten"], "shortening")],
)
def test_run_and_shorten_refuse_it(
    command: list[str], what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line on standard error, exit code 2, and no recording or cubes; a file as well."""
    scene, moves = tmp_path / "scene.toml", tmp_path / "moves.jsonl"
    scene.write_text(scene_to_toml(scene_from_spec("hex-connected:scene=ring")))
    moves.write_text(json.dumps({"generator": "pivot-1-left", "at": [0, 0]}) + "\n")
    output = tmp_path / ("output.mcap" if command[0] == "run" else "output.jsonl")
    full = [str(scene) if part == "SCENE" else part for part in command]
    if command[0] == "run":
        full += ["--log", str(output)]
    else:
        full += [str(moves), "--system", "hex-connected", "-o", str(output)]
    assert main(full) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"has no {what}" in error
    assert not output.exists()


def test_the_ring_is_what_its_picture_shows() -> None:
    """Eleven modules in a ring, in order, each beside the next; the twelfth closes it again."""
    start = scene_from_spec("hex-connected:scene=ring").start
    ring, double = start[:11], start[11]
    assert all(beside(ring[number], ring[(number + 1) % 11]) for number in range(11))
    assert {cell for cell in ring if beside(cell, double)} == {(3, 0), (2, 0), (2, -1)}
