"""Pictures of a run hold all its moves, and are written whole or not at all."""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import chain, combinations
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from PIL import Image

from cubepath.agents.environments.rollouts import play
from cubepath.agents.rendering.pictures import colours, extent
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs import drawing as pictures, schedule_chart as chart_of
from cubepath.coordinator.runs.drawing import Sheet, run_picture
from cubepath.coordinator.runs.films import animate
from cubepath.coordinator.runs.states import snapshots
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.random_runs import SPECS, random_run


def test_an_inadmissible_move_is_refused(tmp_path: Path) -> None:
    """The step and the site are named, and no file is left."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    step = scene.system.action("edge", (1, 2))
    for path in (tmp_path / "run.png", tmp_path / "run.gif"):
        with pytest.raises(InputError, match=r"step 1: edge at .* is not admissible"):
            if path.suffix == ".gif":
                animate(scene, [[step]], path)
            else:
                run_picture(scene, [[step]], [[step]], path)
    assert not list(tmp_path.iterdir())


def test_moves_that_cancel() -> None:
    """There and back cancels, with other vehicles' moves in between; the last equal ones do."""
    scene = scene_from_spec("agv:graph=grid6x2,n=2")
    out, on, far = (
        scene.system.action("edge", at)
        for at in (((0, 0), (1, 0)), ((1, 0), (2, 0)), ((0, 1), (1, 1)))
    )
    rounds = [[out, far], [on], [on], [on]]
    cancelled = pictures.cancelled_moves(rounds)
    assert cancelled == {(2, on), (3, on)}
    moves = sum(map(len, rounds))
    assert moves - len(cancelled) == sum(map(len, normal_cube_path(chain.from_iterable(rounds))))


@pytest.mark.parametrize("spec", SPECS)
def test_the_schedule_has_a_box_for_each_move(spec: str) -> None:
    """As executed, pale and hollow boxes together are all moves; below are those of the cubes."""
    scene, rounds, _ = random_run(spec, 30)
    run = list(snapshots(scene, rounds))
    short = list(snapshots(scene, normal_cube_path(chain.from_iterable(rounds))))
    figure = pictures._figure(scene, run, short, "", pictures.cancelled_moves(rounds))
    found: dict[bool, set[tuple[int, int]]] = {False: set(), True: set()}
    for collection in figure.axes[-1].collections:
        for path in collection.get_paths():
            step, module = np.asarray(path.vertices)[:4].mean(axis=0)
            found[module > round(module)].add((round(step), round(module)))
    for below, snaps in ((False, run), (True, short)):
        expected = {(step, module) for step, snap in enumerate(snaps) for module in snap.moved}
        assert found[below] == expected


def test_the_numbers_of_a_run() -> None:
    """The title says what the run had and what is left, in words that agree in number."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out, on = (scene.system.action("edge", at) for at in ((0, 1), (1, 2)))
    text = pictures._counts([[out], [], [on], [on]], [(out,)], "round")
    assert text == "4 rounds, 3 moves  \N{RIGHTWARDS ARROW}  1 cube, 1 move, largest cube 1"


def test_the_numbers_of_a_path_that_is_no_run() -> None:
    """Moves alone are counted once; cubes that were given are called so."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out = scene.system.action("edge", (0, 1))
    assert pictures._counts([[out]], [(out,)], "move").startswith("1 move  ")
    assert pictures._counts([[out]], [(out,)], "cube").startswith("1 cube, 1 move  ")
    run = list(snapshots(scene, [[out]]))
    for step_name, word in (("move", "as given, 1 move"), ("round", "as executed, 1 round")):
        figure = pictures._figure(scene, run, run, "", set(), step_name=step_name)
        legend = figure.axes[-1].get_legend()
        assert legend is not None
        assert legend.get_texts()[0].get_text() == word


def test_states_of_the_schedule() -> None:
    """Asked for, the states are those after some cubes, and are called so."""
    scene, rounds, _ = random_run("hex:n=6", 20)
    run = list(snapshots(scene, rounds))
    shortest = list(snapshots(scene, normal_cube_path(chain.from_iterable(rounds))))
    figure = pictures._figure(scene, run, shortest, "", set(), what="schedule")
    words = [text.get_text() for text in figure.texts]
    assert len(shortest) < len(run)
    assert words[2] == "start"
    assert words[-1].startswith(f"cube {len(shortest) - 1}")


def test_states_are_those_in_which_something_moves() -> None:
    """A run that mostly stands still is not shown by equal pictures."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out, on = (scene.system.action("edge", at) for at in ((0, 1), (1, 2)))
    run = list(snapshots(scene, [[], [], [out], *[[]] * 20, [on], *[[]] * 30]))
    figure = pictures._figure(scene, run, run, "", set())
    assert [text.get_text() for text in figure.texts][2:] == ["start", "round 3", "round 24"]


def test_long_specs_are_cut() -> None:
    """The title leaves out folders, not file names."""
    spec = "agv-labelled:graph=/data/maps/random.map,scene=/data/30.json"
    assert pictures._title(spec) == "agv-labelled:graph=random.map,scene=30.json"
    assert len(pictures._title("x" * 300)) == 80


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "header"), [(".png", b"\x89PNG\r\n\x1a\n"), (".svg", b"<?xml"), (".PDF", b"%PDF-")]
)
def test_files_are_what_their_suffix_says(tmp_path: Path, suffix: str, header: bytes) -> None:
    """Each kind has its header, and the same run gives the same bytes."""
    scene, rounds, _ = random_run("hex:n=4", 8)
    cubes = normal_cube_path(chain.from_iterable(rounds))
    paths = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for path in paths:
        run_picture(scene, rounds, cubes, path)
    assert paths[0].read_bytes().startswith(header)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_run_without_a_round_has_a_picture(tmp_path: Path) -> None:
    """The start alone is drawn."""
    path = tmp_path / "still.png"
    run_picture(scene_from_spec("arm:n=3"), [], [], path)
    with Image.open(path) as image:
        assert image.size[0] == 1350


@pytest.mark.parametrize("name", ["run.jpeg", "run", "run.gif"])
def test_unknown_suffixes_of_pictures(tmp_path: Path, name: str) -> None:
    """Another suffix is refused in one line, before anything is drawn or written."""
    with pytest.raises(InputError, match=r"ends in \.png or \.svg or \.pdf$"):
        run_picture(scene_from_spec("arm:n=2"), [], [], tmp_path / name)
    with pytest.raises(InputError, match=r"ends in \.gif$"):
        animate(scene_from_spec("arm:n=2"), [], tmp_path / "film.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_without_a_home_nothing_is_said_but_the_answer(tmp_path: Path) -> None:
    """Where matplotlib can keep nothing, a picture is drawn all the same, and silently."""
    golden = Path(__file__).parents[3] / "logs" / "golden" / "arm-6.mcap"
    known = {"MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "cubepath.coordinator",
            "view",
            str(golden),
            "-o",
            str(tmp_path / "arm.png"),
        ],
        env={name: text for name, text in os.environ.items() if name not in known}
        | {"HOME": os.devnull},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "arm.png").exists()


@pytest.mark.few(2)
@pytest.mark.parametrize("spec", ["hex:n=3", "hex:n=8", "arm:n=5", "assembly"])
def test_boxes_have_the_colours_of_their_modules(spec: str) -> None:
    """Below is the colour that the module has in the states; the legend shows that of no module."""
    scene, rounds, _ = random_run(spec, 12)
    run = list(snapshots(scene, rounds))
    figure = pictures._figure(scene, run, run, "", set())
    chart = figure.axes[-1]
    below = chart.collections[-1]
    assert isinstance(below, PolyCollection)
    seen = set[tuple[int, int]]()
    for path, colour in zip(below.get_paths(), below.get_facecolor(), strict=True):
        step, module = np.asarray(path.vertices)[:4].mean(axis=0).round().astype(int).tolist()
        assert to_rgb(cast("Any", colour)) == pytest.approx(colours(scene, run[step].sites)[module])
        seen.add((step, module))
    assert seen == {(step, module) for step, snap in enumerate(run) for module in snap.moved}
    legend = chart.get_legend()
    assert legend is not None
    shown = [to_rgb(cast("Any", patch.get_facecolor())) for patch in legend.get_patches()]
    assert shown[1] == pytest.approx(chart_of._SWATCH)
    assert shown[0] == pytest.approx(chart_of._pale(chart_of._SWATCH, "white"))


def test_the_legend_of_a_long_schedule_fits() -> None:
    """With thousands of rounds and with moves that cancel all of its words lie on the page."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out = scene.system.action("edge", (0, 1))
    run = list(snapshots(scene, [[out], [out], *[[]] * 10000]))
    figure = pictures._figure(scene, run, run[:1], "", {(1, out), (2, out)})
    legend = figure.axes[-1].get_legend()
    assert legend is not None
    assert len(legend.get_texts()) == 5
    assert legend.get_window_extent().x1 < figure.bbox.x1


def test_every_line_at_an_end_is_told() -> None:
    """Dotted and solid if the cubes are fewer than the rounds, one solid line if they end there."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out = scene.system.action("edge", (0, 1))
    run = list(snapshots(scene, [[out], [], []]))
    for shortest, told in (
        (run, {"end of path and cubes": ("-", 3.5)}),
        (run[:2], {"end of path": (":", 3.5), "end of cubes": ("-", 1.5)}),
    ):
        chart = pictures._figure(scene, run, shortest, "", set()).axes[-1]
        legend = chart.get_legend()
        assert legend is not None
        styles = [line.get_linestyle() for line in legend.get_lines()]
        words = [text.get_text() for text in legend.get_texts()][-len(styles) :]
        assert dict(zip(words, styles, strict=True)) == {
            word: style for word, (style, _) in told.items()
        }
        drawn = {(line.get_linestyle(), np.ravel(line.get_xdata())[0]) for line in chart.lines}
        assert drawn == set(told.values())


@pytest.mark.parametrize("spec", ["hex:n=5", "hex-open:n=6", "agv:graph=grid30x30,n=2", "arm:n=5"])
def test_all_states_have_one_frame(spec: str) -> None:
    """It holds all that the run and the cubes visit, those of states that are not shown too."""
    scene, rounds, _ = random_run(spec, 12)
    run = list(snapshots(scene, rounds))
    shortest = list(snapshots(scene, normal_cube_path(chain.from_iterable(rounds))))
    *states, _ = pictures._figure(scene, run, shortest, "", set()).axes
    assert len(states) == 6
    ((limits, _size),) = {
        (
            tuple(np.round((*axes.get_xlim(), *axes.get_ylim()), 9).tolist()),
            (round(axes.get_position().width, 9), round(axes.get_position().height, 9)),
        )
        for axes in states
    }
    visited = [site for snap in (*run, *shortest) for site in snap.sites]
    left, right, low, high = extent(scene, visited)
    assert limits[0] <= left + 1e-9
    assert right <= limits[1] + 1e-9
    assert limits[2] <= low + 1e-9
    assert high <= limits[3] + 1e-9


@pytest.mark.parametrize(
    ("box", "page", "columns"),
    [
        ((0, 6, 0, 6), 9, 6),
        ((0, 13, 0, 8), 9, 3),
        ((0, 40, 0, 1.2), 9, 1),
        ((0, 1.2, 0, 40), 9, 6),
        ((0, 32, 0, 32), 9, 3),
        ((0, 93, 0, 55), 13, 2),
        ((0, 1000, 0, 1000), 13, 3),
    ],
)
def test_states_are_as_large_as_there_is_room(
    box: tuple[float, float, float, float], page: float, columns: int
) -> None:
    """Small frames stand side by side, wide ones below one another, large ones on a wide page."""
    found = pictures._panels(box, 6)
    assert (found.page, found.columns) == (page, columns)


def test_axes_of_one_module_have_whole_numbers() -> None:
    """One module is lane 0 and nothing else; steps count from 1 to the last."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out = scene.system.action("edge", (0, 1))
    for rounds, steps in (([], [1]), ([[out]], [1]), ([[out], [out], []], [1, 2, 3])):
        run = list(snapshots(scene, rounds))
        chart = pictures._figure(scene, run, run, "", set()).axes[-1]
        assert chart.get_yticks().tolist() == [0]
        assert chart.get_xticks().tolist() == steps


def test_ticks_are_round_numbers() -> None:
    """Never more than asked for, multiples of 1, 2 or 5 times a power of ten, from the first on."""
    assert list(chart_of._ticks(1, 8, 16)) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert list(chart_of._ticks(0, 59, 12)) == [0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55]
    assert list(chart_of._ticks(1, 1000, 16)) == [100, 200, 300, 400, 500, 600, 700, 800, 900, 1000]


def test_states_are_framed_around_modules_that_could_not_be_read() -> None:
    """A chain of 60 is a row of specks in the frame of all, and twice as large in its own."""
    scene = scene_from_spec("hex:n=60")
    played = play("hex:n=60", max_rounds=120)
    run = list(snapshots(scene, played.steps))
    box = extent(scene, [site for snap in run for site in snap.sites])
    states = [run[0], run[120]]
    for zoom, framed in ((None, True), (False, False), (True, True)):
        boxes = pictures._frames(scene, states, box, zoom)
        assert (boxes != [box, box]) == framed
        ((wide, high),) = {
            (round(right - left, 9), round(top - low, 9)) for left, right, low, top in boxes
        }
        scale = pictures._panels(boxes[0], 2).scale(boxes[0])
        assert (scale > 2 * pictures._panels(box, 2).scale(box)) == framed
        for state, (left, right, low, top) in zip(states, boxes, strict=True):
            own = extent(replace(scene, start=state.sites, goal=None, goals=()), ())
            assert left <= own[0] + 1e-9
            assert own[1] <= right + 1e-9
            assert low <= own[2] + 1e-9
            assert own[3] <= top + 1e-9
        assert (wide, high) <= (round(box[1] - box[0], 9), round(box[3] - box[2], 9))


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("parts", ["both", "states", "schedule"])
def test_all_words_lie_on_the_page(
    parts: Literal["both", "states", "schedule"], dark: bool
) -> None:
    """Title, captions and legends are within the picture, none over another, and can be seen."""
    scene, rounds, _ = random_run("hex:n=6", 20)
    run = list(snapshots(scene, rounds))
    sheet = Sheet(parts=parts, dark=dark, title="T", caption="word " * 100, states=(0, 1, 2, 3))
    figure = pictures._figure(scene, run, run, "", set(), sheet=sheet)
    ground = np.array(to_rgb(cast("Any", figure.get_facecolor())))
    boxes = []
    for text in figure.texts:
        extents = text.get_window_extent()
        if text.get_text():
            assert figure.bbox.x0 <= extents.x0 < extents.x1 <= figure.bbox.x1
            assert figure.bbox.y0 <= extents.y0 < extents.y1 <= figure.bbox.y1
            assert np.abs(np.array(to_rgb(cast("Any", text.get_color()))) - ground).min() > 0.5
            boxes.append(extents)
    boxes += [axes.get_window_extent() for axes in figure.axes]
    for one, other in combinations(boxes, 2):
        assert not one.overlaps(other)
    assert len(figure.axes) == {"both": 5, "states": 4, "schedule": 1}[parts]


def test_titles_and_captions_are_words(tmp_path: Path) -> None:
    """Dollars make no formula, lines stay lines, and a letter that cannot be drawn is named."""
    scene, rounds, _ = random_run("hex:n=3", 2)
    run = list(snapshots(scene, rounds))
    sheet = Sheet(title="cost\t$\\foo$", caption="between $5 and $6\nor more")
    figure = pictures._figure(scene, run, run, "", set(), sheet=sheet)
    found = {text.get_text() for text in figure.texts}
    assert {"cost $\\foo$", "between $5 and $6\nor more"} <= found
    run_picture(scene, rounds, rounds, tmp_path / "run.svg", sheet=sheet)
    with pytest.raises(InputError, match=r"^caption: .* is not in the font DejaVu Sans"):
        run_picture(scene, rounds, rounds, tmp_path / "b.svg", sheet=Sheet(caption="\u65e5"))
    assert [path.name for path in tmp_path.iterdir()] == ["run.svg"]
