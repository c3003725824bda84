"""The example projects of the docs, as a reader has them: against the installed cubepath."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


def run_tests(tmp_path: Path, name: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the tests of a project in a fresh process with nothing of ours on its path."""
    project = tmp_path / name
    if not project.exists():
        ignored = shutil.ignore_patterns("__pycache__", ".*")
        shutil.copytree(EXAMPLES / name, project, ignore=ignored)
    (tmp_path / "t").mkdir(exist_ok=True)
    return subprocess.run(
        [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider", "-q", *options],
        cwd=project,
        env={**os.environ, "TMPDIR": str(tmp_path / "t"), "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "tests"), [("vehicles", 6), ("stock", 2)])
def test_an_example_project_passes(name: str, tests: int, tmp_path: Path) -> None:
    """Copied elsewhere; it leaves nothing."""
    done = run_tests(tmp_path, name)
    assert done.returncode == 0, done.stdout
    assert f"{tests} passed" in done.stdout
    assert not list((tmp_path / "t").glob("cubepath-*"))


@pytest.mark.slow
@pytest.mark.parametrize("test", ["link", pytest.param("fault", marks=pytest.mark.thorough)])
def test_the_planted_bug_is_found(test: str, tmp_path: Path) -> None:
    """A lost update under a cut link; the report shows how, and no process is left, nor router."""
    right, wrong = re.findall(
        r"```python\n    (.*)\n```", (EXAMPLES / "stock" / "README.md").read_text()
    )
    shutil.copytree(EXAMPLES / "stock", tmp_path / "stock")
    store = tmp_path / "stock" / "store.py"
    assert store.read_text().count(right) == 1
    store.write_text(store.read_text().replace(right, wrong))
    done = run_tests(tmp_path, "stock", "-k", test, "--hypothesis-seed=1")
    assert "1 failed" in done.stdout, done.stdout + done.stderr
    assert re.search(r"lost +[\d.]+ .*stock/sale", done.stdout), done.stdout
    assert re.search(r"\d+ +stock/sold", done.stdout)
    path = str(tmp_path).encode()
    left = [each for each in Path("/proc").glob("[0-9]*/environ") if path in _content(each)]
    assert not left


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""  # it has ended
