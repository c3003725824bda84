"""The example project of docs/testing.md, as its reader has it: against the installed cubepath."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "vehicles"


@pytest.mark.thorough
def test_the_example_project_passes(tmp_path: Path) -> None:
    """Copied elsewhere, in a fresh process, with nothing of ours on its path; it leaves nothing."""
    project = tmp_path / "vehicles"
    shutil.copytree(EXAMPLE, project, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    (tmp_path / "t").mkdir()
    done = subprocess.run(
        [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider", "-q"],
        cwd=project,
        env={**os.environ, "TMPDIR": str(tmp_path / "t"), "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "6 passed" in done.stdout
    assert not list((tmp_path / "t").glob("cubepath-*"))
