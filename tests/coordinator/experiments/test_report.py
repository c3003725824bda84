"""Reports: what the tables say is what the rows say, and the files are whole and the same again."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pyarrow.parquet
import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.batch_runs import play_batch
from cubepath.coordinator.experiments.folder import SweepFolder, table_of
from cubepath.coordinator.experiments.outcomes import GAVE_UP, failed
from cubepath.coordinator.experiments.plots import plots_of
from cubepath.coordinator.experiments.report import distances, write_report
from cubepath.coordinator.experiments.rows import FAILURES, RUN_COLUMNS
from cubepath.coordinator.experiments.spec import expand, sweep_of
from cubepath.coordinator.experiments.sweeping import read_sweep, sweep
from cubepath.coordinator.experiments.tables import (
    best_by_scene,
    groups,
    growth_table,
    pairs_table,
    price_table,
    runs_table,
    short_names,
    shown,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.statistics import Interval
from processes.command_line import refused

SLOW_RULE = """
from dataclasses import replace
from cubepath.agents.rules.chain import CHAIN

def make(known):
    rule, turns = CHAIN.make(known), 0
    def choose(view):
        nonlocal turns
        turns += 1
        return 0 if turns % 2 else rule(view)
    return choose

SLOW = replace(CHAIN, name="slow", make=make, vectorised=None, free=None)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of two rules that reach the goal and one that does not."""
    made = tmp_path_factory.mktemp("sweep")
    (made / "slow.py").write_text(SLOW_RULE)
    rules = ["chain", "random", f"{made}/slow.py:SLOW"]
    sweep("hex:n=3..6", rules=rules, seeds=6, max_rounds=60, out=made / "out")
    return made / "out"


def test_runs_are_counted_by_setting(folder: Path) -> None:
    """Shares and means are those of the rows."""
    rows = read_sweep(folder).rows
    for told in runs_table(rows).document():
        mine = [r for r in rows if (r["system"], r["rule"]) == (told["system"], told["rule"])]
        reached = [row for row in mine if row["goal"]]
        assert told["runs"] == len(mine) == 6
        assert told["goal"]["estimate"] == len(reached) / 6
        mean = sum(row["rounds"] if row["goal"] else 60 for row in mine) / 6
        assert told["rounds"]["estimate"] == pytest.approx(mean)
        assert told["rounds"]["low"] <= mean <= told["rounds"]["high"]
        assert (told["cubes"] is None) == (not reached)


def test_what_failed_is_counted_however_it_did(folder: Path) -> None:
    """By an error, the death of its process, or what kept it from being played."""
    row = read_sweep(folder).rows[0]
    (told,) = runs_table([row, *({**row, "ended": end} for end in FAILURES)]).document()
    assert (told["runs"], told["failed"]) == (1 + len(FAILURES), len(FAILURES))
    assert len(FAILURES) > 2


def test_what_a_fault_ended_is_counted_apart(folder: Path) -> None:
    """So it is not taken for what the rule did; without any there is no such column to see."""
    row = read_sweep(folder).rows[0]
    (told,) = runs_table([row, {**row, "ended": "fault", "goal": False}]).document()
    assert (told["runs"], told["by fault"], told["failed"]) == (2, 1, 0)
    assert runs_table([row]).document()[0]["by fault"] is None


def test_there_is_one_best_of_a_system(folder: Path) -> None:
    """The fewest cubes of any run there or known before, in all tables, whichever row has it."""
    rows = read_sweep(folder).rows
    runs, paid = runs_table(rows).document(), price_table(rows).document()
    best = best_by_scene(rows)
    assert {told["system"]: told["best"] for told in runs} == best
    assert {told["system"]: told["best"] for told in paid} == best
    for system, fewest in best.items():
        mine = [row for row in rows if row["system"] == system]
        took = [row["cubes"] for row in mine if row["goal"]]
        known = [row[key] for row in mine for key in ("optimum", "best_known") if row[key]]
        assert fewest == min(took + known)
    lucky = next(row for row in rows if row["system"] == "hex:n=5" and row["rule"] == "random")
    more = [*rows, lucky | {"goal": True, "cubes": 2, "rounds": 3}]
    told = [
        row["best"]
        for table in (runs_table, price_table)
        for row in table(more).document()
        if row["system"] == "hex:n=5"
    ]
    assert set(told) == {2}


def test_rules_are_compared_on_equal_seeds(folder: Path) -> None:
    """One that waits each other round never is faster; one that moves at random does not arrive."""
    found = pairs_table(short_names(read_sweep(folder).rows)).document()
    (chain, other) = [
        next(r for r in found if r["system"] == "hex:n=5" and r["second"].endswith(end))
        for end in ("SLOW", "random")
    ]
    assert (chain["first"], chain["pairs"], chain["both"]) == ("chain", 6, 6)
    assert chain["second"] == "slow.py:SLOW"
    assert chain["difference"]["estimate"] > 0
    assert (chain["first faster"], chain["p"], chain["test"]) == (6, 0.03125, "Wilcoxon")
    assert (other["both"], other["first alone"], other["p of goals"]) == (0, 6, 0.03125)


def test_runs_on_other_numbers_of_processes_are_others(folder: Path) -> None:
    """Tables tell them apart where they differ in that alone, and pair them with their like."""
    rows = [row for row in read_sweep(folder).rows if row["rule"] != "random"]
    small = [row | {"core": "simulated", "processes": min(4, row["modules"])} for row in rows]
    assert "processes" not in runs_table([*rows, *small]).columns
    assert "processes" not in growth_table([*rows, *small]).columns
    two = [row | {"core": "simulated", "processes": 2, "keepers": 1} for row in rows]
    told = runs_table([*small, *two]).document()
    assert [(row["runs"], "keepers" in row) for row in told] == [(6, True)] * 16
    assert {row["processes"] for row in told} == {2, 3, 4}
    pairs = pairs_table([*small, *two]).document()
    assert [row["pairs"] for row in pairs] == [6] * 8


def test_a_run_in_two_versions_is_in_no_pair(folder: Path) -> None:
    """Unless they came to the same; the order of rows decides nothing."""
    rows = [row for row in read_sweep(folder).rows if row["system"] == "hex:n=5"]
    again = next(row for row in rows if row["rule"] == "chain" and row["seed"] == 2)
    same, other = again | {"id": "0"}, again | {"rounds": again["rounds"] + 9}
    plain = pairs_table(rows)
    assert pairs_table([*rows, same]).rows == plain.rows
    told = pairs_table([*rows, other]).document()
    assert [row["pairs"] for row in told] == [5, 6, 5]
    assert pairs_table([other, *rows]).rows == pairs_table([*rows, other]).rows


def test_growth_is_that_of_the_means(folder: Path) -> None:
    """Of `chain`, whose moves are known: n (n - 1) / 2 and more, so the exponent is near 2."""
    found = [r for r in growth_table(read_sweep(folder).rows).document() if r["rule"] == "chain"]
    assert {(row["family"], row["sizes"], row["modules"]) for row in found} == {("hex", 4, "3..6")}
    (moves,) = [row for row in found if row["measure"] == "moves"]
    assert moves["exponent"]["low"] < 2 < moves["exponent"]["high"] < 2.5


@pytest.mark.thorough
def test_plots_of_rounds_show_the_runs_that_did_not_arrive(folder: Path) -> None:
    """A rule that never arrives stands at the limit with its share, and others beside theirs."""
    rows = short_names(read_sweep(folder).rows)
    plots = {plot.name: plot.svg().decode() for plot in plots_of(rows, {})}
    assert plots["growth-rounds"].count(">0/6<") == 3
    assert ">random<" in plots["growth-rounds"]
    assert "24 of 24 reached" in plots["price"]
    mixed = [row | {"goal": row["goal"] and row["seed"] != 2} for row in rows]
    plots = {plot.name: plot.svg().decode() for plot in plots_of(mixed, {})}
    assert plots["growth-cubes"].count(">5/6<") == plots["cubes-over-best"].count(">5/6<") == 8


def test_growth_leaves_out_sizes_at_which_a_run_did_not_arrive(folder: Path) -> None:
    """The runs that did arrive there may be the easy ones."""
    rows = [row for row in read_sweep(folder).rows if row["rule"] == "chain"]
    assert growth_table(rows).rows
    late = [row | {"goal": row["goal"] and (row["modules"], row["seed"]) != (6, 0)} for row in rows]
    assert growth_table(late).rows == ()


@pytest.mark.parametrize(
    ("number", "text"),
    [(343.2, "343"), (999.7, "1000"), (1003.0, "1003"), (1e6, "1000000"), (1.25, "1.25")],
)
def test_numbers_up_to_a_million_are_plain(number: float, text: str) -> None:
    """Without powers of ten, as a value and as the ends of an interval."""
    assert shown(number) == text
    assert shown(Interval(number, number, number)) == text
    assert shown(Interval(number, 1.0, number)) == f"{text} [1, {text}]"


def test_distances_are_those_of_the_rounds(folder: Path, tmp_path: Path) -> None:
    """Of the runs that are asked for, in the order of rounds; else what is missing, if known."""
    results = read_sweep(folder)
    asked = {row["id"] for row in results.rows if row["seed"] < 4}
    expected = {
        run: [row["distance"] for row in rows]
        for (run,), rows in groups(results.rounds, ["id"]).items()
        if run in asked
    }
    found = distances(folder, asked)
    assert {run: each.tolist() for run, each in found.items()} == expected
    asked_here = list(expand(sweep_of(["hex:n=3"], {"seeds": 3, "rules": ["chain"]})).batches)
    known, half, nothing = play_batch(asked_here[0])
    half = replace(half, rounds={**half.rounds, "distance": None})
    nothing = replace(nothing, rounds={**nothing.rounds, "distance": None, "missing": None})
    with SweepFolder(tmp_path) as written:
        written.begin(asked_here)
        written.add([nothing, known, half])
    told = distances(tmp_path, {each.run["id"] for each in (known, half, nothing)})
    assert {run: each.tolist() for run, each in told.items()} == {
        known.run["id"]: [row["distance"] for row in known.round_rows()],
        half.run["id"]: [row["missing"] for row in half.round_rows()],
    }


class Page(HTMLParser):
    """Takes note of what a page would load, and of its names."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take note of a tag."""
        self.tags.append(tag)
        for name, value in attrs:
            if name in {"src", "href", "xlink:href"} and not (value or "").startswith("#"):
                self.loads.append(str(value))
            if name == "id":
                self.ids.append(str(value))


@pytest.mark.thorough
def test_the_files_are_whole_and_the_same_again(folder: Path, tmp_path: Path) -> None:
    """A page that loads nothing, with every table and plot in it; byte for byte the same."""
    found = write_report(folder, tmp_path / "one")
    again = write_report(folder, tmp_path / "two")
    assert [path.name for path in found.files] == [path.name for path in again.files]
    for one, two in zip(found.files, again.files, strict=True):
        assert one.read_bytes() == two.read_bytes()
    names = {path.name for path in found.files}
    assert names >= {
        "report.html",
        "growth-rounds.svg",
        "progress.png",
        "cubes-over-best.svg",
        "price.svg",
    }
    for path in found.files:
        if path.suffix == ".svg":
            ET.parse(path)  # noqa: S314 - our own
        elif path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG")
    text = found.files[0].read_text()
    page = Page()
    page.feed(text)
    assert page.loads == []
    assert len(page.ids) == len(set(page.ids))
    assert page.tags.count("svg") == len(names) // 2
    assert page.tags.count("table") == 5
    assert "prefers-color-scheme: dark" in text
    assert not re.search(r"url\(#(?!growth|progress|cubes-over-best|price)", text)


def test_slow_modules_are_seen_in_the_time() -> None:
    """It is a column where it is not that of the rounds, and empty elsewhere."""
    given: dict[str, Any] = {"rules": "chain", "seeds": 2}
    rows = sweep("hex:n=3", **given, faults="slow=0,1,slow_factor=20").rows
    plain, slow = runs_table(rows).document()
    assert slow["rounds"] == plain["rounds"] == plain["time"]
    assert slow["time"]["estimate"] == 20 * plain["rounds"]["estimate"]
    assert runs_table(rows[:2]).document()[0]["time"] is None


@pytest.mark.parametrize("text", ["{}", "[]", "not JSON", None])
def test_a_run_without_its_configuration_is_told(tmp_path: Path, text: str | None) -> None:
    """In a line that names the file and the run."""
    found = sweep("hex:n=3", out=tmp_path, seeds=1)
    (part,) = (tmp_path / "runs").iterdir()
    pyarrow.parquet.write_table(
        table_of([found.rows[0] | {"configuration": text}], RUN_COLUMNS), part
    )
    why = f"run {found.rows[0]['id']}: expected the configuration"
    with pytest.raises(InputError, match=why):
        write_report(tmp_path)


def test_a_report_mixes_no_versions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a scene or a rule whose file was changed the last one counts, and the rest is told."""

    def swept(seeds: int, *rules: str, **version: Any) -> None:
        given = {"rules": list(rules or ("chain", "random")), "seeds": seeds}
        asked = expand(sweep_of(["hex:n=3..4"], given))
        batches = [
            replace(each, setting=replace(each.setting, **version))
            if (each.setting.system, each.setting.rule) == ("hex:n=3", "chain")
            else each
            for each in asked.batches
        ]
        with SweepFolder(tmp_path) as folder:
            known = folder.begin(batches)
            folder.add(
                failed(batch, seed, GAVE_UP, "it would not")
                for batch in batches
                for seed, run in zip(batch.seeds, batch.ids(), strict=True)
                if run not in known
            )

    def counted() -> tuple[list[int], int]:
        assert main(["report", str(tmp_path), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        runs = [row["runs"] for row in told["tables"]["Runs"]]
        assert told["runs"] == sum(runs)
        assert told["runs"] + told["older"] == len(read_sweep(tmp_path).rows)
        return runs, told["older"]

    swept(3, source="first")
    assert counted() == ([3, 3, 3, 3], 0)
    swept(1, source="second")
    assert counted() == ([1, 3, 3, 3], 2)
    assert main(["report", str(tmp_path)]) == 0
    assert "left out: 2 runs of earlier versions" in capsys.readouterr().out
    assert "2 runs of earlier versions" in (tmp_path / "report" / "report.html").read_text()
    swept(3, source="first")
    assert counted() == ([3, 3, 3, 3], 0)
    swept(2, "chain", source="first", scene="other")
    assert counted() == ([2, 3, 3], 4)  # of the other scene no run of `random` is there


@pytest.mark.thorough
def test_the_command_tells_the_tables(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As text, and as one JSON document."""
    assert main(["report", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["runs"] == 72
    assert len(document["tables"]["Rules in pairs"]) == 12
    assert document["files"][0] == str(folder / "report" / "report.html")
    assert main(["report", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "Rules in pairs:" in out
    legend = " ".join(out.split())
    for name in ("class is cubes over", "rule factor is these over", "p of goals is that of"):
        assert name in legend
    assert f"written to {folder}/report/report.html" in out


def test_what_is_no_sweep_has_no_report(tmp_path: Path) -> None:
    """A line says what was found; so for one without runs, and a place that takes no files."""
    assert "has no sweep.json" in refused("report", str(tmp_path))
    with SweepFolder(tmp_path / "out"):
        pass
    assert "has no finished runs" in refused("report", str(tmp_path / "out"))
    sweep("hex:n=3", seeds=1, out=tmp_path / "out")
    assert "cannot be written" in refused("report", str(tmp_path / "out"), "-o", "/proc/report")
