"""Compiled functions: kept on disk where they can be, and working where they cannot."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
if sys.argv[1] != "0":
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
import numpy as np
from cubepath.coordinator.complexes.cliques import following
chosen = np.zeros(2, dtype=np.int32)
print(following(np.zeros((2, 2), dtype=np.bool_), chosen, 0, True))
"""


def clique(cache: Path, most: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", CODE, str(most)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


@pytest.mark.slow
def test_what_was_compiled_is_kept(tmp_path: Path) -> None:
    """The second process finds what the first has written."""
    for _ in range(2):
        assert clique(tmp_path, 0).stdout == "1\n"
    assert list(tmp_path.rglob("*.nbc"))


@pytest.mark.slow
def test_on_a_full_disk_it_is_compiled_all_the_same(tmp_path: Path) -> None:
    """No file may grow beyond a hundred bytes: nothing is kept, and the answer is right."""
    done = clique(tmp_path, 100)
    assert (done.stdout, done.stderr) == ("1\n", "")
    assert not list(tmp_path.rglob("*.nbc"))
