"""Sessions: too few file descriptors are told in one line, before zenoh panics."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parents[3] / "logs" / "golden" / "hex-5.mcap"
REPLAY = ("replay", str(GOLDEN))
RUN = ("run", "hex:n=5", "--max-rounds=3", "--log=run.mcap")
MANY = ("run", "hex:n=30", "--processes=30", "--max-rounds=3", "--log=run.mcap")


def with_descriptors(folder: Path, most: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command that may open so many files."""
    return subprocess.run(
        [sys.executable, "-m", "cubepath.coordinator", *arguments],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        cwd=folder,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (most, most)),
    )


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("arguments", "most"), [(REPLAY, 16), (RUN, 16), (REPLAY, 22), (RUN, 30), (MANY, 64)]
)
def test_too_few_descriptors_are_one_line(
    tmp_path: Path, arguments: tuple[str, ...], most: int
) -> None:
    """With how many there are and how many it takes; nothing is begun."""
    done = with_descriptors(tmp_path, most, *arguments)
    assert done.returncode == 1
    assert done.stderr.startswith(f"cubepath: too few open files are allowed: {most}, expected at")
    assert done.stderr.count("\n") == 1
    assert (done.stdout, list(tmp_path.iterdir())) == ("", [])


@pytest.mark.thorough
def test_the_least_that_is_asked_for_is_enough(tmp_path: Path) -> None:
    """A run that is refused with one file less comes to its end; its recording is counted too."""
    told = with_descriptors(tmp_path, 16, *RUN).stderr
    least = int(told.partition("at least ")[2].partition(" ")[0])
    assert with_descriptors(tmp_path, least - 1, *RUN).stderr.count(f" {least} ") == 1
    assert list(tmp_path.iterdir()) == []
    done = with_descriptors(tmp_path, least, *RUN)
    assert (done.returncode, len(done.stderr.splitlines())) == (0, 1), done.stderr
    assert done.stderr.startswith("cubepath: endpoint ")


@pytest.mark.few(1)
@pytest.mark.parametrize("arguments", [REPLAY, RUN])
def test_enough_descriptors_are_enough(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    """What is asked for before is enough for what comes."""
    assert with_descriptors(tmp_path, 64, *arguments).returncode == 0
