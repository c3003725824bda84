"""What a worker plays is what was asked for, and what prevents that is no fault of the run."""

import importlib
import os
from dataclasses import replace
from errno import ENOSPC
from pathlib import Path

import pytest

from cubepath.agents.rules.registry import forget_rule_files
from cubepath.coordinator.experiments.batch_runs import play_batch
from cubepath.coordinator.experiments.folder import SweepFolder, read_runs
from cubepath.coordinator.experiments.rows import Row
from cubepath.coordinator.experiments.setting import Core, RunBatch
from cubepath.coordinator.experiments.spec import Sweep, expand
from cubepath.coordinator.experiments.sweeping import sweep
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

RULE = """
from dataclasses import replace
from cubepath.agents.rules.uniform import RANDOM
def make(known):
    {made}
MINE = replace(RANDOM, name="mine", make=make, vectorised=None)
"""
RANDOM, STAYING = "return RANDOM.make(known)", "return lambda view: 0"


def asked(folder: Path, made: str, size: int, core: Core = "compiled") -> RunBatch:
    """Return a run of a rule in a scene, both in files that have just been written."""
    rule, scene = folder / "mine.py", folder / "scene.toml"
    rule.write_text(RULE.format(made=made))
    scene.write_text(scene_to_toml(scene_from_spec(f"hex-open:n={size}")))
    plan = Sweep((str(scene),), (f"{rule}:MINE",), seeds=(1,), max_rounds=9, core=core)
    (batch,) = expand(plan).batches
    return batch


def played(batch: RunBatch) -> Row:
    """Return the row of a run."""
    (found,) = play_batch(batch)
    return found.run


@pytest.mark.parametrize("core", ["compiled", "simulated"])
def test_a_process_plays_files_as_they_are_now(tmp_path: Path, core: Core) -> None:
    """One that played them before they changed, as a notebook or a worker of a cluster does."""
    before = asked(tmp_path, RANDOM, 3, core)
    first = played(before)
    changed = played(asked(tmp_path, STAYING, 4, core))
    assert (first["modules"], changed["modules"]) == (3, 4)
    assert first["moves"] > changed["moves"] == 0
    again = played(asked(tmp_path, RANDOM, 3, core))
    assert (again["id"], again["digest"]) == (before.ids()[0], first["digest"])


@pytest.mark.parametrize(("made", "size", "name"), [(RANDOM, 4, "scene"), (STAYING, 3, "mine")])
def test_a_run_whose_files_are_others_is_not_played(
    tmp_path: Path, made: str, size: int, name: str
) -> None:
    """Nothing is played under its id; the row says which file it is."""
    before = asked(tmp_path, RANDOM, 3)
    assert played(asked(tmp_path, made, size))["ended"] == "max-rounds"
    row = played(before)
    assert (row["ended"], row["moves"], row["modules"]) == ("prevented", None, None)
    assert f"{name}." in row["reason"]
    assert "is not here what it was where the sweep began" in row["reason"]


def test_a_file_that_changes_during_a_run_prevents_it(tmp_path: Path) -> None:
    """With messages: its nodes may have read the one or the other."""
    scene, other = tmp_path / "scene.toml", tmp_path / "other.toml"
    other.write_text(scene_to_toml(scene_from_spec("hex-open:n=4")))
    copy = f"__import__('shutil').copy({str(other)!r}, {str(scene)!r})"
    row = played(asked(tmp_path, f"{copy}; {RANDOM}", 3, "simulated"))
    assert (row["ended"], row["moves"]) == ("prevented", None)
    assert "changed while it was played" in row["reason"]


@pytest.mark.parametrize(
    ("made", "ended"),
    [
        (f"raise OSError({ENOSPC}, {os.strerror(ENOSPC)!r})", "prevented"),
        ("raise MemoryError", "prevented"),
        ("raise ValueError('mine')", "error"),
    ],
)
@pytest.mark.parametrize("core", ["compiled", "simulated"])
def test_what_the_machine_has_no_more_of_is_no_error_of_a_run(
    tmp_path: Path, made: str, ended: str, core: Core
) -> None:
    """Space or memory; any other error is one of the rule."""
    assert played(asked(tmp_path, made, 3, core))["ended"] == ended


def test_what_was_prevented_is_played_the_next_time(tmp_path: Path) -> None:
    """A version of cubepath, or a file, that was not there; an error of the rule stays."""
    batch, out = asked(tmp_path, RANDOM, 3), tmp_path / "out"
    (tmp_path / "mine.py").rename(tmp_path / "away.py")
    forget_rule_files()
    missing = play_batch(batch)
    assert missing[0].run["ended"] == "prevented"
    assert "mine.py: no such file" in missing[0].run["reason"]
    other = play_batch(replace(batch, code="0.0+other"))
    assert other[0].run["ended"] == "prevented"
    assert other[0].run["reason"].endswith("expected 0.0+other")
    with SweepFolder(out) as folder:
        folder.begin([batch])
        folder.add(missing)
    assert [row["ended"] for row in read_runs(out)] == ["prevented"]
    (tmp_path / "away.py").rename(tmp_path / "mine.py")
    system, rule = batch.setting.system, batch.setting.rule
    for known in (0, 1):
        found = sweep(system, rules=rule, seeds="1,", max_rounds=9, out=out)
        assert (found.known, [row["ended"] for row in found.rows]) == (known, ["max-rounds"])


@pytest.mark.thorough
def test_a_worker_that_lives_on_plays_files_as_they_are_now(tmp_path: Path) -> None:
    """One process of a cluster, asked twice; the files have changed between."""
    distributed = importlib.import_module("distributed")  # the extra `cluster`, which .ci/run has
    found = list[Row]()
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        for made, size in ((RANDOM, 3), (STAYING, 4)):
            setting = asked(tmp_path, made, size).setting
            found += sweep(
                setting.system,
                rules=setting.rule,
                seeds="1,",
                max_rounds=9,
                cluster=cluster.scheduler_address,
            ).rows
    assert [row["modules"] for row in found] == [3, 4]
    assert found[0]["moves"] > found[1]["moves"] == 0
