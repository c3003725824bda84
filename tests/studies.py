"""The studies of docs/studies: from the folders of their sweeps to what is committed of them.

``python tests/studies.py price DIR...``, or ``free-clock``, writes what each run came to as Parquet
into docs/studies, the picture beside it, and the tables into the page, between marks.
"""

import argparse
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure

from cubepath.coordinator.experiments.rows import RUN_COLUMNS, Row, in_canonical_order
from cubepath.coordinator.experiments.sweeping import read_sweep
from cubepath.coordinator.experiments.tables import FACTORS, groups, priced, shown, without_size
from cubepath.protocol.core.statistics import geometric_mean_interval

DOCS = Path(__file__).parent.parent / "docs"
FOLDER = DOCS / "studies"
PAGE = DOCS / "findings.md"
_NOT_KEPT = {"seconds", "id", "code", "configuration", "recording", "digest", "costs"}
"""Columns that tell how a run was played, that do not go into tens of kilobytes, or that no table
of a study has."""
JITTER = 0.5
"""Without rounds, turns take from 1 - JITTER to 1 + JITTER of their average in compiled code."""


def kept(rows: Iterable[Row]) -> list[Row]:
    """Return the rows in their order, without what is of the machine."""
    names = [name for name in RUN_COLUMNS if name not in _NOT_KEPT]
    ordered = in_canonical_order(row | {"id": row.get("id") or ""} for row in rows)
    return [{name: row[name] for name in names} for row in ordered]


def committed(study: str) -> list[Row]:
    """Return the rows of a study that are in docs/studies."""
    rows: list[Row] = pq.read_table(FOLDER / f"{study}.parquet").to_pylist()
    return rows


def write_rows(study: str, rows: Sequence[Row]) -> None:
    """Write the rows of a study; columns take the least room that their values need."""
    types = {
        "string": pa.string(),
        "int64": pa.int32(),
        "float64": pa.float64(),
        "bool": pa.bool_(),
    }
    schema = pa.schema([(name, types[RUN_COLUMNS[name]]) for name in rows[0]])
    table = pa.Table.from_pylist(list(rows), schema=schema)
    pq.write_table(table, FOLDER / f"{study}.parquet", compression="zstd", compression_level=19)


def markdown(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as it stands on a page."""
    lines = [columns, ["---"] * len(columns), *([shown(each) for each in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


# The price of decentralisation.


def best_known() -> dict[str, Row]:
    """Return by system the best schedule on file, and its bound."""
    rows = json.loads((FOLDER / "price-best.json").read_text("utf-8"))
    return {row["system"]: row for row in rows}


def optimum_shown(row: Mapping[str, Any]) -> str:
    """Return a proved optimum in bold, or the bound and the best known."""
    proved = row["best"] == row["bound"]
    return f"**{row['best']}**" if proved else f"{row['bound']} to {row['best']}"


def with_best(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of the study of prices with the best schedules on file, and their bounds."""
    best = best_known()
    return [
        row
        | {
            "bound": max(known["bound"], row["bound"] or 0),
            "best_known": known["best"],
            "optimum": known["best"] if known["proved"] else None,
        }
        for row in rows
        for known in [best[row["system"]]]
    ]


def _modules(row: Row) -> int:
    modules: int = row["modules"]
    return modules


def price_tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the table of prices: factors of the largest of systems that one rule alone plays."""
    chance = {row["system"] for row in rows if row["rule"] == "random"}
    best = best_known()
    by_setting = groups(priced(with_best(rows)), ["system", "hesitate"])
    lines = []
    kinds = {without_size(row["system"]): row for row in sorted(rows, key=_modules)}
    for kind in dict.fromkeys(without_size(row["system"]) for row in rows):
        system = kinds[kind]["system"]
        if system in chance:
            continue
        both = [by_setting.get((system, hesitate), []) for hesitate in (0.0, 0.5)]
        lost = [
            geometric_mean_interval([row[name] for row in played]).estimate if played else None
            for played, name in zip((both[0], *both), ("class", "timing", "timing"), strict=True)
        ]
        one = next((row[FACTORS[2]] for each in both for row in each), None)
        lines.append([f"`{system}`", optimum_shown(best[system]), one, *lost])
    names = ["system", "optimum", "rule", "class, h 0", "timing, h 0", "timing, h ½"]
    return {"rules": markdown(names, lines)}


PICTURED = {
    "arm:n=80": "arm of 80 segments",
    "assembly:n=6": "pyramid of 21 parts",
    "hex-tunnel:n=16": "16 hexagons in a channel",
    "polygon:n=20": "polygon with 20 corners",
    "triangulation:n=40,seed=1": "triangulation of 40 points",
    "hex:n=16": "chain of 16 hexagons",
    "hex-open:n=16": "chain that may split, 16",
    "sliding-shapes:n=8,seed=1": "8 squares to any shape",
    "hex-shapes:n=7,seed=1": "7 hexagons to any shape",
    "agv-labelled:graph=grid8x8,n=16,seed=1": "16 vehicles, a goal each",
    "agv:graph=grid8x8,n=16,seed=1": "16 vehicles, any goal",
    "arm-free:n=8": "free arm of 8 segments",
}
"""One system of each family, and what a reader who does not know it reads."""


def price_picture(rows: Sequence[Row]) -> bytes:
    """Return the picture of prices: for one system of each family, the three factors of its rule.

    The bars are runs with a common beat, the marks runs in which modules skip half of the rounds.
    """
    runs = [row for row in with_best(rows) if row["rule"] != "random"]
    paid = groups(priced(runs), ["system", "hesitate"])
    found = []
    for system, name in PICTURED.items():
        both = [paid[system, hesitate] for hesitate in (0.0, 0.5)]
        each = [geometric_mean_interval([row[of] for row in both[0]]).estimate for of in FACTORS]
        marks = [
            geometric_mean_interval([row["price"] for row in several]).estimate for several in both
        ]
        found.append((marks[0], marks[1], each[::-1], f"{name}: {both[0][0]['rule']}"))
    found.sort(reverse=True)
    style: Any = {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False}
    names = (
        "rule: the best way that it found is longer",
        "class: another run found a better way",
        "timing: moves are later than possible",
    )
    looks = (("#0072B2", ""), ("#E69F00", "////"), ("#ffffff", "...."))
    with mpl.rc_context(style):
        figure = Figure(figsize=(9.6, 4.8), layout="constrained", dpi=110)
        axes = figure.subplots()
        at = list(range(len(found)))
        left = np.ones(len(found))
        for place, (name, (color, hatch)) in enumerate(zip(names, looks, strict=True)):
            right = left * [each[place] for _, _, each, _ in found]
            axes.barh(
                at,
                right - left,
                left=left,
                color=color,
                hatch=hatch,
                edgecolor="#1b1f24",
                linewidth=0.6,
                height=0.7,
                label=name,
            )
            left = right
        late = [late for _, late, _, _ in found]
        axes.plot(
            late, at, "D", color="#D55E00", markersize=5, label="if modules skip half of the rounds"
        )
        axes.set_yticks(at, [label for *_, label in found])
        axes.set_xscale("log")
        ticks = [each for each in (1, 2, 3, 5, 10, 20, 50) if each <= max(late) * 1.1]
        axes.set_xticks(ticks, [f"{each}" for each in ticks])
        axes.minorticks_off()
        axes.set_xlim(1, max(late) * 1.1)
        axes.grid(visible=True, axis="x", color="#8a8f98", alpha=0.35)
        axes.set_axisbelow(True)
        axes.set_xlabel("rounds, as a multiple of the best schedule known")
        shown_as, labels = axes.get_legend_handles_labels()
        order = (1, 2, 3, 0)
        figure.legend(
            [shown_as[place] for place in order],
            [labels[place] for place in order],
            loc="outside lower center",
            ncols=2,
            frameon=False,
        )
        stream = BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


# The free clock against lockstep.


def beat(modules: int, slow: int, factor: int) -> float:
    """Return how long the longest turn of a round is on average, if turns vary as without rounds.

    It is the mean of the maximum of independent uniform numbers, from 1 - JITTER to 1 + JITTER
    times 1, or times the factor.
    """
    at = np.linspace(0.0, factor * (1 + JITTER), 20_001)
    below = np.ones_like(at)
    for size, count in ((1, modules - slow), (factor, slow)):
        share = (at / size - (1 - JITTER)) / (2 * JITTER)
        below *= np.clip(share, 0.0, 1.0) ** count
    return float(np.trapezoid(1 - below, at))


def ratios(rows: Sequence[Row], *, varied: bool = False) -> dict[tuple[str, str], list[float]]:
    """Return time without rounds over time with rounds, by system and faults, on equal seeds.

    With rounds every round takes as long as the slowest module's average turn; if `varied`, as long
    as the longest turn is on average, where turns vary as they do without rounds.
    """
    found: dict[tuple[str, str], list[float]] = {}
    pairs = groups([row for row in rows if row["goal"]], ["system", "faults", "seed"])
    for (system, faults, _), pair in pairs.items():
        times = {row["clock"]: row["time"] for row in pair}
        if len(times) < 2:
            continue
        row = pair[0]
        slow, factor = round(row["slow"] * row["modules"]), row["slow_factor"]
        longer = beat(row["modules"], slow, factor) / (factor if slow else 1) if varied else 1.0
        found.setdefault((system, faults), []).append(times["free"] / times["lockstep"] / longer)
    return found


def _faults_in_order(rows: Sequence[Row]) -> list[str]:
    keys = {(row["slow_factor"] if row["slow"] else 1, row["slow"], row["faults"]) for row in rows}
    return [faults for _, _, faults in sorted(keys)]


def _named(faults: str) -> str:
    if faults == "none":
        return "equal"
    given = dict(part.split("=") for part in faults.split(","))
    return f"{100 * float(given['slow']):.0f}% by {given.get('slow_factor', '10')}"


def free_tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page on clocks: ratios of times, in the model and with messages."""
    every = rows
    rows = [row for row in every if row["core"] == "compiled"]
    times = ratios(rows)
    order = [faults for faults in _faults_in_order(rows) if "slow_factor=2" not in faults]
    systems = list(dict.fromkeys(row["system"] for row in rows))
    slow = markdown(
        ["system", *map(_named, order)],
        [
            [
                f"`{system}`",
                *(geometric_mean_interval(times[system, faults]).estimate for faults in order),
            ]
            for system in systems
        ],
    )
    return {"slow": slow, "simulated": _simulated_table(every)}


def _simulated_table(rows: Sequence[Row]) -> str:
    """Return simulated time without rounds over time with rounds, at equal speeds and slow.

    Simulated rounds are those of modules that act at once; what the slowest thinks is added to each
    of them. A thinking time is 10 ms there.
    """
    found = []
    simulated = [row for row in rows if row["core"] == "simulated"]
    for (system,), several in groups(simulated, ["system"]).items():
        rounds = {row["seed"]: row for row in several if row["clock"] == "lockstep"}
        line: list[object] = [f"`{system}`"]
        for factor in (1, 10):
            free = [row for row in several if row["slow"] and row["slow_factor"] == factor]
            times = [
                row["time"] / (with_rounds["time"] + with_rounds["rounds"] * factor / 100)
                for row in free
                for with_rounds in [rounds[row["seed"]]]
            ]
            line.append(geometric_mean_interval(times))
        found.append(line)
    return markdown(["system", "equal", "25% by 10"], found)


def free_picture(rows: Sequence[Row]) -> bytes:
    """Return the picture of the page on clocks: ratios by the share of slow modules."""
    rows = [row for row in rows if row["core"] == "compiled"]
    times = {key: geometric_mean_interval(found) for key, found in ratios(rows).items()}
    setting = {row["faults"]: (row["slow"], row["slow_factor"]) for row in rows}
    systems = list(dict.fromkeys(row["system"] for row in rows))
    style: Any = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    looks = {2: ("#0072B2", "o", "-"), 10: ("#D55E00", "s", "--")}
    with mpl.rc_context(style):
        figure = Figure(figsize=(10.8, 5.6), layout="constrained", dpi=144)
        all_axes = figure.subplots(2, 4, sharey=True)
        for axes, system in zip(all_axes.flat, systems, strict=True):
            axes.axhline(1.0, color="#1b1f24", linewidth=0.8)
            for factor, (color, marker, line) in looks.items():
                points = sorted(
                    (share, times[system, faults])
                    for faults, (share, times_slow) in setting.items()
                    if times_slow == factor or not share
                )
                middle = [each.estimate for _, each in points]
                away = [
                    [each.estimate - (each.low or 0.0) for _, each in points],
                    [(each.high or 0.0) - each.estimate for _, each in points],
                ]
                axes.errorbar(
                    [100 * share for share, _ in points],
                    middle,
                    yerr=away,
                    color=color,
                    marker=marker,
                    linestyle=line,
                    capsize=2,
                    markersize=4,
                    linewidth=1.4,
                    label=f"slow modules take {factor} times as long",
                )
            axes.set_yscale("log")
            axes.set_yticks([0.1, 0.2, 0.5, 1.0, 2.0], ["0.1", "0.2", "0.5", "1", "2"])
            axes.minorticks_off()
            axes.grid(visible=True, color="#8a8f98", alpha=0.35)
            axes.set_title(system.replace(",seed=1", ""), fontsize=9)
            axes.set_xlabel("slow modules, %")
        figure.supylabel("time, free over lockstep", fontsize=9)
        figure.legend(
            *all_axes.flat[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=2,
            frameon=False,
        )
        stream = BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


TABLES = {"price": price_tables, "free-clock": free_tables}
PICTURES = {"price": price_picture, "free-clock": free_picture}


def tables_of_page() -> dict[str, str]:
    """Return the tables that stand on the page, by their marks."""
    text = PAGE.read_text("utf-8")
    return dict(re.findall(r"<!-- table (\w+) -->\n(.*?)\n<!-- end -->", text, re.DOTALL))


def write_tables(tables: Mapping[str, str]) -> None:
    """Put tables into the page, by their marks."""
    text = PAGE.read_text("utf-8")
    for mark, table in tables.items():
        begin, end = f"<!-- table {mark} -->\n", "<!-- end -->"
        before, _, rest = text.partition(begin)
        text = f"{before}{begin}{table}\n{end}{rest.partition(end)[2]}"
    PAGE.write_text(text, "utf-8")


def main() -> None:
    """Write the rows, the picture and the tables of a study from the folders of its sweeps."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("study", choices=TABLES)
    parser.add_argument("folders", nargs="*", metavar="DIR", help="default: the rows on file")
    asked = parser.parse_args()
    if asked.folders:
        found = [row for folder in asked.folders for row in read_sweep(folder).rows]
        write_rows(asked.study, kept(found))
    rows = committed(asked.study)
    (FOLDER / f"{asked.study}.png").write_bytes(PICTURES[asked.study](rows))
    write_tables(TABLES[asked.study](rows))


if __name__ == "__main__":
    main()
