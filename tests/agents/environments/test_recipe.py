"""The recipe for learners: what it learns runs over zenoh, and is better than the baselines.

These take the extra ``learning``, as those of `test_sb3.py` do.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents import sb3_rule
from processes.command_line import ROOT

pytest.importorskip("sb3_contrib")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

RECIPE = ROOT / "docs" / "examples" / "learning" / "recipe.py"


@pytest.mark.thorough
def test_a_policy_is_written_and_runs_over_zenoh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """After few steps, on few scenes, as a user starts it: moves in processes are those here."""
    folder = tmp_path / "learned"
    monkeypatch.setattr(sys, "argv", [str(RECIPE), str(folder), "--steps", "20000"])
    runpy.run_path(str(RECIPE), run_name="__main__")
    table, last = capsys.readouterr().out.split("\nseed 1 over zenoh: ")
    assert [line.split()[0] for line in table.splitlines()] == [
        "rule",
        "policy",
        "metropolis",
        "metropolis:temperature=0.2",
        "random",
    ]
    assert last.endswith(" moves, as here: True\n")
    assert (folder / "seed-1.mcap").exists()


@pytest.mark.nightly
def test_what_is_learned_beats_the_baselines(tmp_path: Path) -> None:
    """On 50 scenes that it has not seen: the intervals of the shares do not overlap."""
    recipe: dict[str, Any] = runpy.run_path(str(RECIPE))
    recipe["learn"](tmp_path / "policy.npz", 300_000)
    (tmp_path / "policy.py").write_text(recipe["RULE"])
    baselines = ["random", "metropolis", *(f"metropolis:temperature={x}" for x in (0.1, 0.2, 0.3))]
    found = recipe["compare"]([sb3_rule("policy", tmp_path / "policy.npz"), *baselines])
    low, _ = found.pop("policy")
    assert low > max(high for _, high in found.values())
    assert all(recipe["over_zenoh"](tmp_path, seed) for seed in (1, 2, 3))
