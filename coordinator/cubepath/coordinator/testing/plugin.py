"""The plugin for pytest: fixtures, seeds, recordings in the report, and what sessions must meet.

The entry point ``pytest11`` names it, so every pytest imports it where cubepath is installed: it
imports nothing large before a fixture is used.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Generator, Iterator
from contextlib import suppress
from itertools import islice, pairwise
from traceback import format_exception
from typing import TYPE_CHECKING, Any

import pytest

from cubepath.coordinator.testing import properties

if TYPE_CHECKING:
    from cubepath.coordinator.testing.fixtures import (
        RecordingFolder,
        ReplayFixture,
        RunFixture,
        SimulateFixture,
    )
    from cubepath.coordinator.testing.network import NetworkUnderTest

SEED = "cubepath_seed"
MARKER = "cubepath"
_TIMEOUT_S = 30.0
_TOLD = pytest.StashKey[list[Any]]()
"""Those that name recordings when a test fails."""
_UNMET = pytest.StashKey[list[str]]()
"""A line for each property that the session has not met."""
SEEDS_MAX = 100_000
"""A test is called no more often."""
_OURS = re.compile(r"cubepath\.(protocol|agents|coordinator)\b|contextlib$")
_PYTEST = re.compile(r"(_?pytest|pluggy)\b")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("cubepath", "runs of cubepath under test")
    group.addoption(
        "--cubepath-seeds",
        metavar="SEEDS",
        help="the seeds of each test that takes one: 5 for 0 to 4, or as 3..9, or as 1,4,7",
    )
    group.addoption(
        "--cubepath-timeout",
        metavar="SECONDS",
        help="how long runs under test are waited for, unless a test says otherwise (30)",
    )
    parser.addini("cubepath_seeds", "as --cubepath-seeds", default="")
    parser.addini("cubepath_timeout", "as --cubepath-timeout", default="")


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker, and check the options."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}(seeds=None, reaches=(), **options): the seeds of the test, what the session must"
        " reach if it passes, and options of its runs, as timeout_s=10, clock='free', links=False",
    )
    _seeds_asked(config)
    _timeout_s(config)


def _given(config: pytest.Config, name: str) -> str:
    found = config.getoption(f"--cubepath-{name}")
    return str(found if found is not None else config.getini(f"cubepath_{name}"))


def seeds_in(text: str) -> list[int]:
    """Return the seeds of a text: ``5`` for 0 to 4, ``3..9``, or ``1,4,7``; UsageError if none."""
    from cubepath.protocol.core.errors import InputError  # noqa: PLC0415 - few tests ask for seeds
    from cubepath.protocol.core.ranges import seeds_of  # noqa: PLC0415

    try:
        seeds = seeds_of(text, "cubepath-seeds")
    except InputError as error:
        raise pytest.UsageError(str(error)) from None
    if len(seeds) > SEEDS_MAX:
        raise pytest.UsageError(f"cubepath-seeds: expected 1 to {SEEDS_MAX} seeds, found {text}")
    return list(seeds)


def seeds_given(given: Any) -> list[int]:
    """Return the seeds of a marker: several, how many, or a text as for `seeds_in`.

    UsageError if they are none of these.
    """
    with suppress(pytest.UsageError, TypeError):
        if isinstance(given, int | str):
            return seeds_in(str(given))
        seeds = list(islice(given, SEEDS_MAX + 1))
        if 0 < len(seeds) <= SEEDS_MAX and all(type(each) is int and each >= 0 for each in seeds):
            return seeds
    raise pytest.UsageError(f"seeds={given}: expected seeds, as [1, 4, 7], range(5), 5 or '3..9'")


def _seeds_asked(config: pytest.Config) -> list[int]:
    text = _given(config, "seeds")
    return seeds_in(text) if text else []


def _timeout_s(config: pytest.Config) -> float:
    text = _given(config, "timeout")
    try:
        seconds = float(text) if text else _TIMEOUT_S
    except ValueError:
        seconds = 0.0
    if not 0.0 < seconds < 3600.0:
        raise pytest.UsageError(
            f"cubepath-timeout={text}: expected seconds, above 0, less than 3600"
        )
    return seconds


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Call a test that takes a seed once for each: of the command line, its marker, the ini."""
    if SEED not in metafunc.fixturenames:
        return
    asked = metafunc.config.getoption("--cubepath-seeds")
    marked = _marked_seeds(metafunc.definition)
    seeds = seeds_in(asked) if asked else marked
    chosen = list(_seeds_asked(metafunc.config) if seeds is None else seeds)
    if chosen:
        metafunc.parametrize(SEED, chosen, indirect=True, ids=[f"seed{seed}" for seed in chosen])


def _marked_seeds(item: pytest.Item) -> list[int] | None:
    """Return the seeds of the nearest marker that has some; one line tells what is wrong."""
    found: Any = None
    for marker in item.iter_markers(MARKER):
        if marker.args:
            arguments = ", ".join(map(repr, marker.args))
            raise pytest.Collector.CollectError(
                f"{item.nodeid}: {MARKER}({arguments}): expected names, as clock='free'"
            )
        found = marker.kwargs.get("seeds") if found is None else found
    try:
        return None if found is None else seeds_given(found)
    except pytest.UsageError as error:
        raise pytest.Collector.CollectError(f"{item.nodeid}: {error}") from None


def _in_a_line(excinfo: pytest.ExceptionInfo[BaseException]) -> str:
    """Remove our frames from an error that is printed as one line; return it if no frame is left.

    What is wrong is in the test, and the line says what; ``--full-trace`` and ``--pdb`` show all
    frames.
    """
    errors = sys.modules.get("cubepath.protocol.core.errors")
    if errors is None or not isinstance(excinfo.value, errors.CubepathError):
        return ""

    if _keeps_theirs(excinfo.value):
        return ""
    cause = excinfo.value.__cause__
    traceback = [] if cause is None or cause.__traceback__ is None else format_exception(cause)
    return "".join([*traceback, f"{excinfo.typename}: {excinfo.value}"])


def _keeps_theirs(error: BaseException) -> bool:
    """Remove our frames from an error and its causes; return whether the test's are in it."""
    if error.__cause__ is not None:
        _keeps_theirs(error.__cause__)
    found, left, theirs = error.__traceback__, [], False
    while found is not None:
        module = str(found.tb_frame.f_globals.get("__name__", ""))
        if not _OURS.match(module):
            left.append(found)
            theirs = theirs or not _PYTEST.match(module)
        found = found.tb_next
    for one, after in pairwise([*left, None]):
        if one is not None:
            one.tb_next = after
    error.__traceback__ = left[0] if left else None
    return theirs


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[Any]
) -> Generator[None, Any, Any]:
    """Name the recordings of a test that failed, and show what is wrong without our frames."""
    options = ("fulltrace", "usepdb")
    whole = call.excinfo is None or any(item.config.getoption(each, False) for each in options)
    line = "" if whole or call.excinfo is None else _in_a_line(call.excinfo)
    report = yield
    if report.failed:
        report.longrepr = line or report.longrepr
        lines = [line for fixture in item.stash.get(_TOLD, []) for line in fixture.report_lines()]
        if lines:
            if any(line.startswith("recording ") for line in lines):
                lines.append("to look at one: cubepath log info FILE, or cubepath view FILE")
            # A section of the report itself would not be in JUnit XML. On a continuous integration
            # server pytest repeats a report that is plain text, whole, in its summary.
            shown: Any = report.longrepr
            if getattr(shown, "addsection", None) is not None:
                shown.addsection("cubepath", "\n".join(lines))
            elif call.excinfo is not None:
                report.longrepr = rest = call.excinfo.getrepr(style="native")
                entry: Any = rest.reprtraceback.reprentries[0]
                entry.lines[:] = [str(shown), "\n"]
                rest.addsection("cubepath", "\n".join(lines))
            else:  # it passed, and was to fail
                report.sections.append(("cubepath", "\n".join(lines)))
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Expect of the session what the markers of a test say, if it passes."""
    where, due = f"{item.path}:{(item.location[1] or 0) + 1}", dict[str, tuple[str, int, bool]]()
    for marker in item.iter_markers(MARKER):
        given = marker.kwargs.get("reaches", [])
        if not isinstance(given, list) or not all(isinstance(each, str) for each in given):
            pytest.fail(f"{MARKER}(reaches={given!r}): expected a list of texts", pytrace=False)
        due |= dict.fromkeys(given, (where, 0, False))
    result = yield
    properties.add(due)
    return result


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Add what a worker of pytest-xdist has counted, unless it died."""
    properties.add(getattr(node, "workeroutput", {}).get(MARKER, {}))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a session that was not cut short and has not met what it must."""
    output: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    whole = (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
    if output is not None:
        output[MARKER] = properties.tally()
    elif session.exitstatus in whole and not session.shouldfail:
        lines = session.config.stash[_UNMET] = properties.unmet()
        session.exitstatus = pytest.ExitCode.TESTS_FAILED if lines else session.exitstatus


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Name what the session has not met."""
    lines = config.stash.get(_UNMET, [])
    if lines:
        terminalreporter.section("cubepath: never met in this session", red=True, bold=True)
    for line in lines:
        terminalreporter.line(f"FAILED {line}", red=True)


@pytest.fixture
def cubepath_seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of this test: 0, or one of those that were asked for."""
    return int(getattr(request, "param", 0))


@pytest.fixture
def _cubepath_places(request: pytest.FixtureRequest) -> RecordingFolder:
    from cubepath.coordinator.testing.fixtures import RecordingFolder  # noqa: PLC0415 - only when asked for

    found = RecordingFolder(request.getfixturevalue("tmp_path"))
    _tell(request, found)
    return found


def _tell(request: pytest.FixtureRequest, fixture: object) -> None:
    request.node.stash.setdefault(_TOLD, []).append(fixture)


def _marked(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the options that the markers of a test give its runs; the nearest counts."""
    found: dict[str, Any] = {}
    for marker in reversed(list(request.node.iter_markers(MARKER))):
        found |= {k: each for k, each in marker.kwargs.items() if k not in ("seeds", "reaches")}
    return found


@pytest.fixture
def cubepath_run(
    request: pytest.FixtureRequest, cubepath_seed: int, _cubepath_places: RecordingFolder
) -> Iterator[RunFixture]:
    """Return what starts runs: ``cubepath_run("hex:n=7", "chain")`` is a `RunUnderTest`.

    Everything that it starts is ended when the test is over, whatever happens.
    """
    from cubepath.coordinator.testing.fixtures import RunFixture, marked  # noqa: PLC0415 - as above

    defaults: dict[str, Any] = {"seed": cubepath_seed, "timeout_s": _timeout_s(request.config)}
    found = RunFixture(_cubepath_places, defaults | marked(_marked(request)))
    _tell(request, found)
    try:
        yield found
    finally:
        found.close()


@pytest.fixture
def cubepath_network(request: pytest.FixtureRequest) -> Iterator[NetworkUnderTest]:
    """Return a private router for zenoh processes of your own: a `NetworkUnderTest`.

    What it has started is ended when the test is over; if the test fails, the report has the log.
    """
    from cubepath.coordinator.testing.network import NetworkUnderTest  # noqa: PLC0415 - as above

    timeout_s = _marked(request).get("timeout_s", _timeout_s(request.config))
    found = NetworkUnderTest(timeout_s=timeout_s)
    _tell(request, found)
    with found:
        yield found


@pytest.fixture
def cubepath_simulate(
    request: pytest.FixtureRequest, cubepath_seed: int, _cubepath_places: RecordingFolder
) -> SimulateFixture:
    """Return what simulates a run under faults and checks it: the arguments are of `trial_of`."""
    from cubepath.coordinator.testing.fixtures import SimulateFixture, marked  # noqa: PLC0415 - as above

    return SimulateFixture(_cubepath_places, cubepath_seed, marked(_marked(request)))


@pytest.fixture
def cubepath_replay(
    request: pytest.FixtureRequest, _cubepath_places: RecordingFolder
) -> Iterator[ReplayFixture]:
    """Return what puts a recording into the code under test: a function, a command, a rule."""
    from cubepath.coordinator.testing.fixtures import ReplayFixture  # noqa: PLC0415 - as above

    found = ReplayFixture(_timeout_s(request.config), _cubepath_places)
    try:
        yield found
    finally:
        found.close()
