"""The legend of a picture names the marks that occur in it, and no others."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from cubepath.agents.environments.world import World
from cubepath.agents.rendering.pictures import Legend, legend_of, style_of
from cubepath.agents.rendering.style import Shot
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

WIDE = 8.0
MOVED = ["has just moved", "where it was before"]


def told(scene: Scene, shots: list[Shot]) -> list[str]:
    return [
        mark.meaning
        for mark in legend_of(scene, shots, style_of(scene).frame(scene, ()), WIDE).marks
    ]


def still(scene: Scene) -> list[Shot]:
    return [(scene.start, {})]


def after_a_move(scene: Scene) -> list[Shot]:
    """Return the start, and the state after a move of the first module that can move."""
    world = World(scene, seed=0)
    masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
    module = next(number for number, mask in enumerate(masks) if mask.sum() > 1)
    source = world.sites[module]
    world.step({module: int(masks[module].nonzero()[0][1])})
    return [(scene.start, {}), (tuple(world.sites), {module: source})]


@pytest.mark.parametrize(
    ("spec", "always", "moved"),
    [
        ("hex:n=4", ["goal"], MOVED),
        ("hex:n=4,base=1", ["goal", "obstacle"], MOVED),
        ("sliding:p=2,q=2,n=3", ["goal", "obstacle"], MOVED),
        ("agv:graph=grid4x4,n=2", ["goal"], MOVED),
        ("agv-labelled:graph=K5,n=2", ["goal of the module of its colour"], MOVED),
        ("arm:n=4", ["goal", "joint"], MOVED),
        ("arms:n=1", ["goal", "fixed", "joint"], MOVED),
        ("polygon:n=5", ["goal", "fixed edge"], ["has just flipped", "quadrilateral of a flip"]),
        (
            "words",
            ["lower right: letter of the goal", "has the letter of the goal"],
            ["has just changed", "upper left: letter before"],
        ),
    ],
)
def test_what_occurs_is_told(spec: str, always: list[str], moved: list[str]) -> None:
    """Moves bring an outline and a trace into the legend, and nothing else changes."""
    scene = scene_from_spec(spec)
    assert sorted(told(scene, still(scene))) == sorted(always)
    assert sorted(told(scene, after_a_move(scene))) == sorted([*always, *moved])


def test_walls_of_a_map_are_told_where_there_are_any(tmp_path: Path) -> None:
    """A map with a hole in it has walls, an open one has none."""
    path = tmp_path / "holed.map"
    path.write_text("height 2\nwidth 3\nmap\n...\n.@.\n")
    holed = scene_from_spec(f"agv:graph={path},n=2")
    assert told(holed, still(holed)) == ["goal", "wall"]


def test_nothing_to_tell_takes_no_room() -> None:
    """Without a goal and a move a picture of hexagons has no legend; one row is lower than two."""
    system = LatticeSystem(page_catalogue("hexagons-1"))
    scene = Scene("own", "own", system, start=((0, 0),))
    figure = Figure(figsize=(4, 4))
    empty = legend_of(scene, still(scene), style_of(scene).frame(scene, ()), WIDE)
    empty.put(figure, 0, 0)
    assert (empty.height, figure.legends) == (0, [])
    marked = scene_from_spec("hex:n=4")
    wide, narrow = (
        legend_of(marked, after_a_move(marked), style_of(marked).frame(marked, ()), room)
        for room in (WIDE, 2.0)
    )
    assert 0 < wide.height < narrow.height


def test_kept_free_cells_are_told() -> None:
    """Obstacles that are off are told apart from those that are on, and only those in the frame."""
    system = LatticeSystem(page_catalogue("hexagons-1"), filled=[(2, 0)], empty=[(3, 0)])
    scene = Scene("own", "own", system, start=((0, 0), (1, 0)))
    assert told(scene, still(scene)) == ["obstacle", "kept free"]
    assert [mark.meaning for mark in legend_of(scene, still(scene), (0, 1, 0, 1), WIDE).marks] == [
        "obstacle"
    ]


@pytest.mark.parametrize("spec", ["hex:n=4", "agv:graph=K5,n=2", "arm:n=4"])
def test_the_legend_fits_on_the_figure(spec: str) -> None:
    """Put where it belongs, all of it lies within the width and height that it asked for."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    scene = scene_from_spec(spec)
    for wide in (3.0, WIDE):
        legend: Legend = legend_of(
            scene, after_a_move(scene), style_of(scene).frame(scene, ()), wide
        )
        figure = Figure(figsize=(wide, legend.height + 0.02), dpi=100)
        FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]  # so is it in matplotlib
        legend.put(figure, 0, 0)
        (drawn,) = figure.legends
        box = drawn.get_window_extent()
        assert box.x0 >= 0
        assert box.x1 <= 100 * wide
        assert box.y0 >= -1
        words = [text.get_text() for text in drawn.get_texts()]
        assert words == [mark.meaning for mark in legend.marks]
