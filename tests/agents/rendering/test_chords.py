"""Chords in text and in pixels: every diagonal is told, where it is and what it is."""

from collections.abc import Mapping

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cubepath.agents.rendering import chords
from cubepath.agents.rendering.pictures import draw_on, draw_text, style_of
from cubepath.agents.rendering.style import palette
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.flips import FlipSystem


def pixels(
    scene: Scene, sites: list[Site], moved: Mapping[int, Site] | None = None
) -> NDArray[np.uint8]:
    """Return a square picture of 600 pixels, without numbers."""
    figure = Figure(figsize=(6, 6), dpi=100)
    axes: Axes = figure.add_axes((0, 0, 1, 1))
    draw_on(axes, scene, sites, moved=moved, numbers=False)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # so is it in matplotlib
    return np.array(canvas.buffer_rgba(), dtype=np.uint8)[:, :, :3]  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("spec", ["polygon:n=9", "triangulation:n=12"])
def test_a_table_of_chords(spec: str) -> None:
    """Read back, the marks are the modules, the goal and the fixed edges."""
    scene = scene_from_spec(spec)
    goal = scene.goal or frozenset()
    assert isinstance(scene.system, FlipSystem)
    lines = draw_text(scene, scene.start).splitlines()
    assert len(lines) == len(scene.system.positions)
    wide = len(lines[0].split()[-1])
    found: dict[str, set[tuple[int, int]]] = {}
    for line in lines[1:]:
        one = int(line[:wide])
        marks = line[wide + 1 :]
        for other in range(len(lines)):
            mark = marks[other * (wide + 1) : (other + 1) * (wide + 1)].strip()
            found.setdefault(mark, set()).add((one, other))
    start = set(scene.start)
    assert found["o"] == start - goal
    assert found.get("@", set()) == start & goal
    assert found["+"] == goal - start
    assert found["#"] == scene.system.filled
    assert all(one < other for mark in "o@+#." for one, other in found.get(mark, ()))


@pytest.mark.slow
def test_many_points_are_told_by_their_chords() -> None:
    """Of more than 40 points only what is joined is written."""
    scene = scene_from_spec("triangulation:n=45")
    lines = draw_text(scene, scene.start).splitlines()
    found = {
        (int(one), int(word[1:]))
        for line in lines
        for one, _, rest in [line.partition(":")]
        for word in rest.split()
        if word[0] in "o@#"
    }
    assert found == scene.start_state


def spot(scene: Scene, point: int) -> tuple[float, float]:
    """Return the column and row of a point in the picture of 600 pixels."""
    system = scene.system
    assert isinstance(system, FlipSystem)
    known = np.array([system.positions[k] for k in range(len(system.positions))])
    left, right, low, high = style_of(scene).frame(scene, ())
    size = known.max(axis=0) - known.min(axis=0)
    cell = 600 / max(right - left, high - low)
    unit = (right - left - 1.2) * cell / size[0]
    x, y = (known[point] - (known.max(axis=0) + known.min(axis=0)) / 2) * unit
    return 300 + float(x), 300 - float(y)


def test_chords_lie_between_their_points() -> None:
    """At a third of the way from end to end is the colour of the module."""
    scene = scene_from_spec("polygon:n=7")
    shown = pixels(scene, list(scene.start))
    for site, colour in zip(scene.start, palette(len(scene.start)), strict=True):
        assert isinstance(site, tuple)
        (x, y), (u, v) = (spot(scene, end) for end in site)
        at = shown[round(y + (v - y) / 3), round(x + (u - x) / 3)]
        assert np.abs(at - 255 * np.array(colour)).max() < 3


def test_a_flip_tints_its_quadrilateral() -> None:
    """What changes when a chord is said to have flipped lies in the quadrilateral of the flip."""
    scene = scene_from_spec("polygon:n=6")
    action = scene.system.action("flip", (0, 1, 2, 3))
    after = apply(action, scene.start_state)
    sites: list[Site] = [site if site in after else (1, 3) for site in scene.start]
    number = sites.index((1, 3))
    plain, tinted = pixels(scene, sites), pixels(scene, sites, {number: (0, 2)})
    rows, columns = np.nonzero((plain != tinted).any(axis=2))
    corners = [spot(scene, corner) for corner in range(4)]
    assert columns.min() >= min(x for x, _ in corners) - 8
    assert columns.max() <= max(x for x, _ in corners) + 8
    assert rows.min() >= min(y for _, y in corners) - 8
    assert rows.max() <= max(y for _, y in corners) + 8
    assert len(rows) > 10_000


@pytest.mark.parametrize("spec", ["triangulation:n=40", "triangulation:n=20", "triangulation:n=9"])
def test_numbers_are_beside_points_that_lie_close(spec: str) -> None:
    """Each is nearer to its point than to any other, in the frame, and none lies on another."""
    scene = scene_from_spec(spec)
    spots = chords._spots(scene.system)
    left, right, low, high = box = style_of(scene).frame(scene, ())
    found = chords._beside(spots, box)
    assert found.keys() == spots.keys()
    points, names = np.array(list(spots.values())), np.array(list(found.values()))
    apart = np.hypot(*(names[:, None] - points).T)
    assert (apart.argmin(axis=0) == np.arange(len(points))).mean() > 0.9
    between = np.hypot(*(names[:, None] - names).T)[~np.eye(len(names), dtype=bool)]
    assert between.min() > 0.3
    assert (names.min(axis=0) >= (left, low)).all()
    assert (names.max(axis=0) <= (right, high)).all()
