"""The schedule of a run beside its normal cube path: a lane for each module, on one time axis.

matplotlib is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cubepath.agents.rendering.pictures import colours
from cubepath.agents.rendering.style import INK, LIGHT, PAPER, Colour, Theme
from cubepath.coordinator.runs.states import Snapshot
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_BAND, _QUIET, _EDGES = "#f4f5f6", "#6d727a", "#b9bdc3"
_AT_NIGHT = "#23272d", "#959ba4", "#5b616a"
"""The colours of every second lane, of what is quiet, and of the edges of boxes."""
_SWATCH: Colour = (0.35, 0.37, 0.4)
"""Stands for the colour of any module in the legend of the schedule; no module has it."""


def draw_schedule(
    axes: Axes,
    scene: Scene,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    cancelled: set[tuple[int, Action]],
    *,
    as_given: str,
    theme: Theme = LIGHT,
) -> None:
    """Draw a lane for each module, with the rounds in which it moved above and the cubes below.

    `cancelled` are the moves, by step and action, that are in no cube; `as_given` says what the
    rounds are.
    """
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415

    ink, paper = theme.of(INK), theme.of(PAPER)
    band, quiet, edges = (_BAND, _QUIET, _EDGES) if theme is LIGHT else _AT_NIGHT
    modules, steps = len(run[0].sites), max(len(run), len(shortest), 2) - 1
    for lane in range(1, modules, 2):
        axes.axhspan(lane - 0.5, lane + 0.5, color=band, linewidth=0, zorder=0)
    kept: dict[tuple[int, int], Colour] = {}
    hollow: list[tuple[int, int]] = []
    normal: dict[tuple[int, int], Colour] = {}
    for step, snapshot in enumerate(run):
        hues = colours(scene, snapshot.sites) if snapshot.by else ()
        for module, action in snapshot.by.items():
            if (step, action) in cancelled:
                hollow.append((step, module))
            else:
                kept[step, module] = _pale(hues[module], paper)
    for step, snapshot in enumerate(shortest):
        hues = colours(scene, snapshot.sites) if snapshot.by else ()
        normal |= {(step, module): hues[module] for module in snapshot.by}
    thin: dict[str, Any] = {"edgecolors": edges, "linewidths": 0.4}
    _draw_boxes(axes, list(kept), -1, facecolors=list(kept.values()), **thin)
    _draw_boxes(axes, hollow, -1, facecolors=paper, edgecolors=quiet, linewidths=0.6)
    _draw_boxes(axes, list(normal), 1, facecolors=list(normal.values()), **thin)
    ends: list[tuple[int, Literal["-", ":"], str]] = [
        (len(run), ":", "end of path"),
        (len(shortest), "-", "end of cubes"),
    ]
    if len(run) == len(shortest):
        ends = [(len(run), "-", "end of path and cubes")]
    for length, style, _ in ends:
        axes.axvline(length - 0.5, color=ink, linewidth=0.9, linestyle=style)
    axes.set(xlim=(0.4, max(steps, 8) + 0.7), ylim=(modules - 0.5, -0.5))
    axes.set_xlabel("time step", fontsize=8.5, color=ink, labelpad=2)
    axes.set_ylabel("module", fontsize=8.5, color=ink, labelpad=5)
    axes.set_xticks(_ticks(1, steps, 16))
    axes.set_yticks(_ticks(0, modules - 1, 12))
    axes.tick_params(labelsize=8, length=2.5, color=quiet, labelcolor=ink)
    axes.spines[:].set_visible(False)
    axes.set_facecolor(paper)
    keys: list[Artist] = [
        Patch(facecolor=_pale(_SWATCH, paper), label=as_given),
        Patch(facecolor=_SWATCH, label=f"normal cube path, {counted(len(shortest) - 1, 'cube')}"),
    ]
    if hollow:
        keys.append(Patch(facecolor="white", edgecolor=quiet, label="cancels with another"))
    keys += [
        Line2D((), (), color=ink, linewidth=0.9, linestyle=style, label=label)
        for _, style, label in ends
    ]
    axes.legend(
        handles=keys,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=len(keys),
        frameon=False,
        fontsize=8.5,
        labelcolor=ink,
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


def _pale(colour: Colour, paper: str) -> Colour:
    """Return a colour mixed with that of the ground."""
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    red, green, blue = (
        0.4 * part + 0.6 * ground for part, ground in zip(colour, to_rgb(paper), strict=True)
    )
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
