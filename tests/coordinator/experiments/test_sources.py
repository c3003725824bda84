"""What a rule from elsewhere follows from is part of what a run is."""

from pathlib import Path

import numpy as np
import pytest

from cubepath.agents.rules.policy import FORMAT
from cubepath.agents.rules.registry import forget_rule_files
from cubepath.coordinator.experiments.setting import source_hash
from cubepath.protocol.core.errors import InputError

BY_A_POLICY = """
from cubepath.agents import policy_rule
MINE = policy_rule("mine", lambda observation, action_mask: action_mask.nonzero()[0][{which}])
"""
BY_A_PARTIAL = """
from dataclasses import replace
from functools import partial
from cubepath.agents.rules.uniform import RANDOM
def make(which, known):
    return lambda view: int(view.mask.nonzero()[0][which])
MINE = replace(RANDOM, name="mine", make=partial(make, {which}), vectorised=None)
"""
IMPORTED = """
import importlib, os
from cubepath.agents import policy_rule
MINE = policy_rule("mine", importlib.import_module(os.environ["FOLLOWED"]).act)
"""


def hashed(path: Path, text: str) -> str:
    """Return the hash of the rule MINE in a file that has just been written."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    forget_rule_files()
    return source_hash(f"{path}:MINE")


@pytest.mark.parametrize("text", [BY_A_POLICY, BY_A_PARTIAL])
def test_a_rule_follows_from_its_file(tmp_path: Path, text: str) -> None:
    """However it is made there, and at once; where the file lies does not matter."""
    one, other = (hashed(tmp_path / "a" / "mine.py", text.format(which=each)) for each in "01")
    assert one != other
    assert hashed(tmp_path / "b" / "mine.py", text.format(which=0)) == one


def test_a_rule_follows_from_what_it_has_learned(tmp_path: Path) -> None:
    """From the weights that its file reads, though that is the same file."""
    found = []
    text = "from cubepath.agents import sb3_rule\nMINE = sb3_rule('mine', {which!r})\n"
    for weight in (0.0, 1.0, 0.0):
        arrays = {
            "format": FORMAT,
            "observation": "relative",
            "weight_0": np.full((3, 2), weight),
            "bias_0": np.zeros(2),
            "activation_0": "none",
        }
        np.savez(tmp_path / "learned.npz", **arrays)  # type: ignore[arg-type]
        path = str(tmp_path / "learned.npz")
        found.append(hashed(tmp_path / "mine.py", text.format(which=path)))
    assert found[0] == found[2] != found[1]


def test_a_rule_follows_from_the_file_of_its_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where that is imported, and the file of the rule is the same."""
    monkeypatch.syspath_prepend(str(tmp_path))
    found = set()
    for name in ("followed_one", "followed_two"):
        (tmp_path / f"{name}.py").write_text(f"def act(seen, mask):\n    return 0  # {name}\n")
        monkeypatch.setenv("FOLLOWED", name)
        found.add(hashed(tmp_path / "mine.py", IMPORTED))
    assert len(found) == 2


def test_built_in_rules_follow_from_cubepath_alone() -> None:
    """They have no hash of their own; an unknown rule has none at all."""
    assert source_hash("random") == ""
    with pytest.raises(InputError, match="unknown rule 'rando'"):
        source_hash("rando")
