"""Runs under test: awaited, wounded, with processes of others; what fails tells what was seen."""

import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError

pytestmark = pytest.mark.slow
SYSTEM = "hex:n=5"
VEHICLES = "agv-labelled:graph=grid10x4,n=4"
OWN = [
    sys.executable,
    "-I",
    str(Path(__file__).parents[2] / "processes" / "own_module.py"),
    "{endpoint}",
    "1",
]


@pytest.fixture(scope="module")
def digest(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of the path in one process, without a link."""
    return run(SYSTEM, processes=0, log=tmp_path_factory.mktemp("a") / "a.mcap").path_digest


def reached(rig: RunUnderTest) -> str:
    """Play to the end, check everything, and return the digest of the path."""
    outcome = rig.play(timeout_s=60)
    log = rig.finish()
    log.assert_legal()
    log.assert_goal()
    return outcome.path_digest


Wound = Callable[[RunUnderTest], Any]
LONG: Any = pytest.mark.thorough
WOUNDS: list[Any] = [
    pytest.param(lambda rig: rig.double("bundle"), id="doubled", marks=LONG),
    pytest.param(lambda rig: rig.drop("ready", sender="process_1", times=2), id="lost", marks=LONG),
    pytest.param(
        lambda rig: rig.drop("go", to=0, round=3, phase="claim", times=1), id="go lost", marks=LONG
    ),
    pytest.param(lambda rig: rig.drop(probability=0.01, seed=5), id="by chance", marks=LONG),
    pytest.param(lambda rig: rig.delay(0.02, sender="process_0", times=20), id="late", marks=LONG),
    pytest.param(lambda rig: rig.reorder("bundle", by=3), id="overtaken", marks=LONG),
    pytest.param(lambda rig: rig.hold("bundle", round=3, seconds=0.3), id="held back", marks=LONG),
    pytest.param(lambda rig: rig.pause(0, at="claim", seconds=0.3), id="paused"),
    pytest.param(
        lambda rig: rig.cut_off("process_1", at=3, seconds=0.3, keep=True), id="cut off", marks=LONG
    ),
]


@pytest.mark.parametrize("wound", WOUNDS)
def test_a_run_with_rounds_tolerates_it(
    wound: Wound, cubepath_run: RunFixture, digest: str
) -> None:
    """The path is the one of a run in one process, and something did happen."""
    rig = cubepath_run(SYSTEM)
    done = wound(rig)
    assert reached(rig) == digest
    assert getattr(done, "count", 0) or getattr(done, "done", False)


def test_ten_lines_kill_a_module(cubepath_run: RunFixture) -> None:
    """Without rounds; it is started again, and the goal is reached."""
    rig = cubepath_run(SYSTEM, clock="free", keepers=2)
    rig.until_moves(4)
    rig.kill("process_1")
    rig.restart("process_1")
    rig.until_goal()
    rig.finish().assert_legal()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["keeper_1", "process_0"])
def test_without_rounds_who_is_wounded_goes_on(name: str, cubepath_run: RunFixture) -> None:
    """Paused, cut off for a while, killed and started again, with links that lose."""
    rig = cubepath_run("hex:n=7", clock="free", keepers=2)
    lost = rig.drop("tile", probability=0.2)
    rig.until_moves(3)
    rig.pause(name, seconds=0.5)
    rig.until_moves(6)
    rig.cut_off(name)
    healed = rig.heal(name, at="turns")
    rig.until(lambda _: healed.done)
    rig.kill(name, at="commit")
    rig.until(lambda _: name not in rig.pids)
    rig.restart(name)
    rig.until_goal()
    rig.finish().assert_legal()
    assert lost.count


@pytest.mark.thorough
def test_processes_of_others_take_part(cubepath_run: RunFixture) -> None:
    """They are named and wounded as ours are, by a name or by one of their modules."""
    rig = cubepath_run(VEHICLES, seed=8, commands={"mine": OWN})
    assert rig.name_of(1) == rig.name_of("module_1") == "mine"
    deaf = rig.drop("bundle", to=1, times=2)
    mute = rig.drop("reports", sender="mine", round=7)
    paused = rig.pause(1, at=5, seconds=0.3)
    mute.times = 1
    reached_by = reached(rig)
    assert (deaf.count, mute.count) == (2, 1)
    assert {each.sender for each in mute.met} == {"process_0"}
    assert paused.done
    assert rig.commands["mine"].wait() == 0
    again = cubepath_run(VEHICLES, seed=8, commands=[OWN], links=False)
    assert again.play().path_digest == reached_by
    assert list(again.commands) == ["own_0"]
    assert again.name_of(1) == "own_0"


def test_messages_and_states_are_awaited(cubepath_run: RunFixture) -> None:
    """A message that comes from now on is returned."""
    rig = cubepath_run(VEHICLES, seed=2)
    rig.step(2)
    assert rig.round == 2
    claim = rig.until("claim", module=1)
    assert isinstance(claim, WireMessage)
    assert (claim.kind, claim.round) == ("bundle", rig.round)
    assert 1 in claim.modules
    rig.until(lambda each: each.round >= 5 and each.moves > 3)
    rig.until_round(7)
    assert rig.sites == rig.run.sites
    log = rig.finish()
    assert rig.outcome.ended == "interrupted"
    log.assert_legal()
    log.assert_count(range(1, 99), "claim", module=1)


def anything(value: Any) -> Any:
    """Return what no type checker lets pass."""
    return value


def failing(act: Callable[[], object], line: str) -> str:
    with pytest.raises(AssertionError, match=line) as found:
        act()
    return str(found.value)


@pytest.mark.thorough
def test_what_ended_a_run_is_told_with_what_came(cubepath_run: RunFixture) -> None:
    """How the run stands, each process with its modules, and the last messages."""
    rig = cubepath_run(SYSTEM, timeout_s=3.0)
    rig.step(3)
    rig.cut_off(0)
    text = failing(rig.until_goal, r"^the run ended before: the goal\nround 3, 3 moves, goal not")
    assert "the run has ended, failed: no answer within 3 s to phase sense of round 4" in text
    assert "process_0: process id " in text
    assert ", modules 0, 1, its link is cut (lost)\n" in text
    assert "the last messages:\n" in text


@pytest.mark.parametrize("error", [CheckError("mine"), TimeoutError("mine")], ids=repr)
def test_what_a_test_raises_is_not_taken_for_what_the_run_does(
    error: Exception, cubepath_run: RunFixture
) -> None:
    """Neither that of a listener nor that of a condition; the run goes on."""

    due = [error, error]

    def raises(*_: object) -> None:
        if due:
            raise due.pop()

    rig = cubepath_run("hex:n=3", links=False, processes=0)
    with pytest.raises(type(error), match=r"^mine$"):
        rig.until(raises)
    rig.run.listen(raises)
    with pytest.raises(type(error), match=r"^mine$"):
        rig.until_round(1)
    assert rig.run.goes_on


def test_a_run_that_fails_fails_the_test(cubepath_run: RunFixture) -> None:
    """With what was seen, unless the test asks for it; and then a run that does not."""
    rig = cubepath_run("hex:n=3", links=False)
    rig.kill("process_0", at=2)
    text = failing(rig.play, r"^the run failed: module_0.* \(process 0\) died in round [12]")
    assert "the last messages:\n" in text
    assert rig.play(failing=True).ended == "failed"
    good = cubepath_run("hex:n=3", processes=0, max_rounds=2)
    failing(lambda: good.play(failing=True), "^the run did not fail, expected it to")


def test_what_does_not_come_in_time_is_told(cubepath_run: RunFixture) -> None:
    """With the pattern, and at once where who would have to say it has died."""
    rig = cubepath_run("hex:n=4", "random", clock="free", keepers=1, timeout_s=1.0, patience=20.0)
    failing(
        lambda: rig.until("action"), r"^not within 1 s: a message with kind=action\nlevel \d+, "
    )
    os.kill(rig.pids["process_1"], signal.SIGKILL)
    failing(
        lambda: rig.until("action", timeout_s=20),
        r"^while waiting for a message with kind=action: process_1 has died \(killed by signal 9\)",
    )


@pytest.mark.thorough
def test_what_a_command_said_is_told(cubepath_run: RunFixture) -> None:
    """A process of others that ends by itself ends the run, and its last words are shown."""
    text = (
        "import sys, time, zenoh, runpy; sys.argv = ['x', *sys.argv[2:]];"
        f"print('here', file=sys.stderr); runpy.run_path({OWN[2]!r}, run_name='__main__')"
    )
    command = [sys.executable, "-c", text, "-", "{endpoint}", "1"]
    rig = cubepath_run(VEHICLES, commands={"mine": command}, timeout_s=20)
    rig.kill("mine", at=2)
    found = failing(rig.until_goal, "^the run ended before: the goal")
    assert "died in round 2" in found or "died in round 1" in found
    assert "mine: process id " in found
    assert "stderr: here" in found


def test_a_plan_says_itself_what_it_asks_for(cubepath_run: RunFixture, tmp_path: Path) -> None:
    """Its seed, processes and log are not those of the test; what is named beside it counts."""
    plan = Plan(SYSTEM, seed=7, processes=0, log=tmp_path / "own.mcap", max_rounds=2)
    rig = cubepath_run(plan, max_rounds=1)
    assert rig.play().rounds == 1
    assert (rig.run.plan.seed, rig.run.plan.processes) == (7, 0)
    assert rig.path == tmp_path / "own.mcap"


def test_what_cannot_be_done_is_one_line(cubepath_run: RunFixture) -> None:
    """With what there is."""
    rig = cubepath_run(SYSTEM)
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: rig.kill("process_9"), "process_9: expected one of process_0, process_1, "),
        (lambda: rig.cut_off("router"), "router: has no link, the processes that have one: "),
        (lambda: rig.drop("bundle", to="process_7"), "process_7: has no link, "),
        (lambda: rig.drop("calim"), "kind=calim: expected one of .*did you mean 'claim'"),
        (lambda: rig.kill("proces_0", at=2), "proces_0: expected one of .*did you mean 'process_"),
        (lambda: rig.pause("process_9", at=2), "process_9: expected one of process_0, "),
        (lambda: rig.resume("proces_0"), "proces_0: expected one of "),
        (lambda: rig.cut_off("process_9", at="claim"), "process_9: expected one of process_0, "),
        (lambda: rig.restart("proces_0"), "proces_0: expected one of "),
        (lambda: rig.kill(anything(2.5)), "module=2.5: expected 0 to 4"),
        (lambda: rig.restart("process_1"), "process_1: started again only in runs without rounds"),
        (lambda: rig.kill(0, at=anything(2.5)), "2.5: expected a kind of message, or a Pattern"),
        (lambda: rig.when(2, anything(5)), "5: expected a function"),
        (lambda: rig.pause(0, seconds=anything("x")), "seconds='x': expected a number"),
        (lambda: rig.delay(anything("claim")), "seconds='claim': expected a number"),
        (lambda: rig.drop("claim", sender="proces_0"), "proces_0: has no link, .*did you mean "),
        (lambda: rig.drop("claim", sender="x", to=1), "sender=x: expected one of coordinator, "),
        (lambda: rig.drop("claim", to="proces_0"), "to=proces_0: expected a process, a region "),
        (lambda: rig.drop("claim", phase="sens"), "phase=sens: expected .*did you mean 'sense'"),
        (lambda: rig.drop("claim", round="3"), "round='3': expected 0 or more"),
        (lambda: rig.drop("claim", module=99), "module=99: expected 0 to 4"),
        (lambda: rig.drop("claim", times="x"), "times='x': expected 1 or more"),
        (lambda: rig.drop("claim", where=5), "where=5: expected a function of a message"),
        (lambda: rig.drop(process=1), "process: expected one of kind, round, "),
        (lambda: rig.drop("bundle", seconds=3), "seconds: expected one of kind, round, .*, seed"),
        (lambda: rig.hold("bundle", by=2), "by: expected one of kind, round, .*, seed, seconds"),
        (lambda: rig.hold("bundle", seconds=0), "seconds=0: expected more than 0, or rule.release"),
        (lambda: rig.kill(9), "module=9: expected 0 to 4"),
        (lambda: rig.until_round(anything("x")), "until_round='x': expected 0 or more"),
        (lambda: rig.until_moves(anything(None)), "until_moves=None: expected 0 or more"),
        (lambda: rig.step(timeout_s=anything("x")), "timeout_s='x': expected a number"),
        (lambda: cubepath_run(SYSTEM, timeout_s="x"), "timeout_s='x': expected a number"),
        (lambda: cubepath_run(SYSTEM, commands="x"), "commands=x: expected a list, or names"),
    ]
    for act, line in wrong:
        with pytest.raises(InputError, match=f"^{line}"):
            act()
    assert set(rig.pids) == {"process_0", "process_1", "router"}
    assert not any(link.up.rules or link.down.rules for link in rig.links.values())
    rig.finish()
    with pytest.raises(InputError, match=r"^process_0: has no process any more, the run has ended"):
        rig.pause("process_0")
    with pytest.raises(InputError, match=r"^process_0: there is none, the run has not begun or"):
        RunUnderTest(SYSTEM).kill("process_0")


@pytest.mark.thorough
def test_without_links_the_wire_is_as_it_is(cubepath_run: RunFixture, digest: str) -> None:
    """Rules need one; named processes have one alone."""
    rig = cubepath_run(SYSTEM, links=False)
    with pytest.raises(InputError, match=r"^drop: no process has a link, expected links=True$"):
        rig.drop("bundle")
    assert not rig.links
    rig = cubepath_run(SYSTEM, links=["process_1"])
    assert list(rig.links) == ["process_1"]
    with pytest.raises(InputError, match=r"^process_0: has no link, .* have one: process_1 "):
        rig.drop("bundle", sender="process_0")
    rule = rig.drop("bundle", to="process_1", sender="process_0", times=1)
    assert rule.pattern.sender == "process_0"
    rule.stop()
    with pytest.raises(InputError, match=r"^links: proces_1: expected one of process_0, "):
        cubepath_run(SYSTEM, links=["proces_1"])
    with pytest.raises(InputError, match=r"^links='process_1': expected True, False, or a list"):
        cubepath_run(SYSTEM, links="process_1")
    assert reached(rig) == digest


def test_links_and_commands_take_files_too() -> None:
    """Where a run alone may begin, it may not with them; one line says so, and nothing is begun."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken = len(list(Path("/dev/fd").iterdir()))
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (taken + 37, hard))
        RunUnderTest(SYSTEM, links=False)
        for more in ({"links": True}, {"links": ["process_0"]}, {"commands": ["true"]}):
            with pytest.raises(CubepathError, match=r"^too few open files are allowed: \d+, exp"):
                RunUnderTest(SYSTEM, **{"links": False, **more})  # type: ignore[arg-type]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_rule_that_raises_fails_the_test(tmp_path: Path) -> None:
    """When the run is closed, if nothing else has failed."""
    with (
        pytest.raises(CheckError, match=r"^a rule of the link of process_0 raised ZeroDivision"),
        RunUnderTest(SYSTEM, processes=1, log=tmp_path / "a.mcap") as rig,
    ):
        rig.drop(Pattern(where=lambda _: 1 // 0 > 0))
        rig.step(1)
