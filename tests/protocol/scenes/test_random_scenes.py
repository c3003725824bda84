"""Random scenes: one seed names one scene everywhere, in every form; what cannot be is refused."""

import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from cubepath.agents.environments.rollouts import play_in_python
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, to_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.random_scenes import Stream, random_triangulation
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.point_sets import Triangles

PINNED = {
    "hex-shapes:n=8,seed=5": "23d3999e074f",
    "hex-shapes:n=20,seed=2,how=growth,density=0.1,catalogue=2": "f28a7dfb3475",
    "hex-shapes:n=7,seed=3,walk=25,density=0.05": "8abb10cd10c8",
    "sliding-shapes:n=6,seed=4": "b7ea0f062a74",
    "sliding-shapes:n=5,seed=1,density=0.2,walk=12": "098c52734dd8",
    "agv:graph=grid8x8,n=9,seed=6,open=0.8": "364a6ab04053",
    "agv:graph=tree12,n=4,seed=1": "5d45c5dc01a9",
    "agv:graph=gnp12x0.3,n=4,seed=2": "de9e6075c4af",
    "agv-labelled:graph=regular10x3,n=4,seed=3": "6a897858adf6",
    "agv-labelled:graph=grid4x4,n=5,seed=0,walk=30": "089dd568f89a",
    "triangulation:n=10,seed=2": "304256533848",
    "triangulation:n=10,seed=2,start=random,goal=random": "d2af9d274bc7",
    "triangulation:n=10,seed=2,start=random,walk=8": "08ba30f6726c",
}
"""What some specs have meant since random scenes exist, as digests."""


def digest(scene: Scene) -> str:
    """Return a short digest of all that is random in a scene."""
    system = scene.system
    goal: tuple[Site, ...] = in_order(scene.goal or ())
    drawn: list[object] = [to_json(scene.start), to_json(goal), to_json(in_order(system.filled))]
    if isinstance(system, GraphSystem):
        drawn.append(to_json(system.edges))
    if isinstance(system, FlipSystem):
        drawn.append(to_json(system.plane.points))
    return sha256(repr(drawn).encode()).hexdigest()[:12]


@pytest.mark.parametrize("spec", PINNED)
def test_a_seed_names_the_same_scene_for_good(spec: str) -> None:
    """The digests were written down when the keys came."""
    assert digest(scene_from_spec(spec)) == PINNED[spec]


@pytest.mark.slow
def test_a_seed_names_the_same_scene_in_another_process() -> None:
    """Texts are hashed otherwise there, and sets of them in another order."""
    program = (
        "import sys\n"
        "from cubepath.protocol import scene_from_spec, scene_to_toml\n"
        "for spec in sys.argv[1:]: print(scene_to_toml(scene_from_spec(spec)))\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", program, *PINNED],
        env={**os.environ, "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout == "".join(f"{scene_to_toml(scene_from_spec(spec))}\n" for spec in PINNED)


@pytest.mark.parametrize("spec", PINNED)
def test_a_random_scene_is_the_same_after_a_file(spec: str, tmp_path: Path) -> None:
    """Written as TOML and read back it is equal, and no longer drawn."""
    scene = scene_from_spec(spec)
    assert set(scene.spec.partition(":")[2].split(",")) == set(spec.partition(":")[2].split(","))
    path = tmp_path / "scene.toml"
    path.write_text(scene_to_toml(scene))
    again = scene_from_spec(str(path))
    assert scene_to_toml(again) == path.read_text()
    assert (again.start, again.goal, again.goals) == (scene.start, scene.goal, scene.goals)
    assert digest(scene_from_toml(path.read_text(), "text")) == digest(scene)


@pytest.mark.slow
@pytest.mark.parametrize("spec", PINNED)
def test_a_random_scene_can_be_played(spec: str) -> None:
    """Some rounds at random, the same from the same seed."""
    scene = scene_from_spec(spec)
    rule = rule_named("random", scene.system)
    one, other = (play_in_python(scene, rule, seed=3, hesitate=0.0, max_rounds=4) for _ in range(2))
    assert one == other
    assert any(played.moves for played in one.rounds)


@pytest.mark.parametrize("family", ["hex-shapes", "sliding-shapes"])
@pytest.mark.parametrize("walk", ["", ",walk=9"])
def test_shapes_share_a_cell_and_obstacles_are_elsewhere(family: str, walk: str) -> None:
    """Start and goal both hold (0, 0), unless the goal is where a walk led."""
    obstacles = set()
    for seed in range(3):
        scene = scene_from_spec(f"{family}:n=5,seed={seed},density=0.15{walk}")
        goal = scene.goal or frozenset()
        assert (0, 0) in scene.start
        assert walk or (0, 0) in goal
        assert scene.goals == (in_order(goal),) * 5
        assert not scene.system.filled & {*scene.start, *goal}
        obstacles.add(scene.system.filled)
    assert len(obstacles) == 3


def test_density_is_the_share_of_free_cells() -> None:
    """Of some 2000 cells of a box a tenth are obstacles."""
    scene = scene_from_spec("hex-shapes:n=600,how=growth,density=0.1,catalogue=2")
    free = len(scene.system.workspace or ()) - len({*scene.start, *(scene.goal or ())})
    assert abs(len(scene.system.filled) - free / 10) < 4 * (free * 0.09) ** 0.5
    assert free > 500


def test_more_vehicles_start_where_fewer_did() -> None:
    """On the same map, to the same goals, labelled or not; another seed gives others."""
    few, many = (scene_from_spec(f"agv:graph=grid8x8,open=0.7,n={n},seed=4") for n in (3, 9))
    assert many.start[:3] == few.start
    assert many.goals[:3] == few.goals
    assert many.system.places == few.system.places
    labelled = scene_from_spec("agv-labelled:graph=grid8x8,open=0.7,n=9,seed=4")
    assert [labelled.system.place_of(site) for site in labelled.start] == list(many.start)
    assert labelled.goals == many.goals
    assert scene_from_spec("agv:graph=grid8x8,open=0.7,n=3,seed=5").start != few.start


def test_random_triangulations_are_triangulations() -> None:
    """No two edges cross and none is missing; start and goal are drawn apart."""
    scene = scene_from_spec("triangulation:n=30,seed=1,start=random,goal=random")
    assert isinstance(scene.system, FlipSystem)
    assert frozenset(scene.start) != scene.goal
    for seed in range(3):
        edges = random_triangulation(scene.system, Stream("test", seed))
        assert edges >= scene.system.kept
        Triangles(scene.system.plane.points, edges)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hex-shapes:n=1", "n=1: expected a whole number of at least 2"),
        ("hex-shapes:n=33", "n=33,how=uniform: expected at most 32 cells; how=growth has no"),
        ("sliding-shapes:n=19", "n=19,how=uniform: expected at most 18 cells"),
        ("hex-shapes:how=some", "how=some: expected uniform or growth"),
        ("hex-shapes:seed=-1", "seed=-1: expected a whole number of at least 0"),
        ("hex-shapes:density=0.6", "density=0.6: expected a decimal number of at least 0, at most"),
        ("hex-shapes:density=some", "density=some: expected a decimal number"),
        ("hex-shapes:density=.", "density=.: expected a decimal number"),
        ("hex-shapes:catalogue=4", "catalogue=4: expected 1, 2 or 3"),
        ("hex-shapes:box=0", "box=0: expected a whole number of at least 1"),
        ("hex-shapes:walk=0", "walk=0: expected a whole number of at least 1"),
        ("hex-shapes:n=1000,how=growth,walk=1001", "walk=1001: .* at most 1000"),
        ("sliding-shapes:k=-1", "k=-1: expected a whole number of at least 0"),
        ("agv:open=0.5", "open=0.5: expected seed=NUMBER too"),
        ("agv:walk=5", "walk=5: expected seed=NUMBER too"),
        ("agv:graph=tree9", "graph=tree9: expected seed=NUMBER too"),
        ("agv:graph=grid9x9,seed=1,open=1.1", "open=1.1: expected a decimal number"),
        ("agv:graph=grid9x9,seed=1,open=0.01", "open=0.01: no two neighbouring vertices"),
        ("agv:graph=K4,seed=1,n=5", "n=5: the graph has 4 vertices"),
        ("agv:scene=s.json,seed=1", "seed=1: starts and goals are those of the scene"),
        ("agv:graph=C5,seed=1,n=5,walk=3", "walk=3: no module can move"),
        ("triangulation:start=some", "start=some: expected one of right, left, up, down, random"),
        ("triangulation:n=201,start=random", "201 points: a random triangulation has at most 200"),
        ("triangulation:walk=3,goal=up", "walk=3: leads to the goal, so expected no goal=up"),
    ],
)
def test_what_cannot_be_drawn_is_refused(spec: str, message: str) -> None:
    """In one line, with what was expected."""
    with pytest.raises(InputError, match=message) as error:
        scene_from_spec(spec)
    assert "\n" not in str(error.value)
