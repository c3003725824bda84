"""The plugin for pytest, as a project that uses it has it: in processes of pytest of their own."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cubepath.coordinator.testing.fixtures import SimulateFixture
from cubepath.coordinator.testing.plugin import seeds_given, seeds_in
from processes.living import is_there

pytestmark = pytest.mark.slow
ENOUGH_S = 110.0


def outcome_of(
    folder: Path, text: str = "", *options: str, conftest: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run pytest in a project with one file of tests; temporary files go to the project."""
    return subprocess.run(
        command(folder, text, *options, conftest=conftest),
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder), "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        timeout=ENOUGH_S,
        check=False,
    )


def command(folder: Path, text: str, *options: str, conftest: str = "") -> list[str]:
    """Write a project and return the command that tests it."""
    (folder / "pytest.ini").write_text("[pytest]\n")
    (folder / "conftest.py").write_text(conftest)
    if text:
        (folder / "test_mine.py").write_text(text)
    return [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", *options]


LOADED = """
import sys
def pytest_unconfigure(config):
    heavy = {"zenoh", "numba", "numpy", "msgspec", "hypothesis", "mcap", "matplotlib"}
    print("LOADED", sorted(heavy & set(sys.modules)))
"""


@pytest.mark.thorough
def test_nothing_heavy_is_imported_before_a_fixture_is_asked_for(tmp_path: Path) -> None:
    """In a project that has no tests of cubepath, with the plugin in it."""
    bare = ("--collect-only", "-p", "no:hypothesispytest", "-p", "no:randomly")
    found = outcome_of(tmp_path, "", *bare, conftest=LOADED)
    assert "LOADED []" in found.stdout
    assert "cubepath_run" in outcome_of(tmp_path, "", "--fixtures").stdout


WITHOUT_PYTEST = """
import importlib, sys
sys.modules["pytest"] = None
for face in ("protocol", "agents", "coordinator", "coordinator.testing"):
    found = importlib.import_module(f"cubepath.{face}")
    for name in found.__all__:
        getattr(found, name)
from cubepath.coordinator.commands.main import main
sys.exit(main(["system", "list", "--json"]))
"""


@pytest.mark.thorough
def test_cubepath_works_without_pytest() -> None:
    """Every public name, and the command line."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_PYTEST], capture_output=True, check=False, timeout=ENOUGH_S
    )
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.thorough
def test_without_hypothesis_the_strategies_say_so() -> None:
    """In one line, with what to install."""
    text = "import sys; sys.modules['hypothesis'] = None; from cubepath.coordinator.testing import "
    done = subprocess.run(
        [sys.executable, "-c", text + "faults"], capture_output=True, text=True, check=False
    )
    last = done.stderr.strip().splitlines()[-1]
    assert last.endswith("strategies take hypothesis: pip install 'cubepath[testing]'")
    subprocess.run([sys.executable, "-c", text + "RunUnderTest"], check=True)


SEEDS = """
import pytest
def test_plain(cubepath_seed):
    assert cubepath_seed in (0, 7, 8)
@pytest.mark.cubepath(seeds=[3, 5])
def test_marked(cubepath_seed):
    assert cubepath_seed in (3, 5, 7, 8)
def test_other():
    pass
"""


def ids(folder: Path, *options: str) -> list[str]:
    """Return the tests that are collected."""
    text = outcome_of(folder, SEEDS, "--collect-only", *options).stdout
    return re.findall(r"^test_mine.py::(\S+)$", text, re.MULTILINE)


@pytest.mark.thorough
def test_seeds_are_those_asked_for(tmp_path: Path) -> None:
    """On the command line, else by the marker, else in the ini; else 0, which has no name."""
    marked = ["test_marked[seed3]", "test_marked[seed5]"]
    assert ids(tmp_path, "-p", "no:randomly") == ["test_plain", *marked, "test_other"]
    both = [f"{name}[seed{seed}]" for name in ("test_plain", "test_marked") for seed in (7, 8)]
    assert ids(tmp_path, "-p", "no:randomly", "--cubepath-seeds=7..8") == [*both, "test_other"]
    ini = ids(tmp_path, "-p", "no:randomly", "-o", "cubepath_seeds=7,8")
    assert ini == [*both[:2], *marked, "test_other"]


@pytest.mark.thorough
def test_seeds_come_to_the_tests(tmp_path: Path) -> None:
    """And options that are none end pytest in one line."""
    assert "4 passed" in outcome_of(tmp_path, SEEDS).stdout
    wrong = outcome_of(tmp_path, SEEDS, "--cubepath-seeds=x")
    line = "cubepath-seeds: expected a number of seeds, a range A..B or a list of both, found 'x'"
    assert line in wrong.stderr
    wrong = outcome_of(tmp_path, SEEDS, "--cubepath-timeout=never")
    assert "cubepath-timeout=never: expected seconds, above 0, less than 3600" in wrong.stderr


@pytest.mark.parametrize(
    ("text", "seeds"), [("3", [0, 1, 2]), ("3..5", [3, 4, 5]), ("4,1", [4, 1]), ("0..0", [0])]
)
def test_seeds_are_read(text: str, seeds: list[int]) -> None:
    """A number, a range or a list."""
    assert seeds_in(text) == seeds


BAD = ("", "0", "-1", "5..3", "a", "1;2", "100001", "0..100000", "9" * 5000)


@pytest.mark.parametrize("text", BAD, ids=[text[:9] for text in BAD])
def test_no_seeds_are_an_error(text: str) -> None:
    """The option is named, with what is expected."""
    with pytest.raises(pytest.UsageError, match=r"^cubepath-seeds: .*expected"):
        seeds_in(text)


@pytest.mark.parametrize(
    ("given", "seeds"), [([3, 5], [3, 5]), (range(2, 4), [2, 3]), (3, [0, 1, 2]), ("7..8", [7, 8])]
)
def test_a_marker_has_seeds_in_any_form(given: object, seeds: list[int]) -> None:
    """Several numbers, how many, or as on the command line."""
    assert seeds_given(given) == seeds


@pytest.mark.parametrize("given", ["x", [], 0, -1, [-1], [1.5], ["a"], True, [True], 2.5, object])
def test_a_marker_without_seeds_is_an_error(given: object) -> None:
    """With what is expected."""
    with pytest.raises(pytest.UsageError, match=r"^seeds=.*: expected seeds, as \[1, 4, 7\], "):
        seeds_given(given)


FAILS = """
import pytest
@pytest.mark.cubepath(max_rounds=3, links=False)
def test_run(cubepath_run, cubepath_simulate):
    rig = cubepath_run("hex:n=3", "random", processes=0)
    assert rig.play().rounds == 3
    rig = cubepath_run("hex:n=3", processes=0, max_rounds=100)
    rig.until_goal()
    rig.finish().assert_goal()
    assert rig.run.plan.seed == 4
    cubepath_simulate("hex:n=3", processes=1)
    if "{fails}":
        from cubepath.coordinator.testing import fault
        cubepath_simulate("hex:n=3", faults=[fault("loss", "process_0 up", 1)], check=True)
        assert rig.moves < 0
"""


@pytest.mark.thorough
def test_a_test_that_fails_keeps_its_recordings_and_names_them(tmp_path: Path) -> None:
    """Under xdist as well; one that passes says nothing. Options come from the marker."""
    failing = FAILS.replace("{fails}", "yes")
    found = outcome_of(tmp_path, failing, "-n1", "--cubepath-seeds=4..4", "--basetemp=base").stdout
    logs = re.findall(r"^recording (\S+\.mcap): hex:n=3, seed 4, round \d+", found, re.MULTILINE)
    assert len(logs) == 2, found
    assert [Path(log).name for log in logs] == ["run.mcap", "run-2.mcap"]
    assert all(Path(log).is_file() for log in logs)
    assert "cubepath log info FILE" in found
    passing = FAILS.replace("{fails}", "")
    found = outcome_of(tmp_path, passing, "--cubepath-seeds=4..4").stdout
    assert "1 passed" in found
    assert "recording" not in found


LOSES = """
from cubepath.protocol import open_client
def test_wait(cubepath_network, request):
    with open_client(cubepath_network.endpoint("arm")) as session:
        lost = cubepath_network.drop("robot/arm")
        session.put("robot/arm", "gone")
        lost.wait()
        {fails}
"""


@pytest.mark.parametrize(
    "fails",
    [
        "assert not lost.count",
        "cubepath_network.start('arm', '')",
        "request.getfixturevalue('none')",
    ],
)
def test_the_log_is_in_the_report_and_in_its_xml(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once, whether the failure is shown with frames or as no fixture, and on a server too."""
    monkeypatch.setenv("CI", "true")  # where the summary does not cut what failed
    found = outcome_of(tmp_path, LOSES.format(fails=fails), "--junitxml=found.xml").stdout
    for text in (found, (tmp_path / "found.xml").read_text()):
        assert text.count("messages by key, 1 key:") == 1, text
        assert text.count(" 0 (1 lost) robot/arm") == 1
        assert " cubepath ----" in text


def test_an_error_in_one_line_has_the_log_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That of a fixture that comes after the one that lost something."""
    monkeypatch.setenv("CI", "true")
    text = LOSES.format(fails="pass").replace("def test_wait", "@pytest.fixture\ndef lossy")
    text = (
        f"import pytest{text}\n@pytest.mark.cubepath(typo=3)\ndef test_it(lossy, cubepath_run): ..."
    )
    found = outcome_of(tmp_path, text, "--junitxml=found.xml").stdout
    assert re.search(
        r"^InputError: @pytest.mark.cubepath: typo: expected one of", found, re.MULTILINE
    )
    for each in (found, (tmp_path / "found.xml").read_text()):
        assert each.count("messages by key, 1 key:") == 1, each


def test_a_test_that_was_to_fail_shows_its_log_too(tmp_path: Path) -> None:
    """It has no error that could be shown with it."""
    text = LOSES.format(fails="pass").replace(
        "def test", "@pytest.mark.xfail(strict=True)\ndef test"
    )
    found = outcome_of(tmp_path, "import pytest" + text).stdout
    assert "[XPASS(strict)]" in found
    assert found.count("messages by key, 1 key:") == 1, found


WRONG = """
import pytest
@pytest.fixture
def mine(cubepath_run):
    return cubepath_run("hexx", processes=0)
def test_fixture(mine): pass
def test_method(cubepath_run):
    run = cubepath_run("hex:n=3", processes=0, links=False)
    run.until(lambda run: run.kill("proces_0"))
def test_where(cubepath_run):
    run = cubepath_run("hex:n=3", processes=0)
    run.drop(where=lambda message: message.nothing)
    run.step()
@pytest.mark.cubepath(tiemout_s=3)
def test_option(cubepath_run): pass
@pytest.mark.cubepath(hesitat=1)
def test_simulated(cubepath_simulate): pass
"""
WRONG_SEEDS = """
import pytest
@pytest.mark.cubepath(seeds="x")
def test_seeds(cubepath_seed): pass
"""
WRONG_USE = """
import pytest
@pytest.mark.cubepath("free")
def test_option(cubepath_run): pass
"""


@pytest.mark.thorough
def test_what_is_wrong_in_a_test_is_told_without_frames_of_ours(tmp_path: Path) -> None:
    """In fixtures, methods and markers; those of the test are shown, its functions too."""
    (tmp_path / "test_seeds.py").write_text(WRONG_SEEDS)
    (tmp_path / "test_use.py").write_text(WRONG_USE)
    options = ("--continue-on-collection-errors", "-p", "no:randomly")
    found = outcome_of(tmp_path, WRONG, *options).stdout
    for line in (
        "test_seeds.py::test_seeds: seeds=x: expected seeds, as [1, 4, 7], range(5), 5 or '3..9'",
        "test_use.py::test_option: cubepath('free'): expected names, as clock='free'",
        "InputError: @pytest.mark.cubepath: tiemout_s: expected one of ",
        "(did you mean 'timeout_s'?)",
        "(did you mean 'hesitate'?)",
        "InputError: unknown system 'hexx' (did you mean 'hex'?)",
        '>       return cubepath_run("hexx", processes=0)',
        '    run.until(lambda run: run.kill("proces_0"))',
        "test_mine.py:9: InputError",
        "run.drop(where=lambda message: message.nothing)",
        "CheckError: a rule of the link of process_0 raised AttributeError(",
    ):
        assert line in found, found
    assert "coordinator/testing" not in found
    assert "_pytest" not in found


LEAVES = """
import os, signal, sys, time
from pathlib import Path
import pytest
def test_leaves(cubepath_run, request):
    command = [sys.executable, "-I", {own!r}, "{{endpoint}}", "1"]
    one = cubepath_run("agv-labelled:graph=grid10x4,n=4", commands=[command])
    one.step(2)
    other = cubepath_run("hex:n=4", "random", clock="free", max_rounds=10**6, keepers=1)
    other.until_moves(2)
    other.pause("process_0")
    told = [os.getpid(), *one.pids.values(), *other.pids.values()]
    path = Path({pids!r})
    path.with_suffix(".new").write_text(" ".join(map(str, told)))
    path.with_suffix(".new").rename(path)
    {ending}
"""
OWN = str(Path(__file__).parents[2] / "processes" / "own_module.py")
ENDINGS = [
    pytest.param("raise KeyError('x')", (), 0, id="exception"),
    pytest.param("pass", (), 0, id="none"),
    pytest.param("time.sleep(100)", ("-n1",), signal.SIGKILL, id="killed worker"),
    pytest.param("time.sleep(100)", (), signal.SIGINT, id="interrupt"),
    pytest.param("time.sleep(100)", (), signal.SIGTERM, id="terminated"),
    pytest.param("os._exit(3)", (), 0, id="exit"),
    pytest.param("pytest.exit('no more')", (), 0, id="pytest.exit"),
    pytest.param("time.sleep(100)", ("--timeout=30", "--timeout-method=signal"), 0, id="timeout"),
    pytest.param(
        "time.sleep(100)", ("--timeout=30", "--timeout-method=thread"), 0, id="timeout thread"
    ),
    pytest.param("other.until('act', timeout_s=100)", ("-x",), signal.SIGINT, id="while waiting"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("ending", "options", "number"), ENDINGS)
def test_nothing_is_left_running_however_a_test_ends(
    ending: str, options: tuple[str, ...], number: int, tmp_path: Path
) -> None:
    """Our processes, one that stands still, and those of others; sockets neither."""
    (tmp_path / "t").mkdir()
    told = tmp_path / "pids"
    text = LEAVES.format(own=OWN, pids=str(told), ending=ending)
    with subprocess.Popen(
        command(tmp_path, text, *options),
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path / "t"), "PYTEST_ADDOPTS": ""},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as child:
        until(lambda: told.exists() or child.poll() is not None)
        if not told.exists():
            child.kill()
            raise AssertionError(child.communicate()[0])
        pids = [int(pid) for pid in told.read_text().split()]
        if number:
            os.kill(pids[0], number)
        try:
            output, _ = child.communicate(timeout=ENOUGH_S)
        finally:
            child.kill()
    assert len(pids) == 9
    until(lambda: not any(map(is_there, pids)))
    left = [pid for pid in pids if is_there(pid)]
    assert not left, output
    until(lambda: not list((tmp_path / "t").glob("cubepath-*")))
    assert not list((tmp_path / "t").glob("cubepath-*")), output


def until(what: object, patience_s: float = 40.0) -> None:
    """Wait until something holds, or for long."""
    assert callable(what)
    end = time.monotonic() + patience_s
    while not what() and time.monotonic() < end:
        time.sleep(0.05)


@pytest.mark.cubepath(clock="free", hesitate=0.25, links=False)
def test_the_marker_is_for_simulated_runs_too(cubepath_simulate: SimulateFixture) -> None:
    """As far as they have its options; what is named in the test counts."""
    free = cubepath_simulate("hex:n=3", moves=2).trial.scenario
    assert (type(free).__name__, free.hesitate) == ("FreeScenario", 0.25)
    assert cubepath_simulate("hex:n=3", clock="lockstep").trial.scenario.hesitate == 0.25
