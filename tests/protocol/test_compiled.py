"""Compiled functions: kept on disk where they can be, and working where they cannot."""

import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from cubepath.protocol.compiled import inner

CODE = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
if sys.argv[1] != "0":
    sys.dont_write_bytecode = True  # Python before 3.12 would leave half of a file
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
import numpy as np
from cubepath.coordinator.theory.complexes.links import following
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


@pytest.mark.thorough
def test_on_a_full_disk_it_is_compiled_all_the_same(tmp_path: Path) -> None:
    """No file may grow beyond a hundred bytes: nothing is kept, and the answer is right."""
    done = clique(tmp_path, 100)
    assert (done.stdout, done.stderr) == ("1\n", "")
    assert not list(tmp_path.rglob("*.nbc"))


MODULES = {
    "inner": """
from typing import NamedTuple
from cubepath.protocol.compiled import compiled
FACTOR = 1
class Pair(NamedTuple):
    one: int
    other: int
@compiled
def scaled(number: int) -> int:
    return 10 * number
""",
    "middle": """
from cubepath.protocol.compiled import inner
from room.inner import scaled
@inner
def middle(number: int) -> int:
    return scaled(number) + 1
""",
    "outer": """
from cubepath.protocol.compiled import compiled
from room import middle
@compiled
def call(number: int) -> int:
    return later(number)
@compiled
def later(number: int) -> int:
    return middle.middle(number)
""",
    "constant": """
from cubepath.protocol.compiled import compiled
from room.inner import FACTOR
@compiled
def call(number: int) -> int:
    return FACTOR * number
""",
    "fields": """
from cubepath.protocol.compiled import compiled
from room.inner import Pair
@compiled
def one(pair: Pair) -> int:
    return pair.one
def call(number: int) -> int:
    return one(Pair(one=number, other=0))
call.dispatcher = one.dispatcher
""",
    "unrelated": """
from cubepath.protocol.compiled import compiled
@compiled
def same(number: int) -> int:
    return number
""",
}
"""A package whose compiled functions take from other modules what can be taken."""

CALL = """
import sys
from importlib import import_module
*before, last = sys.argv[1:]
for name in before:
    import_module(f"room.{name}")
call = import_module(f"room.{last}").call
print(call(7), sum(call.dispatcher.stats.cache_hits.values()))
"""


@dataclass(frozen=True)
class Installation:
    """The package in a folder, the variables that its processes see, and where code is kept."""

    folder: Path
    variables: dict[str, str]
    kept: Path | None

    def change(self, old: str, new: str) -> None:
        """Change the innermost module, so that its file is also older than what was compiled."""
        path = self.folder / "room" / "inner.py"
        text = path.read_text()
        assert text.count(old) == 1
        path.write_text(text.replace(old, new))
        os.utime(path, (1_000_000_000, 1_000_000_000))

    def call(self, *modules: str) -> tuple[int, bool]:
        """Import the modules in a new process; the answer of the last, and whether it was kept."""
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", CALL, *modules],
            env=self.variables,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
        assert (done.stderr, done.returncode) == ("", 0)
        answer, hits = done.stdout.split()
        return int(answer), hits == "1"


def installation(folder: Path, kind: str) -> Installation:
    """Write the package; no `__pycache__` can be made where a file has that name, not by root."""
    room, home = folder / "room", folder / "home"
    room.mkdir()
    for name, text in MODULES.items():
        (room / f"{name}.py").write_text(text)
    variables = {
        name: value
        for name, value in os.environ.items()
        if name not in {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}
    } | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    if kind == "tree":
        return Installation(folder, variables, room / "__pycache__")
    if kind == "NUMBA_CACHE_DIR":
        return Installation(folder, variables | {kind: str(home)}, home)
    (room / "__pycache__").write_text("")
    if kind == "home":
        return Installation(folder, variables | {"HOME": str(home)}, home / ".cache")
    return Installation(folder, variables | {"HOME": os.devnull}, None)


@pytest.mark.thorough
@pytest.mark.parametrize("place", ["tree", "NUMBA_CACHE_DIR", "home"])
def test_a_change_reaches_the_compiled_functions_of_other_modules(
    tmp_path: Path, place: str
) -> None:
    """What calls it by way of an inner function of a third module is compiled and kept again."""
    room = installation(tmp_path, place)
    assert room.call("outer") == (71, False)
    room.change("10 * number", "20 * number")
    assert room.call("outer") == (141, False)
    assert room.call("outer") == (141, True)
    assert room.kept is not None
    assert list(room.kept.rglob("outer.call-*.nbc"))
    assert not list(room.kept.rglob("middle.*"))


def test_an_inner_function_is_for_compiled_code() -> None:
    """A call from Python is refused, unless it is to run in plain Python."""

    @inner
    def twice(number: int) -> int:
        return 2 * number

    with pytest.raises(TypeError, match="twice can be called by compiled functions only"):
        twice(3)
    assert twice.plain(3) == 6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("user", "old", "new", "after"),
    [
        ("constant", "FACTOR = 1", "FACTOR = 3", 21),
        ("fields", "one: int\n    other: int", "other: int\n    one: int", 7),
    ],
)
@pytest.mark.thorough
def test_a_change_reaches_those_who_take_a_constant_or_a_type(
    tmp_path: Path, user: str, old: str, new: str, after: int
) -> None:
    """Numbers and the order of a tuple's fields are part of what was compiled."""
    room = installation(tmp_path, "tree")
    assert room.call(user) == (7, False)
    room.change(old, new)
    assert room.call(user) == (after, False)


@pytest.mark.slow
@pytest.mark.thorough
def test_what_else_is_imported_makes_no_difference(tmp_path: Path) -> None:
    """Kept code is found again whichever modules a process has imported before."""
    room = installation(tmp_path, "tree")
    assert room.call("outer") == (71, False)
    assert room.call("unrelated", "fields", "outer") == (71, True)


@pytest.mark.thorough
def test_two_processes_compile_a_function_once(tmp_path: Path) -> None:
    """The one that comes second waits, and loads what the first has kept."""
    room = installation(tmp_path, "tree")
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(room.call, ["outer", "outer"]))
    assert sorted(found) == [(71, False), (71, True)]


@pytest.mark.thorough
def test_a_damaged_file_is_compiled_and_kept_again(tmp_path: Path) -> None:
    """A file that was cut off, as by a loss of power, costs one compilation."""
    room = installation(tmp_path, "tree")
    room.call("outer")
    assert room.kept is not None
    for ending in ("nbc", "nbi"):
        [path] = room.kept.glob(f"outer.call-*.{ending}")
        path.write_bytes(b"")
        assert room.call("outer") == (71, False)
    assert room.call("outer") == (71, True)


@pytest.mark.thorough
def test_code_with_types_that_have_moved_is_compiled_and_kept_again(tmp_path: Path) -> None:
    """An index that names a module which a newer version no longer has costs one compilation."""
    room = installation(tmp_path, "tree")
    room.call("outer")
    assert room.kept is not None
    [path] = room.kept.glob("outer.call-*.nbi")
    with path.open("rb") as stream:
        version = pickle.load(stream)  # noqa: S301 - our own
    path.write_bytes(pickle.dumps(version) + b"cmoved.away\nTable\n.")
    assert room.call("outer") == (71, False)
    assert room.call("outer") == (71, True)


@pytest.mark.thorough
def test_with_nowhere_to_write_it_is_compiled_all_the_same(tmp_path: Path) -> None:
    """Neither the installation nor a home can be written to: right all the same, and silent."""
    assert installation(tmp_path, "nowhere").call("outer") == (71, False)


LITTLE = """
import sys
import numpy as np
from room.loops import Part, fill

def filled(steps):
    part, kept = Part(np.zeros((3, 2), dtype=np.int32)), np.zeros(2, dtype=np.bool_)
    answer = fill.for_work(steps)(part, kept, 7)
    return (answer, part.rows.tolist(), kept.tolist())

found = [filled(steps) for steps in map(int, sys.argv[1:])]
assert all(each == found[0] for each in found), found
print(found[0], "numba" in sys.modules)
"""

LOOPS = """
from typing import NamedTuple
import numpy as np
from numpy.typing import NDArray
from cubepath.protocol.compiled import compiled
from room.inner import scaled
at = np.uint32
class Part(NamedTuple):
    rows: NDArray[np.int32]
@compiled
def fill(part: Part, kept: NDArray[np.bool_], number: int) -> int:
    for row in range(len(part.rows)):
        part.rows[at(row), 1] = half(scaled(number)) + row
    kept[0] = number > 0
    return half(number)
@compiled
def half(number: int) -> int:
    return number // 2
"""


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("works", "loaded"),
    [((100, 1000, 10_000), False), ((400_000,), True), ((100, 299_900, 1), True)],
)
def test_little_work_is_done_without_numba(
    tmp_path: Path, works: tuple[int, ...], loaded: bool
) -> None:
    """In plain Python as long as the allowance lasts, then compiled, with the same results."""
    room = installation(tmp_path, "tree")
    (tmp_path / "room" / "loops.py").write_text(LOOPS)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", LITTLE, *map(str, works)],
        env=room.variables,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    answer = (3, [[0, 35], [0, 36], [0, 37]], [True, False])
    assert (done.stdout, done.stderr) == (f"{answer} {loaded}\n", "")
    assert bool(list(tmp_path.rglob("*.nbi"))) == loaded
