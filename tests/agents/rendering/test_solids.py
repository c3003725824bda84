"""Cells in space hide one another as a depth buffer sees it, at rest and on the way."""

from functools import partial
from itertools import product
from math import pi, radians

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cubepath.agents.rendering.pictures import draw_on, draw_text, extent, way_of
from cubepath.agents.rendering.projection import (
    CELL_FACES,
    ROD,
    Face,
    Faces,
    Viewpoint,
    box_faces,
    moved,
    project,
    tone,
)
from cubepath.agents.rendering.solids import middle_of
from cubepath.agents.rendering.style import palette
from cubepath.agents.rendering.ways import along
from cubepath.protocol.core.catalogue import CUBE_EDGES, CUBES, LATTICES, Cell, Generator
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from oracles.depth_buffer import nearest_faces
from samples.rolling import (
    CUBE_TURNS,
    ROLL,
    SLIDE,
    on_a_lattice,
    rolling_cubes,
    rolling_dodecahedra,
    turn,
)

ROUND = (0, -1, 0), (0, -1, -1), (0, 0, -1), (0, 0, -2), (0, 1, -2)
OVER = turn("over", ((0, 1, 0),), (0, 1, -1), ROUND)
CORNER = turn("corner", ((0, 0, -1),), (1, 0, -1), ((1, 0, 0),))
VIEWS = [Viewpoint(radians(22.5 + 45 * step)) for step in range(8)]


def cell(drawing: str, site: Site) -> Faces:
    """Return the faces of a cell where it lies."""
    axis = site[3] if isinstance(site, tuple) and len(site) == 4 else 0
    return moved(CELL_FACES[drawing][axis], middle_of(drawing, site))


def differs(
    scene: Scene,
    bodies: list[Faces],
    box: tuple[float, ...],
    shot: NDArray[np.uint8],
    trace: Faces = (),
) -> int:
    """Return at how many pixels a picture is not what the depth buffer sees, away from lines.

    The first bodies are the modules; where the trace of one is, nothing is compared.
    """
    tall, wide = shot.shape[:2]
    x = box[0] + (np.arange(wide) + 0.5) / wide * (box[1] - box[0])
    y = box[3] - (np.arange(tall) + 0.5) / tall * (box[3] - box[2])
    spots = np.stack(np.meshgrid(x, y), axis=-1)
    body, face = nearest_faces(bodies, spots)
    seen = np.where(nearest_faces([trace], spots)[0] < 0, 100 * body + face, -1)
    near = np.lib.stride_tricks.sliding_window_view(seen, (7, 7))
    plain = (near == near[:, :, 3:4, 3:4]).all(axis=(2, 3))
    inner, seen = shot[3:-3, 3:-3, :3].astype(int), np.where(plain, seen[3:-3, 3:-3], -1)
    wrong, hues = 0, palette(len(scene.start))
    assert len({number // 100 for number in np.unique(seen)}) > 4
    for number in np.unique(seen[(seen >= 0) & (seen < 100 * len(hues))]):
        normal = bodies[number // 100][number % 100].normal
        hue = 255 * tone(normal) * np.array(hues[number // 100])
        wrong += int((np.abs(inner[seen == number] - hue).max(axis=1) > 3).sum())
    return wrong


def picture(scene: Scene, **keywords: object) -> tuple[tuple[float, ...], NDArray[np.uint8]]:
    """Return the frame and the pixels of a scene without numbers."""
    left, right, low, high = extent(scene, ())
    size = max(right - left, high - low) + 1
    x, y = (left + right - size) / 2, (low + high - size) / 2
    box = x, x + size, y, y + size
    figure = Figure(figsize=(3, 3), dpi=100)
    canvas = FigureCanvasAgg(figure)
    draw_on(figure.add_axes((0, 0, 1, 1)), scene, scene.start, box=box, numbers=False, **keywords)  # type: ignore[arg-type]
    canvas.draw()  # type: ignore[no-untyped-call]
    return box, np.array(canvas.buffer_rgba())  # type: ignore[no-untyped-call]


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("drawing", "step"), [("cubes", SLIDE), ("dodecahedra", ROLL), ("cube-edges", None)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_picture_is_what_a_depth_buffer_sees(
    drawing: str, step: Generator | None, seed: int
) -> None:
    """Pixel by pixel, in a random heap of cells, wherever no line runs."""
    lattice = LATTICES[drawing]
    random = np.random.default_rng(seed)
    tails = [(axis,) for axis in range(3)] if lattice == CUBE_EDGES else [()]
    every = [(*at, *tail) for at in product(range(4), repeat=3) for tail in tails]
    fits = [site for site in every if not (lattice.even and sum(site) % 2)]
    start = tuple(fits[n] for n in sorted(random.choice(len(fits), 16, replace=False)))
    here, there = (0, 0, 0, 0), (1, 0, 0, 0)
    slide = Generator("e", (here, there), (here, there), (here,), (there,), ((here, there),))
    scene = on_a_lattice(lattice, (step or slide,), start)
    bodies = [cell(drawing, site) for site in start]
    if lattice == CUBE_EDGES:  # joints are in front of edges, and hide them, but are of no module
        tips = {
            tuple(middle_of(drawing, s) + e * np.eye(3)[s[3]] / 2) for s in start for e in (1, -1)
        }
        bodies += [moved(box_faces(ROD, ROD, ROD), np.array(tip)) for tip in sorted(tips)]
    box, shot = picture(scene)
    assert differs(scene, bodies, box, shot) == 0


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "target", "also"),
    [
        (rolling_cubes(), (1, 0, 1), ((0, -1, 0), (1, 1, 1), (2, -1, 1), (3, 0, 0))),
        (rolling_cubes(), (1, 0, 1), ((0, -1, 1), (1, -1, 1), (0, 1, 1), (-1, 0, 1))),
        # Here the middles alone would put the module on the wrong side of the third cube.
        (
            on_a_lattice(CUBES, (OVER,), OVER.before),
            (0, 1, -1),
            ((1, 0, -1), (-2, 0, 0), (2, 2, 0)),
        ),
        (rolling_dodecahedra(), (1, 0, 1), ((-1, 1, 0), (0, -1, 1), (1, -1, 0), (2, 2, 0))),
    ],
)
@pytest.mark.parametrize("part", [0.5, 0.3, 0.8])
def test_it_is_while_a_module_turns(
    scene: Scene, target: Cell, also: tuple[Cell, ...], part: float
) -> None:
    """The module that turns is painted between those that it passes."""
    drawing, system = scene.system.drawing, scene.system
    lattice = LATTICES[drawing]
    source, *rest = map(lattice.check, scene.start)
    (move,) = (each for each in system.moves_at(source) if each.target == target)
    action = move.action
    assert system.catalogue is not None
    now = on_a_lattice(lattice, system.catalogue.generators, (target, *rest, *also))
    way = way_of(scene, action, source, target)
    pose = partial(along, way, part)
    turned = tuple(
        Face(pose(face.corners), pose(face.normal) - pose(np.zeros(3)))
        for face in cell(drawing, source)
    )
    bodies = [turned, *(cell(drawing, site) for site in now.start[1:])]
    box, shot = picture(now, moved={0: source}, by={0: action}, part=part)
    assert differs(now, bodies, box, shot, cell(drawing, source)) == 0


def occludes(faces: Faces, apart: NDArray[np.float64], towards: NDArray[np.float64]) -> bool:
    """Return whether a cell moved by a vector hides a part of the cell at 0.

    It does if the vector is t towards the viewer, t > 0, plus a difference of two inner points.
    """
    low, high = 0.0, np.inf
    for corners, normal in faces:
        # The difference is on the inner side of a plane twice as far away as that of the face.
        over, rate = normal @ apart - 2 * (normal @ corners[0]) + 1e-9, normal @ towards
        low = max(low, over / rate) if rate > 0 else low
        high = min(high, over / rate) if rate < 0 else high
    return low < high


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("drawing", ["cubes", "dodecahedra"])
def test_what_hides_another_cell_is_less_deep(drawing: str, view: Viewpoint) -> None:
    """In every view by 45 degrees; some cells do hide others."""
    hiding = [
        np.array(at)
        for at in product(range(-4, 5), repeat=3)
        if any(at) and (drawing == "cubes" or sum(at) % 2 == 0)
        if occludes(CELL_FACES[drawing][0], np.array(at), view.axes[2])
    ]
    assert len(hiding) > 6
    assert min(project(at, view)[2] for at in hiding) > 1e-3


@pytest.mark.parametrize(
    ("drawing", "generator", "turns"),
    [
        *(("cubes", each, [pi if each.name == "round" else pi / 2]) for each in CUBE_TURNS),
        ("dodecahedra", ROLL, [2 * pi / 3]),
        ("cubes", SLIDE, []),
        ("cubes", CORNER, []),
    ],
)
def test_a_move_turns_about_an_edge_that_it_keeps(
    drawing: str, generator: Generator, turns: list[float]
) -> None:
    """It comes to its new cell, past none that stays; a move that needs no room for it slides."""
    lattice = LATTICES[drawing]
    scene = on_a_lattice(lattice, (generator,), generator.before)
    action = generator.place(lattice, (0, 0, 0))
    for source, target in (generator.motion[0], generator.motion[0][::-1]):
        way = way_of(scene, action, source, target)
        assert [abs(leg.turn) for leg in way if leg.turn] == pytest.approx(turns)
        corners = np.concatenate([face.corners for face in cell(drawing, source)])
        there = np.concatenate([face.corners for face in cell(drawing, target)])
        now = along(way, 1, corners)
        assert all(np.abs(there - corner).max(axis=1).min() < 1e-8 for corner in now)
        for part, other in product(np.linspace(0, 1, 21), generator.before[1:]):
            points = np.concatenate([corners, [middle_of(drawing, source)]])
            points = along(way, float(part), points)
            outer = [(points - f.corners[0]) @ f.normal > -1e-6 for f in cell(drawing, other)]
            assert np.any(outer, axis=0).all()


def test_a_floor_is_in_the_frame() -> None:
    """All of it, below a module on an endless lattice; what lies far away is not."""
    floor = tuple((x, y, 0) for x, y in product(range(7), repeat=2))
    scene = on_a_lattice(CUBES, (SLIDE,), ((3, 3, 1),), filled=floor)
    left, right, low, high = extent(scene, ())
    for place in floor:
        x, y, _ = project(np.concatenate([face.corners for face in cell("cubes", place)])).T
        assert left < x.min() < x.max() < right
        assert low < y.min() < y.max() < high
    far = on_a_lattice(CUBES, (SLIDE,), ((3, 3, 1),), filled=((999, 0, 0),))
    assert extent(far, ()) == extent(on_a_lattice(CUBES, (SLIDE,), ((3, 3, 1),)), ())


def test_text_has_the_layers_from_the_top() -> None:
    """Each with y upwards; a cell of the goal is marked, and an odd place has no dodecahedron."""
    scene = rolling_cubes()
    assert draw_text(scene, scene.start) == "z = 1\no . .\nz = 0\n@ @ +"
    scene = rolling_dodecahedra()
    assert draw_text(scene, scene.start) == "z = 1\n.\n  +\nz = 0\n  o\n@"
