"""Films of a run or of its schedule, with one frame for each step.

matplotlib is imported when something is drawn. All frames share one table of colours, so that a
module has the same colour in each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from cubepath.agents.rendering.legend import legend_of
from cubepath.agents.rendering.pen import DARK, INK, LIGHT, PAPER, Theme, palette
from cubepath.agents.rendering.pictures import draw_on, extent
from cubepath.coordinator.runs.drawing import check_suffix
from cubepath.coordinator.runs.states import Snapshot, Steps, snapshots, visited
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.system import Scene

FILM_SUFFIXES = (".gif",)
FRAMES_PER_SECOND = 4
_SLOWEST, _FASTEST = 0.01, 50
"""Frames a second. GIF counts hundredths of a second; many viewers turn less than two into ten."""
_FRAMES_MAX = 400
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
    lasts a whole number of hundredths of a second.

    InputError if the suffix is unknown, the rate is impossible, a move is not admissible or the
    file cannot be written.

    >>> played = play("hex:n=4")
    >>> animate(played.scene, played.steps[:3], "film.gif")
    >>> from PIL import Image
    >>> with Image.open("film.gif") as film:
    ...     film.n_frames
    4
    """
    check_film(path, frames_per_second)
    found = list(snapshots(scene, steps))
    shown = frames_shown(len(found) - 1)
    screen = _Screen(scene, found, shown, step_name, DARK if dark else LIGHT)
    write_film(screen.shot, shown, path, frames_per_second, progress)


def check_film(path: Path | str, frames_per_second: float) -> None:
    """Raise InputError if a film cannot have this name or this rate."""
    check_suffix(path, FILM_SUFFIXES)
    _check_frame_rate(frames_per_second)


def frames_shown(last: int) -> list[int]:
    """Return the numbers of the steps that a film shows: all, or some of very many."""
    return sorted({*range(0, last, 1 + last // _FRAMES_MAX), last})


def write_film(
    shot: Callable[[int], Image.Image],
    shown: Sequence[int],
    path: Path | str,
    frames_per_second: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Write the pictures of these steps as .gif, all with one table of colours."""
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
    ends = [round(100 * number / frames_per_second) for number in range(len(shown) + 1)]
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
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
        from matplotlib.figure import Figure  # noqa: PLC0415

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
        whole = _CAPTION + tall + below
        figure = Figure(figsize=(wide, whole), dpi=_DOTS, facecolor=theme.of(PAPER))
        self._axes = figure.add_axes((0, below / whole, 1, tall / whole))
        self._caption = figure.text(
            _EDGE / wide, 1 - 0.07 / whole, "", va="top", color=theme.of(INK), fontsize=10
        )
        legend.put(figure, _EDGE, _CAPTION + tall + _EDGE / 2)
        self._canvas = FigureCanvasAgg(figure)

    def shot(self, number: int) -> Image.Image:
        """Return the picture of a step."""
        snapshot = self._found[number]
        self._axes.clear()
        draw_on(
            self._axes,
            self._scene,
            snapshot.sites,
            moved=snapshot.moved,
            box=self._box,
            theme=self._theme,
        )
        self._caption.set_text(f"{self._step_name} {number} of {len(self._found) - 1}")
        self._canvas.draw()  # type: ignore[no-untyped-call]  # untyped in matplotlib
        pixels = self._canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
        return Image.fromarray(np.array(pixels, dtype=np.uint8)[:, :, :3].copy())


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
