"""The studies: what their page says is what their rows say, and the rows come out again."""

import json
import re
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

import price_best
from cubepath.coordinator.experiments.rows import Row
from cubepath.coordinator.experiments.spec import expand, read_sweep_file
from cubepath.coordinator.experiments.sweeping import play_sweep
from cubepath.coordinator.experiments.tables import FACTORS, groups, priced
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.protocol import scene_from_spec
from cubepath.protocol.core.statistics import mean_interval
from faces import ROOT
from studies import FOLDER, PAGE, PICTURES, TABLES, beat, committed, kept, tables_of_page, with_best

SPECS = {
    "price": ("price", "price-vehicles", "price-random"),
    "free-clock": ("free-clock", "free-clock-simulated"),
}
SMALL = {
    "price": ("hex:n=4", "arm:n=5,10"),
    "price-vehicles": ("agv:graph=grid8x8,n=4,seed=1",),
    "price-random": ("arm:n=2,3", "polygon:n=6", "words"),
    "free-clock": ("hex:n=6", "arm:n=8"),
    "free-clock-simulated": ("arm:n=8",),
}
"""Systems of each file that are played again."""
_RUN = ("system", "rule", "clock", "core", "hesitate", "faults", "seed")


def _unwatched(_runs: object) -> None:
    """Nobody waits."""


def _named(row: Row) -> tuple[object, ...]:
    return tuple(row[name] for name in _RUN)


@pytest.mark.parametrize("study", TABLES)
def test_the_page_has_the_tables_of_its_rows(study: str) -> None:
    """Each table between its marks; the picture is there, and all is small."""
    assert tables_of_page().items() >= TABLES[study](committed(study)).items()
    assert f"studies/{study}.png" in PAGE.read_text("utf-8")
    assert (FOLDER / f"{study}.parquet").stat().st_size < 100_000


@pytest.mark.few(1)
@pytest.mark.parametrize("study", TABLES)
def test_the_rows_are_those_of_the_sweeps(study: str) -> None:
    """One for each run that the files name, and none beside them."""
    runs = [
        (each.label, each.rule, each.clock, each.core, each.hesitate, each.faults.text(), seed)
        for name in SPECS[study]
        for batch in expand(read_sweep_file(FOLDER / f"{name}.toml")).batches
        for each in [batch.setting]
        for seed in batch.seeds
    ]
    assert sorted(map(_named, committed(study)), key=str) == sorted(runs, key=str)


def test_how_long_paths_are_without_rounds() -> None:
    """With slow modules longer in 8 of 48 settings, with equal ones in one, all of vehicles."""
    rows = [row for row in committed("free-clock") if row["core"] == "compiled" and row["goal"]]
    longer: dict[tuple[str, str], float] = {}
    settings = groups(rows, ["system", "faults"])
    for (system, faults), several in settings.items():
        by_clock = groups(several, ["clock"])
        free, lockstep = (
            mean_interval([row["cubes"] for row in by_clock[clock,]])
            for clock in ("free", "lockstep")
        )
        one, other = (each.low or 0 for each in (free, lockstep))
        if one > (lockstep.high or 0) or other > (free.high or 0):
            longer[system, faults] = free.estimate / lockstep.estimate
    many = "agv-labelled:graph=grid8x8,n=16,seed=1"
    equal = {system: ratio for (system, faults), ratio in longer.items() if faults == "none"}
    slow = {key: ratio for key, ratio in longer.items() if key[1] != "none"}
    assert len([faults for _, faults in settings if faults != "none"]) == 48
    assert list(equal) == [many]
    assert {system.partition("-")[0].partition(":")[0] for system, _ in slow} == {"agv"}
    assert max(slow, key=lambda each: slow[each]) == (many, "slow=0.25")
    least, most = (f"{100 * ratio - 100:.0f}" for ratio in (min(slow.values()), max(slow.values())))
    text = " ".join(PAGE.read_text("utf-8").split())
    assert f"takes {100 * equal[many] - 100:.0f}% more cubes" in text
    assert f"takes {least} to {most}% more in {len(slow)} of the 48 settings" in text


def test_all_runs_of_the_rules_arrive() -> None:
    """Whatever the size and the hesitation; those by chance need not."""
    rows = committed("price")
    assert all(row["goal"] for row in rows if row["rule"] not in {"random", "metropolis"})


def test_rules_that_find_an_optimal_way() -> None:
    """Crossing and geodesic, in each system that they play alone."""
    found = {
        row["system"]: row["rule factor"]
        for row in priced(with_best(committed("price")))
        if row["rule"] in {"crossing", "geodesic"}
    }
    assert len(found) > 8
    assert {*found.values()} == {1.0}


def test_prices_multiply_in_every_row() -> None:
    """To rounds over the best known, which nothing goes below; a proved optimum is that."""
    rows = with_best(committed("price"))
    found = priced(rows)
    assert len(found) > 3000
    for row in found:
        timing, class_, rule = (row[name] for name in FACTORS)
        assert timing * class_ * rule == pytest.approx(row["rounds"] / row["best"])
        assert min(timing, class_, rule) >= 1
        assert row["rounds"] >= row["cubes"] >= row["best"] >= row["bound"]
        assert row["optimum"] in {None, row["best"]}


def test_what_the_page_says_of_all_runs_holds_in_every_row() -> None:
    """The arm is optimal on time, chains take one number of cubes, a slow module slows all."""
    arms = [row for row in committed("price") if row["rule"] == "word" and not row["hesitate"]]
    assert arms
    assert all(row["goal"] and row["rounds"] == row["bound"] for row in arms)
    bends = [row for row in committed("price") if row["family"] in {"hex", "hex-open"}]
    bends = [row for row in bends if "bend" not in row["system"]]
    assert {row["rule"] for row in bends} == {"chain"}
    for row in bends:
        n = row["modules"]
        assert row["goal"]
        assert row["cubes"] == (5 * n - 6 if row["family"] == "hex" else 4 * n - 4)
    for row in committed("free-clock"):
        if row["clock"] == "lockstep" and row["core"] == "compiled":
            assert row["time"] == row["rounds"] * (row["slow_factor"] if row["slow"] else 1)


def test_the_longest_turn_of_a_round() -> None:
    """Of n equal modules it is 1/2 + n / (n + 1) on average; slow ones alone decide from 3 on."""
    assert beat(4, 0, 10) == pytest.approx(0.5 + 4 / 5, abs=1e-3)
    assert beat(9, 2, 10) == pytest.approx(10 * (0.5 + 2 / 3), abs=1e-2)
    assert 2 * (0.5 + 1 / 2) < beat(9, 1, 2) < 3


@pytest.mark.thorough
@pytest.mark.parametrize("study", TABLES)
def test_pictures_are_drawn_from_the_rows(study: str) -> None:
    """Whole, and the same again."""
    rows = committed(study)
    assert PICTURES[study](rows) == PICTURES[study](rows)
    assert PICTURES[study](rows).startswith(b"\x89PNG")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("study", "name"),
    [
        pytest.param(study, name, marks=[pytest.mark.nightly] * (name == "price-vehicles"))
        for study, names in SPECS.items()
        for name in names
    ],
)
def test_rows_come_out_again(study: str, name: str) -> None:
    """Small systems and two seeds, played again: the same but for seconds."""
    spec = read_sweep_file(FOLDER / f"{name}.toml")
    small = replace(spec, systems=SMALL[name], seeds=spec.seeds[:2])
    again = kept(
        play_sweep(expand(small), None, jobs=1, cluster=None, record=False, watch=_unwatched).rows
    )
    known = {_named(row): row for row in committed(study)}
    assert again
    assert [known[_named(row)] for row in again] == again


def test_one_run_of_each_kind_comes_out_again() -> None:
    """The short sibling: one small system with one seed of each study."""
    for study, system in (("price", "words"), ("free-clock", "arm:n=8")):
        spec = read_sweep_file(FOLDER / f"{SPECS[study][-1 if study == 'price' else 0]}.toml")
        small = replace(spec, systems=(system,), seeds=(3,))
        again = kept(
            play_sweep(
                expand(small), None, jobs=1, cluster=None, record=False, watch=_unwatched
            ).rows
        )
        known = {_named(row): row for row in committed(study)}
        assert len(again) > 1
        assert [known[_named(row)] for row in again] == again


def test_the_best_schedules_are_no_worse_than_any_run() -> None:
    """There is one row for each system; a value on file is never worse than what a sweep found."""
    rows = {row.system: row for row in price_best.read_rows()}
    runs = groups(committed("price"), ["system"])
    assert [(system,) for system in rows] == list(runs)
    for (system,), several in runs.items():
        row, reached = rows[system], [run for run in several if run["goal"]]
        assert row.fewest == min(run["cubes"] for run in reached)
        own = [run for run in reached if run["cubes"] == row.fewest]
        assert (row.rule, row.hesitate, row.seed) in {
            (run["rule"], run["hesitate"], run["seed"]) for run in own
        }
        assert row.best <= min(run["best_known"] or row.best for run in several)
        assert row.best >= row.bound >= max(run["bound"] or 0 for run in several)
        assert row.proved == (row.best == row.bound)
        assert (row.moves is None) == (row.best == row.fewest)
        assert (row.sha256 is None) == (row.size is None)


BETTER = [row.system for row in price_best.read_rows() if row.moves is not None]
RUNS = [row.system for row in price_best.read_rows() if row.moves is None]


@pytest.mark.parametrize(
    "system", [*BETTER, *(pytest.param(each, marks=pytest.mark.thorough) for each in RUNS)]
)
def test_the_best_schedules_lead_to_the_goal(system: str, tmp_path: Path) -> None:
    """In as many cubes as their row says, by admissible moves that commute."""
    row = next(row for row in price_best.read_rows() if row.system == system)
    scene = scene_from_spec(system)
    assert scene.goal is not None
    found = price_best.schedule_of(row, tmp_path).cube_path
    assert len(found) == row.best
    assert is_normal(found)
    assert end_state(found, scene.start_state) == scene.goal | scene.system.filled


@pytest.mark.slow
def test_a_best_that_can_be_beaten_fails_the_nightly_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The row on file stands; one without the schedule that was found is beaten, and repaired."""
    system = "agv:graph=grid8x8,n=4,seed=1"
    monkeypatch.setattr(sys, "argv", ["price_best.py", system, "--check", "--prove", "10"])
    price_best.main()
    assert capsys.readouterr().out.startswith(f"{system}: fewest 6, best 5, bound 5")
    known = next(row for row in price_best.read_rows() if row.system == system)
    worse = replace(known, best=6, bound=1, proved=False, sha256=None, size=None, moves=None)
    path = tmp_path / "rows.json"
    path.write_text(json.dumps([asdict(worse)]), "utf-8")
    monkeypatch.setattr(price_best, "FILE", path)
    with pytest.raises(SystemExit, match=re.escape(f"{system}: 5 cubes, the page has 6")):
        price_best.main()
    monkeypatch.setattr(sys, "argv", ["price_best.py", system, "--prove", "10", "-o", str(path)])
    price_best.main()
    again = next(row for row in price_best.read_rows(path) if row.system == system)
    assert (again.best, again.proved, again.sha256 is None) == (5, True, False)


def test_the_nightly_script_runs_what_there_is() -> None:
    """Each file that it names is in the repository."""
    text = (ROOT / ".ci" / "nightly").read_text("utf-8")
    named = re.findall(r"python ((?:tests|docs)/\S+\.py)", text)
    assert "docs/studies/price_best.py" in named
    assert all((ROOT / each).is_file() for each in named)
