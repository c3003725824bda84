"""A picture of a whole run: some of its states, and its schedule.

Room: coordinator. Modules are followed through the moves from where they start, so only the scene
and the moves are needed. matplotlib is imported when something is drawn.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from itertools import chain, count
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from cubepath.agents.rendering.legend import legend_of
from cubepath.agents.rendering.pen import Box, Colour
from cubepath.agents.rendering.pictures import INK, colours, draw_on, extent
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.runs.snapshots import Snapshot, Steps, snapshots, visited
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
What: TypeAlias = Literal["run", "schedule"]
"""Whose states a picture shows: those of the run, or of its normal cube path."""
_WIDE, _EDGE, _GAP = (9.0, 13.0), 0.3, 0.14
"""In inches: the possible widths of a picture, its margin, and the gap between two states."""
_TITLE, _CAPTION = 0.85, 0.2
"""In inches: the height of the title, and of the caption of a state."""
_STATES, _COLUMNS = 6, (6, 3, 2, 1)
"""The number of states shown, and the possible numbers of columns."""
_TALL = 5.5
"""In inches: a height that a state may always have, however narrow it is."""
_READABLE, _SPECK = 10.5, 5.0
"""In points: the least width of a cell with a readable number; below the second it is a speck."""
_QUIET, _BAND, _EDGES = "#6d727a", "#f4f5f6", "#b9bdc3"
_SWATCH: Colour = (0.35, 0.37, 0.4)
"""Stands for the colour of any module in the legend of the schedule; no module has it."""


def run_picture(
    scene: Scene,
    rounds: Steps,
    cubes: Steps,
    path: Path | str,
    *,
    found: NormalForm | None = None,
    step_name: str = "round",
    what: What = "run",
) -> None:
    """Write a picture of a run and of its normal cube path as .png, .svg or .pdf.

    `rounds` holds the actions that each round of the run executed, including rounds without a move;
    `cubes` is the normal cube path of the same moves (`cubepath.coordinator.normal_form.heap`), and
    `found` says what becomes of each move, if that is known already. `step_name` names the steps of
    a path that is not a run.
    The upper part shows some states of the run, or of the schedule if `what` says so, with modules
    coloured by number and the moves of the last step marked.
    The lower part is the schedule, with a lane for each module: in the upper half of the lane the
    rounds in which the module moved (pale, and hollow if the move cancels), in the lower half the
    cubes.

    InputError if the suffix is unknown, a move is not admissible or the file cannot be written.

    >>> played = play("hex:n=4")
    >>> run_picture(played.scene, played.steps, normal_cube_path(played.path), "run.svg")
    >>> Path("run.svg").read_text().count("<svg")
    1
    """
    check_suffix(path, PICTURE_SUFFIXES)
    executed = [list(actions) for actions in rounds]
    normal = [list(actions) for actions in cubes]
    run = list(snapshots(scene, executed))
    shortest = list(snapshots(scene, normal))
    gone = _cancelled(executed, found)
    counts = _counts(executed, normal, step_name)
    figure = _figure(scene, run, shortest, counts, gone, step_name=step_name, what=what)
    save_figure(figure, path)


def check_suffix(path: Path | str, known: Sequence[str]) -> None:
    """Raise InputError if a name has none of the known suffixes."""
    if Path(path).suffix.lower() not in known:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(known)}")


def _counts(
    rounds: Sequence[Sequence[Action]], cubes: Sequence[Sequence[Action]], step_name: str
) -> str:
    moves, left = sum(map(len, rounds)), sum(map(len, cubes))
    largest = max(map(len, cubes), default=0)
    # In a path without rounds the steps are the moves, which are counted anyway.
    steps = "" if step_name == "move" else f"{_plural(len(rounds), step_name)}, "
    return (
        f"{steps}{_plural(moves, 'move')}  \N{RIGHTWARDS ARROW}  "
        f"{_plural(len(cubes), 'cube')}, {_plural(left, 'move')}, largest cube {largest}"
    )


def _plural(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _cancelled(
    rounds: Iterable[Iterable[Action]], found: NormalForm | None = None
) -> set[tuple[int, Action]]:
    """Return the moves, by step and action, that are not in the normal cube path.

    A move that cancels does so with the last remaining move that equals it.
    """
    path = [(number, action) for number, actions in enumerate(rounds, 1) for action in actions]
    if found is None:
        found = cancellations(action for _, action in path)
    return {path[place] for place in np.flatnonzero(found.levels == 0).tolist()}


def _title(spec: str) -> str:
    """Return a spec without the folders of its files, cut off if it is too long."""
    short = re.sub(r"[^=,]*/", "", spec)
    return short if len(short) <= 80 else short[:77] + "..."


def _figure(
    scene: Scene,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    counts: str,
    cancelled: set[tuple[int, Action]],
    *,
    step_name: str = "round",
    what: What = "run",
) -> Figure:
    from matplotlib.figure import Figure  # noqa: PLC0415 - only when something is drawn

    states, state_name = (run, step_name) if what == "run" else (shortest, "cube")
    shown = sorted(set(np.linspace(0, len(states) - 1, _STATES).round().astype(int).tolist()))
    box = extent(scene, visited(chain(run, shortest)))
    width, columns, wide, tall = _panels(box, len(shown))
    lanes = min(max(0.2 * len(scene.start), 0.5), 5.5)
    shots = [(states[number].sites, states[number].moved) for number in shown]
    legend = legend_of(scene, shots, box, width - 2 * _EDGE)
    legend_top = _TITLE + ceil(len(shown) / columns) * (_CAPTION + tall + _GAP)
    chart_top = legend_top + legend.height + 0.4
    page = _Page(Figure(facecolor="white"), width, chart_top + lanes + 0.55)
    page.write(_title(scene.spec), _EDGE, 0.2, fontsize=12.5, fontweight="bold")
    page.write(counts, _EDGE, 0.47, fontsize=10)
    for index, number in enumerate(shown):
        name = "start" if number == 0 else f"{state_name} {number}"
        if number == len(states) - 1 and scene.reached(states[number].sites):
            name += ", goal"
        at = _EDGE + index % columns * (wide + _GAP)
        top = _TITLE + index // columns * (_CAPTION + tall + _GAP)
        page.write(name, at, top, fontsize=8.5)
        axes = page.axes(at, top + _CAPTION, wide, tall)
        draw_on(axes, scene, states[number].sites, moved=states[number].moved, box=box)
    legend.put(page.figure, _EDGE, legend_top)
    chart = page.axes(_EDGE + 0.3, chart_top, width - 2 * _EDGE - 0.3, lanes)
    as_given = f"{'as executed' if step_name == 'round' else 'as given'}, "
    as_given += _plural(len(run) - 1, step_name)
    _draw_schedule(chart, scene, run, shortest, cancelled, as_given=as_given)
    return page.figure


class _Panels(NamedTuple):
    """The layout of states on a page: its width, its columns and the size of a state, in inches."""

    page: float
    columns: int
    wide: float
    tall: float

    def scale(self, box: Box) -> float:
        """Return the width of a cell in points."""
        left, right, low, high = box
        return 72 * min(self.wide / (right - left), self.tall / (high - low))


def _panels(box: Box, count: int) -> _Panels:
    """Return the layout for a frame: on a narrow page, or a wide one if modules would be specks."""
    narrow, wide = (_best_panels(page, box, count) for page in _WIDE)
    return narrow if narrow.scale(box) >= _SPECK else wide


def _best_panels(page: float, box: Box, count: int) -> _Panels:
    """Return the layout with as many columns as leave room for numbers on modules.

    If none does, the layout that shows modules largest among those that are no higher than the page
    is wide, and the one with the most columns.
    """
    left, right, low, high = box
    fitting: list[_Panels] = []
    for columns in _COLUMNS:
        wide = (page - 2 * _EDGE - (columns - 1) * _GAP) / columns
        tall = min(wide * (high - low) / (right - left), max(2 * wide, _TALL))
        if not fitting or ceil(count / columns) * (_CAPTION + tall + _GAP) <= page:
            fitting.append(_Panels(page, columns, wide, tall))
    largest = max(fitting, key=lambda found: found.scale(box))
    return next((found for found in fitting if found.scale(box) >= _READABLE), largest)


class _Page:
    """A figure whose parts are placed in inches from its upper left corner."""

    def __init__(self, figure: Figure, wide: float, high: float) -> None:
        figure.set_size_inches(wide, high)
        self.figure = figure
        self.wide = wide
        self.high = high

    def axes(self, left: float, top: float, wide: float, tall: float) -> Axes:
        bottom = self.high - top - tall
        return self.figure.add_axes(
            (left / self.wide, bottom / self.high, wide / self.wide, tall / self.high)
        )

    def write(self, text: str, left: float, top: float, **style: Any) -> None:
        self.figure.text(left / self.wide, 1 - top / self.high, text, va="top", color=INK, **style)


def _draw_schedule(
    axes: Axes,
    scene: Scene,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    cancelled: set[tuple[int, Action]],
    *,
    as_given: str,
) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415

    modules, steps = len(run[0].sites), max(len(run), len(shortest), 2) - 1
    for lane in range(1, modules, 2):
        axes.axhspan(lane - 0.5, lane + 0.5, color=_BAND, linewidth=0, zorder=0)
    kept: dict[tuple[int, int], Colour] = {}
    hollow: list[tuple[int, int]] = []
    normal: dict[tuple[int, int], Colour] = {}
    for step, snapshot in enumerate(run):
        hues = colours(scene, snapshot.sites) if snapshot.by else ()
        for module, action in snapshot.by.items():
            if (step, action) in cancelled:
                hollow.append((step, module))
            else:
                kept[step, module] = _pale(hues[module])
    for step, snapshot in enumerate(shortest):
        hues = colours(scene, snapshot.sites) if snapshot.by else ()
        normal |= {(step, module): hues[module] for module in snapshot.by}
    thin: dict[str, Any] = {"edgecolors": _EDGES, "linewidths": 0.4}
    _draw_boxes(axes, list(kept), -1, facecolors=list(kept.values()), **thin)
    _draw_boxes(axes, hollow, -1, facecolors="white", edgecolors=_QUIET, linewidths=0.6)
    _draw_boxes(axes, list(normal), 1, facecolors=list(normal.values()), **thin)
    ends: list[tuple[int, Literal["-", ":"], str]] = [
        (len(run), ":", "end of path"),
        (len(shortest), "-", "end of cubes"),
    ]
    if len(run) == len(shortest):
        ends = [(len(run), "-", "end of path and cubes")]
    for length, style, _ in ends:
        axes.axvline(length - 0.5, color=INK, linewidth=0.9, linestyle=style)
    axes.set(xlim=(0.4, max(steps, 8) + 0.7), ylim=(modules - 0.5, -0.5))
    axes.set_xlabel("time step", fontsize=8.5, color=INK, labelpad=2)
    axes.set_ylabel("module", fontsize=8.5, color=INK, labelpad=5)
    axes.set_xticks(_ticks(1, steps, 16))
    axes.set_yticks(_ticks(0, modules - 1, 12))
    axes.tick_params(labelsize=8, length=2.5, color=_QUIET, labelcolor=INK)
    axes.spines[:].set_visible(False)
    keys: list[Artist] = [
        Patch(facecolor=_pale(_SWATCH), label=as_given),
        Patch(facecolor=_SWATCH, label=f"normal cube path, {_plural(len(shortest) - 1, 'cube')}"),
    ]
    if hollow:
        keys.append(Patch(facecolor="white", edgecolor=_QUIET, label="cancels with another"))
    keys += [
        Line2D((), (), color=INK, linewidth=0.9, linestyle=style, label=label)
        for _, style, label in ends
    ]
    axes.legend(
        handles=keys,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=len(keys),
        frameon=False,
        fontsize=8.5,
        labelcolor=INK,
        handlelength=1.5,
        columnspacing=1.2,
        borderpad=0,
        borderaxespad=0.4,
    )


def _ticks(first: int, last: int, most: int) -> range:
    """Return the integers at which an axis has a tick: multiples of a round step."""
    steps = (digit * 10**power for power in count() for digit in (1, 2, 5))
    step = next(step for step in steps if last // step - (first - 1) // step <= most)
    return range(-(-first // step) * step, last + 1, step)


def _pale(colour: Colour) -> Colour:
    red, green, blue = (1 - 0.4 * (1 - part) for part in colour)
    return red, green, blue


def _draw_boxes(axes: Axes, cells: Sequence[tuple[int, int]], half: int, **style: Any) -> None:
    """Draw boxes at (step, module), in the upper (-1) or the lower (1) half of the lane."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    if not cells:
        return
    side, near, far = 0.46, 0.03 * half, 0.44 * half
    box = np.array([(-side, near), (side, near), (side, far), (-side, far)])
    shapes = [box + cell for cell in cells]
    axes.add_collection(PolyCollection(shapes, zorder=2, **style), autolim=False)


def save_figure(figure: Figure, path: Path | str) -> None:
    """Draw everything first and then write the file, so that no file is left half written.

    InputError if the suffix is unknown or the file cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415

    check_suffix(path, PICTURE_SUFFIXES)

    kind = Path(path).suffix.lower()[1:]
    # No dates and no random names, so that the same run gives the same bytes.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "cubepath"}):
        figure.savefig(buffer, format=kind, dpi=150, metadata=undated)
    with written_whole(path) as stream:
        stream.write(buffer.getvalue())
