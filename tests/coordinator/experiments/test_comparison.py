"""Comparisons: scenes pooled as replicates, sweeps that come with cubepath, published figures."""

import json
from itertools import chain
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.folder import read_mark
from cubepath.coordinator.experiments.instances import standard
from cubepath.coordinator.experiments.plots import published_rows
from cubepath.coordinator.experiments.report import write_report
from cubepath.coordinator.experiments.rows import Row
from cubepath.coordinator.experiments.spec import STANDARD, expand, sweep_of
from cubepath.coordinator.experiments.sweeping import read_sweep, sweep
from cubepath.coordinator.experiments.tables import (
    by_size,
    pairs_table,
    price_table,
    runs_table,
    short_names,
    without_size,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.ranges import values
from cubepath.protocol.core.statistics import share_interval

DATA = Path(__file__).parents[2] / "data" / "imports"
OWN = """
data_from = "the tests of cubepath"
rules = ["pibt", "random"]
seeds = 1
max_rounds = 20
pool = "entry"

[[systems]]
name = "agv-labelled"
graph = "rooms.yaml"
scene = "rooms-mapf.yaml"
entry = [4, 12]
n = [1, 2]

[[published]]
source = "a page. Its vehicles wait."
runs = 8
results = [
  ["agv-labelled:graph=rooms.yaml,scene=rooms-mapf.yaml,n=2", "Planner", 0.5, 7.5],
  ["agv-labelled:graph=others.yaml,n=2", "Planner", 1.0, 2.5],
]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of four seeds of scenes, each with two sizes and two rules."""
    made = tmp_path_factory.mktemp("pooled")
    spec = "agv:graph=grid4x4,n=2..3,seed=1..4"
    sweep(spec, rules=["tswap", "random"], seeds=2, max_rounds=60, out=made)
    return made


def told(table: Any, **of: object) -> list[dict[str, Any]]:
    """Return the rows of a table with these values."""
    return [row for row in table.document() if all(row[key] == of[key] for key in of)]


def test_seeds_of_scenes_are_replicates_of_one_setting(folder: Path) -> None:
    """One row for each family, size and rule; means are those over all of its runs."""
    rows = read_sweep(folder).rows
    pooled = short_names(rows, ["seed"])
    table = runs_table(pooled)
    assert len(table.rows) == 4
    assert len(runs_table(short_names(rows)).rows) == 16
    (one,) = told(table, system="agv:graph=grid4x4,n=3", rule="tswap")
    mine = [r for r in rows if r["modules"] == 3 and r["rule"] == "tswap"]
    assert one["runs"] == len(mine) == 8
    for key in ("moves", "costs", "cubes"):
        assert one[key]["estimate"] == pytest.approx(sum(r[key] for r in mine) / 8)
    assert one["goal"]["estimate"] == 1.0 > one["goal"]["low"]


def test_what_is_best_stays_that_of_each_scene(folder: Path) -> None:
    """Pooled or not, each run pays the same price; the best of a setting is the mean of scenes."""
    rows = read_sweep(folder).rows
    alone, pooled = price_table(short_names(rows)), price_table(short_names(rows, ["seed"]))
    for row in told(pooled, rule="tswap"):
        base = row["system"]
        mine = [r for r in told(alone, rule="tswap") if without_seed(r["system"]) == base]
        assert len(mine) == 4
        assert row["best"]["estimate"] == sum(r["best"] for r in mine) / 4
        product = 1.0
        for each in mine:
            product *= each["price"]["estimate"]
        assert row["price"]["estimate"] == pytest.approx(product ** (1 / 4))


def without_seed(system: str) -> str:
    """Return the name of a system without its seed."""
    return ",".join(part for part in system.split(",") if not part.startswith("seed="))


def test_pairs_are_of_one_scene_and_seed(folder: Path) -> None:
    """The runs of all scenes of a setting are paired, each with that of the other rule."""
    pooled = short_names(read_sweep(folder).rows, ["seed"])
    assert [row["pairs"] for row in pairs_table(pooled).document()] == [8, 8]


@pytest.mark.slow
def test_a_report_pools_shows_columns_and_draws_what_it_is_asked_to(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One table of these columns, one plot of these axes, as PDF of this size, without a title."""
    words = ["--pool", "seed", "--columns", "system,rule,goal,costs", "--pdf", "--json"]
    more = ["--axes", "modules", "costs", "--size", "3", "2"]
    assert main(["report", str(folder), "-o", str(tmp_path), *words, *more]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document["tables"]) == ["Runs"]
    assert len(document["tables"]["Runs"]) == 4
    assert list(document["tables"]["Runs"][0]) == ["system", "rule", "goal", "costs"]
    stem = "costs-by-modules"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"{stem}.{kind}" for kind in ("pdf", "png", "svg")),
        "report.html",
    ]
    pdf = (tmp_path / f"{stem}.pdf").read_bytes()
    assert b"/MediaBox [ 0 0 216 144 ]" in pdf
    assert b"CreationDate" not in pdf
    write_report(folder, tmp_path, pool=("seed",), axes=("modules", "costs"), size=(3, 2), pdf=True)
    assert (tmp_path / f"{stem}.pdf").read_bytes() == pdf


@pytest.mark.slow
@pytest.mark.parametrize("axes", [("modules", "goal"), ("hesitate", "rounds"), ("seed", "price")])
def test_all_columns_may_be_axes(folder: Path, tmp_path: Path, axes: tuple[str, str]) -> None:
    """Shares between 0 and 1, and what is 0 somewhere, too."""
    report = write_report(folder, tmp_path, pool=("seed",), axes=axes)
    assert [path.stem for path in report.files[1:]] == [f"{axes[1]}-by-{axes[0]}"] * 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pool": ("seeds",)}, "pool=seeds: no system here has this key"),
        ({"columns": ("rounds", "p")}, "columns: no table has rounds, p, expected those of one:"),
        ({"axes": ("modules", "round")}, "axes: found 'modules,round', expected two of modules, "),
        ({"size": (0.1, 3.0)}, "size: found [0.1, 3.0], expected two of 1 to 100 inches"),
    ],
)
def test_a_report_that_cannot_be_is_refused(
    folder: Path, tmp_path: Path, options: dict[str, Any], said: str
) -> None:
    """In a line, and nothing is written."""
    with pytest.raises(InputError) as error:
        write_report(folder, tmp_path / "out", **options)
    assert str(error.value).startswith(said)
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of samples, whose file has published figures."""
    made = tmp_path_factory.mktemp("compared")
    (made / "own.toml").write_text(OWN)
    sweep(made / "own.toml", data=DATA, out=made / "out")
    return made / "out"


@pytest.mark.slow
def test_published_figures_stand_beside_ours(compared: Path) -> None:
    """In the rows of their system, with their source; scenes are pooled as the file says."""
    report = write_report(compared, axes=("modules", "goal"))
    table = next(each for each in report.tables if each.title == "Runs")
    base = "agv-labelled:graph=rooms.yaml,scene=rooms-mapf.yaml"
    assert [(row["system"], row["rule"], row["runs"]) for row in table.document()] == [
        (f"{base},n=1", "pibt", 2),
        (f"{base},n=1", "random", 2),
        (f"{base},n=2", "pibt", 2),
        (f"{base},n=2", "random", 2),
        (f"{base},n=2", "Planner (published)", 8),
    ]
    theirs = table.document()[-1]
    assert (theirs["goal"]["estimate"], theirs["rounds"], theirs["cubes"]) == (0.5, 7.5, None)
    assert 0 < theirs["goal"]["low"] < 0.5 < theirs["goal"]["high"] < 1
    assert table.note.startswith("Published: a page. Its vehicles wait. Goal is")
    drawn = report.files[1].with_suffix(".svg").read_text()
    assert ">Planner (published)<" in drawn
    assert ">Published: a page. Its vehicles wait.<" in drawn
    alone = write_report(compared, pool=(), axes=("modules", "goal"))
    assert len(next(each for each in alone.tables if each.title == "Runs").rows) == 8


def test_published_figures_are_points_beside_ours(compared: Path) -> None:
    """The share of as many runs and the mean rounds, at the modules of the system; nothing else."""
    (published,) = read_mark(compared)[1].published
    rows = short_names(read_sweep(compared).rows, ["entry"])
    others = published_rows(rows, [published])
    assert {(row["rule"], row["modules"]) for row in others} == {("Planner (published)", 2)}
    assert by_size(others, "goal")[2] == share_interval(4, 8)
    assert by_size(others, "rounds")[2].estimate == 7.5
    assert not by_size(others, "moves")


def test_another_sweep_in_the_folder_keeps_what_was_published(
    compared: Path, tmp_path: Path
) -> None:
    """Unless its file has published figures, too."""
    out = Path(copytree(compared, tmp_path / "out"))
    sweep("hex:n=3", seeds=1, out=out)
    before, after = (json.loads((each / "sweep.json").read_text()) for each in (compared, out))
    assert before["notes"] == after["notes"]
    assert after["notes"]["pool"] == ["entry"]


def test_sweeps_come_with_cubepath() -> None:
    """The standard instances; POGEMA's and movingai's scenarios, whose names stand for files."""
    assert sweep_of(["instances-1"], {}).systems == (STANDARD,)
    for name, source in (("pogema-1", "pogema-benchmark"), ("movingai-1", "movingai.com")):
        with pytest.raises(InputError, match=f"^{name}: .*not found, expected --data .*{source}"):
            sweep_of([name], {})


def test_data_is_found_in_the_folder_that_is_given(tmp_path: Path) -> None:
    """All systems of movingai-1: four maps, 25 scenarios, three sizes."""
    names = ("random-32-32-10", "random-32-32-20", "room-32-32-4", "maze-32-32-4")
    scenes = [values(f"{name}-even-1..25.scen", "scene") for name in names]
    for file in (*chain(*scenes), *(f"{name}.map" for name in names)):
        (tmp_path / file).touch()
    found = sweep_of(["movingai-1"], {"data": str(tmp_path)})
    assert len(found.systems) == 300 == len({*found.systems})
    assert found.systems[0].startswith(f"agv-labelled:graph={tmp_path}/random-32-32-10.map,scene=")


def test_data_stays_in_its_folder(tmp_path: Path) -> None:
    """A file that you were given does not choose what is read elsewhere."""
    (tmp_path / "own.toml").write_text(OWN.replace('"rooms.yaml"', '"../README.yaml"'))
    with pytest.raises(InputError, match=r"own.toml: .* leads out of"):
        sweep_of([str(tmp_path / "own.toml")], {"data": str(DATA)})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("runs = 8", "runs = 0", "published: Expected `int` >= 1"),
        ("0.5, 7.5", "5, 7.5", "published: Expected `float` <= 1.0"),
        ("0.5, 7.5", "0.5", "published: Expected `array` of length 4, got 3"),
        ("runs = 8", "number = 8", "published: Object contains unknown field `number`"),
    ],
)
def test_published_figures_that_cannot_be_are_refused(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    """By the name of the file and a line on what is wrong."""
    (tmp_path / "own.toml").write_text(OWN.replace(old, new))
    with pytest.raises(InputError, match=f"own.toml: {said}"):
        sweep_of([str(tmp_path / "own.toml")], {"data": str(DATA)})


@pytest.mark.thorough
def test_the_standard_instances_fit_a_rule_each() -> None:
    """The sweep of all of them leaves no instance out."""
    found = expand(sweep_of(["instances-1"], {}))
    assert {setting.label for setting in found.settings} == {each.name for each in standard()}


def test_names_keep_their_folders_where_they_are_needed() -> None:
    """Two files of one name in two folders are two systems; their sizes are as they were."""
    row: Row = {"rule": "pibt"}
    systems = [
        f"agv:graph=a/{name},n=3,seed={seed}" for name in ("x.map", "y.map") for seed in "12"
    ]
    named = short_names(
        ({"system": each, **row} for each in [*systems, "agv:graph=b/x.map,n=3"]), ["seed"]
    )
    assert sorted({each["system"] for each in named}) == [
        "agv:graph=a/x.map,n=3",
        "agv:graph=b/x.map,n=3",
        "agv:graph=y.map,n=3",
    ]
    assert without_size("agv:graph=y.map,n=3") == "agv:graph=y.map"
