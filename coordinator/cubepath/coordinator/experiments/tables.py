"""The tables of a report: runs by setting, rules in pairs on equal seeds, growth, price.

A table is its columns and rows of values, for pages, terminals and machines.

The price is the cost of letting modules decide for themselves, as a product of three factors:
timing, class and rule. The rounds of a run are at least the cubes of its normal cube path; these
are at least the fewest cubes that its rule ever took there; these are at least the best known. So
rounds over the best known is a product of three ratios, each 1 or more.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

from matplotlib.axes import Axes

from cubepath.coordinator.experiments.published import PUBLISHED, PublishedResults
from cubepath.coordinator.experiments.rows import FAILURES, Row, natural
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.statistics import (
    SIZES_MIN,
    Interval,
    geometric_mean_interval,
    mean_interval,
    paired_test,
    power_law,
    share_interval,
    sign_test,
)

_ALIKE = ("system", "clock", "core", "hesitate", "faults", "max_rounds")
_PARTS = ("processes", "keepers")
WORLD = (*_ALIKE, *_PARTS)
"""What two runs have in common whose rules are compared."""
_LEVELS = "levels of moves, which take no fixed time"


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table: its title, what it says in a line or two, its columns, and its rows."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def document(self) -> list[dict[str, Any]]:
        """Return the rows as plain data."""
        return [dict(zip(self.columns, map(_plain, row), strict=True)) for row in self.rows]

    def texts(self) -> list[list[str]]:
        """Return the rows as texts."""
        return [[shown(value) for value in row] for row in self.rows]


def _plain(value: object) -> object:
    return value._asdict() if isinstance(value, Interval) else value


def shown(value: object) -> str:
    """Return a value as it stands in a table.

    >>> shown(Interval(1003.2, 420.4, 1578.0)), shown(None), shown(0.000012), shown(1234567.0)
    ('1003 [420, 1578]', '', '1.2e-05', '1.23e+06')
    """
    match value:
        case None:
            return ""
        case Interval(estimate, low, high):
            if low is None or high is None or low == high == estimate:
                return shown(estimate)
            return f"{shown(estimate)} [{shown(low)}, {shown(high)}]"
        case float():
            # Three digits, but no power of ten before a million.
            return f"{value:.0f}" if 999.5 <= abs(value) <= 1e6 else f"{value:.3g}"
        case _:
            return str(value)


def short_names(rows: Iterable[Row], pool: Sequence[str] = ()) -> list[Row]:
    """Return rows whose files are named without folders, where that is unambiguous.

    Systems that differ in the keys of `pool` alone have one name; `scene` tells them apart.
    InputError for a key that no system has.
    """
    several = [row | {"scene": scene_of(row)} for row in rows]
    for key in pool:
        if not any(re.search(rf"[:,]{re.escape(key)}=", row["scene"]) for row in several):
            raise InputError(f"pool={key}: no system here has this key, expected one of theirs")
    for column, name in (("system", partial(without_keys, keys=pool)), ("rule", str)):
        long = {row[column]: name(row[column]) for row in several}
        short = {each: re.sub(r"(^|=)[^,=]*/", r"\1", each) for each in {*long.values()}}
        counts = Counter(short.values())
        names = {each: short[one] if counts[short[one]] == 1 else one for each, one in long.items()}
        several = [row | {column: names[row[column]]} for row in several]
    return several


def scene_of(row: Row) -> str:
    """Return the one scene of a run, by whatever name it is pooled with others."""
    return str(row.get("scene", row["system"]))


def groups(rows: Iterable[Row], keys: Sequence[str]) -> dict[tuple[Any, ...], list[Row]]:
    """Return rows by the values of some columns, in the order in which these come."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return found


def varying(rows: Sequence[Row], keys: Iterable[str]) -> list[str]:
    """Return those columns that do not have the same value throughout, and always the first.

    How many processes and keepers there are follows from the rest as a rule: a run in compiled code
    has none, and one of few modules has few. They are returned if runs differ in them alone.
    """
    alike = list(groups(rows, ("rule", *_ALIKE)).values())
    return [
        key
        for place, key in enumerate(keys)
        if not place
        or any(
            len({row.get(key) for row in several}) > 1
            for several in (alike if key in _PARTS else [rows])
        )
    ]


def best_by_scene(rows: Iterable[Row]) -> dict[str, int]:
    """Return for each system the fewest cubes that are known between its start and its goal.

    They are those of a run to the goal, whatever its setting, or were known before; a system
    without either is left out.

    >>> run = {"system": "hex:n=4", "goal": True, "optimum": None, "best_known": None}
    >>> best_by_scene([run | {"cubes": 14}, run | {"cubes": 11}, run | {"cubes": 12}])
    {'hex:n=4': 11}
    """
    found: dict[str, int] = {}
    for row in rows:
        own = row["cubes"] if row["goal"] else None
        for cubes in (own, row["optimum"], row["best_known"]):
            if cubes is not None:
                found[scene_of(row)] = min(cubes, found.get(scene_of(row), cubes))
    return found


def rounds_or_limit(row: Row) -> int | None:
    """Return the rounds of a run; of one that did not reach its goal the most that it might take.

    Means over the runs that arrived alone would favour a rule that arrives in easy cases only.
    """
    rounds: int | None = row["rounds"] if row["goal"] else row["max_rounds"]
    return rounds


_MEASURED = ("runs", "goal", "rounds", "time", "moves", "costs", "cubes")
_KNOWN = ("bound", "best", "price", "conflicts", "messages", "stuck", "by fault", "failed")


def runs_table(rows: Sequence[Row], published: Sequence[PublishedResults] = ()) -> ReportTable:
    """Return the results of the runs of each setting, with what others published on it."""
    keys = varying(rows, ("system", "rule", *WORLD[1:]))
    keys = ["system", "rule", *(key for key in keys if key not in {"system", "rule"})]
    best = best_by_scene(rows)
    rows = [row | {"scene": scene_of(row), "best": best.get(scene_of(row))} for row in rows]
    paid = groups(priced(rows), keys)
    # With rounds it may say the same again.
    timed = any(row["time"] not in {None, row["rounds"]} for row in rows)
    faulty = any(row["ended"] == "fault" for row in rows)
    found = []
    for key, several in groups(rows, keys).items():
        reached = [row for row in several if row["goal"]]
        found.append(
            (
                *key,
                len(several),
                share_interval(len(reached), len(several)),
                _mean(several, rounds_or_limit),
                _mean(reached if timed else (), lambda row: row["time"]),
                _mean(reached, lambda row: row["moves"]),
                _mean(reached, lambda row: row.get("costs")),
                _mean(reached, lambda row: row["cubes"]),
                _over_scenes(several, "bound"),
                _over_scenes(several, "best"),
                _geometric(paid[key], "price") if key in paid else None,
                _mean(several, lambda row: row["conflicts"]),
                _mean(several, lambda row: row["messages"]),
                sum(bool(row["stuck"]) for row in several),
                sum(row["ended"] == "fault" for row in several) if faulty else None,
                sum(row["ended"] in FAILURES for row in several),
            )
        )
    limits = " or ".join(map(str, sorted({row["max_rounds"] for row in rows})))
    systems = [row[0] for row in found]
    blank, rest = [None] * (len(keys) - 2), [None] * (len(found[0]) - len(keys) - 3)
    others = [(each, row) for each in published for row in each.results if row[0] in systems]
    for each, (system, name, share, rounds) in others:
        goal = share_interval(round(share * each.runs), each.runs)
        found.append((system, name + PUBLISHED, *blank, each.runs, goal, rounds, *rest))
    found.sort(key=lambda row: systems.index(row[0]))
    return ReportTable(
        "Runs",
        "".join(f"Published: {source} " for source in dict.fromkeys(e.source for e, _ in others))
        + f"Goal is the share of runs that reached their goal within {limits} rounds, with its"
        " exact interval (Clopper and Pearson). Rounds are means over all runs, where a run that"
        " did not reach its goal counts as its limit; time, moves, costs, cubes and price are means"
        " over the runs that did. Costs are the rounds up to each module's last move, summed over"
        " all modules. Intervals are those of 2,000 seeded bootstrap resamples, at 95%. Best is the"
        " fewest cubes known in the system, including those of all runs here; price is rounds over"
        " best. Time is in turns of a module that is not slow, under the simulator in virtual"
        " seconds; it is shown if it differs from the rounds."
        " By fault counts runs that a fault or the limit of virtual time ended.",
        (*keys, *_MEASURED, *_KNOWN),
        tuple(found),
    )


def _mean(rows: Iterable[Row], measure: Callable[[Row], float | None]) -> Interval | None:
    numbers = [found for row in rows if (found := measure(row)) is not None]
    return mean_interval(numbers) if numbers else None


def _over_scenes(rows: Iterable[Row], column: str) -> int | Interval | None:
    """Return the greatest that is known of a scene, or of several pooled ones the mean."""
    known = groups((row for row in rows if row[column] is not None), ["scene"])
    values = [max(row[column] for row in several) for several in known.values()]
    return mean_interval(values) if len(values) > 1 else next(iter(values), None)


_PAIRED = ("first", "second", "pairs", "both", "difference", "first faster", "second faster")
_TESTED = ("p", "test", "first alone", "second alone", "p of goals")


def pairs_table(rows: Sequence[Row]) -> ReportTable:
    """Return how the rules compare, two by two, on the same systems and seeds."""
    keys = varying(rows, WORLD)
    rows = [row | {"scene": scene_of(row)} for row in rows]
    found = []
    for key, several in groups(rows, keys).items():
        by_rule: dict[str, dict[Any, Row]] = {}
        for (rule, *place), copies in groups(several, ("rule", "scene", *WORLD, "seed")).items():
            # Of versions of a run none counts more than the others, nor does it count twice.
            if len({(row["goal"], row["rounds"]) for row in copies}) == 1:
                by_rule.setdefault(rule, {})[tuple(place)] = copies[0]
        for one, other in combinations(sorted(by_rule, key=natural), 2):
            pairs = [
                (row, by_rule[other][place])
                for place, row in by_rule[one].items()
                if place in by_rule[other]
            ]
            if pairs:
                found.append((*key, one, other, *_compared(pairs)))
    return ReportTable(
        "Rules in pairs",
        "Runs of two rules from the same start with the same seed. The difference is that of the"
        " rounds of the second rule and the first, over the pairs in which both reached the goal,"
        " with its bootstrap interval; p is two-sided and exact, of Wilcoxon's signed-rank test or,"
        " with more than 200 differences, of the sign test. Where one alone reached the goal, p of"
        " goals is that of the sign test. No p is corrected for how many there are. A run that is"
        " there in several versions, which differ, is left out. Rounds of runs without"
        f" rounds are {_LEVELS}.",
        (*keys, *_PAIRED, *_TESTED),
        tuple(found),
    )


def _compared(pairs: Sequence[tuple[Row, Row]]) -> tuple[Any, ...]:
    both = [(one, other) for one, other in pairs if one["goal"] and other["goal"]]
    alone = [sum(bool(pair[place]["goal"]) for pair in pairs) - len(both) for place in (0, 1)]
    away = [float(other["rounds"] - one["rounds"]) for one, other in both]
    test = paired_test(away) if away else None
    return (
        len(pairs),
        len(both),
        mean_interval(away) if away else None,
        sum(each > 0 for each in away),
        sum(each < 0 for each in away),
        None if test is None else test.p,
        None if test is None else test.name,
        *alone,
        sign_test(*alone) if sum(alone) else None,
    )


def without_size(system: str) -> str:
    """Return the name of a system without its number of modules.

    >>> without_size("agv:graph=K9,n=4"), without_size("hex:n=4"), without_size("mine.toml")
    ('agv:graph=K9', 'hex', 'mine.toml')
    """
    return without_keys(system, ("n",))


def without_keys(system: str, keys: Sequence[str]) -> str:
    """Return the name of a system without some of its keys."""
    name, _, rest = system.partition(":")
    kept = ",".join(part for part in rest.split(",") if part.partition("=")[0] not in {*keys, ""})
    return f"{name}:{kept}" if kept else name


def by_size(rows: Sequence[Row], measure: str, size: str = "modules") -> dict[float, Interval]:
    """Return the means of a measure over the runs that have it, by modules or another column.

    Of `goal` it is the share, with its exact interval.
    """
    known = [row for row in rows if row[measure] is not None and row[size] is not None]
    return {
        at: share_interval(sum(values), len(values)) if measure == "goal" else mean_interval(values)
        for (at,), several in sorted(groups(known, [size]).items())
        for values in [[row[measure] for row in several]]
    }


def growth_table(rows: Sequence[Row]) -> ReportTable:
    """Return how rounds, moves and cubes grow with the size, where all runs arrived."""
    rows = [row | {"family": without_size(row["system"])} for row in rows]
    keys = ["family", *varying(rows, ("rule", *WORLD[1:]))]
    found = []
    for key, several in groups(rows, keys).items():
        cut = {row["modules"] for row in several if not row["goal"]}
        arrived = [row for row in several if row["modules"] not in cut]
        for measure in ("rounds", "moves", "cubes"):
            means = by_size(arrived, measure)
            fit = power_law(list(means), [each.estimate for each in means.values()])
            if fit is not None:
                sizes = f"{min(means)}..{max(means)}"
                found.append(
                    (*key, measure, sizes, len(means), fit.exponent, fit.factor, fit.r_squared)
                )
    return ReportTable(
        "Growth",
        "Least squares of the logarithms: the mean is about factor x modules^exponent. The 95%"
        " interval of the exponent is Student's, from how far the means lie off the line: it shows"
        " how well a power law fits. Sizes at which a run did not reach its goal are left out, and"
        f" nothing is fitted to fewer than {SIZES_MIN} sizes. Rounds of runs without rounds are"
        f" {_LEVELS}.",
        (*keys, "measure", "modules", "sizes", "exponent", "factor", "R2"),
        tuple(found),
    )


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
    several: list[Row] = [row | {"scene": scene_of(row)} for row in rows]
    reached = [row for row in several if row["goal"] and row["cubes"]]
    best = best_by_scene(several)
    fewest = {
        key: min(row["cubes"] for row in mine)
        for key, mine in groups(reached, ["scene", "rule"]).items()
    }
    found = []
    for row in reached:
        if row["clock"] == "free":
            continue
        least, known = fewest[row["scene"], row["rule"]], best[row["scene"]]
        factors = (row["rounds"] / row["cubes"], row["cubes"] / least, least / known)
        paid = {"best": known, "price": row["rounds"] / known}
        found.append(row | dict(zip(FACTORS, factors, strict=True)) | paid)
    return found


def price_table(rows: Sequence[Row]) -> ReportTable:
    """Return what the runs of each setting paid: the three factors, and their product."""
    paid = priced(rows)
    keys = ["system", "rule", *varying(paid, WORLD)[1:]]
    found = []
    for key, several in groups(paid, keys).items():
        found.append(
            (
                *key,
                several[0]["modules"],
                len(several),
                _over_scenes(several, "bound"),
                _over_scenes(several, "best"),
                *(_geometric(several, name) for name in (*FACTORS, "price")),
            )
        )
    return ReportTable(
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
