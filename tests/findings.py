"""Tables and pictures of docs/findings.md, from the rows of the scripts in docs/studies.

``python tests/findings.py`` writes them. docs/findings.md names the commands that make the rows.
"""

import json
import re
from collections.abc import Sequence
from io import BytesIO
from math import cos, exp, log, pi, sin, sqrt
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import RegularPolygon
from PIL import Image

from cubepath.coordinator.experiments.tables import without_size
from studies import DOCS, FOLDER, markdown, write_tables

FILES = {
    "flips": "flip-diameter.json",
    "hexagons": "hexagon-shapes.json",
    "gaps": "three-gaps.json",
    "torsion": "torsion.json",
}
Rows = list[dict[str, Any]]
_STYLE: Any = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
_BLUE, _RED, _ORANGE, _INK, _GREY = "#0072B2", "#D55E00", "#E69F00", "#1b1f24", "#c9ced6"


def committed(name: str) -> Rows:
    """Return the rows of one of `FILES`."""
    rows: Rows = json.loads((FOLDER / FILES[name]).read_text("utf-8"))
    return rows


def flips_table(rows: Rows) -> str:
    """Return the table of diameters."""
    columns = ["n", "up to symmetry", "eccentricities", "diameter"]
    lines = []
    for row in rows:
        known = row["eccentricities"]
        said = known and ", ".join(f"{each}: {many:,}" for each, many in known.items())
        lines.append([row["n"], f"{row['orbits']:,}", said, f"**{row['diameter']}**"])
    return markdown(columns, lines)


def hexagons_table(rows: Rows) -> str:
    """Return the table of components, from five hexagons on: fewer have one."""
    columns = ["n", "shapes", "components", "in the largest", "stuck"]
    lines = []
    for row in rows:
        if row["catalogue"] == 2:
            assert row["components"] == 1
            continue
        if row["n"] < 5:
            assert row["components"] == 1
            continue
        share = f"{100 * row['largest'] / row['shapes']:.1f}%"
        counts = [f"{row[key]:,}" for key in ("shapes", "components")]
        lines.append([row["n"], *counts, share, row["stuck"]])
    return markdown(columns, lines)


def _mean(numbers: Sequence[float]) -> float:
    return exp(sum(map(log, numbers)) / len(numbers))


def factors(row: dict[str, Any], beat: int) -> tuple[float, float, float]:
    """Return timing, class and rule of the runs with a common beat (0) or without (1).

    Their product is the geometric mean of rounds over the best known, or the optimum if proved.
    """
    runs = row["runs"][beat]
    timing = _mean([rounds / cubes for rounds, cubes in runs])
    return timing, _mean([cubes for _, cubes in runs]) / row["fewest"], row["fewest"] / row["best"]


def torsion_table(rows: Rows) -> str:
    """Return the table of homology with torsion."""
    columns = ["grid", "vehicles", "torsion of H_2", "pairs of junctions", "can change places"]
    lines = []
    for row in rows:
        torsion = [factors for k, factors in enumerate(row["torsion"]) if k == 2]
        assert not any(factors for k, factors in enumerate(row["torsion"]) if k != 2)
        lines.append(
            [
                f"{row['columns']}x{row['rows']}",
                row["vehicles"],
                " + ".join(f"**Z/{factor}**" for factor in torsion[0]) or "none",
                row["pairs"],
                row["swapping"],
            ]
        )
    return markdown(columns, lines)


def _png(figure: Figure) -> bytes:
    drawn, small = BytesIO(), BytesIO()
    figure.savefig(drawn, format="png", metadata={"Software": None})
    # Few colours in a palette take a third of the room.
    Image.open(drawn).convert("RGB").quantize(32).save(small, format="png", optimize=True)
    return small.getvalue()


def flips_picture(rows: Rows) -> bytes:
    """Return the diameters by n, beside a farthest pair of the largest polygon."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.6, 3.4), layout="constrained", dpi=120)
        curve, *polygons = figure.subplots(1, 3, width_ratios=[1.3, 1, 1])
        sizes = [row["n"] for row in rows]
        curve.step(sizes, [row["diameter"] for row in rows], where="mid", color=_BLUE)
        curve.plot(sizes, [row["diameter"] for row in rows], "o", color=_BLUE, markersize=4)
        curve.set_xlabel("corners n")
        curve.set_ylabel("parallel diameter, rounds")
        curve.set_xticks(sizes)
        curve.set_ylim(0)
        curve.grid(visible=True, axis="y", color="#8a8f98", alpha=0.35)
        last = rows[-1]
        for axes, chords, color in zip(polygons, last["pair"], (_BLUE, _RED), strict=True):
            _polygon(axes, last["n"], chords, color)
        said = f"n = {last['n']}: {last['diameter']} rounds apart"
        figure.suptitle(said, fontsize=9, x=0.7)
        return _png(figure)


def _polygon(axes: Axes, corners: int, chords: Sequence[tuple[int, int]], color: str) -> None:
    at = [(sin(2 * pi * k / corners), cos(2 * pi * k / corners)) for k in range(corners)]
    sides = [(k, (k + 1) % corners) for k in range(corners)]
    for pairs, look in ((sides, _INK), (chords, color)):
        for one, other in pairs:
            axes.plot(*zip(at[one], at[other], strict=True), color=look, linewidth=1.2)
    for k, (x, y) in enumerate(at):
        axes.text(1.13 * x, 1.13 * y, str(k), fontsize=7, ha="center", va="center")
    axes.set_aspect("equal")
    axes.axis("off")


def hexagons_picture(rows: Rows) -> bytes:
    """Return the stuck shapes of up to ten hexagons, and the first of the small components."""
    first = [row for row in rows if row["catalogue"] == 1 and 1 < row["n"] <= 10]
    drawn = [(row["n"], shape, "stuck") for row in first for shape in row["stuck_shapes"]]
    drawn += [(row["n"], shape, f"one of {many}") for row in first for many, shape in row["locked"]]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.6, 4.2), layout="constrained", dpi=110)
        panels = figure.subplots(2, -(-len(drawn) // 2))
        for axes in panels.flat:
            axes.axis("off")
        for axes, (size, shape, said) in zip(panels.flat, drawn, strict=False):
            color = _ORANGE if said == "stuck" else _BLUE
            for q, r in shape:
                place = (sqrt(3) * (q + r / 2), 1.5 * r)
                axes.add_patch(
                    RegularPolygon(place, 6, radius=1, facecolor=color, edgecolor="white")
                )
            axes.set_aspect("equal")
            axes.autoscale_view()
            axes.set_title(f"n = {size}, {said}", fontsize=8)
        return _png(figure)


def gaps_picture(rows: Rows) -> bytes:
    """Return, for each kind of system, what rule, class and timing cost by size."""
    kinds: dict[str, Rows] = {}
    for row in rows:
        system = re.sub(r"shift=\d+", "shift=n", without_size(row["system"]))
        kinds.setdefault(f"{system} {row['rule']}", []).append(row)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(10.8, 5.2), layout="constrained", dpi=110)
        panels = figure.subplots(2, 4, sharey=True)
        for axes in panels.flat:
            axes.axis("off")
        for axes, (kind, several) in zip(panels.flat, kinds.items(), strict=False):
            axes.axis("on")
            _panel(axes, kind, several)
        handles, labels = panels.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
        proved = all(row["best"] == row["bound"] for row in rows)
        figure.supylabel("over the optimum" if proved else "over the best known", fontsize=9)
        return _png(figure)


def _panel(axes: Axes, kind: str, several: Rows) -> None:
    sizes = [_size(row["system"]) for row in several]
    levels = []
    for row in several:
        (early, cubes, rule), (late, hesitant, _) = factors(row, 0), factors(row, 1)
        levels.append((rule, rule * cubes, rule * cubes * early, rule * hesitant * late))
    least, classes, beat, none = zip(*levels, strict=True)
    axes.fill_between(sizes, 1, least, color=_BLUE, alpha=0.55, linewidth=0, label="rule")
    axes.fill_between(sizes, least, classes, color=_ORANGE, alpha=0.7, linewidth=0, label="class")
    axes.fill_between(sizes, classes, beat, color=_RED, alpha=0.5, linewidth=0, label="timing, h 0")
    axes.plot(sizes, none, "--", color=_INK, linewidth=1.2, label="rounds, h ½")
    open_ = [size for size, row in zip(sizes, several, strict=True) if row["best"] > row["bound"]]
    if open_:
        axes.plot(open_, [1.0] * len(open_), "x", color=_INK, markersize=5, label="not proved")
    axes.set_yscale("log")
    axes.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    axes.minorticks_off()
    axes.set_xticks(sizes)
    axes.grid(visible=True, axis="y", color=_GREY)
    axes.set_title(kind.replace(",seed=1", "").replace(":graph=", " "), fontsize=8)
    axes.set_xlabel("modules", fontsize=8)


def torsion_picture(rows: Rows) -> bytes:
    """Return an exchange at a junction, and how the exchanges at two of them change places."""
    way = next(row["way"] for row in rows if row["way"])
    places = ((1, 2), (1, 0), (1, 3), (0, 3), (2, 3), (2, 0), (2, 1))
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.6, 3.9), layout="constrained", dpi=110)
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1, 2.3]).flat
        at = ((0, 0), (-1, 0), (0, 1), (1, 0))
        for axes, standing in zip(above.subplots(1, len(places)), places, strict=True):
            for leaf in at[1:]:
                axes.plot(*zip(at[0], leaf, strict=True), color=_INK, linewidth=1.2, zorder=1)
            axes.scatter(*zip(*at, strict=True), s=70, color="white", edgecolor=_INK, zorder=2)
            for name, place in zip("ab", standing, strict=True):
                axes.scatter(*at[place], s=110, color=_BLUE, zorder=3)
                axes.text(
                    *at[place], name, color="white", fontsize=8, ha="center", va="center_baseline"
                )
            axes.set_xlim(-1.4, 1.4)
            axes.set_ylim(-0.4, 1.4)
            axes.set_aspect("equal")
            axes.axis("off")
        for axes, pair in zip(below.subplots(1, len(way)), way, strict=True):
            for x, y in [(x, y) for x in range(5) for y in range(5)]:
                for there in ((x + 1, y), (x, y + 1)):
                    if max(there) < 5:
                        axes.plot(*zip((x, y), there, strict=True), color=_GREY, zorder=0)
            for (middle, *leaves), color in zip(pair, (_BLUE, _ORANGE), strict=True):
                for leaf in leaves:
                    axes.plot(*zip(middle, leaf, strict=True), color=color, linewidth=4, zorder=1)
                axes.scatter(*zip(middle, *leaves, strict=True), s=50, color=color, zorder=2)
            axes.set_aspect("equal")
            axes.axis("off")
        return _png(figure)


def _size(system: str) -> int:
    found = re.search(r"n=(\d+)", system)
    assert found is not None
    return int(found[1])


TABLES = {"flips": flips_table, "hexagons": hexagons_table, "torsion": torsion_table}
PICTURES = {
    "flips": flips_picture,
    "hexagons": hexagons_picture,
    "gaps": gaps_picture,
    "torsion": torsion_picture,
}


def main() -> None:
    """Write the pictures and the tables."""
    for name in FILES:
        (DOCS / f"findings-{name}.png").write_bytes(PICTURES[name](committed(name)))
    write_tables({name: table(committed(name)) for name, table in TABLES.items()})


if __name__ == "__main__":
    main()
