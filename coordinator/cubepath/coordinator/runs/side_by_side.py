"""A film of a run beside its schedule: the states of both on one time axis, above their moves.

matplotlib is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw

from cubepath.agents.rendering.pen import DARK, GOAL, INK, LIGHT, PAPER, Theme
from cubepath.agents.rendering.pictures import draw_on, extent
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.runs.drawing import cancelled_moves
from cubepath.coordinator.runs.films import (
    FRAMES_PER_SECOND,
    check_film,
    frames_shown,
    write_film,
)
from cubepath.coordinator.runs.schedule_chart import draw_schedule
from cubepath.coordinator.runs.states import Snapshot, Steps, snapshots, visited
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

_WIDE, _EDGE, _GAP, _CAPTION = 9.0, 0.15, 0.2, 0.34
_TALLEST, _FLATTEST = 3.2, 1.2
"""In inches: the heights of a state."""
_LANES, _BELOW = (0.14, 0.6, 2.4), 0.5
"""In inches: the height of a lane, of all lanes at least and at most, and of what is below them."""
_DOTS = 90


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
    ...     film.n_frames == 1 + len(played.steps)
    True
    """
    check_film(path, frames_per_second)
    executed = [list(actions) for actions in rounds]
    run = list(snapshots(scene, executed))
    shortest = list(snapshots(scene, cubes))
    shown = frames_shown(max(len(run), len(shortest)) - 1)
    screen = _Screen(scene, run, shortest, step_name, DARK if dark else LIGHT)
    screen.chart(
        cancelled_moves(executed, found), "as executed" if step_name == "round" else "as given"
    )
    write_film(screen.shot, shown, path, frames_per_second, progress)


class _Screen:
    """Two states side by side, and below them the schedule, which is drawn once."""

    def __init__(
        self,
        scene: Scene,
        run: Sequence[Snapshot],
        shortest: Sequence[Snapshot],
        step_name: str,
        theme: Theme,
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
        from matplotlib.figure import Figure  # noqa: PLC0415

        self._scene, self._run, self._shortest = scene, run, shortest
        self._step_name, self._theme = step_name, theme
        self._box = left, right, low, high = extent(scene, visited(chain(run, shortest)))
        wide = (_WIDE - 2 * _EDGE - _GAP) / 2
        tall = min(max(wide * (high - low) / (right - left), _FLATTEST), _TALLEST)
        whole = _CAPTION + tall
        figure = Figure(figsize=(_WIDE, whole), dpi=_DOTS, facecolor=theme.of(PAPER))
        self._sides = [
            figure.add_axes((at / _WIDE, 0, wide / _WIDE, tall / whole))
            for at in (_EDGE, _EDGE + wide + _GAP)
        ]
        self._captions = [
            figure.text(
                at / _WIDE, 1 - 0.08 / whole, "", va="top", color=theme.of(INK), fontsize=10
            )
            for at in (_EDGE, _EDGE + wide + _GAP)
        ]
        self._canvas = FigureCanvasAgg(figure)

    def chart(self, cancelled: set[tuple[int, Action]], as_given: str) -> None:
        """Draw the moves of both, over which a line is to go along."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
        from matplotlib.figure import Figure  # noqa: PLC0415

        lane, least, most = _LANES
        lanes = min(max(lane * len(self._scene.start), least), most)
        whole = lanes + _BELOW + 0.35
        figure = Figure(figsize=(_WIDE, whole), dpi=_DOTS, facecolor=self._theme.of(PAPER))
        left = _EDGE + 0.45
        axes = figure.add_axes(
            (left / _WIDE, _BELOW / whole, (_WIDE - _EDGE - left) / _WIDE, lanes / whole)
        )
        draw_schedule(
            axes,
            self._scene,
            self._run,
            self._shortest,
            cancelled,
            as_given=f"{as_given}, {counted(len(self._run) - 1, self._step_name)}",
            theme=self._theme,
        )
        canvas = FigureCanvasAgg(figure)
        self._chart = _pixels(canvas)
        ends = axes.transData.transform([(0, -0.5), (1, len(self._scene.start) - 0.5)])
        self._step = float(ends[0, 0]), float(ends[1, 0] - ends[0, 0])
        self._lanes = self._chart.height - float(ends[0, 1]), self._chart.height - float(ends[1, 1])

    def shot(self, number: int) -> Image.Image:
        """Return the picture of both after so many steps, or at their ends."""
        sides = zip(
            self._sides,
            self._captions,
            ((self._run, self._step_name), (self._shortest, "cube")),
            strict=True,
        )
        for axes, caption, (states, name) in sides:
            at = min(number, len(states) - 1)
            snapshot = states[at]
            axes.clear()
            draw_on(
                axes,
                self._scene,
                snapshot.sites,
                moved=snapshot.moved if at == number else {},
                box=self._box,
                theme=self._theme,
            )
            words = f"{'the run' if states is self._run else 'its schedule'}: {name} {at} of"
            words += f" {len(states) - 1}"
            if at == len(states) - 1 and self._scene.reached(snapshot.sites):
                words += ", goal"
            caption.set_text(words)
        above = _pixels(self._canvas)
        both = Image.new("RGB", (above.width, above.height + self._chart.height))
        both.paste(above, (0, 0))
        both.paste(self._chart, (0, above.height))
        origin, step = self._step
        x = round(origin + (number + 0.5) * step)
        top, bottom = (round(above.height + y) for y in self._lanes)
        ImageDraw.Draw(both).line([(x, top), (x, bottom)], fill=self._theme.of(GOAL), width=2)
        return both


def _pixels(canvas: FigureCanvasAgg) -> Image.Image:
    canvas.draw()  # type: ignore[no-untyped-call]  # untyped in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return Image.fromarray(np.array(pixels, dtype=np.uint8)[:, :, :3].copy())
