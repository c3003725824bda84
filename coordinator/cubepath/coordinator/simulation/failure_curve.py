"""A picture of how probable a failure is after each event of a run, and of the event that decided.

matplotlib is imported when something is drawn.
"""

from pathlib import Path
from textwrap import fill

from cubepath.coordinator.runs.drawing import save_figure
from cubepath.coordinator.simulation.causes import Cause

_INK, _QUIET, _DECIDED = "#22262b", "#9aa0a8", "#c8102e"
_COLUMNS = 100
"""Letters in a line of the title, at most."""


def failure_curve(cause: Cause, path: Path, *, title: str) -> None:
    """Draw the probability of the failure by event, with its intervals, as .svg, .png or .pdf.

    InputError if the suffix is unknown or the file cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - only when something is drawn

    figure = Figure(figsize=(9, 4.2), facecolor="white", layout="constrained")
    axes = figure.subplots()
    points = cause.points
    where, shares = [point.event for point in points], [point.share for point in points]
    ends = [point.interval for point in points]
    below = [share - low for share, (low, _) in zip(shares, ends, strict=True)]
    above = [high - share for share, (_, high) in zip(shares, ends, strict=True)]
    axes.plot(where, shares, color=_INK, linewidth=1.2)
    axes.errorbar(where, shares, (below, above), fmt="o", color=_INK, ecolor=_QUIET, markersize=4)
    axes.set(ylim=(-0.03, 1.03), xlim=(-0.01 * cause.events, 1.01 * cause.events))
    axes.set_xlabel(f"first events that stay as they were, of {cause.events}")
    axes.set_ylabel("share of runs that fail in the same way")
    if cause.event is not None:
        axes.axvline(cause.event, color=_DECIDED, linewidth=1, linestyle="--", zorder=0)
    axes.set_title(fill(title, _COLUMNS), loc="left", color=_INK, fontsize=10, fontweight="bold")
    said = fill(cause.what, _COLUMNS + 30)
    figure.supxlabel(said, x=0.01, ha="left", color=_DECIDED, fontsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    save_figure(figure, path)
