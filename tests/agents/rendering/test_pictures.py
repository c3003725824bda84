"""Pictures show every module at its place, in text and in pixels, and cost nothing at import."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cubepath.agents.environments.world import World
from cubepath.agents.rendering.pictures import (
    colours,
    draw_on,
    draw_pixels,
    draw_text,
    extent,
    legend_of,
    style_of,
)
from cubepath.agents.rendering.style import INK, WALL, palette
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem

SPECS = [*all_families(), "agv:graph=K5,n=2", "agv-labelled:graph=S4,n=3"]


def walk(scene: Scene, rounds: int) -> list[Site]:
    """Return where the modules are after random rounds."""
    world, random = World(scene, seed=1), np.random.default_rng(3)
    for _ in range(rounds):
        masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
        world.step(
            {module: int(random.choice(mask.nonzero()[0])) for module, mask in enumerate(masks)}
        )
    return world.sites


def axes_of_size(width: float, height: float) -> Axes:
    return Figure(figsize=(width, height)).add_axes((0, 0, 1, 1))


def from_corner(cells: set[tuple[int, int]]) -> set[tuple[int, int]]:
    return {(a - min(c[0] for c in cells), b - min(c[1] for c in cells)) for a, b in cells}


def numbers(site: Site) -> tuple[int, ...]:
    assert isinstance(site, tuple)
    return site


@pytest.mark.parametrize("rounds", [0, 25])
def test_hexagons_in_text(rounds: int) -> None:
    """Read back, the marks are the modules and goal cells, up to a translation of them all."""
    scene = scene_from_spec("hex:n=9,bend=60")
    sites = walk(scene, rounds)
    goal = scene.goal or frozenset()
    text = draw_text(scene, sites).splitlines()
    for mark, cells in (
        ("o@", set(sites)),
        ("o", set(sites) - goal),
        ("+@", goal),
        ("+@o", goal | set(sites)),
    ):
        found = {
            (column, -row)
            for row, line in enumerate(text)
            for column, character in enumerate(line)
            if character in mark
        }
        expected = {(2 * q + r, r) for q, r in map(numbers, cells)}
        assert from_corner(found) == from_corner(expected)


def test_vehicles_on_a_grid_in_text() -> None:
    """Cell (x, y) of a map is column x of row y; a vehicle on a goal cell is told from others."""
    scene = scene_from_spec("agv:graph=grid4x3,n=2")
    assert draw_text(scene, [(1, 0), (3, 2)]) == ". o . .\n. . . +\n. . . @"


def test_labels_and_holes_in_text(tmp_path: Path) -> None:
    """A labelled vehicle shows its label, starred at its own goal; holes of a map are walls."""
    path = tmp_path / "small.map"
    path.write_text("height 2\nwidth 7\nmap\n.......\n..@@...\n")
    scene = scene_from_spec(f"agv-labelled:graph={path},n=11")
    rows = [line.split() for line in draw_text(scene, scene.start).splitlines()]
    assert [rows[1][column] for column in (2, 3)] == ["#", "#"]
    shown = {
        (x, y, word)
        for y, row in enumerate(rows)
        for x, word in enumerate(row)
        if word[0].isdigit()
    }
    expected = set()
    for label, site in enumerate(scene.start):
        x, y = numbers(numbers(site)[0])
        expected.add((x, y, f"{label}*" if site in (scene.goal or ()) else str(label)))
    assert shown == expected
    assert len({len(line) for line in draw_text(scene, scene.start).splitlines()}) == 1


@pytest.mark.parametrize("rounds", [0, 12])
def test_an_arm_in_text(rounds: int) -> None:
    """Read back, segments are where they are, and those where the goal wants them are told."""
    scene = scene_from_spec("arm:n=5,goal=xyxyx")
    sites = walk(scene, rounds)
    lines = draw_text(scene, sites).splitlines()
    found: dict[str, set[Site]] = {"off": set(), "there": set(), "wanted": set()}
    kinds = {"---": "off", "|": "off", "===": "there", "H": "there", "...": "wanted", ":": "wanted"}
    for up, line in enumerate(reversed(lines)):
        for start in range(0, len(line), 4):
            mark = line[start + 1 : start + 4].strip() if up % 2 == 0 else line[start].strip()
            if mark:
                found[kinds[mark]].add((start // 4, up // 2, up % 2))
    goal = scene.goal or frozenset()
    assert found == {
        "off": set(sites) - goal,
        "there": goal & set(sites),
        "wanted": goal - set(sites),
    }


def test_a_general_graph_in_text() -> None:
    """A line a vertex: what is there, and the neighbours; of a large graph only what matters."""
    scene = scene_from_spec("agv-labelled:graph=P4,n=2")
    assert draw_text(scene, [(3, 0), (0, 1)]).splitlines() == [
        "0: 1  - 1",
        "1: .  - 0 2",
        "2: +  - 1 3",
        "3: 0* - 2",
    ]
    large = scene_from_spec("agv:graph=C90,n=2")
    assert [line.split(":")[0].strip() for line in draw_text(large, [5, 6]).splitlines()] == [
        "5",
        "6",
        "88",
        "89",
    ]


def test_frames_of_text_line_up() -> None:
    """While modules walk along the edge of the frame, goal cells stay where they are."""
    scene = scene_from_spec("hex:n=5")
    after = walk(scene, 1)
    assert min(numbers(site)[1] for site in after) < 0
    texts = [draw_text(scene, sites).splitlines() for sites in (scene.start, after)]
    assert len(texts[0]) == len(texts[1])
    assert texts[0][1] == texts[1][1]
    assert style_of(scene).frame(scene, ()) == style_of(scene).frame(scene, after)


def test_obstacles_of_a_lattice_in_text() -> None:
    """An obstacle that is on is drawn as such, one that is off as no place."""
    system = LatticeSystem(page_catalogue("hexagons-1"), filled=[(2, 0)], empty=[(3, 0)])
    scene = Scene("own", "own", system, start=((0, 0), (1, 0)))
    assert draw_text(scene, scene.start).splitlines()[1] == ". o o #   ."


@pytest.mark.few(8)
@pytest.mark.parametrize("spec", SPECS)
def test_pixels(spec: str) -> None:
    """Pixels are (height, width, 3) uint8, the same for the same state, another after a move."""
    scene = scene_from_spec(spec)
    first, again = draw_pixels(scene, scene.start), draw_pixels(scene, scene.start)
    assert first.shape[0] == 360
    assert first.shape[1] % 2 == 0
    assert first.shape[2:] == (3,)
    assert first.dtype == np.uint8
    assert (first == again).all()
    later = draw_pixels(scene, walk(scene, 3))
    assert later.shape == first.shape
    assert (later != first).any()


def test_pixels_change_where_the_move_is() -> None:
    """A vehicle that moves changes the pixels of the two cells and no others, row 0 on top."""
    scene = scene_from_spec("agv:graph=grid5x4,n=1")
    before, after = (
        draw_pixels(scene, [(1, 0)], height=240),
        draw_pixels(scene, [(2, 0)], height=240),
    )
    rows, columns = np.nonzero((before != after).any(axis=2))
    left, right, low, high = style_of(scene).frame(scene, ())
    cell = 240 / (high - low)
    assert (right - left) * cell == pytest.approx(before.shape[1], abs=1)
    assert rows.min() >= 0.1 * cell
    assert rows.max() <= 1.1 * cell + 1
    assert columns.min() >= 1.1 * cell
    assert columns.max() <= 3.1 * cell + 1


def test_pixels_keep_their_shape_when_modules_leave_the_frame() -> None:
    """A film needs frames of one size, wherever modules walk."""
    scene = scene_from_spec("hex:n=3,bend=0")
    far = [(40, 0), (41, 0), (42, 0)]
    assert draw_pixels(scene, far).shape == draw_pixels(scene, scene.start).shape


def shot(axes: Axes) -> NDArray[np.uint8]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = axes.figure
    assert isinstance(figure, Figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # so is it in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return np.array(pixels, dtype=np.uint8)


def drawn(scene: Scene, sites: list[Site], **keywords: object) -> NDArray[np.uint8]:
    axes = axes_of_size(3, 3)
    draw_on(axes, scene, sites, **keywords)  # type: ignore[arg-type]  # each case fits
    return shot(axes)


def count_of(colour: str, pixels: NDArray[np.uint8]) -> int:
    """Return how many pixels have this colour, or nearly, where a thin line is blurred."""
    distance = np.abs(pixels[:, :, :3].astype(int) - list(bytes.fromhex(colour[1:])))
    return int((distance.max(axis=2) <= 40).sum())


@pytest.mark.few(8)
@pytest.mark.parametrize("spec", SPECS)
def test_what_moved_is_seen(spec: str) -> None:
    """A module that has just moved looks different from one that has stood there."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=0)
    masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
    module = next(number for number, mask in enumerate(masks) if mask.sum() > 1)
    source = world.sites[module]
    world.step({module: int(masks[module].nonzero()[0][1])})
    stood = drawn(scene, world.sites, numbers=False)
    moved = drawn(scene, world.sites, numbers=False, moved={module: source})
    old, new = (scene.system.place_of(site) for site in (source, world.sites[module]))
    assert source != world.sites[module]
    # The module has a dark outline now, and its trace is neither dark nor what was there; a place
    # that changes its letter leaves a small one.
    dark = count_of(INK, moved) - count_of(INK, stood)
    assert dark > 20
    assert (stood != moved).any(axis=2).sum() > (1.1 if old == new else 3) * dark


def test_modules_have_the_colours_of_their_numbers() -> None:
    """Each colour of the palette shows, at the cell of its module."""
    scene = scene_from_spec("hex:n=4,bend=0,shift=0")
    scene = replace(scene, goal=None, goals=())
    pixels = drawn(scene, list(scene.start), numbers=False)
    left, right, _, _ = style_of(scene).frame(scene, ())
    for number, colour in enumerate(palette(4)):
        x = round((number - left) / (right - left) * pixels.shape[1])
        found = pixels[pixels.shape[0] // 2, x, :3]
        assert np.abs(found - 255 * np.array(colour)).max() <= 1.5


def test_numbers_are_written_where_there_is_room() -> None:
    """Left to itself the picture writes numbers on large cells and none on small ones."""
    large, small = (
        scene_from_spec("agv:graph=grid4x4,n=3"),
        scene_from_spec("agv:graph=grid30x30,n=3"),
    )
    for scene, written in ((large, True), (small, False)):
        left_alone = drawn(scene, list(scene.start))
        assert (left_alone == drawn(scene, list(scene.start), numbers=written)).all()
        assert (left_alone != drawn(scene, list(scene.start), numbers=not written)).any()


def test_neighbours_that_do_not_meet_have_a_wall_between_them() -> None:
    """Cells side by side without an edge look different from cells with one."""
    cells: list[Site] = [(0, 0), (1, 0), (0, 1), (1, 1)]
    edges: list[tuple[Site, Site]] = [((0, 0), (1, 0)), ((0, 0), (0, 1)), ((1, 0), (1, 1))]
    closed = GraphSystem(cells, edges, compass=True)
    open_ = GraphSystem(cells, [*edges, ((0, 1), (1, 1))], compass=True)
    pictures = [
        drawn(Scene("own", "own", system, start=((0, 0),)), [(0, 0)]) for system in (closed, open_)
    ]
    assert count_of(WALL, pictures[0]) > 100
    assert count_of(WALL, pictures[1]) == 0
    rows, columns = np.nonzero((pictures[0] != pictures[1]).any(axis=2))
    assert rows.min() > 150 - 5
    assert abs(columns.mean() - 150) < 2


def test_many_modules_are_few_artists() -> None:
    """Modules are drawn as collections: their number does not decide the number of artists."""
    counts = []
    for spec in ("hex:n=3", "hex:n=30"):
        scene = scene_from_spec(spec)
        axes = axes_of_size(3, 3)
        draw_on(axes, scene, scene.start, numbers=False)
        counts.append(len(axes.get_children()))
    assert counts[0] == counts[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import cubepath.agents.rendering.pictures", "matplotlib"),
        (
            "from cubepath.agents import raw_env; raw_env('arm', render_mode='rgb_array').render()",
            "matplotlib.pyplot",
        ),
    ],
)
def test_what_is_not_imported(code: str, absent: str) -> None:
    """matplotlib is imported when something is drawn, and pyplot never."""
    check = f"{code}\nimport sys\nsys.exit({absent!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0


def test_the_colour_of_a_module_does_not_depend_on_how_many_there_are() -> None:
    """Module 3 looks the same among four and among forty; no two of 27 look alike."""
    assert palette(4) == palette(40)[:4]
    spread = np.array(palette(27))
    apart = np.abs(spread[:, None] - spread[None]).sum(axis=2)
    assert apart[~np.eye(27, dtype=bool)].min() > 0.15


def test_colours_are_those_of_the_picture() -> None:
    """By number, of letters by the letter that is on, and a marked vertex is dark."""
    chain, word = scene_from_spec("hex:n=3"), scene_from_spec("words:word=aba,goal=bab")
    assert colours(chain, chain.start) == palette(3)
    first, second, third = colours(word, word.start)
    assert first == third != second
    arms = scene_from_spec("arms:n=1")
    found = colours(arms, arms.start)
    edges = [number for number, site in enumerate(arms.start) if len(numbers(site)) == 3]
    assert edges
    assert all(found[number] == palette(len(found))[number] for number in edges)
    dark = {found[number] for number in range(len(found)) if number not in edges}
    assert len(dark) == 1
    assert max(next(iter(dark))) < 0.2


def test_the_goal_of_a_label_has_the_colour_of_its_module() -> None:
    """Also where modules do not start in the order of their labels."""
    scene = scene_from_spec("agv-labelled:graph=grid5x1,n=2")
    sites: list[Site] = [((1, 0), 1), ((0, 0), 0)]
    goal = frozenset({((4, 0), 1), ((3, 0), 0)})
    swapped = replace(scene, start=tuple(sites), goal=goal, goals=())
    pixels = drawn(swapped, sites, numbers=False)
    left, right, _, _ = style_of(swapped).frame(swapped, ())
    unit = pixels.shape[1] / (right - left)
    for number, x in ((0, 4), (1, 3)):
        column = round((x - left + 0.43) * unit)
        strip = pixels[140:160, column - 3 : column + 3, :3].reshape(-1, 3)
        assert np.abs(strip - 255 * np.array(palette(2)[number])).max(axis=1).min() < 3


@pytest.mark.parametrize("spec", SPECS)
def test_the_extent_of_a_run_holds_all_that_it_visits(spec: str) -> None:
    """The pictures of a run lie within the frame of everything, and hold start, goal and way."""
    scene = scene_from_spec(spec)
    sites = walk(scene, 6)
    left, right, low, high = extent(scene, sites)
    all_of_it = style_of(scene).frame(scene, sites)
    assert right > left
    assert high > low
    if scene.system.bounded:
        outer = (all_of_it[0] <= left, right <= all_of_it[1], all_of_it[2] <= low)
        assert (*outer, high <= all_of_it[3]) == (True,) * 4
    alone = replace(scene, goal=None, goals=())
    walked = [replace(alone, start=tuple(sites))] if scene.system.local else []
    for part in (*walked, alone):
        inner = extent(part, ())
        assert left <= inner[0]
        assert inner[1] <= right
        assert low <= inner[2]
        assert inner[3] <= high


def test_of_a_large_workspace_only_what_is_visited_is_shown() -> None:
    """Two vehicles in a corner of a large map; of a small map, or after a long way, all of it."""
    scene = scene_from_spec("agv:graph=grid50x40,n=2")
    start, goal = ((3, 3), (4, 3)), frozenset({(3, 5), (4, 5)})
    corner = replace(scene, start=start, goal=goal, goals=())
    assert extent(corner, [(6, 3)]) == pytest.approx((1.4, 7.6, -6.6, -1.4))
    assert extent(corner, [(49, 39)]) == style_of(scene).frame(scene, ())
    small = scene_from_spec("agv:graph=grid12x4,n=1")
    assert extent(replace(small, goal=None, goals=()), ()) == style_of(small).frame(small, ())


def test_a_single_module_has_a_frame_of_its_own() -> None:
    """One column, one row and one cell have room about them and are drawn."""
    for spec in ("hex:n=1", "agv:graph=grid1x9,n=1", "agv:graph=grid9x1,n=1", "arm:n=1"):
        scene = scene_from_spec(spec)
        left, right, low, high = extent(scene, ())
        assert min(right - left, high - low) >= 1
        axes = axes_of_size(2, 2)
        draw_on(axes, scene, scene.start, box=extent(scene, ()))
        assert (shot(axes)[:, :, :3] != 255).any()


def test_a_frame_that_is_given_is_kept() -> None:
    """Wherever modules are, the same box of cells is shown at the same place."""
    scene = scene_from_spec("agv:graph=grid50x40,n=1")
    limits = set()
    for site in ((3, 3), (6, 8)):
        axes = axes_of_size(2, 2)
        draw_on(axes, scene, [site], box=(0.0, 10.0, -10.0, 0.0))
        limits.add((axes.get_xlim(), axes.get_ylim()))
    assert limits == {((0.0, 10.0), (-10.0, 0.0))}


class Solid(TabledSystem):
    """A system of another distribution, whose sites or positions are in space."""

    table = "solid"


def solid(drawing: str, sites: list[Site], position: tuple[float, ...] | None = None) -> Scene:
    """Return a scene with a move from the first site to the second, drawn in a style."""
    action = Action(sites, sites, sites[:1], sites[1:])
    positions: Any = {} if position is None else dict.fromkeys(sites, position)
    system = Solid([Move(action, "go", 0, ((sites[0], sites[1]),))], drawing="graph", positions={})
    system.drawing, system.positions = drawing, positions
    return Scene("solid", "solid", system, start=(sites[0],))


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        (solid("hexagons", [(0, 0, 0), (0, 0, 1)]), True),
        (solid("map", ["a", "b"]), True),
        (solid("edges", [(0, 0, 2), (0, 0, 1)]), True),
        (solid("cubes", [(0, 0), (0, 1)]), True),
        (solid("gears", [(0, 0), (0, 1)]), True),
        (solid("graph", ["a", "b"], (0, 0, 1)), False),
        (solid("letters", ["a", "b"], (0, 0, 1)), False),
    ],
)
def test_what_no_style_can_draw_is_a_graph(scene: Scene, told: bool) -> None:
    """Unknown styles and places that do not fit, with a note; positions in space are projected."""
    assert count_of(INK, drawn(scene, list(scene.start), moved={0: scene.start[0]})) > 0
    marks = legend_of(scene, [(scene.start, {})], extent(scene, ()), 4).marks
    note = f"drawn as a graph, not as {scene.system.drawing!r}"
    assert (note in [mark.meaning for mark in marks]) == told


def test_positions_in_too_many_dimensions_are_refused() -> None:
    """One line names the place."""
    scene = solid("graph", ["a", "b"], (0, 0, 1, 1))
    with pytest.raises(InputError, match=r"\(0, 0, 1, 1\) of 'a': expected two or three numbers"):
        extent(scene, scene.start)
