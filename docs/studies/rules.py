"""What share of runs the rules bring to the goal: in every family, and under limits.

``python docs/studies/rules.py -o docs/studies/rules.json`` plays 100 seeds of each family at its
default size and at double that with the rule of the family and with `metropolis`, and the limited
rules of `LIMITED` with each value of `misread` and `notes`; ``--quick`` plays three seeds of a few
settings. Where a scene is drawn at random, run i plays scene seed i. The picture is written beside
the file, as PNG.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cubepath.agents import play_many
from cubepath.agents.rules.registry import find_rule, own_rule
from cubepath.protocol import scene_from_spec
from cubepath.protocol.core.statistics import share_interval

_OWN, _BASELINE = "#0072b2", "#e69f00"
MAX_ROUNDS = 2000
LIMITED_ROUNDS = 500
SEEDS = 100
FAMILIES: tuple[tuple[str, str], ...] = (
    ("hex:n=12", "hex:n=24"),
    ("hex-open:n=7", "hex-open:n=14"),
    ("hex-tunnel:n=6", "hex-tunnel:n=12"),
    ("hex-shapes:n=6,walk=500,seed={}", "hex-shapes:n=12,walk=500,seed={}"),
    ("sliding:n=2", "sliding:n=4"),
    ("sliding-shapes:n=6,seed={}", "sliding-shapes:n=12,seed={}"),
    ("agv:graph=grid8x8,n=8,seed={}", "agv:graph=grid8x8,n=16,seed={}"),
    ("agv-labelled:graph=grid8x8,n=8,seed={}", "agv-labelled:graph=grid8x8,n=16,seed={}"),
    ("arm:n=5", "arm:n=10"),
    ("arm-free:n=6", "arm-free:n=12"),
    ("arms:n=2", "arms:n=4"),
    ("polygon:n=6", "polygon:n=12"),
    ("triangulation:n=12,seed={}", "triangulation:n=24,seed={}"),
    (
        "words:presentation=raag",
        "words:presentation=raag,word=" + "abcd" * 4 + ",goal=" + "badc" * 4,
    ),
    ("assembly:n=3", "assembly:n=6"),
)
LIMITED = (
    ("hex:n=12", "chain"),
    ("hex-tunnel:n=6", "tunnel"),
    ("agv:graph=grid8x8,n=16,seed={}", "tswap"),
    ("agv-labelled:graph=grid8x8,n=16,seed={}", "pibt"),
)
VALUES: dict[str, tuple[float, ...]] = {
    "misread": (0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4),
    "notes": (0, 1, 2, 5, 10, 20, 40, 80),
}


def settings(*, quick: bool) -> list[tuple[str, str]]:
    """Return systems, with ``{}`` for the seed of a scene, and rules."""
    pairs = FAMILIES[8:9] if quick else FAMILIES
    found = []
    for system in (system for pair in pairs for system in pair):
        own = own_rule(scene_from_spec(system.format(1)))
        found += [(system, rule) for rule in dict.fromkeys((own, "metropolis"))]
    for key, values in VALUES.items():
        for system, rule in LIMITED[1:2] if quick else LIMITED:
            found += [(system, f"{rule}:{key}={value}") for value in values[:: 3 if quick else 1]]
    return found


def share(system: str, rule: str, seeds: int) -> dict[str, Any]:
    """Return how many runs reached the goal, and the mean number of their rounds."""
    chosen = find_rule(rule)
    most = LIMITED_ROUNDS if ":" in rule else MAX_ROUNDS
    if "{}" in system:
        runs = [
            play_many(system.format(seed), chosen, [seed], max_rounds=most)
            for seed in range(1, seeds + 1)
        ]
    else:
        runs = [play_many(system, chosen, range(1, seeds + 1), max_rounds=most)]
    rounds = [
        int(count)
        for run in runs
        for count, reached in zip(run.rounds, run.reached, strict=True)
        if reached
    ]
    mean = round(sum(rounds) / len(rounds), 1) if rounds else None
    return {"system": system, "rule": rule, "runs": seeds, "goal": len(rounds), "rounds": mean}


def picture(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw the share of each family at both sizes, and of each limited rule by its limit."""
    by = {(row["system"], row["rule"]): row for row in rows}
    figure = Figure(figsize=(9, 10), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.9, 1))
    for size, title in enumerate(("default size", "double size")):
        _draw_families(figure.add_subplot(grid[0, size]), size, title, by)
    for column, key in enumerate(VALUES):
        _draw_limits(figure.add_subplot(grid[1, column]), key, by)
    bars = [Patch(color=_OWN, label="rule of the family"), Patch(color=_BASELINE)]
    bars[1].set_label("metropolis")
    figure.legend(handles=bars, loc="outside upper center", ncols=2)
    return figure


def _draw_families(
    axes: Axes, size: int, title: str, by: dict[tuple[str, str], dict[str, Any]]
) -> None:
    for at, pair in enumerate(FAMILIES):
        own = own_rule(scene_from_spec(pair[size].format(1)))
        for rule, shift, colour in ((own, -0.2, _OWN), ("metropolis", 0.2, _BASELINE)):
            row = by.get((pair[size], rule))
            if row is None or (own == "metropolis" and shift < 0):
                continue
            middle, low, high = share_interval(row["goal"], row["runs"])
            error = [[middle - (low or 0)], [(1 if high is None else high) - middle]]
            axes.barh(at + shift, middle, 0.36, xerr=error, color=colour)
    names = [one.partition(":")[0] for one, _ in FAMILIES]
    axes.set(title=title, xlim=(0, 1), xlabel="share of runs that reach the goal")
    axes.set_yticks(range(len(names)), names if size == 0 else [""] * len(names))
    axes.set_ylim(len(names) - 0.5, -0.5)


def _draw_limits(axes: Axes, key: str, by: dict[tuple[str, str], dict[str, Any]]) -> None:
    values = VALUES[key]
    for (system, rule), mark in zip(LIMITED, ("o-", "s--", "^:", "x-."), strict=True):
        rows = [by.get((system, f"{rule}:{key}={value}")) for value in values]
        shares = [row["goal"] / row["runs"] if row else float("nan") for row in rows]
        axes.plot(range(len(values)), shares, mark, markersize=8, fillstyle="none", label=rule)
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values])
    what = {"misread": "probability that a place is seen wrongly", "notes": "changes of a note"}
    axes.set(ylim=(-0.03, 1.03), xlabel=what[key], ylabel="share that reaches the goal")
    axes.legend()


def main() -> None:
    """Play all settings; print each, and write them with their picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file, and a PNG beside it")
    parser.add_argument("--quick", action="store_true", help="three seeds of a few settings")
    parser.add_argument("--draw", action="store_true", help="only draw the rows on file again")
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if asked.draw:
        rows = json.loads(asked.o.read_text("utf-8"))
    else:
        for system, rule in settings(quick=asked.quick):
            rows.append(share(system, rule, 3 if asked.quick else SEEDS))
            print(*rows[-1].values(), flush=True)
    if asked.o is not None:
        lines = ",\n".join(json.dumps(row) for row in rows)
        asked.o.write_text(f"[\n{lines}\n]\n", "utf-8")
        picture(rows).savefig(asked.o.with_suffix(".png"), dpi=90)


if __name__ == "__main__":
    main()
