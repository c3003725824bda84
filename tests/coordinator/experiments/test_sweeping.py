"""Sweeps played: the same rows however they are played, and nothing lost on the way."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from cubepath.coordinator.experiments import sweeping, workers
from cubepath.coordinator.experiments.batch_runs import late, play_batch
from cubepath.coordinator.experiments.folder import SweepFolder, read_runs
from cubepath.coordinator.experiments.outcomes import DIED, failed
from cubepath.coordinator.experiments.rows import FinishedRun, Row
from cubepath.coordinator.experiments.setting import RunBatch, code_version
from cubepath.coordinator.experiments.spec import expand, sweep_of
from cubepath.coordinator.experiments.sweeping import read_sweep, sweep
from cubepath.coordinator.experiments.workers import Cluster, Pool, played_by
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

SMALL: dict[str, Any] = {"rules": ["chain", "random"], "seeds": 6, "max_rounds": 30}
RULE = """
import os
from dataclasses import replace
from pathlib import Path
from cubepath.agents.rules.uniform import RANDOM

def endless():
    while True:
        try:
            while True:
                pass
        except Exception:
            pass

def make(known):
    {trap}
    return RANDOM.make(known)

MINE = replace(RANDOM, name="mine", make=make, vectorised=None)
"""


def mine(folder: Path, trap: str) -> str:
    """Return a rule in a file that does something where it is made."""
    (folder / "mine.py").write_text(RULE.format(trap=trap))
    return f"{folder}/mine.py:MINE"


def timeless(rows: Sequence[Row]) -> list[Row]:
    """Return rows without the seconds that their runs took."""
    return [row | {"seconds": 0} for row in rows]


@pytest.mark.slow
def test_the_rows_are_the_same_in_any_number_of_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here, in two processes, in memory and on disk; and so are the rows of the rounds."""
    here = sweep("hex:n=4..6", **SMALL)
    monkeypatch.setattr(sweeping, "is_small", lambda _: False)
    several = sweep("hex:n=4..6", out=tmp_path / "out", jobs=2, **SMALL)
    assert timeless(several.rows) == timeless(here.rows)
    assert several.rounds == here.rounds
    assert len(here.rounds) == sum(row["rounds"] for row in here.rows)
    assert timeless(read_sweep(tmp_path / "out").rows) == timeless(here.rows)
    assert not multiprocessing.active_children()


def test_finished_runs_are_not_played_again(tmp_path: Path) -> None:
    """More seeds are more runs; the same sweep once more has nothing to do."""
    played: list[FinishedRun] = []
    sweep("hex:n=4", out=tmp_path, seeds=2)
    found = sweep("hex:n=4", out=tmp_path, seeds=5, watch=played.extend)
    assert (found.known, [each.run["seed"] for each in played]) == (2, [2, 3, 4])
    assert [row["seed"] for row in found.rows] == [0, 1, 2, 3, 4]
    assert sweep("hex:n=4", out=tmp_path, seeds=5, watch=played.extend).known == 5
    assert len(played) == 3


@pytest.mark.thorough
def test_a_changed_rule_is_another_run_and_the_last_one_counts(tmp_path: Path) -> None:
    """The rows of both are kept; read without more, each run is there once, as it was last."""
    out, digests = tmp_path / "out", []
    for trap in ("pass", "known.stream.fraction()"):
        rule = mine(tmp_path, trap)
        text = f"from cubepath.coordinator import sweep; sweep('hex-open:n=4', rules={rule!r},"
        subprocess.run(
            [sys.executable, "-c", f"{text} seeds=1, max_rounds=9, out={str(out)!r})"], check=True
        )
        (row,) = read_runs(out)
        digests.append(row["digest"])
    assert len(set(digests)) == len(read_runs(out, all_versions=True)) == 2


@pytest.mark.slow
def test_a_process_that_dies_takes_nothing_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run that kills it is tried twice and has a row with the reason; all others are there."""
    monkeypatch.setattr(sweeping, "is_small", lambda _: False)
    rule = mine(tmp_path, "if known.modules == 5: os.kill(os.getpid(), 9)")
    found = sweep(
        "hex:n=4..6", rules=[rule, "random"], seeds=1, jobs=2, max_rounds=20, out=tmp_path / "out"
    )
    assert len(found.rows) == 6
    (died,) = found.failures
    assert (died["system"], died["rule"], died["seed"]) == ("hex:n=5", rule, 0)
    assert died["ended"] == "died"
    assert "died again" in died["reason"]
    assert not multiprocessing.active_children()


def test_a_run_whose_process_died_is_played_again(tmp_path: Path) -> None:
    """The next time; it may have been the machine, and the row that says so counts no more."""
    asked = expand(sweep_of(["hex:n=4"], {"seeds": 2}))
    with SweepFolder(tmp_path) as folder:
        folder.begin(asked.batches)
        folder.add([failed(next(iter(asked.batches)), 1, DIED, "it died")])
    found = sweep("hex:n=4", seeds=2, out=tmp_path)
    assert (found.known, [row["ended"] for row in found.rows]) == (0, ["goal", "goal"])
    assert sweep("hex:n=4", seeds=2, out=tmp_path).known == 2


@pytest.mark.thorough
def test_a_process_that_dies_once_is_forgiven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Played again, the run is as if nothing had happened."""
    monkeypatch.setattr(sweeping, "is_small", lambda _: False)
    once = tmp_path / "once"
    trap = f"p = Path({str(once)!r}); p.exists() or (p.touch(), os.kill(os.getpid(), 9))"
    rule = mine(tmp_path, trap)
    found = sweep("hex:n=4..5", rules=[rule], seeds=3, jobs=2, max_rounds=20)
    assert once.exists()
    assert [row["ended"] for row in found.rows] == ["max-rounds"] * 6


ENDLESS = "if known.modules == 4: {}"


def test_a_run_over_its_limit_is_a_row_and_no_more(tmp_path: Path) -> None:
    """Whatever its rule catches; the next one is played, and the limit is none of its id."""
    (batch, other) = expand(
        sweep_of(
            ["hex:n=4..5"],
            {
                "rules": [mine(tmp_path, ENDLESS.format("endless()"))],
                "seeds": 2,
                "max_rounds": 5,
                "timeout_s": 0.15,
            },
        )
    ).batches
    assert batch.ids() == replace(batch, timeout_s=None).ids()
    rows = [each.run for each in (*play_batch(batch), *play_batch(other))]
    assert [row["ended"] for row in rows] == ["timeout"] * 2 + ["max-rounds"] * 2
    assert rows[0]["reason"] == "over its limit of 0.15 s"
    assert rows[0]["seconds"] >= 0.15
    assert rows[0]["modules"] == 4


def test_a_run_over_its_limit_is_played_again_with_a_longer_one(tmp_path: Path) -> None:
    """Or with none, and not with the same."""
    (batch,) = expand(sweep_of(["hex:n=4"], {"seeds": 1})).batches
    late_run = late(replace(batch, timeout_s=2.0), 1.9, known=True)
    with SweepFolder(tmp_path) as folder:
        folder.begin([batch])
        folder.add([late_run])
    with SweepFolder(tmp_path) as folder:
        known = [bool(folder.begin([batch], limit)) for limit in (1.0, 2.0, 2.5, None)]
    assert known == [True, True, False, False]
    found = sweep("hex:n=4", seeds=1, out=tmp_path)
    assert (found.known, [row["ended"] for row in found.rows]) == (0, ["goal"])


@pytest.mark.thorough
def test_rules_from_elsewhere_are_played_apart(tmp_path: Path) -> None:
    """However little there is to play: one that ends its process, or never ends, is a row."""
    ends = mine(tmp_path, "os._exit(0)")
    found = sweep("hex:n=4", rules=[ends], seeds=1, max_rounds=5, jobs=2)
    assert [row["ended"] for row in found.rows] == ["died"]
    endless = mine(tmp_path, "endless()")
    found = sweep("hex:n=4", rules=[endless], seeds=1, max_rounds=5, timeout_s=0.2)
    assert [row["ended"] for row in found.rows] == ["timeout"]
    assert not multiprocessing.active_children()


@pytest.mark.thorough
def test_a_run_that_cannot_be_interrupted_ends_with_its_process(tmp_path: Path) -> None:
    """As in a loop of compiled code; all others are played."""
    rule = mine(tmp_path, ENDLESS.format("any(iter(int, 1))"))
    found = sweep("hex:n=4..5", rules=[rule], seeds=1, max_rounds=5, timeout_s=3.0)
    assert [row["ended"] for row in found.rows] == ["timeout", "max-rounds"]
    assert "could not be interrupted" in found.rows[0]["reason"]


def test_a_rule_that_fails_is_a_row_and_no_more(tmp_path: Path) -> None:
    """An exception of a rule is told with its kind; the other runs are played."""
    rule = mine(tmp_path, "if known.modules == 5: raise ValueError('no five')")
    found = sweep("hex:n=4..6", rules=[rule], seeds=2, max_rounds=20)
    assert [row["ended"] for row in found.rows] == ["max-rounds"] * 2 + ["error"] * 2 + [
        "max-rounds"
    ] * 2
    assert "no five" in found.failures[0]["reason"]
    assert found.failures[0]["rounds"] is None


@pytest.mark.thorough
def test_what_is_interrupted_ends_its_processes_and_keeps_what_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is taken up where it ended."""
    monkeypatch.setattr(sweeping, "is_small", lambda _: False)

    def interrupt(_: Sequence[FinishedRun]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep("hex:n=4..9", out=tmp_path, jobs=2, watch=interrupt, **SMALL)
    assert not multiprocessing.active_children()
    known = len(read_runs(tmp_path))
    assert 0 < known < 72
    assert sweep("hex:n=4..9", out=tmp_path, **SMALL).known == known


KILLED = """
import sys
from cubepath.coordinator.experiments import folder, sweeping
folder._RUNS_MAX = 1
sweeping.is_small = lambda _: False
if __name__ == "__main__":
    sweeping.sweep("hex:n=5..9", rules="random", seeds=200, out=sys.argv[1], jobs=2)
"""


@pytest.mark.thorough
def test_what_is_killed_leaves_what_is_right_and_no_process(tmp_path: Path) -> None:
    """At any moment: what was written can be read, and the sweep goes on from there."""
    script, out = tmp_path / "killed.py", tmp_path / "out"
    script.write_text(KILLED)
    with subprocess.Popen(
        [sys.executable, str(script), str(out)], start_new_session=True
    ) as process:
        while not list(out.glob("runs/*.parquet")):
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
    rows = read_runs(out)
    assert rows
    assert {row["code"] for row in rows} == {code_version()}
    deadline = time.monotonic() + 30
    while _in_session(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    # Two workers: any of the first runs may have been the one that was written.
    first = rows[0]
    found = sweep(str(first["system"]), rules="random", seeds=[int(str(first["seed"]))], out=out)
    assert found.known == 1
    assert not list(out.glob("*/.*.part"))


def _in_session(session: int) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if os.getsid(int(entry.name)) == session:
                found.append(int(entry.name))
    return found


def test_one_sweep_at_a_time_writes_to_a_folder(tmp_path: Path) -> None:
    """Another is refused in a line, and may come when the first is over."""
    with (
        SweepFolder(tmp_path / "out"),
        pytest.raises(InputError, match="another sweep is writing there"),
    ):
        sweep("hex:n=4", out=tmp_path / "out", seeds=1)
    assert len(sweep("hex:n=4", out=tmp_path / "out", seeds=1).rows) == 1


def test_a_new_folder_is_looked_into_by_one_sweep_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that start together: one finds the folder locked, and not half made by the other."""
    inside = SweepFolder._check

    def check(folder: SweepFolder) -> None:
        (tmp_path / ".sweep.json.part").touch()  # as the mark is written
        monkeypatch.setattr(SweepFolder, "_check", inside)
        with pytest.raises(InputError, match="another sweep is writing there"):
            SweepFolder(tmp_path).__enter__()
        (tmp_path / ".sweep.json.part").unlink()
        inside(folder)

    monkeypatch.setattr(SweepFolder, "_check", check)
    assert len(sweep("hex:n=4", out=tmp_path, seeds=1).rows) == 1


def test_what_is_written_of_a_report_is_left_alone(tmp_path: Path) -> None:
    """It has a folder of its own there, and may be under way; parts of a dead sweep go."""
    for name in ("report", "runs"):
        (tmp_path / name).mkdir()
        (tmp_path / name / ".half.part").touch()
    (tmp_path / "sweep.json").write_text('{"format": "cubepath-sweep-1", "versions": []}')
    sweep("hex:n=4", out=tmp_path, seeds=1)
    assert [each.parent.name for each in tmp_path.glob("*/.*.part")] == ["report"]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("notes.txt", "mine", "holds 'notes.txt' and no sweep.json"),
        ("sweep.json", "{}", "expected that of a sweep"),
        ("sweep.json", "[", "expected that of a sweep"),
        ("sweep.json", '{"format": "other"}', "expected that of a sweep"),
    ],
)
def test_the_folder_of_something_else_is_left_alone(
    tmp_path: Path, name: str, text: str, why: str
) -> None:
    """It is refused in a line, and is as it was."""
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=why):
        sweep("hex:n=4", out=tmp_path, seeds=1)
    assert (tmp_path / name).read_text() == text
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_results_are_read_as_tables(tmp_path: Path) -> None:
    """Rows, Arrow tables and, by anybody's reader, the same datasets."""
    found = sweep("hex:n=4", out=tmp_path, seeds=2)
    assert found.table().to_pylist() == list(found.rows)
    read = pyarrow.parquet.read_table(tmp_path / "rounds").to_pylist()
    assert sorted(map(str, read)) == sorted(map(str, found.rounds))


def test_a_part_of_rounds_without_its_runs_does_not_count(tmp_path: Path) -> None:
    """It was written by a sweep that was cut off before the runs were."""
    found = sweep("hex:n=4", out=tmp_path, seeds=2)
    (part,) = (tmp_path / "runs").iterdir()
    (tmp_path / "rounds" / "lost.parquet").write_bytes(
        (tmp_path / "rounds" / part.name).read_bytes()
    )
    assert read_sweep(tmp_path).rounds == found.rounds


@pytest.mark.parametrize("dataset", ["runs", "rounds"])
@pytest.mark.parametrize("damage", ["lost", "cut"])
def test_a_damaged_part_is_told_and_mended_by_the_same_sweep(
    tmp_path: Path, dataset: str, damage: str
) -> None:
    """Its runs are played again, those of others are not, and the rows are what they were."""
    first = sweep("hex:n=4", out=tmp_path, seeds=2)
    (mine,) = (tmp_path / dataset).iterdir()
    whole = sweep("hex:n=4", out=tmp_path, seeds=3)
    if damage == "lost":
        mine.unlink()
    else:
        mine.write_bytes(mine.read_bytes()[:-9])
    if (dataset, damage) != ("runs", "lost"):
        with pytest.raises(InputError, match=r"cannot be read: .*the same sweep once more plays"):
            read_sweep(tmp_path).rounds  # noqa: B018 - they are read as they are asked for
    again = sweep("hex:n=4", out=tmp_path, seeds=3)
    assert (first.known, again.known) == (0, 1)
    assert timeless(again.rows) == timeless(whole.rows)
    assert again.rounds == whole.rounds == read_sweep(tmp_path).rounds
    assert len(pyarrow.parquet.read_table(tmp_path / "rounds")) == len(whole.rounds)


def test_recordings_are_kept_if_asked_for(tmp_path: Path) -> None:
    """Of runs with messages, each by the id of its run."""
    found = sweep("hex:n=3", out=tmp_path, seeds=1, core="simulated", record=True)
    assert (tmp_path / "recordings" / found.rows[0]["recording"]).stem == found.rows[0]["id"]
    with pytest.raises(InputError, match="record: without a folder"):
        sweep("hex:n=3", seeds=1, record=True)


def test_a_run_that_lacks_its_recording_is_played_again(tmp_path: Path) -> None:
    """If recordings are asked for: it was played without, or somebody took it away."""
    known = []
    for record in (False, True, True, False):
        found = sweep("hex:n=3", out=tmp_path, seeds=2, core="simulated", record=record)
        known.append(found.known)
    assert known == [0, 0, 2, 2]
    lost, kept = (tmp_path / "recordings" / row["recording"] for row in found.rows)
    before = kept.read_bytes()
    lost.unlink()
    again = sweep("hex:n=3", out=tmp_path, seeds=2, core="simulated", record=True)
    assert (again.known, timeless(again.rows)) == (1, timeless(found.rows))
    assert lost.is_file()
    assert kept.read_bytes() == before
    assert sweep("hex:n=3", out=tmp_path, seeds=2, record=True).known == 0  # has no messages
    assert sweep("hex:n=3", out=tmp_path, seeds=2, record=True).known == 2


def test_what_cannot_be_recorded_is_refused(tmp_path: Path) -> None:
    """Before anything is played: without rounds under the simulator."""
    with pytest.raises(InputError, match="record: the simulator keeps no recording"):
        sweep(
            "hex:n=3",
            out=tmp_path / "out",
            core="simulated",
            clocks=["lockstep", "free"],
            seeds=1,
            record=True,
        )
    assert not (tmp_path / "out").exists()


def test_rows_are_named_as_the_sweep_names_them(tmp_path: Path) -> None:
    """Whoever played the scene first, by another name; nothing is played again."""
    path = tmp_path / "mine.toml"
    path.write_text(scene_to_toml(scene_from_spec("hex:n=4")))
    first = sweep("hex:n=4", out=tmp_path / "out", seeds=2)
    second = sweep(str(path), out=tmp_path / "out", seeds=2)
    assert (second.known, [row["system"] for row in second.rows]) == (2, [str(path)] * 2)
    assert [row | {"system": "hex:n=4"} for row in second.rows] == list(first.rows)


def test_without_pyarrow_a_line_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is played or written; in memory a sweep needs none."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(InputError, match=r"pip install 'cubepath\[experiments\]'"):
        sweep("hex:n=4", out=tmp_path / "out", seeds=1)
    assert not list(tmp_path.iterdir())
    assert len(sweep("hex:n=4", seeds=1).rows) == 1


def test_where_no_process_can_start_a_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a program whose work is not under a guard."""
    monkeypatch.setattr(workers, "_begin", os.abort)
    with pytest.raises(InputError, match="__main__"):
        Pool(2).start()


def test_a_cluster_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a line that names the address; so is a missing distribution, with how to install it."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'cubepath\[cluster\]'"):
        Cluster("tcp://127.0.0.1:1").start()


@pytest.mark.thorough
def test_a_cluster_gives_the_same_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Real workers in processes of their own; nobody is left connected."""
    distributed = importlib.import_module("distributed")  # the extra `cluster`, which .ci/run has
    monkeypatch.setattr(workers, "_CONNECT_S", 3)
    with pytest.raises(CheckError, match="no dask scheduler"):
        Cluster("tcp://127.0.0.1:1").start()
    here = sweep("hex:n=4..6", **SMALL)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        there = sweep("hex:n=4..6", cluster=cluster.scheduler_address, **SMALL)
    assert timeless(there.rows) == timeless(here.rows)
    assert there.rounds == here.rounds


def batches() -> list[RunBatch]:
    """Return the batches of a small sweep."""
    return list(expand(sweep_of(["hex:n=4"], {"seeds": 2})).batches)


def test_signals_leave_no_pool() -> None:
    """A consumer that stops early ends the workers."""
    playing = played_by(Pool(2), batches(), None)
    next(playing)
    playing.close()
    assert not multiprocessing.active_children()
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
