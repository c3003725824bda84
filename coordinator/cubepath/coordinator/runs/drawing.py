"""Pictures of a whole run: a film strip with its schedule, and a film.

Room: coordinator. Modules are followed through the moves from where they start, so all that is
needed is the scene and the moves. matplotlib is imported when something is drawn.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cubepath.agents.rendering.pictures import INK, draw_on, frame, palette
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.protocol.core.actions import Action, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Steps: TypeAlias = Sequence[Iterable[Action]]
"""A run or a cube path: the actions of each round or cube, which commute."""

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
FILM_SUFFIXES = (".gif",)
_WIDE, _EDGE, _GAP = 9.0, 0.3, 0.14
"""In inches: the width of a picture, its margin, what lies between two states."""
_TITLE, _CAPTION = 0.85, 0.2
"""In inches: the height of the title, and of what is said of each state."""
_STATES, _SMALL = 6, 14
"""How many states are shown; in two rows where the frame is more than so many cells wide."""
_FRAMES_MAX = 400
_QUIET, _BAND = "#6d727a", "#f4f5f6"


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Where modules are after a step; who moved in it, from which site and by which action."""

    sites: tuple[Site, ...]
    moved: Mapping[int, Site]
    by: Mapping[int, Action]


def snapshots(scene: Scene, steps: Iterable[Iterable[Action]]) -> Iterator[Snapshot]:
    """Follow the modules through the steps: first the start, then a snapshot after each step.

    InputError where an action is not admissible when its turn comes.
    """
    sites = list(scene.start)
    module_at = {site: number for number, site in enumerate(sites)}
    state = set(scene.start_state)
    yield Snapshot(tuple(sites), {}, {})
    for number, actions in enumerate(steps, 1):
        moved: dict[int, Site] = {}
        by: dict[int, Action] = {}
        for action in actions:
            index = end_at(action, state)
            if index is None:
                raise InputError(f"step {number}: {why_inadmissible(action, state)}")
            motion = _goes(scene.system, action, index)
            apply_in_place(action, state)
            movers = [module_at.pop(source) for source, _ in motion]
            for module, (source, target) in zip(movers, motion, strict=True):
                moved[module], by[module] = source, action
                sites[module] = target
                module_at[target] = module
        yield Snapshot(tuple(sites), moved, by)


def _goes(system: System, action: Action, index: int) -> Sequence[tuple[Site, Site]]:
    """Return where the action takes each module of its trace from its end `index`."""
    before = in_order(action.ends[index] & action.trace)
    for move in system.moves_of(action):
        if set(before) == {source for source, _ in move.motion}:
            return move.motion
    after = in_order(action.ends[1 - index] & action.trace)
    if len(before) != len(after):
        raise InputError(f"{action!r} makes {len(after)} modules of {len(before)}")
    return list(zip(before, after, strict=True))


def run_picture(
    scene: Scene, rounds: Steps, cubes: Steps, path: Path, *, found: NormalForm | None = None
) -> None:
    """Write a picture of a run and of its normal cube path as .png, .svg or .pdf.

    `rounds` holds the actions that each round of the run executed, rounds without a move included;
    `cubes` is the normal cube path of the same moves (`cubepath.coordinator.normal_form.heap`), and
    `found` what becomes of each of them, where that is known already.
    Above are some states of the run, modules coloured by number, with what the last round moved.
    Below is the schedule: a lane for each module, in its upper half the rounds in which the module
    moved (pale, hollow where the move cancels with another one), in its lower half the cubes.

    InputError where the suffix is another, a move is not admissible or the file cannot be written.
    """
    _check_suffix(path, PICTURE_SUFFIXES)
    executed = [list(actions) for actions in rounds]
    normal = [list(actions) for actions in cubes]
    run = list(snapshots(scene, executed))
    shortest = list(snapshots(scene, normal))
    gone = _cancelled(executed, found)
    figure = _figure(scene, run, shortest, _counts(executed, normal), gone)
    _save(figure, path)


def _check_suffix(path: Path, known: Sequence[str]) -> None:
    if path.suffix.lower() not in known:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(known)}")


def _counts(rounds: Sequence[Sequence[Action]], cubes: Sequence[Sequence[Action]]) -> str:
    moves, left = sum(map(len, rounds)), sum(map(len, cubes))
    largest = max(map(len, cubes), default=0)
    return (
        f"{_plural(len(rounds), 'round')}, {_plural(moves, 'move')}  \N{RIGHTWARDS ARROW}  "
        f"{_plural(len(cubes), 'cube')}, {_plural(left, 'move')}, largest cube {largest}"
    )


def _plural(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _cancelled(
    rounds: Iterable[Iterable[Action]], found: NormalForm | None = None
) -> set[tuple[int, Action]]:
    """Return the moves, by step and action, that are not in the normal cube path.

    A move that cancels does so with the last one that equals it and is still there.
    """
    path = [(number, action) for number, actions in enumerate(rounds, 1) for action in actions]
    if found is None:
        found = cancellations(action for _, action in path)
    return {path[place] for place in np.flatnonzero(found.levels == 0).tolist()}


def _title(spec: str) -> str:
    """Return a spec with the folders of its files left out, cut where it is too long."""
    short = re.sub(r"[^=,]*/", "", spec)
    return short if len(short) <= 80 else short[:77] + "..."


def _figure(
    scene: Scene,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    counts: str,
    cancelled: set[tuple[int, Action]],
) -> Figure:
    from matplotlib.figure import Figure  # noqa: PLC0415 - only when something is drawn

    shown = sorted(set(np.linspace(0, len(run) - 1, _STATES).round().astype(int).tolist()))
    also = dict.fromkeys(site for number in shown for site in run[number].sites)
    left, right, low, high = frame(scene, also)
    columns = _STATES if right - left <= _SMALL else _STATES // 2
    wide = (_WIDE - 2 * _EDGE - (columns - 1) * _GAP) / columns
    tall = min(wide * (high - low) / (right - left), 2 * wide)
    lanes = min(max(0.2 * len(scene.start), 0.8), 5.5)
    chart_top = _TITLE + ceil(len(shown) / columns) * (_CAPTION + tall + _GAP) + 0.35
    page = _Page(Figure(facecolor="white"), chart_top + lanes + 0.55)
    page.write(_title(scene.spec), _EDGE, 0.2, fontsize=12.5, fontweight="bold")
    page.write(counts, _EDGE, 0.47, fontsize=10)
    for index, number in enumerate(shown):
        name = "start" if number == 0 else f"round {number}"
        if number == len(run) - 1 and scene.reached(run[number].sites):
            name += ", goal"
        at = _EDGE + index % columns * (wide + _GAP)
        top = _TITLE + index // columns * (_CAPTION + tall + _GAP)
        page.write(name, at, top, fontsize=8.5)
        axes = page.axes(at, top + _CAPTION, wide, tall)
        draw_on(axes, scene, run[number].sites, moved=run[number].moved, also=also)
    chart = page.axes(_EDGE + 0.3, chart_top, _WIDE - 2 * _EDGE - 0.3, lanes)
    _draw_schedule(chart, run, shortest, cancelled)
    return page.figure


class _Page:
    """A figure on which things are put in inches from its upper left corner."""

    def __init__(self, figure: Figure, high: float) -> None:
        figure.set_size_inches(_WIDE, high)
        self.figure = figure
        self.high = high

    def axes(self, left: float, top: float, wide: float, tall: float) -> Axes:
        bottom = self.high - top - tall
        return self.figure.add_axes(
            (left / _WIDE, bottom / self.high, wide / _WIDE, tall / self.high)
        )

    def write(self, text: str, left: float, top: float, **style: Any) -> None:
        self.figure.text(left / _WIDE, 1 - top / self.high, text, va="top", color=INK, **style)


def _draw_schedule(
    axes: Axes,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    cancelled: set[tuple[int, Action]],
) -> None:
    from matplotlib.patches import Patch  # noqa: PLC0415
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415

    modules, steps = len(run[0].sites), max(len(run), len(shortest)) - 1
    colours = np.array(palette(modules))
    pale = 1 - 0.4 * (1 - colours)
    for lane in range(1, modules, 2):
        axes.axhspan(lane - 0.5, lane + 0.5, color=_BAND, linewidth=0, zorder=0)
    kept: list[tuple[int, int]] = []
    hollow: list[tuple[int, int]] = []
    for step, snapshot in enumerate(run):
        for module, action in snapshot.by.items():
            (hollow if (step, action) in cancelled else kept).append((step, module))
    normal = [(step, module) for step, snapshot in enumerate(shortest) for module in snapshot.moved]
    _draw_boxes(axes, kept, -1, facecolors=[pale[module] for _, module in kept], linewidths=0)
    _draw_boxes(axes, hollow, -1, facecolors="white", edgecolors=_QUIET, linewidths=0.6)
    _draw_boxes(axes, normal, 1, facecolors=[colours[module] for _, module in normal], linewidths=0)
    for snaps, style in ((run, ":"), (shortest, "-")):
        axes.axvline(len(snaps) - 0.5, color=INK, linewidth=0.9, linestyle=style)
    axes.set(xlim=(0.4, max(steps, 8) + 0.7), ylim=(modules - 0.5, -0.5))
    axes.set_xlabel("time step", fontsize=8.5, color=INK, labelpad=2)
    axes.set_ylabel("module", fontsize=8.5, color=INK, labelpad=5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=16, min_n_ticks=1))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=max(1, min(modules, 12))))
    axes.tick_params(labelsize=8, length=2.5, color=_QUIET, labelcolor=INK)
    axes.spines[:].set_visible(False)
    pale_hue, hue = pale[modules // 2].tolist(), colours[modules // 2].tolist()
    keys = [
        Patch(facecolor=pale_hue, label=f"as executed, {_plural(len(run) - 1, 'round')}"),
        Patch(facecolor=hue, label=f"normal cube path, {_plural(len(shortest) - 1, 'cube')}"),
    ]
    if hollow:
        keys.append(Patch(facecolor="white", edgecolor=_QUIET, label="cancels with another move"))
    axes.legend(
        handles=keys,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=len(keys),
        frameon=False,
        fontsize=8.5,
        labelcolor=INK,
        handlelength=1.5,
        borderpad=0,
        borderaxespad=0.4,
    )


def _draw_boxes(axes: Axes, cells: Sequence[tuple[int, int]], half: int, **style: Any) -> None:
    """Draw boxes at (step, module), in the upper (-1) or the lower (1) half of the lane."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    if not cells:
        return
    side, near, far = 0.46, 0.03 * half, 0.44 * half
    box = np.array([(-side, near), (side, near), (side, far), (-side, far)])
    shapes = [box + cell for cell in cells]
    axes.add_collection(PolyCollection(shapes, zorder=2, **style), autolim=False)


def _save(figure: Figure, path: Path) -> None:
    """Draw everything first and write the file then, so that none is left half written."""
    from matplotlib import rc_context  # noqa: PLC0415

    kind = path.suffix.lower()[1:]
    # Neither dates nor random names: the same run gives the same bytes.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "cubepath"}):
        figure.savefig(buffer, format=kind, dpi=150, metadata=undated)
    with written_whole(path) as stream:
        stream.write(buffer.getvalue())


def animate(
    scene: Scene,
    steps: Steps,
    path: Path,
    *,
    step_name: str = "round",
    frames_per_second: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film of the steps, rounds or cubes, as .gif.

    `step_name` is what each frame calls its step. `progress` is told after each frame how many are
    done and how many there are. Of more than 400 steps every second, third, ... is shown.

    InputError where the suffix is another, a move is not admissible or the file cannot be written.
    """
    from matplotlib.animation import PillowWriter  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    _check_suffix(path, FILM_SUFFIXES)
    found = list(snapshots(scene, steps))
    last = len(found) - 1
    shown = sorted({*range(0, last, 1 + last // _FRAMES_MAX), last})
    also = dict.fromkeys(site for number in shown for site in found[number].sites)
    left, right, low, high = frame(scene, also)
    stretch = min(max((right - left) / (high - low), 0.4), 3.0)
    wide, tall = 4.8 * min(stretch, 1.5), 4.8 * min(stretch, 1.5) / stretch
    figure = Figure(figsize=(wide, tall + 0.3), dpi=100, facecolor="white")
    axes = figure.add_axes((0, 0, 1, tall / (tall + 0.3)))
    caption = figure.text(0.1 / wide, 1 - 0.07 / (tall + 0.3), "", va="top", color=INK, fontsize=10)
    writer = PillowWriter(fps=frames_per_second)
    # The writer wants the name of a file, and all frames are in memory anyway.
    with TemporaryDirectory() as folder:
        film = Path(folder) / "film.gif"
        with writer.saving(figure, film, dpi=100):
            for done, number in enumerate(shown, 1):
                axes.clear()
                draw_on(axes, scene, found[number].sites, moved=found[number].moved, also=also)
                caption.set_text(f"{step_name} {number} of {last}")
                # The end stays for a while before the film starts again.
                for _ in range(1 + (number == last) * ceil(1.5 * frames_per_second)):
                    writer.grab_frame()
                if progress is not None:
                    progress(done, len(shown))
        with written_whole(path) as stream:
            stream.write(film.read_bytes())
