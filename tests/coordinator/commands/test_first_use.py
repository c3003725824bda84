"""The first use after an installation: small work neither loads numba nor waits for a compiler."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parents[3] / "logs" / "golden"

IN_PROCESS = """
import json, sys
from cubepath.protocol.compiled import allowance
if sys.argv[1] == "compiled":
    allowance.left = 0
{work}
print(json.dumps({{"numba": "numba" in sys.modules}}))
"""
COMMAND = """
from cubepath.coordinator.commands.main import main
assert main(sys.argv[2:]) == 0
"""
PARSED = """
from cubepath.coordinator.commands.main import main
try:
    main(["run", "--help"])
except SystemExit as ended:
    assert not ended.code
"""
RESET = """
from cubepath.agents import parallel_env
seen, _ = parallel_env("hex:n=7").reset(seed=1)
print(json.dumps(sorted(seen)))
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for what is compiled, in which there was nothing before these tests."""
    return tmp_path_factory.mktemp("kept")


def carried_out(
    work: str, how: str, folder: Path, cache: Path, *arguments: str
) -> tuple[Any, bool, list[Path]]:
    """Do the work in a new process: its answer, whether numba is loaded, what is in its caches."""
    here = folder / how
    here.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", IN_PROCESS.format(work=work), how, *arguments],
        cwd=here,
        env={
            **os.environ,
            "NUMBA_CACHE_DIR": str(cache),
            "HOME": str(cache),
            "XDG_CACHE_HOME": str(cache),
            "MPLCONFIGDIR": str(cache),
        },
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *lines, last = done.stdout.splitlines()
    return json.loads("\n".join(lines)), json.loads(last)["numba"], list(cache.rglob("*"))


COMMANDS = [
    ("run", "hex:n=5", "--processes", "2", "--log", "run.mcap", "--json"),
    ("shorten", str(GOLDEN / "hex-5.mcap"), "--certificate", "made.json", "--json"),
    ("replay", str(GOLDEN / "agv-3.mcap"), "--json"),
]


@pytest.mark.thorough
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_compiled_code_gives_the_same_as_a_small_command(
    command: tuple[str, ...], tmp_path: Path, kept: Path
) -> None:
    """Which loads no numba, and answers alike where it does."""
    (tmp_path / "cache").mkdir()
    plain, loaded, _ = carried_out(COMMAND, "plain", tmp_path, tmp_path / "cache", *command)
    assert not loaded
    compiled, loaded, cached = carried_out(COMMAND, "compiled", tmp_path, kept, *command)
    assert loaded
    assert any(path.suffix == ".nbi" for path in cached)
    assert plain["moves"] > 0
    for key in {*plain, *compiled} - {"seconds", "log", "run", "endpoint"}:
        assert (key, plain[key]) == (key, compiled[key])


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("work", "arguments"),
    [
        *((COMMAND, command) for command in COMMANDS),
        (RESET, ()),
        (COMMAND, ("verify", str(GOLDEN / "hex-5.mcap"), "--json")),
        (COMMAND, ("complex", "arm:n=4", "--homology", "--link", "--json")),
    ],
    ids=["run", "shorten", "replay", "reset", "verify", "complex"],
)
def test_small_work_compiles_nothing(work: str, arguments: tuple[str, ...], tmp_path: Path) -> None:
    """It loads no numba and leaves nothing in any cache."""
    (tmp_path / "cache").mkdir()
    _, loaded, cached = carried_out(work, "plain", tmp_path, tmp_path / "cache", *arguments)
    assert not loaded
    assert cached == []


@pytest.mark.thorough
def test_a_large_path_is_shortened_by_compiled_code(tmp_path: Path, kept: Path) -> None:
    """A hundred thousand moves are too many for plain Python: compiled, and kept for later."""
    lines = [
        json.dumps({"id": f"{place}", "support": [place, place + 1], "trace": [place, place + 1]})
        for place in range(10)
    ]
    (tmp_path / "long.jsonl").write_text(("\n".join(lines) + "\n") * 10_001)
    answer, loaded, cached = carried_out(
        COMMAND, "plain", tmp_path, kept, "shorten", "../long.jsonl", "--json"
    )
    assert answer["moves"] == 100_010
    assert loaded
    assert any(path.name.startswith("kernel.append_moves") for path in cached)


@pytest.mark.parametrize("work", ["import cubepath.coordinator.commands.main", PARSED])
def test_what_there_is_to_ask_costs_no_libraries(work: str) -> None:
    """The commands and their options are known without numpy, zenoh, mcap or pettingzoo."""
    heavy = "set(sys.modules) & {'numpy', 'zenoh', 'mcap', 'pettingzoo', 'numba'}"
    done = subprocess.run(
        [sys.executable, "-c", f"{work}\nimport sys; print({heavy}, file=sys.stderr)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == "set()\n"
