"""Pages in a browser: modules on their arcs, and three dimensions from every side."""

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations, product
from math import pi
from pathlib import Path

import numpy as np
import pytest

from cubepath.agents.environments.rollouts import play
from cubepath.agents.rendering.pictures import way_of
from cubepath.agents.rendering.projection import FRONT, Viewpoint
from cubepath.agents.rendering.solids import middle_of
from cubepath.agents.rendering.ways import along
from cubepath.coordinator.runs.states import snapshots
from cubepath.coordinator.tools.viewing.pages import run_page
from cubepath.coordinator.tools.viewing.run_view import RunView
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import (
    CUBES,
    DODECAHEDRA,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
    Lattice,
)
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.rays import Points, first_met, planes
from processes.watched_pages import Open
from samples.rolling import rolling_cubes

pytestmark = pytest.mark.browser

WAYS = [
    np.eye(3, dtype=int)[list(order)] * signs
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
]


def scene_of(lattice: Lattice, moves: Mapping[str, Sequence[Sequence[Cell]]], filled: int) -> Scene:
    """Return a scene of moves, each by its two ends, who stays, and what it sweeps, in any way."""
    found: dict[frozenset[tuple[int, Cell]], Generator] = {}
    for (name, groups), way in product(moves.items(), WAYS):
        ends, on, off = ([tuple((way @ cell).tolist()) for cell in cells] for cells in groups)
        low = np.min(ends, axis=0)
        key = {(n, tuple(cell - low)) for n, cells in enumerate((ends, on, off)) for cell in cells}
        here, there = ends
        made = Generator(
            f"{name}-{len(found)}", (*ends, *on, *off), (here, there), (here, *on), (there, *on),
            ((here, there),),
        )  # fmt: skip
        found.setdefault(frozenset(key), made)
    cells = [
        cell
        for cell in product(range(3), range(3), range(-1, 3))
        if not (lattice.even and sum(cell) % 2) and cell not in {(1, 1, 2), (0, 2, 1)}
    ]
    system = LatticeSystem(Catalogue(lattice, tuple(found.values())), filled=cells[:filled])
    return Scene("solid.toml", "solid", system, tuple(cells[filled:]))


def pivoting_cubes() -> Scene:
    """Return cubes that turn about an edge, by a quarter and by half."""
    over, corner = [(0, 0, 1), (1, 0, 1)], [(1, 0, 0), (2, 0, 0), (2, 0, -1)]
    moves = {
        "along": ([(0, 0, 0), (1, 0, 0)], [(0, 0, -1), (1, 0, -1)], over),
        "round": ([(0, 0, 0), (1, 0, -1)], [(0, 0, -1)], over + corner),
    }
    return scene_of(CUBES, moves, 10)


def rolling_dodecahedra() -> Scene:
    """Return dodecahedra that roll about an edge of one that stays, by a third."""
    near = [(-1, 0, 1), (0, 0, 2), (0, 1, 1), (1, -1, 0), (1, -1, 2), (1, 0, 1), (1, 1, 0)]
    off = [*near, (1, -2, 1), (1, 0, -1)]
    return scene_of(DODECAHEDRA, {"roll": ([(0, 0, 0), (0, -1, 1)], [(-1, -1, 0)], off)}, 6)


def bodies(
    scene: Scene, sites: Sequence[Site], then: Sequence[Site], step: Sequence[Action], part: float
) -> list[tuple[Points, Points]]:
    """Return the middle and the planes of each module after a part of a step, then of obstacles."""
    drawing = scene.system.drawing
    own, found = planes(drawing), list[tuple[Points, Points]]()
    for source, target in [*zip(sites, then, strict=True), *((s, s) for s in scene.system.filled)]:
        start = middle_of(drawing, source)
        action = next((each for each in step if source in each.trace and source != target), None)
        if action:
            way = way_of(scene, action, source, target)
            points = along(way, part, np.array([start, *(own + start)]))
            found.append((points[0], points[1:] - points[0]))
        else:
            found.append((start, own))
    return found


@pytest.mark.parametrize("make", [pivoting_cubes, rolling_dodecahedra])
def test_what_is_drawn_last_is_what_a_ray_meets_first(
    make: Callable[[], Scene], tmp_path: Path, opened: Open
) -> None:
    """On a grid over the picture, from all sides, at rest and while modules turn."""
    scene = make()
    steps = play(scene, "random", seed=4, max_rounds=4).steps
    assert sum(map(len, steps)) > 5
    run_page(RunView(scene, steps, steps), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    states = [each.sites for each in snapshots(scene, steps)]
    count, compared = len(scene.start), 0
    for side, (number, step) in enumerate(enumerate(steps), 1):
        page.keyboard.press(".")
        for t in (0.3, 0.5, 0.8):
            seen = page.evaluate(
                """(t) => {
                  cubepath.seek(t);
                  const [stage] = cubepath.view.stages;
                  const [left, right, low, high] = stage.world.frame;
                  const found = [];
                  for (let x = left; x < right; x += 0.23) for (let y = low; y < high; y += 0.23) {
                    const [u, v] = [stage.left + stage.scale * x, stage.top - stage.scale * y];
                    found.push([x, y, stage.moduleAt(u, v) ?? -1]);
                  }
                  return found;
                }""",
                number + t,
            )
            spots, shown = np.array(seen)[:, :2], np.array(seen)[:, 2]
            part = t * t * (3 - 2 * t)
            cells = bodies(scene, states[number], states[number + 1], step, part)
            view = Viewpoint(FRONT.azimuth + side * pi / 4, FRONT.tilt)
            met = [np.array(first_met(cells, spots, view.axes, size)) for size in (0.97, 1.0)]
            met = [np.where(each < count, each, -1) for each in met]
            clear = met[0] == met[1]  # not at the rim of a cell
            assert (shown[clear] == met[1][clear]).all()
            compared += int((shown[clear] >= 0).sum())
    assert compared > 1000


def test_a_goal_is_a_whole_cell(tmp_path: Path, opened: Open) -> None:
    """Its faces meet: the edge between the two in front has the colour of the goal."""
    run_page(RunView(rolling_cubes(), [()], ()), tmp_path / "run.html")
    red, green, blue, _ = opened(tmp_path / "run.html").evaluate(
        """() => {
          const [stage] = cubepath.view.stages, { ratio, scale, left, top, canvas } = stage;
          const [x, y] = stage.world.camera.seen([2.5, -0.5, 0]);
          const at = [ratio * (left + scale * x), ratio * (top - scale * y)].map(Math.round);
          return [...canvas.getContext("2d").getImageData(...at, 1, 1).data];
        }"""
    )
    assert red > 2 * green > 0
    assert red > blue


def test_the_view_turns_in_steps(tmp_path: Path, opened: Open) -> None:
    """By keys and buttons, which pages of the plane do not have; eight steps lead all around."""
    run_page(RunView(pivoting_cubes(), [()], ()), tmp_path / "run.html")
    run_page(RunView(scene_from_spec("hex:n=3"), [()], ()), tmp_path / "plane.html")
    assert not opened(tmp_path / "plane.html").is_visible("#turning")
    page = opened(tmp_path / "run.html")
    picture = "cubepath.view.draw(), document.querySelector('.stage canvas').toDataURL()"
    seen = [page.evaluate(picture)]
    for _ in range(8):
        page.keyboard.press(".")
        seen.append(page.evaluate(picture))
    assert len(set(seen)) == 8
    assert seen[0] == seen[8]
    for button, found in (("#left", seen[7]), ("#right", seen[0])):
        page.click(button)
        assert page.evaluate(picture) == found


def test_a_cube_slides_round_a_corner(tmp_path: Path, opened: Open) -> None:
    """Straight, and straight again, in a page as in Python."""
    scene = scene_from_spec("sliding-cubes:n=2")
    action = scene.system.action("corner-6", (1, 0, 1))
    here, there = (0, 0, 0), (1, 0, 1)
    way = way_of(scene, action, here, there)
    assert [(leg.axis, leg.turn) for leg in way] == [((0, 0, 1), 0), ((1, 0, 0), 0)]
    run_page(RunView(scene, [(action,)], [(action,)]), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    for part in (0.2, 0.5, 0.9):
        pose = page.evaluate(f"cubepath.poseBetween(cubepath.view.worlds[0], 0, 2, 0, {part})")
        assert pose["point"] == pytest.approx(along(way, part, np.zeros(3)).tolist(), abs=1e-6)
        assert not pose["spins"]


def test_a_square_turns_about_two_corners_in_succession(tmp_path: Path, opened: Open) -> None:
    """From one square over a gap to the next, a page shows it where Python says."""
    here, there, on = (0, 1), (2, 1), ((0, 0), (2, 0))
    swept = tuple(
        cell for cell in product(range(-1, 4), range(4)) if cell not in {here, there, *on}
    )
    step = Generator(
        "step", (here, there, *on, *swept), (here, there), (here, *on), (there, *on),
        ((here, there),),
    )  # fmt: skip
    scene = Scene("own.toml", "own", LatticeSystem(Catalogue(SQUARES, (step,))), (here, *on))
    action = step.place(SQUARES, (0, 0))
    run_page(RunView(scene, [(action,)], [(action,)]), tmp_path / "run.html")
    way = way_of(scene, action, here, there)
    assert [abs(leg.turn) for leg in way] == pytest.approx([pi / 2, pi / 2])
    page = opened(tmp_path / "run.html")
    for part in (0.2, 0.5, 0.9):
        pose = page.evaluate(f"cubepath.poseBetween(cubepath.view.worlds[0], 0, 3, 0, {part})")
        middle = along(way, part, np.array([[*map(float, here), 0.0]]))[0]
        assert [pose["x"], pose["y"]] == pytest.approx(middle[:2].tolist(), abs=1e-5)
        assert pose["turn"] == pytest.approx(-part * pi, abs=1e-5)
