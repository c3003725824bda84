"""What it costs that modules decide for themselves: timing, class and rule, factor by factor.

The rounds of a run are at least the cubes of its normal cube path, these at least the fewest cubes
that its rule ever took there, and these at least the best that is known. So rounds over the best
known is a product of three factors, each 1 or more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from matplotlib.axes import Axes

from cubepath.coordinator.experiments.rows import Row
from cubepath.coordinator.experiments.statistics import Interval, geometric_mean_interval
from cubepath.coordinator.experiments.tables import WORLD, Table, best_by_system, groups, varying

FACTORS = ("timing", "class", "rule factor")
"""The columns of the three factors; their product is the column ``price``."""
_LOOKS = {  # from the best known upwards; they differ in print without their colours, too
    "rule factor": {"color": "#0072B2", "hatch": ""},
    "class": {"color": "#E69F00", "hatch": "////"},
    "timing": {"color": "#ffffff", "hatch": "...."},
}
_WIDE = 0.8


def priced(rows: Iterable[Row]) -> list[Row]:
    """Return the runs with rounds that reached their goal, each with what it paid and for what.

    Columns are added: `best`, the fewest cubes that are known between start and goal, those of all
    runs here among them; `timing`, rounds over cubes; `class`, cubes over the fewest of all runs of
    the same rule in the same system; `rule factor`, these over `best`; and `price`, rounds over
    `best`, which is the product of the three. Runs that start at their goal are left out, and those
    without rounds, whose levels take no fixed time; the cubes of these count all the same.

    >>> row = {"system": "hex:n=4", "rule": "chain", "clock": "lockstep", "goal": True,
    ...     "rounds": 21, "cubes": 14, "optimum": None, "best_known": 9}
    >>> [(each["timing"], each["class"], each["best"]) for each in priced([row])]
    [(1.5, 1.0, 9)]
    """
    several = list(rows)
    reached = [row for row in several if row["goal"] and row["cubes"]]
    best = best_by_system(several)
    fewest = {
        key: min(row["cubes"] for row in mine)
        for key, mine in groups(reached, ["system", "rule"]).items()
    }
    found = []
    for row in reached:
        if row["clock"] == "free":
            continue
        least, known = fewest[row["system"], row["rule"]], best[row["system"]]
        factors = (row["rounds"] / row["cubes"], row["cubes"] / least, least / known)
        paid = {"best": known, "price": row["rounds"] / known}
        found.append(row | dict(zip(FACTORS, factors, strict=True)) | paid)
    return found


def price_table(rows: Sequence[Row]) -> Table:
    """Return what the runs of each setting paid: the three factors, and their product."""
    paid = priced(rows)
    keys = ["system", "rule", *varying(paid, WORLD)[1:]]
    found = []
    for key, several in groups(paid, keys).items():
        bounds = [row["bound"] for row in several if row["bound"] is not None]
        found.append(
            (
                *key,
                several[0]["modules"],
                len(several),
                max(bounds, default=None),
                several[0]["best"],
                *(_geometric(several, name) for name in (*FACTORS, "price")),
            )
        )
    return Table(
        "Price",
        "What runs with rounds that reached their goal paid: rounds over the best known (that of"
        " all runs here included) is timing x class x rule factor. Timing is rounds over cubes,"
        " class is cubes over the fewest that the rule took in any run here, rule factor is these"
        " over the best known. All are geometric means, so that they multiply here too, with the"
        " 95% interval of 2,000 seeded bootstrap resamples. No schedule has fewer cubes than the"
        " bound.",
        (*keys, "modules", "runs", "bound", "best", *FACTORS, "price"),
        tuple(found),
    )


def _geometric(rows: Sequence[Row], name: str) -> Interval:
    return geometric_mean_interval([row[name] for row in rows])


def stacked(order: Sequence[str], name: Callable[[Row], str]) -> Callable[..., None]:
    """Return what draws bars of the three factors, one upon the other on a logarithmic axis.

    There is a group of bars for each number of modules, in it a bar for each variant: in this
    `order`, by what `name` calls the variant of a run.
    """
    wide = _WIDE / len(order)

    def draw(axes: Axes, rows: Sequence[Row], _looks: object) -> None:
        sizes = sorted({row["modules"] for row in rows})
        top = 1.0
        for (size, variant), several in groups(
            [row | {"variant": name(row)} for row in rows], ["modules", "variant"]
        ).items():
            at = sizes.index(size) + (order.index(variant) - (len(order) - 1) / 2) * wide
            below = 1.0
            for factor, look in _LOOKS.items():
                above = below * _geometric(several, factor).estimate
                bar: dict[str, Any] = {"edgecolor": "#1b1f24", "linewidth": 0.6, **look}
                axes.bar(at, above - below, wide * 0.92, bottom=below, label=factor, **bar)
                below = above
            top = max(top, below)
        axes.set_yscale("log")
        ticks = [1, 1.5, 2, 3, 5, 7, 10, 20, 50, 100, 200, 500, 1000]
        shown = [tick for tick in ticks if tick <= top * 1.05]
        shown = shown if top < 8 else [tick for tick in shown if tick not in {1.5, 3, 7}]
        axes.set_yticks(shown, [f"{tick:g}" for tick in shown])
        axes.minorticks_off()
        axes.set_ylim(1.0, top * 1.08)
        axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
        axes.grid(visible=False, axis="x")
        axes.set_axisbelow(True)
        axes.set_xlabel("modules")
        axes.set_ylabel("rounds over best")

    return draw
