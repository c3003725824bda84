"""Films of a run or of its schedule, a frame a step.

Room: coordinator. matplotlib is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.agents.rendering.legend import legend_of
from cubepath.agents.rendering.pictures import INK, draw_on, extent
from cubepath.coordinator.runs.drawing import check_suffix
from cubepath.coordinator.runs.snapshots import Steps, snapshots, visited
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    pass

FILM_SUFFIXES = (".gif",)
_FRAMES_MAX = 400
_EDGE, _CAPTION = 0.1, 0.3
"""In inches: the margin, and the height of what is said of each step."""
_LEAST = 3.2
"""In inches: the least width, so that the legend can be read."""


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

    check_suffix(path, FILM_SUFFIXES)
    found = list(snapshots(scene, steps))
    last = len(found) - 1
    shown = sorted({*range(0, last, 1 + last // _FRAMES_MAX), last})
    box = left, right, low, high = extent(scene, visited(found))
    stretch = min(max((right - left) / (high - low), 0.4), 3.0)
    wide = 4.8 * min(stretch, 1.5)
    tall = wide / stretch
    wide = max(wide, _LEAST)
    shots = [(found[number].sites, found[number].moved) for number in shown]
    legend = legend_of(scene, shots, box, wide - 2 * _EDGE)
    below = legend.height + (_EDGE if legend.marks else 0)
    high_ = _CAPTION + tall + below
    figure = Figure(figsize=(wide, high_), dpi=100, facecolor="white")
    axes = figure.add_axes((0, below / high_, 1, tall / high_))
    caption = figure.text(_EDGE / wide, 1 - 0.07 / high_, "", va="top", color=INK, fontsize=10)
    legend.put(figure, _EDGE, _CAPTION + tall + _EDGE / 2)
    # Written beside its place and moved there at the end, so that no half film is left.
    part = path.with_name(f".{path.stem}.part.gif")
    writer = PillowWriter(fps=frames_per_second)
    try:
        with writer.saving(figure, part, dpi=100):
            for done, number in enumerate(shown, 1):
                axes.clear()
                draw_on(axes, scene, found[number].sites, moved=found[number].moved, box=box)
                caption.set_text(f"{step_name} {number} of {last}")
                # The end stays for a while before the film starts again.
                for _ in range(1 + (number == last) * ceil(1.5 * frames_per_second)):
                    writer.grab_frame()
                if progress is not None:
                    progress(done, len(shown))
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)
