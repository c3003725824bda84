"""Films of a run or of its schedule: a frame for each step, and more on the way there.

matplotlib is imported when something is drawn. All frames share one table of colours, so that a
module has the same colour in each. A film may also show a run beside its schedule: the states of
both on one time axis, above their moves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import accumulate, chain, pairwise
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from cubepath.agents.rendering.pictures import draw_on, extent, legend_of, way_of
from cubepath.agents.rendering.style import DARK, GOAL, LIGHT, Box, Theme, palette
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.runs.drawing import Page, cancelled_moves, check_suffix
from cubepath.coordinator.runs.schedule_chart import draw_schedule
from cubepath.coordinator.runs.states import Snapshot, Steps, snapshots, visited
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FILM_SUFFIXES = (".gif",)
FRAMES_PER_SECOND = 4
_SLOWEST, _FASTEST = 0.01, 50
"""Frames a second. GIF counts hundredths of a second; many viewers turn less than two into ten."""
_FRAMES_MAX = 400
_PARTS = 4
"""The number of frames of a step in which modules are seen on their way."""
_SAMPLES, _COLOURS, _OWN = 5, 255, 27
"""The number of frames to take colours from, of colours, and of colours kept for modules."""
_SAME = 255
"""Stands in a frame for the colour that the pixel had in the frame before."""
_END_S = 1.5
"""How long the last frame stays before the film starts again."""
_EDGE, _CAPTION = 0.1, 0.3
"""In inches: the margin, and the height of the caption."""
_LEAST, _DOTS = 3.2, 100
"""The least width in inches at which the legend can be read, and dots per inch."""


def _check_frame_rate(rate: float) -> None:
    """Raise InputError if a film cannot have this number of frames a second."""
    if not _SLOWEST <= rate <= _FASTEST:
        raise InputError(
            f"{rate:g} frames a second: expected {_SLOWEST} to {_FASTEST}, as GIF counts in"
            " hundredths of a second"
        )


def animate(
    scene: Scene,
    steps: Steps,
    path: Path | str,
    *,
    step_name: str = "round",
    frames_per_second: float = FRAMES_PER_SECOND,
    dark: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film of the steps, rounds or cubes, as .gif.

    `step_name` is the name of a step in the captions; `dark` is for dark ground. `progress` is
    called after each frame with the number of frames done and their total. Of more than 400 steps,
    only every second, third, ... is shown. The film has the given rate on average; a single frame
    lasts a whole number of hundredths of a second. Pivots, slides and
    drives have three frames more each, if there are no more than 100 steps and 12 frames a second.

    InputError if the suffix is unknown, the rate is impossible, a move is not admissible or the
    file cannot be written.

    >>> played = play("hex:n=4")
    >>> animate(played.scene, played.steps[:3], "film.gif")
    >>> from PIL import Image
    >>> with Image.open("film.gif") as film:
    ...     film.n_frames
    13
    """
    check_film(path, frames_per_second)
    found = list(snapshots(scene, steps))
    shown = frames_shown(len(found) - 1)
    screen = _Screen(scene, found, shown, step_name, DARK if dark else LIGHT)
    moments = _with_ways(scene, shown, frames_per_second, found)
    write_film(screen.shot, moments, path, frames_per_second, progress)


def check_film(path: Path | str, frames_per_second: float) -> None:
    """Raise InputError if a film cannot have this name or this rate."""
    check_suffix(path, FILM_SUFFIXES)
    _check_frame_rate(frames_per_second)


def frames_shown(last: int) -> list[int]:
    """Return the numbers of the steps that a film shows: all, or some of very many."""
    return sorted({*range(0, last, 1 + last // _FRAMES_MAX), last})


def _with_ways(
    scene: Scene, shown: Sequence[int], frames_per_second: float, *paths: Sequence[Snapshot]
) -> list[float]:
    """Return the steps that a film shows, and moments on the way to those."""
    parts = [part / _PARTS for part in range(1 - _PARTS, 0)]
    if len(shown) * _PARTS > _FRAMES_MAX + _PARTS or frames_per_second * _PARTS > _FASTEST:
        parts = []
    found: list[float] = []
    for number in shown:
        now = [states[number] for states in paths if number < len(states)]
        found += [number + part for part in parts if any(_is_shown(scene, each) for each in now)]
        found.append(number)
    return found


def _is_shown(scene: Scene, snapshot: Snapshot) -> bool:
    return any(
        way_of(scene, snapshot.by[module], source, snapshot.sites[module])
        for module, source in snapshot.moved.items()
    )


def write_film(
    shot: Callable[[float], Image.Image],
    shown: Sequence[float],
    path: Path | str,
    frames_per_second: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Write the pictures of these steps as .gif, all with one table of colours.

    A moment between two steps lasts a part of a frame.
    """
    samples = sorted({*shown[:: 1 + len(shown) // _SAMPLES], shown[-1]})
    colours = _common_colours(map(shot, samples))
    frames: list[Image.Image] = []
    before: NDArray[np.uint8] | None = None
    for done, number in enumerate(shown, 1):
        frame = shot(number).quantize(palette=colours, dither=Image.Dither.NONE)
        pixels = np.array(frame)
        if before is not None:
            # What stays is left as it is, which makes a film a fraction of its size.
            frame.putdata(np.where(pixels == before, _SAME, pixels).ravel().tolist())
        before = pixels
        frames.append(frame)
        if progress is not None:
            progress(done, len(shown))
    # In hundredths of a second from the first frame on, so that rounding errors do not add up.
    lengths = [min(after - now, 1) for now, after in pairwise([*shown, shown[-1] + 1])]
    ends = [round(100 * at / frames_per_second) for at in accumulate(lengths, initial=0.0)]
    lasting = [10 * (end - begin) for begin, end in pairwise(ends)]
    lasting[-1] += round(1000 * _END_S)
    with written_whole(path) as stream:
        frames[0].save(
            stream,
            "gif",
            save_all=True,
            append_images=frames[1:],
            duration=lasting,
            loop=0,
            optimize=False,
            transparency=_SAME,
            disposal=1,
        )


class _Screen:
    """A figure on which one step after another is drawn, all at the same scale."""

    def __init__(
        self,
        scene: Scene,
        found: Sequence[Snapshot],
        shown: Sequence[int],
        step_name: str,
        theme: Theme,
    ) -> None:
        self._scene = scene
        self._found = found
        self._step_name = step_name
        self._theme = theme
        self._box = left, right, low, high = extent(scene, visited(found))
        stretch = min(max((right - left) / (high - low), 0.4), 3.0)
        wide = 4.8 * min(stretch, 1.5)
        tall = wide / stretch
        wide = max(wide, _LEAST)
        shots = [(found[number].sites, found[number].moved) for number in shown]
        legend = legend_of(scene, shots, self._box, wide - 2 * _EDGE, theme)
        below = legend.height + (_EDGE if legend.marks else 0)
        self._page = page = Page(wide, _CAPTION + tall + below, theme, _DOTS)
        self._axes = page.axes(0, _CAPTION, wide, tall)
        self._caption = page.write("", _EDGE, 0.07, fontsize=10)
        legend.put(page.figure, _EDGE, _CAPTION + tall + _EDGE / 2)

    def shot(self, moment: float) -> Image.Image:
        """Return the picture of a step, or of a moment on the way to it."""
        number = ceil(moment)
        snapshot = self._found[number]
        _draw_moment(self._axes, self._scene, snapshot, moment, box=self._box, theme=self._theme)
        self._caption.set_text(f"{self._step_name} {number} of {len(self._found) - 1}")
        return _pixels(self._page)


def _common_colours(samples: Iterable[Image.Image]) -> Image.Image:
    """Return a table of colours: the exact colours of modules, then the most frequent ones."""
    counted: Counter[int] = Counter()
    for sample in samples:
        pixels = np.asarray(sample).astype(np.uint32)
        numbers = (pixels[:, :, 0] << 16) | (pixels[:, :, 1] << 8) | pixels[:, :, 2]
        found, counts = np.unique(numbers, return_counts=True)
        counted.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
    own = [tuple(round(255 * part) for part in colour) for colour in palette(_OWN)]
    # Equally frequent colours are sorted by number, so that the same run gives the same film.
    rest = sorted(counted, key=lambda number: (-counted[number], number))
    known = [*own, *((number >> 16, number >> 8 & 255, number & 255) for number in rest)]
    table = Image.new("P", (1, 1))
    table.putpalette([part for colour in known[:_COLOURS] for part in colour])
    return table


_WIDE, _SIDES_EDGE, _GAP, _SIDES_CAPTION = 9.0, 0.15, 0.2, 0.34
_TALLEST, _FLATTEST = 3.2, 1.2
"""In inches: the heights of a state."""
_LANES, _BELOW = (0.14, 0.6, 2.4), 0.5
"""In inches: the height of a lane, of all lanes at least and at most, and of what is below them."""
_SIDES_DOTS = 90


def animate_beside(
    scene: Scene,
    rounds: Steps,
    cubes: Steps,
    path: Path | str,
    *,
    found: NormalForm | None = None,
    step_name: str = "round",
    frames_per_second: float = FRAMES_PER_SECOND,
    dark: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film of a run beside its normal cube path, as .gif.

    On the left are the states of the run, on the right those of its schedule after as many cubes,
    and below are the moves of both, with a line that goes along. The arguments are those of
    `run_picture` and `animate`.

    InputError if the suffix is unknown, the rate is impossible, a move is not admissible or the
    file cannot be written.

    >>> played = play("hex:n=3")
    >>> animate_beside(played.scene, played.steps, normal_cube_path(played.path), "beside.gif")
    >>> from PIL import Image
    >>> with Image.open("beside.gif") as film:
    ...     film.n_frames > len(played.steps)
    True
    """
    check_film(path, frames_per_second)
    executed = [list(actions) for actions in rounds]
    run = list(snapshots(scene, executed))
    shortest = list(snapshots(scene, cubes))
    shown = frames_shown(max(len(run), len(shortest)) - 1)
    screen = _Sides(scene, run, shortest, step_name, DARK if dark else LIGHT)
    screen.chart(
        cancelled_moves(executed, found), "as executed" if step_name == "round" else "as given"
    )
    moments = _with_ways(scene, shown, frames_per_second, run, shortest)
    write_film(screen.shot, moments, path, frames_per_second, progress)


class _Sides:
    """Two states side by side, and below them the schedule, which is drawn once."""

    def __init__(
        self,
        scene: Scene,
        run: Sequence[Snapshot],
        shortest: Sequence[Snapshot],
        step_name: str,
        theme: Theme,
    ) -> None:
        self._scene, self._run, self._shortest = scene, run, shortest
        self._step_name, self._theme = step_name, theme
        self._box = left, right, low, high = extent(scene, visited(chain(run, shortest)))
        wide = (_WIDE - 2 * _SIDES_EDGE - _GAP) / 2
        tall = min(max(wide * (high - low) / (right - left), _FLATTEST), _TALLEST)
        self._page = page = Page(_WIDE, _SIDES_CAPTION + tall, theme, _SIDES_DOTS)
        lefts = _SIDES_EDGE, _SIDES_EDGE + wide + _GAP
        self._sides = [page.axes(left, _SIDES_CAPTION, wide, tall) for left in lefts]
        self._captions = [page.write("", left, 0.08, fontsize=10) for left in lefts]

    def chart(self, cancelled: set[tuple[int, Action]], as_given: str) -> None:
        """Draw the moves of both, over which a line is to go along."""
        lane, least, most = _LANES
        lanes = min(max(lane * len(self._scene.start), least), most)
        page = Page(_WIDE, lanes + _BELOW + 0.35, self._theme, _SIDES_DOTS)
        left = _SIDES_EDGE + 0.45
        axes = page.axes(left, 0.35, _WIDE - _SIDES_EDGE - left, lanes)
        draw_schedule(
            axes,
            self._scene,
            self._run,
            self._shortest,
            cancelled,
            as_given=f"{as_given}, {counted(len(self._run) - 1, self._step_name)}",
            theme=self._theme,
        )
        self._chart = _pixels(page)
        ends = axes.transData.transform([(0, -0.5), (1, len(self._scene.start) - 0.5)])
        self._step = float(ends[0, 0]), float(ends[1, 0] - ends[0, 0])
        self._lanes = self._chart.height - float(ends[0, 1]), self._chart.height - float(ends[1, 1])

    def shot(self, moment: float) -> Image.Image:
        """Return the picture of both after this many steps, or at their ends."""
        number = ceil(moment)
        sides = zip(
            self._sides,
            self._captions,
            ((self._run, self._step_name), (self._shortest, "cube")),
            strict=True,
        )
        for axes, caption, (states, name) in sides:
            at = min(number, len(states) - 1)
            snapshot = states[at]
            if at != number:  # it has ended
                snapshot = replace(snapshot, moved={})
            _draw_moment(axes, self._scene, snapshot, moment, box=self._box, theme=self._theme)
            words = f"{'the run' if states is self._run else 'its schedule'}: {name} {at} of"
            words += f" {len(states) - 1}"
            if at == len(states) - 1 and self._scene.reached(snapshot.sites):
                words += ", goal"
            caption.set_text(words)
        above = _pixels(self._page)
        both = Image.new("RGB", (above.width, above.height + self._chart.height))
        both.paste(above, (0, 0))
        both.paste(self._chart, (0, above.height))
        origin, step = self._step
        x = round(origin + (moment + 0.5) * step)
        top, bottom = (round(above.height + y) for y in self._lanes)
        ImageDraw.Draw(both).line([(x, top), (x, bottom)], fill=self._theme.of(GOAL), width=2)
        return both


def _draw_moment(
    axes: Axes, scene: Scene, snapshot: Snapshot, moment: float, *, box: Box, theme: Theme
) -> None:
    """Draw a step on axes, or a moment on the way to it."""
    axes.clear()
    sites, moved, part = snapshot.sites, snapshot.moved, 1 + moment - ceil(moment)
    draw_on(axes, scene, sites, moved=moved, box=box, theme=theme, by=snapshot.by, part=part)


def _pixels(page: Page) -> Image.Image:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    canvas = page.figure.canvas
    canvas = canvas if isinstance(canvas, FigureCanvasAgg) else FigureCanvasAgg(page.figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # untyped in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return Image.fromarray(np.array(pixels, dtype=np.uint8)[:, :, :3].copy())
