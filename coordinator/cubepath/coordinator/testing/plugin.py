"""The plugin for pytest: fixtures, seeds by parametrisation, and recordings in the report.

Named by the entry point ``pytest11``, so it is imported by every pytest where cubepath is
installed: it imports nothing but pytest before a fixture is asked for.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from types import TracebackType
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from cubepath.coordinator.testing.fixtures import RecordingFolder, RunFixture

SEED = "cubepath_seed"
MARKER = "cubepath"
_TIMEOUT_S = 30.0
_TOLD = pytest.StashKey[list[Any]]()
"""Those that tell of recordings when a test fails."""
_RANGE = re.compile(r"(\d+)\.\.(\d+)")
SEEDS_MAX = 100_000
"""A test is called no more often."""
_OURS = re.compile(r"cubepath\.(protocol|agents|coordinator)\b|contextlib$")
_WHOLE = ("fulltrace", "usepdb")
"""The options that show all frames."""


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


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker, and check the options."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}(seeds=None, **options): the seeds of the test, and options of its runs, as"
        " timeout_s=10, clock='free', links=False",
    )
    _seeds_asked(config)
    _timeout_s(config)


def seeds_in(text: str) -> list[int]:
    """Return the seeds of a text: ``5`` for 0 to 4, ``3..9``, or ``1,4,7``; UsageError if none."""
    found = _RANGE.fullmatch(text)
    parts = text.split(",")
    seeds: Sequence[int] = ()
    with suppress(ValueError):  # of a number that is too long to be read
        if found is not None:
            seeds = range(int(found[1]), int(found[2]) + 1)
        elif text.isdecimal():
            seeds = range(int(text))
        elif len(parts) > 1 and all(part.isdecimal() for part in parts):
            seeds = [int(part) for part in parts]
    if not 1 <= len(seeds[: SEEDS_MAX + 1]) <= SEEDS_MAX:  # a longer range may have no length
        raise pytest.UsageError(
            f"cubepath-seeds={text}: expected a number from 1 to {SEEDS_MAX}, or as 3..9,"
            " or as 1,4,7"
        )
    return list(seeds)


def seeds_given(given: Any) -> list[int]:
    """Return the seeds of a marker: several, how many, or a text as for `seeds_in`.

    UsageError if they are none of these.
    """
    seeds: list[Any] = []
    with suppress(pytest.UsageError, TypeError):
        if isinstance(given, int | str):
            seeds = seeds_in(str(given))
        else:
            seeds = list(islice(given, SEEDS_MAX + 1))
    whole = all(isinstance(seed, int) and type(seed) is not bool and seed >= 0 for seed in seeds)
    if not (seeds and whole and len(seeds) <= SEEDS_MAX):
        raise pytest.UsageError(
            f"seeds={given}: expected seeds, as [1, 4, 7], range(5), 5 or '3..9'"
        )
    return seeds


def _seeds_asked(config: pytest.Config) -> list[int]:
    text = config.getoption("--cubepath-seeds")
    return seeds_in(text) if text else []


def _timeout_s(config: pytest.Config) -> float:
    text = config.getoption("--cubepath-timeout")
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
    """Call a test that takes a seed once for each: of the command line, or its marker."""
    if SEED not in metafunc.fixturenames:
        return
    marked = _marked_seeds(metafunc.definition)
    chosen = _seeds_asked(metafunc.config) or marked
    if chosen:
        metafunc.parametrize(SEED, chosen, indirect=True, ids=[f"seed{seed}" for seed in chosen])


def _marked_seeds(item: pytest.Item) -> list[int] | None:
    """Return the seeds of the nearest marker that has some; one line tells what is wrong."""
    found: Any = None
    for marker in item.iter_markers(MARKER):
        if marker.args:
            told = ", ".join(map(repr, marker.args))
            raise pytest.Collector.CollectError(
                f"{item.nodeid}: {MARKER}({told}): expected names, as clock='free'"
            )
        found = marker.kwargs.get("seeds") if found is None else found
    try:
        return None if found is None else seeds_given(found)
    except pytest.UsageError as error:
        raise pytest.Collector.CollectError(f"{item.nodeid}: {error}") from None


def _without_our_frames(found: TracebackType | None) -> TracebackType | None:
    """Take our frames out of a traceback, which begins with one of pytest's."""
    while found is not None and _OURS.match(str(found.tb_frame.f_globals.get("__name__", ""))):
        found = found.tb_next
    if found is not None:
        found.tb_next = _without_our_frames(found.tb_next)
    return found


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[Any]
) -> Generator[None, Any, Any]:
    """Name the recordings of a test that failed, and show what is wrong without our frames."""
    errors: Any = sys.modules.get("cubepath.protocol.core.errors")
    excinfo, whole = call.excinfo, any(item.config.getoption(each, False) for each in _WHOLE)
    told = () if errors is None or whole else (errors.CubepathError,)
    if excinfo is not None and isinstance(excinfo.value, told):
        # What is wrong is in the test, and the line says what.
        _without_our_frames(excinfo.value.__traceback__)
    report = yield
    if report.failed:
        lines = [line for teller in item.stash.get(_TOLD, []) for line in teller.told()]
        if lines:
            text = "\n".join(
                [*lines, "to look at one: cubepath log info FILE, or cubepath view FILE"]
            )
            report.sections.append(("cubepath", text))
    return report


@pytest.fixture
def cubepath_seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of this test: 0, or one of those that were asked for."""
    return int(getattr(request, "param", 0))


@pytest.fixture
def _cubepath_places(request: pytest.FixtureRequest) -> RecordingFolder:
    from cubepath.coordinator.testing.fixtures import RecordingFolder  # noqa: PLC0415 - only when asked for

    return RecordingFolder(request.getfixturevalue("tmp_path"))


def _marked(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the options that the markers of a test give its runs; the nearest counts."""
    found: dict[str, Any] = {}
    for marker in reversed(list(request.node.iter_markers(MARKER))):
        found |= {key: value for key, value in marker.kwargs.items() if key != "seeds"}
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
    request.node.stash.setdefault(_TOLD, []).append(found)
    try:
        yield found
    finally:
        found.close()
