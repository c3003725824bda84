"""What runs pay for timing, class and rule: the factors multiply, and none is less than 1."""

import re
from math import log
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.plots import price_plot
from cubepath.coordinator.experiments.rows import Row
from cubepath.coordinator.experiments.sweeping import sweep
from cubepath.coordinator.experiments.tables import FACTORS, price_table, priced
from cubepath.coordinator.theory.scene_facts import facts_of
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from processes.command_line import refused


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """Return runs of two rules, of which one has many classes, on time and hesitating."""
    systems = ["agv:graph=grid4x4,n=3..4,seed=1", "hex:n=3"]
    return list(
        sweep(
            systems, rules=["tswap", "chain", "random"], hesitate=[0, 0.4], seeds=5, max_rounds=90
        ).rows
    )


def test_the_factors_multiply_and_none_is_below_one(rows: list[Row]) -> None:
    """To rounds over the best that anybody knows, which is at least the bound."""
    found = priced(rows)
    assert len(found) == sum(row["goal"] for row in rows) > len(rows) / 3
    for row in found:
        timing, class_, rule = (row[name] for name in FACTORS)
        assert timing * class_ * rule == pytest.approx(row["price"]) == row["rounds"] / row["best"]
        assert min(timing, class_, rule) >= 1
        assert row["best"] >= row["bound"]
    assert {max(row[name] for row in found) > 1 for name in FACTORS} == {True}
    # Of each rule in each system some run took the fewest cubes that it ever took.
    for system, rule in {(row["system"], row["rule"]) for row in found}:
        mine = [row for row in found if (row["system"], row["rule"]) == (system, rule)]
        assert min(row["class"] for row in mine) == 1
        assert len({row["rule factor"] for row in mine}) == 1


def test_the_table_has_geometric_means(rows: list[Row]) -> None:
    """They multiply as the factors of each run do, and have those of the runs between them."""
    for told in price_table(rows).document():
        key = ("system", "rule", "hesitate")
        mine = [row for row in priced(rows) if all(row[name] == told[name] for name in key)]
        means = [told[name]["estimate"] for name in FACTORS]
        assert means[0] * means[1] * means[2] == pytest.approx(told["price"]["estimate"])
        mean = sum(log(row["price"]) for row in mine) / len(mine)
        assert log(told["price"]["estimate"]) == pytest.approx(mean)
        assert told["price"]["low"] <= told["price"]["estimate"] <= told["price"]["high"]


def test_the_plot_says_which_bar_is_which(rows: list[Row]) -> None:
    """The variants of a size are named in the title, in their order; nothing arrived, no plot."""
    plot = price_plot(rows)
    assert plot is not None
    assert plot.title.endswith("hesitate 0.0, then hesitate 0.4")
    text = plot.svg().decode()
    legend = text[text.index('id="legend_1"') :]
    names = re.findall(r">(rule factor|class|timing)</text>", legend)
    assert names == ["rule factor", "class", "timing"]  # as the bars stand, from below
    assert price_plot([row | {"goal": False} for row in rows]) is None


def test_levels_have_no_price(rows: list[Row]) -> None:
    """Runs without rounds pay in time; what they found counts as known."""
    free = [row | {"clock": "free", "cubes": row["cubes"] - 1} for row in rows if row["goal"]]
    assert price_table(free).rows == ()
    assert price_plot(free) is None
    mixed = priced([*rows, *free])
    plain = {row["id"]: row for row in priced(rows)}
    assert {row["clock"] for row in mixed} == {"lockstep"}
    assert [row["id"] for row in mixed] == list(plain)
    assert all(row["best"] < plain[row["id"]]["best"] for row in mixed)
    assert "clock" not in price_table([*rows, *free]).columns


def test_what_a_search_finds_counts_as_best_known() -> None:
    """Known values are those of the standard set, or of a search that the sweep asks for."""
    (known,) = sweep("hex:n=4", seeds=1).rows
    (plain,) = sweep("hex:n=5", seeds=1).rows
    (found,) = sweep("hex:n=5", seeds=1, improve=60).rows
    (proved,) = sweep("hex:n=5", seeds=1, optimum=20_000).rows
    assert (known["best_known"], known["optimum"]) == (9, 9)
    assert plain["best_known"] is None
    assert proved["optimum"] == proved["best_known"] <= found["best_known"] < found["cubes"]
    assert proved["digest"] == found["digest"]
    facts_of.cache_clear()
    assert facts_of("hex:n=5", 0, 60).best_found == found["best_known"]
    # From where nothing leads to the goal in time no search can go out.
    assert facts_of("agv-labelled:graph=P5,n=3", 0, 1).best_found is None


@pytest.mark.parametrize("spelled", ["hex:n=4,bend=120", "mine.toml"])
def test_a_standard_scene_is_known_by_any_name(spelled: str, tmp_path: Path) -> None:
    """With other keys that say the same, or from a file."""
    if spelled == "mine.toml":
        spelled = str(tmp_path / spelled)
        Path(spelled).write_text(scene_to_toml(scene_from_spec("hex:n=4")))
    (row,) = sweep(spelled, rules=("chain",), seeds=1).rows
    assert (row["best_known"], row["optimum"]) == (9, 9)


def test_how_far_to_search_is_a_whole_number(tmp_path: Path) -> None:
    """On the command line and in a file; what is not is refused in a line."""
    (tmp_path / "study.toml").write_text('systems = ["hex:n=3"]\nimprove = -1\n')
    assert "improve=-1: expected 0 or more" in refused("sweep", f"{tmp_path}/study.toml")
    out = str(tmp_path / "out")
    assert main(["sweep", "hex:n=3", "--seeds", "1", "--steps", "5", "-o", out]) == 0
