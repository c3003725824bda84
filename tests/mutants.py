"""Running tests or the simulator against a mutant: in a child process, which alone has the change.

A child is forked from a process that has imported what the project depends on, but nothing of the
project itself. It imports the mutant in place of the module; the file is not touched, and processes
that a test starts in turn know only the file. Whatever a child writes goes into a folder that is
removed behind it: temporary files, examples of hypothesis, machine code of numba. Examples are
derived from the tests alone, so that a mutant has the same fate each time.
"""

import ast
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from time import monotonic
from types import CodeType, ModuleType

import hypothesis
import pytest

from mutators import Mutation, mutations

ROOT = Path(__file__).parent.parent
SEARCHED = ("protocol", "agents", "coordinator")
"""The folders below `ROOT` that modules are imported from."""
IMPORTED_BEFORE = ("numba", "mcap.writer", "msgspec", "zenoh")
"""What takes long to import, and knows nothing of the project."""
MEMORY_BYTES_MAX = 4 << 30
WALL_FACTOR = 6
"""How much longer than its processor time a child may take, on a machine that has other work."""
PASSED, FAILED, NOTHING_COLLECTED, MISUSED = 0, 1, 5, 4
_BEGUN = "begun"
"""The file in a child's folder that has a byte for each seed that was begun."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Some tests or seeds to run with a mutant of a file, or with the file as it is."""

    file: str
    number: int | None
    """Which of the file's mutations is made; None: the file stays as it is."""
    tests: tuple[str, ...]
    slow: bool
    seconds: float
    """The processor time that it may take."""
    seeds: int = 0
    """Where it is not 0, so many seeds of the simulator are run instead of the tests."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of a trial: whether all tests or seeds passed, and what it cost."""

    passed: bool
    empty: bool
    """There was no test to run."""
    seconds: float
    """The processor time."""
    output: str
    seeds: int
    """How many seeds were begun, the one that failed included."""


def mutations_of(file: str) -> list[Mutation]:
    """Return all mutations of a source file, which is named from the root of the repository."""
    return mutations(ast.parse((ROOT / file).read_text()))


def run_trials(trials: Iterable[Trial], processes: int) -> Iterator[tuple[Trial, Verdict]]:
    """Yield what comes of each trial, as they end, with so many of them at a time.

    What hangs, takes all memory or kills its process has not passed.
    """
    for name in IMPORTED_BEFORE:
        import_module(name)
    waiting = iter(trials)
    running: dict[int, _Child] = {}
    try:
        while True:
            while len(running) < processes and (trial := next(waiting, None)) is not None:
                child = _Child(trial)
                running[child.ended] = child
            if not running:
                return
            for child in _next_to_end(running):
                del running[child.ended]
                yield child.trial, child.verdict()
    finally:
        for child in running.values():
            child.kill()
            child.verdict()


class _Child:
    """A process that makes one trial."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        self.folder = Path(tempfile.mkdtemp(prefix="cubepath-mutant-"))
        self.last_moment = monotonic() + trial.seconds * WALL_FACTOR
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if not self.pid:
            _in_child(trial, self.folder)
        self.ended = os.pidfd_open(self.pid)

    def kill(self) -> None:
        """End it and what it has started."""
        for end in (os.killpg, os.kill):
            try:
                end(self.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue

    def verdict(self) -> Verdict:
        """Wait for its end, remove what it left behind, and return what came of it."""
        _, status, used = os.wait4(self.pid, 0)
        self.kill_rest()
        os.close(self.ended)
        output = (self.folder / "output").read_text(errors="replace")
        begun = self.folder / _BEGUN
        seeds = len(begun.read_bytes()) if begun.exists() else 0
        shutil.rmtree(self.folder, ignore_errors=True)
        code = os.waitstatus_to_exitcode(status)
        if code == MISUSED:
            raise AssertionError(f"pytest could not be run:\n{output}")
        passed = code in (PASSED, NOTHING_COLLECTED)
        seconds = used.ru_utime + used.ru_stime
        return Verdict(passed, code == NOTHING_COLLECTED, seconds, output, seeds)

    def kill_rest(self) -> None:
        """End what it has started and left."""
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            return


def _next_to_end(running: dict[int, _Child]) -> list[_Child]:
    """Wait until a child ends, by itself or because its time is up; return those that did."""
    first = min(child.last_moment for child in running.values())
    ready, _, _ = select.select(list(running), [], [], max(0.0, first - monotonic()))
    if not ready:
        for child in running.values():
            if child.last_moment <= monotonic():
                child.kill()
                ready.append(child.ended)
    return [running[each] for each in ready]


def _in_child(trial: Trial, folder: Path) -> None:
    """Make the trial, and end the process with its exit code."""
    code = FAILED
    try:
        os.setpgid(0, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        output = os.open(folder / "output", os.O_WRONLY | os.O_CREAT)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for own, other in ((0, nothing), (1, output), (2, output)):
            os.dup2(other, own)
        code = _tested(trial, folder)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _tested(trial: Trial, folder: Path) -> int:
    seconds = int(trial.seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = used + MEMORY_BYTES_MAX
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    sys.dont_write_bytecode = True
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(folder)
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    sys.path[:0] = [str(ROOT / room) for room in SEARCHED]
    for name in [name for name in sys.modules if name.split(".")[0] == "cubepath"]:
        del sys.modules[name]
    if trial.number is not None:
        _keep_no_machine_code()
        sys.meta_path.insert(0, _MutantFinder(trial.file, trial.number))
    if trial.seeds:
        return _simulated(trial.file, trial.seeds, folder)
    arguments = ["-n", "0", "-x", "-q", "-p", "no:randomly", "-p", "no:cacheprovider"]
    arguments += ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), "-o", "timeout=0"]
    marked = "slow and not thorough and not nightly" if trial.slow else "not slow"
    arguments += ["--basetemp", str(folder / "pytest"), "-m", marked]
    arguments += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
    os.chdir(ROOT)
    return int(pytest.main([*arguments, *trial.tests], plugins=[_SameExamples()]))


def _simulated(file: str, seeds: int, folder: Path) -> int:
    """Run the simulator from seed 0 on until a seed fails, hangs or raises."""
    # The mutant is in place by now.
    from cubepath.coordinator.simulation.swarm import FreeSwarm, LockstepSwarm

    without_rounds = "agents/keepers/" in file or "agents/free/" in file
    simulator = FreeSwarm() if without_rounds else LockstepSwarm()
    with (folder / _BEGUN).open("wb", buffering=0) as begun:
        for seed in range(seeds):
            begun.write(b".")
            failure = simulator.run_of(seed).failure
            if failure is not None:
                print(f"seed {seed}: {failure.kind}: {failure.detail}")
                return FAILED
    return PASSED


class _SameExamples:
    """A plugin of pytest: hypothesis derives its examples from the test, and keeps none."""

    @pytest.hookimpl(trylast=True)
    def pytest_sessionstart(self) -> None:
        """Change the profile that conftest.py has chosen, before tests are imported.

        pytest has put its own finder before that of the mutant, and takes every module below the
        folder of the plugin: the mutant must be asked first.
        """
        sys.meta_path.sort(key=lambda finder: not isinstance(finder, _MutantFinder))
        own = hypothesis.settings(hypothesis.settings.default, derandomize=True, database=None)
        hypothesis.settings.register_profile("mutants", own)
        hypothesis.settings.load_profile("mutants")


def _keep_no_machine_code() -> None:
    """Have numba write to no cache: it reads what is there already."""
    from numba.core.caching import Cache

    def kept_nowhere(*_: object) -> None:
        return

    Cache.save_overload = kept_nowhere  # type: ignore[method-assign]


class _MutantFinder(MetaPathFinder):
    """Finds one module: a mutant of it."""

    def __init__(self, file: str, number: int) -> None:
        self._path = ROOT / file
        self._number = number
        self._name = module_name(file)

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the mutant where its module is asked for, None for any other."""
        del path, target
        if name != self._name:
            return None
        loader = _MutantLoader(name, str(self._path), self._number)
        return spec_from_file_location(name, self._path, loader=loader)


class _MutantLoader(SourceFileLoader):
    """Loads a module from its file with one mutation."""

    def __init__(self, name: str, path: str, number: int) -> None:
        super().__init__(name, path)
        self._number = number

    def get_code(self, fullname: str) -> CodeType:
        """Return the code of the mutant, which is compiled anew and kept nowhere."""
        del fullname
        tree = ast.parse(Path(self.path).read_text())
        mutations(tree)[self._number].apply()
        return compile(tree, self.path, "exec", dont_inherit=True)


def module_name(file: str) -> str:
    """Return the dotted name under which a source file is imported."""
    room, *parts = Path(file).with_suffix("").parts
    return ".".join(parts if room in SEARCHED else (room, *parts))
