"""A picture of a simulated run: processes as lifelines, messages as arrows, faults marked.

Time runs downwards. Where nothing happens for long the axis is broken, so that a second of waiting
takes no more room than a message. matplotlib is imported when something is drawn.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.runs.drawing import save_figure
from cubepath.coordinator.simulation.faults import ROUTER, SECOND_US
from cubepath.coordinator.simulation.network import Arrow, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Label = Callable[[bytes], str]
"""Says in a few words what a message is."""

ARROWS_MAX = 400
"""Of a longer run the last arrows are shown."""
_INK, _QUIET, _LOST, _SECOND = "#22262b", "#9aa0a8", "#c8102e", "#b36b00"
_SPANS = {
    "pause": ("#d9e4f5", "paused"),
    "stall": ("#d9e4f5", "paused for longer than the patience"),
    "slow": ("#fbeccb", "slow"),
    "crash": (_LOST, "crashed"),
    "return": ("#f6d5da", "crashed, comes back without memory"),
    "router": ("#f6d5da", "router down"),
    "partition": ("#fbeccb", "some do not hear the others"),
    "one-way": ("#fbeccb", "some do not hear the others, who hear them"),
    "host": ("#f6d5da", "its host down"),
    "twin": ("#d9e4f5", "paused, and replaced meanwhile"),
    "jump": ("#fbeccb", "its timer early"),
    "cut": ("#f6d5da", "killed before it had said all"),
    "torn": ("#f6d5da", "killed before it had written all"),
    "leave": ("#f6d5da", "left"),
}
_LEGEND = "dashed: the copy of a message; with a cross: lost"
_LETTER_IN = 0.1
"""In inches: the width of a letter of the title, at most."""
_WIDE_IN, _LEFT_IN, _RIGHT_IN, _TOP_IN = 2.3, 0.9, 1.6, 1.0
"""In inches: the distance of two lifelines, and the margins."""
_ROOM_US, _GAP_US = 250, 500
"""What takes a unit of height, and the longest time that is drawn to scale."""
_UNIT_IN = 0.42


@dataclass(frozen=True, slots=True)
class _Scale:
    """Maps times to heights; breaks the axis where nothing happens."""

    times: list[int]
    heights: list[float]
    breaks: list[tuple[float, int]]
    """Where the axis is broken, and for how many microseconds."""

    def __call__(self, time_us: int) -> float:
        place = min(bisect_right(self.times, time_us), len(self.times) - 1)
        low, high = self.times[place - 1], self.times[place]
        below, above = self.heights[place - 1], self.heights[place]
        share = (time_us - low) / (high - low) if high > low else 0.0
        return below + (above - below) * min(max(share, 0.0), 1.0)


def _scale(times: Iterable[int]) -> _Scale:
    known = sorted(set(times)) or [0]
    if len(known) == 1:
        known.append(known[0] + 1)
    heights, breaks = [0.0], []
    for before, after in pairwise(known):
        shown = min(after - before, _GAP_US) / _ROOM_US
        if after - before > _GAP_US:
            breaks.append((heights[-1] + shown / 2, after - before))
        heights.append(heights[-1] + shown)
    return _Scale(known, heights, breaks)


def sequence_picture(
    trace: Trace, names: Sequence[str], path: Path, *, title: str, label: Label
) -> None:
    """Write the sequence of messages of a run as .svg, .png or .pdf; `names` are the lifelines.

    InputError if the suffix is unknown or the file cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - only when something is drawn

    arrows = sorted(trace.arrows, key=lambda arrow: (arrow.begin_us, arrow.end_us))
    left_out = max(0, len(arrows) - ARROWS_MAX)
    arrows = arrows[left_out:]
    first = arrows[0].begin_us if left_out else 0
    spans = [span for span in trace.spans if span.end_us is None or span.end_us >= first]
    remarks = [remark for remark in trace.remarks if remark.at_us >= first]
    scale = _scale(
        chain(
            (time for arrow in arrows for time in (arrow.begin_us, arrow.end_us)),
            (max(span.begin_us, first) for span in spans),
            (remark.at_us for remark in remarks),
        )
    )
    lanes = {name: place for place, name in enumerate([*names, ROUTER])}
    if not any(span.process == ROUTER for span in spans):
        del lanes[ROUTER]
    wide = _LEFT_IN + _RIGHT_IN + _WIDE_IN * (len(lanes) - 1) + 0.5
    high = _TOP_IN + 0.7 + _UNIT_IN * scale.heights[-1]
    figure = Figure(figsize=(wide, high), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set(
        xlim=(-(_LEFT_IN + 0.5) / _WIDE_IN, len(lanes) - 1 + _RIGHT_IN / _WIDE_IN),
        ylim=(scale.heights[-1] + 0.7 / _UNIT_IN, -_TOP_IN / _UNIT_IN),
    )
    more = f"; the first {left_out} messages are left out" if left_out else ""
    lines = "\n".join(wrap(title + more, int(wide / _LETTER_IN)))
    figure.text(0.02, 1 - 0.12 / high, lines, va="top", color=_INK, fontweight="bold")
    figure.text(0.02, 0.12 / high, _LEGEND, va="bottom", color=_QUIET, fontsize=7.5)
    for name, lane in lanes.items():
        axes.plot((lane, lane), (0, scale.heights[-1]), color=_QUIET, linewidth=0.8, zorder=1)
        style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 10}
        axes.text(lane, -0.35, name, color=_INK, **style)
    for span in spans:
        _draw_span(
            axes, lanes[span.process], scale, (max(span.begin_us, first), span.end_us), span.kind
        )
    _draw_arrows(axes, lanes, scale, arrows, label)
    for remark in remarks:
        place = (lanes[remark.process] + 0.04, scale(remark.at_us))
        text = remark.text if len(remark.text) <= 60 else remark.text[:57] + "..."
        axes.text(*place, text, fontsize=7.5, color=_LOST, va="top", zorder=5)
    _draw_times(axes, scale)
    save_figure(figure, path)


def _draw_span(
    axes: Axes, lane: int, scale: _Scale, times: tuple[int, int | None], kind: str
) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    colour, name = _SPANS[kind]
    begin, end_us = times
    top = scale(begin)
    style: dict[str, Any] = {"fontsize": 7.5, "color": _INK, "zorder": 4}
    if end_us is None:
        axes.plot((lane,), (top,), marker="x", markersize=11, markeredgewidth=2.5, color=colour)
        axes.text(lane + 0.06, top, name, va="bottom", **style)
        return
    low = max(scale(end_us), top + 0.2)
    axes.add_patch(
        Rectangle((lane - 0.035, top), 0.07, low - top, facecolor=colour, edgecolor=_QUIET)
    )
    text = f"{name} {_long(end_us - begin)}"
    axes.text(lane + 0.05, (top + low) / 2, text, va="center", **style)


def _draw_arrows(
    axes: Axes, lanes: dict[str, int], scale: _Scale, arrows: Sequence[Arrow], label: Label
) -> None:
    labelled: set[tuple[str, int, bytes]] = set()
    for arrow in arrows:
        begin, end = lanes[arrow.sender], _end(lanes, arrow)
        tail, head = (begin, scale(arrow.begin_us)), (end, scale(arrow.end_us))
        lost, second = arrow.fate == "lost", arrow.fate == "second"
        colour = _LOST if lost else _SECOND if second else _INK
        # A lost message does not come to its receiver, nor does its arrow.
        if lost and arrow.receiver is not None:
            head = (begin + 0.8 * (end - begin), tail[1] + 0.8 * (head[1] - tail[1]))
        axes.annotate(
            "",
            head,
            tail,
            arrowprops={
                "arrowstyle": "-" if lost else "-|>",
                "color": colour,
                "linewidth": 0.8,
                "linestyle": "--" if second else "-",
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 8,
            },
        )
        if lost:
            axes.plot(*head, marker="x", color=_LOST, markersize=6, zorder=4)
        key = (arrow.sender, arrow.begin_us, arrow.data)
        if key not in labelled:
            labelled.add(key)
            side = 1 if end > begin else -1
            axes.text(
                begin + 0.06 * side,
                tail[1] + 0.06 * (head[1] - tail[1]),
                label(arrow.data),
                ha="left" if side > 0 else "right",
                va="center",
                fontsize=6.5,
                color=colour,
                zorder=4,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.3},
            )


def _end(lanes: dict[str, int], arrow: Arrow) -> float:
    if arrow.receiver is not None:
        return lanes[arrow.receiver]
    begin = lanes[arrow.sender]
    return begin + (0.3 if begin + 1 < len(lanes) else -0.3)


def _draw_times(axes: Axes, scale: _Scale) -> None:
    left = -0.5 / _WIDE_IN
    style: dict[str, Any] = {"fontsize": 7, "color": _QUIET, "va": "center", "ha": "right"}
    shown = -1.0
    for time_us, height in zip(scale.times, scale.heights, strict=True):
        if height - shown >= 1:
            axes.text(left, height, f"{time_us / 1000:.1f} ms", **style)
            shown = height
    for height, gap_us in scale.breaks:
        axes.axhline(height, color=_QUIET, linewidth=0.5, linestyle=(0, (1, 3)), zorder=0)
        axes.text(left, height, f"+ {_long(gap_us)}", style="italic", **style)


def _long(time_us: int) -> str:
    """Return a length of time in words."""
    return f"{time_us / SECOND_US:.3g} s" if time_us >= SECOND_US else f"{time_us / 1000:.3g} ms"
