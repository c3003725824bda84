"""The plots of a report: growth with the size, and the way to the goal round by round.

Rules differ in colour, marker and line, so no plot needs its colours. The same data gives the same
bytes.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from io import BytesIO
from math import ceil
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from numpy.typing import NDArray

from cubepath.coordinator.experiments.published import PUBLISHED, PublishedResults
from cubepath.coordinator.experiments.rows import RUN_COLUMNS, Row, natural
from cubepath.coordinator.experiments.tables import (
    WORLD,
    best_by_scene,
    by_size,
    groups,
    priced,
    rounds_or_limit,
    scene_of,
    stacked,
    varying,
    without_size,
)

INK, PALE = "#1b1f24", "#8a8f98"
"""The colour of letters, which a page replaces by its own, and that of lines behind the data."""
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Those of Okabe and Ito that can be told apart by all, on white and on black."""
_MARKERS, _DASHES = "os^Dv<>p*X", ("-", "--", "-.", ":")
_PANELS_MAX, _ACROSS = 8, 2
_WIDE, _HIGH = 3.1, 2.7
"""Of a panel, in inches: so that letters can still be read where a page is narrow."""
_DOTS = 144
_TITLE = 32
"""This many letters are as wide as a panel; a longer title continues in the next line."""
_LONG = 16
"""Labels of a legend with more letters stand two in a line."""
_SOURCE = 90
"""This many letters of a source are as wide as two panels."""
_DECADE = 10
_OVER = "cubes over best"
_SHARE = "2/6: two of six runs reached the goal"
_CAPPED = f"other runs count as their limit (dotted)\n{_SHARE}"
_NUMBERS = FuncFormatter(lambda number, _: f"{number:g}")
_STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # letters as letters, which publishers ask for
    "font.size": 10,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 9,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": PALE,
    "grid.alpha": 0.35,
    "axes.grid": True,
    "legend.frameon": False,
}

_METADATA: Mapping[str, dict[str, None]] = {  # without a date: the same data gives the same bytes
    "svg": {"Date": None, "Creator": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

Draw = Callable[[Axes, Sequence[Row], "Looks"], None]


@dataclass(frozen=True, slots=True)
class Plot:
    """A plot: its name, what it shows, and its bytes as SVG, PNG and PDF, made when called."""

    name: str
    title: str
    svg: Callable[[], bytes]
    png: Callable[[], bytes]
    pdf: Callable[[], bytes]


class Looks:
    """What lines look like: one look for each variant, the same in all panels.

    `size` is the width and the height of a plot in inches, if they do not follow from its panels;
    `sources` are those of what others published.
    """

    def __init__(self, rows: Sequence[Row], size: Sequence[float] = (), sources: str = "") -> None:
        """Take the variants in the order of their names."""
        self.size: Any = size
        self.sources = sources
        self._keys = varying(rows, ("rule", *WORLD[1:]))
        labels = sorted({self.label(row) for row in rows}, key=natural)
        self._places = {label: place for place, label in enumerate(labels)}

    def in_order(self, labels: Iterable[str]) -> list[str]:
        """Return the labels of a legend as they are drawn: others than variants as they come."""
        return sorted(labels, key=lambda label: self._places.get(label, 0))

    def label(self, row: Row) -> str:
        """Return how the variant of a run is called: its rule, and what else differs."""
        return ", ".join(filter(None, [str(row["rule"]), self.rest(row)]))

    def rest(self, row: Row) -> str:
        """Return what differs beside the rule."""
        return ", ".join(f"{key} {row[key]}" for key in self._keys[1:])

    def by_variant(self, rows: Sequence[Row]) -> Iterable[tuple[dict[str, Any], list[Row]]]:
        """Yield the rows of each variant, with how its line looks."""
        found: dict[str, list[Row]] = {}
        for row in rows:
            found.setdefault(self.label(row), []).append(row)
        for label in sorted(found, key=natural):
            place = self._places[label]
            look = {
                "label": label,
                "color": _COLOURS[place % len(_COLOURS)],
                "marker": _MARKERS[place % len(_MARKERS)],
                "linestyle": _DASHES[place // len(_COLOURS) % len(_DASHES)],
            }
            look |= {"linestyle": ":", "mfc": "white"} if label.endswith(PUBLISHED) else {}
            yield look, found[label]


def plots_of(
    rows: Sequence[Row],
    left: Mapping[str, NDArray[np.int64]],
    axes: Sequence[str] = (),
    size: Sequence[float] = (),
    published: Sequence[PublishedResults] = (),
) -> list[Plot]:
    """Return the plots that the data has something for; with `axes`, that of these two columns.

    `left` has for runs, by their ids, how far the goal is after each round, shape (rounds,).
    What others published on the same systems is drawn beside the runs.
    """
    measured = [*_measured(rows), *published_rows(_measured(rows), published)]
    sources = " ".join(dict.fromkeys(f"Published: {each.source}" for each in published))
    looks = Looks(measured, size, fill(sources, _SOURCE))
    if axes:
        x, y = axes
        panel = "base" if x == "modules" else "system"
        draw = _by_size(y, x)
        chosen = _figure(f"{y}-by-{x}", f"{y} by {x}", measured, panel, looks, draw)
        return [] if chosen is None else [chosen]
    found: list[Plot | None] = []
    sized = [
        row
        for several in groups(measured, ["base"]).values()
        if len({row["modules"] for row in several if row["goal"]}) > 1
        for row in several
    ]
    if not all(row["goal"] for row in sized):
        share = "Share of runs that reach the goal, by modules"
        found.append(_figure("growth-goal", share, sized, "base", looks, _by_size("goal")))
    for name, measure, title in (
        ("growth-rounds", "rounds", f"Rounds to the goal, by modules\n{_CAPPED}"),
        ("growth-cubes", "cubes", f"Cubes of the schedule, by modules\n{_SHARE}"),
        ("cubes-over-best", _OVER, f"Cubes over the best known\n{_SHARE}"),
    ):
        found.append(_figure(name, title, sized, "base", looks, _by_size(measure)))
    found.append(price_plot(rows, size))
    curves = {run: each / each[0] for run, each in left.items() if len(each) and each[0]}
    drawn = [row for row in rows if row["id"] in curves]
    found.append(
        _figure(
            "progress",
            "Distance to the goal that is left, by round",
            drawn,
            "system",
            looks,
            _progress(curves),
        )
    )
    return [each for each in found if each is not None]


_OF_REACHED = ("time", "moves", "costs", "reduced", "cubes", "largest_cube")
MEASURES = (*(name for name, kind in RUN_COLUMNS.items() if kind != "string"), "price", _OVER)
"""What a plot may have on its axes."""


def _measured(rows: Sequence[Row]) -> list[Row]:
    """Return runs with all `MEASURES`, and as `base` the name of the system without its size."""
    prices = {row["id"]: row["price"] for row in priced(rows)}
    best = best_by_scene(rows)
    found = []
    for row in rows:
        counted = {name: row.get(name) if row["goal"] else None for name in _OF_REACHED}
        over = counted["cubes"] / best[scene_of(row)] if counted["cubes"] else None
        more = {"rounds": rounds_or_limit(row), "price": prices.get(row["id"]), _OVER: over}
        found.append(row | counted | more | {"base": without_size(row["system"])})
    return found


def published_rows(rows: Sequence[Row], published: Sequence[PublishedResults]) -> list[Row]:
    """Return the published runs in systems of these rows: with their share, each with the mean."""
    here = {row["system"]: row for row in rows}
    unknown = dict.fromkeys({*MEASURES} - {"modules", "max_rounds", "hesitate"})
    return [
        here[system]
        | unknown
        | {"rule": name + PUBLISHED, "goal": run < round(share * each.runs), "rounds": rounds}
        for each in published
        for system, name, share, rounds in each.results
        if system in here
        for run in range(each.runs)
    ]


def price_plot(rows: Sequence[Row], size: Sequence[float] = ()) -> Plot | None:
    """Return the plot of what runs paid for timing, class and rule; None if none arrived."""
    shares = {
        key: f"{sum(bool(row['goal']) for row in several)} of {len(several)} reached"
        for key, several in groups(
            (row | {"base": without_size(row["system"])} for row in rows if row["clock"] != "free"),
            ["base", "rule"],
        ).items()
    }
    drawn = [
        row | {"panel": f"{base}, {row['rule']}, {shares[base, row['rule']]}"}
        for row in priced(rows)
        if (base := without_size(row["system"]))
    ]
    looks = Looks(drawn or rows, size)
    variants = sorted({looks.rest(row) for row in drawn}, key=natural)
    title = "Rounds over the best known: timing x class x rule"
    if len(variants) > 1:
        title += f"\nbars of a size from left to right: {', then '.join(variants)}"
    return _figure("price", title, drawn, "panel", looks, stacked(variants or [""], looks.rest))


def _by_size(measure: str, size: str = "modules") -> Draw:
    def draw(axes: Axes, rows: Sequence[Row], looks: Looks) -> None:
        for look, several in looks.by_variant(rows):
            means = by_size(several, measure, size)
            if not means:
                continue
            low = [each.estimate - (each.low or each.estimate) for each in means.values()]
            high = [(each.high or each.estimate) - each.estimate for each in means.values()]
            axes.errorbar(
                list(means),
                [each.estimate for each in means.values()],
                yerr=[low, high],
                capsize=2,
                markersize=4,
                linewidth=1.4,
                **look,
            )
            for (at,), there in groups(several, [size]).items():
                reached = sum(bool(row["goal"]) for row in there)
                if reached < len(there) and at in means and measure != "goal":
                    axes.annotate(
                        f"{reached}/{len(there)}",
                        (at, means[at].estimate),
                        xytext=(4, -11),
                        textcoords="offset points",
                        fontsize=8,
                        color=look["color"],
                    )
        for cap in {row["max_rounds"] for row in rows if not row["goal"] and measure == "rounds"}:
            axes.axhline(cap, color=PALE, linestyle=":", linewidth=1.2)
        axes.margins(0.12)  # room for the shares
        sizes = sorted({row[size] for row in rows if row[size] is not None})
        if sizes and sizes[0] > 0:
            axes.set_xscale("log")
        if measure == "goal":
            axes.set_ylim(-0.05, 1.05)
        elif measure != _OVER and axes.get_ylim()[0] > 0:
            axes.set_yscale("log")
            bottom, top = axes.get_ylim()
            narrow = top / bottom < _DECADE
            axes.yaxis.set_major_locator(
                MaxNLocator(5) if narrow else LogLocator(subs=(1.0, 2.0, 5.0))
            )
            axes.yaxis.set_major_formatter(_NUMBERS)
        shown = sizes if len(sizes) <= 6 else [sizes[0], sizes[len(sizes) // 2], sizes[-1]]
        axes.set_xticks(shown, [f"{at:g}" for at in shown])
        axes.minorticks_off()
        axes.set_xlabel(size)
        axes.set_ylabel("share at the goal" if measure == "goal" else measure)

    return draw


def _progress(curves: Mapping[str, NDArray[np.float64]]) -> Draw:
    def draw(axes: Axes, rows: Sequence[Row], looks: Looks) -> None:
        longest = max(len(curves[row["id"]]) for row in rows)
        for look, several in looks.by_variant(rows):
            lines = np.zeros((len(several), longest))
            for line, row in zip(lines, several, strict=True):
                curve = curves[row["id"]]
                line[: len(curve)] = curve
                line[len(curve) :] = curve[-1]  # a run that is over stays as it is
            shown = np.unique(np.geomspace(1, longest, 160).astype(int)) - 1
            low, middle, high = np.percentile(lines[:, shown], [25, 50, 75], axis=0)
            axes.fill_between(shown + 1, low, high, color=look["color"], alpha=0.18, linewidth=0)
            every = max(1, len(shown) // 6)
            axes.plot(shown + 1, middle, linewidth=1.4, markersize=4, markevery=every, **look)
        axes.set_xscale("log")
        if longest < _DECADE:  # there a logarithmic axis has powers of ten between its numbers
            axes.set_xticks(range(1, longest + 1))
            axes.minorticks_off()
        axes.xaxis.set_major_formatter(_NUMBERS)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("round")
        axes.set_ylabel("distance over first round's")

    return draw


def _figure(  # noqa: PLR0917 - a figure is all of these
    name: str, title: str, rows: Sequence[Row], panel: str, looks: Looks, draw: Draw
) -> Plot | None:
    """Draw a panel for each value of a column; of many, eight that lie evenly in their order."""
    if not rows:
        return None
    panels = groups(rows, [panel])
    keys = sorted(panels, key=lambda key: natural(key[0]))
    more = ""
    if len(keys) > _PANELS_MAX:
        more = f" ({_PANELS_MAX} of {len(keys)} systems)"
        keys = [keys[place] for place in np.linspace(0, len(keys) - 1, _PANELS_MAX).astype(int)]
    across = min(_ACROSS, len(keys))
    down = ceil(len(keys) / across)
    style: Any = _STYLE
    with mpl.rc_context(style):
        inches = looks.size or (max(_WIDE * across, 5.4), _HIGH * down + 0.9)
        figure = Figure(figsize=inches, layout="constrained")
        all_axes = figure.subplots(down, across, squeeze=False)
        handles: dict[str, Any] = {}
        for place, axes in enumerate(all_axes.flat):
            if place >= len(keys):
                axes.set_axis_off()
                continue
            draw(axes, panels[keys[place]], looks)
            axes.set_title(_in_lines(str(keys[place][0])))
            handles |= {
                label: handle
                for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
            }
        figure.suptitle(title + more, fontsize=11, color=INK)
        labels = looks.in_order(handles)
        figure.legend(
            [handles[label] for label in labels],
            labels,
            title=looks.sources if any(label.endswith(PUBLISHED) for label in labels) else None,
            title_fontsize=7,
            loc="outside lower center",
            ncols=min(2 if max(map(len, labels)) > _LONG else 4, len(labels)),
        )
        image = partial(_image, figure, name)
        svg, png, pdf = (cache(partial(image, kind)) for kind in ("svg", "png", "pdf"))
        return Plot(name, title + more, svg, png, pdf)


def _in_lines(title: str) -> str:
    """Return a title that is no wider than a panel, broken after commas."""
    lines = [""]
    for part in re.findall(r"[^,]*(?:, ?|$)", title):
        if len(lines[-1]) + len(part.rstrip()) > _TITLE:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.strip() for line in lines if line)


def _image(figure: Figure, name: str, kind: str) -> bytes:
    """Return a figure as bytes; as PDF, for a paper, without the title, which its caption has."""
    if kind == "pdf":
        figure.suptitle("")
    stream, style = BytesIO(), dict[Any, Any](_STYLE | {"svg.hashsalt": name})
    with mpl.rc_context(style):
        figure.savefig(stream, format=kind, dpi=_DOTS, facecolor="white", metadata=_METADATA[kind])
    return stream.getvalue()
