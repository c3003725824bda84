"""Runs without rounds from start to end: what is on record holds, whatever happened."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from cubepath.agents.free.fleet import FreeFleet
from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.runs import free_driver
from cubepath.coordinator.runs.collector import Collector
from cubepath.coordinator.runs.free_driver import FreeDriver
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.resuming import keeper_logs
from cubepath.coordinator.runs.run import run, start
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.wire.free_messages import Commit, decode_free
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import Effect

CHAIN = "hex:n=6"
SLOW = dict.fromkeys(range(6), 4.0)
"""Modules that leave time to do something to them."""


def sound(log: Path) -> None:
    """Assert that everything on record holds, the choices of rules too."""
    found = audit(read_recording(log))
    assert found.ok, [check for check in found.checks if not check.ok]


def wounded(
    start: RunFixture, plan: Plan, name: str, *, after: int = 4, failing: bool = False
) -> Outcome:
    """Run a plan, and kill a process after some moves."""
    rig = start(plan, links=False, timeout_s=100)
    rig.until_moves(after)
    rig.kill(name)
    return rig.play(failing=failing)


@pytest.mark.slow
def test_a_commit_that_contradicts_others_is_on_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run fails, and `verify` finds what it failed for."""
    honest = Collector.receive
    moves = count(1)

    def altered(collector: Collector, key: str, data: bytes) -> list[Effect]:
        message = decode_free(data)
        if isinstance(message, Commit) and message.generator and next(moves) == 3:
            data = encode(structs.replace(message, level=message.level + 1))
        return honest(collector, key, data)

    monkeypatch.setattr(Collector, "receive", altered)
    log = tmp_path / "run.mcap"
    outcome = run(Plan(system=CHAIN, clock="free", processes=2, keepers=2, log=log))
    assert outcome.ended == "failed"
    assert "expected" in str(outcome.error)
    failing = [check.name for check in audit(read_recording(log)).checks if not check.ok]
    assert "levels" in failing


@pytest.mark.parametrize(
    ("system", "ended"), [("triangulation:n=5", "goal"), (CHAIN, "max-rounds")]
)
def test_a_run_that_is_over_before_it_begins_holds(tmp_path: Path, system: str, ended: str) -> None:
    """Nobody has to rest who was never there."""
    log = tmp_path / "run.mcap"
    plan = Plan(system=system, rule="random", clock="free", processes=2, max_rounds=0, log=log)
    assert run(plan).ended == ended
    sound(log)


@pytest.mark.slow
def test_a_run_that_is_stopped_at_its_goal_has_reached_it(tmp_path: Path) -> None:
    """When all have come to rest there, it says goal, and `verify` would find anything else."""
    log = tmp_path / "run.mcap"
    with start(CHAIN, clock="free", processes=2, keepers=2, log=log) as running:
        running.until(lambda run: run.gathered.reached)
        assert running.stop().ended == "goal"
    sound(log)


@pytest.mark.slow
def test_a_run_is_on_record_and_holds(tmp_path: Path) -> None:
    """Its levels are the height of its heap, and its keepers' logs are gone at the end."""
    log = tmp_path / "run.mcap"
    outcome = run(Plan(system=CHAIN, clock="free", processes=2, keepers=2, log=log))
    assert outcome.ended == "goal"
    assert outcome.goal_reached
    assert (outcome.moves, outcome.cubes) == (40, 24)
    assert outcome.rounds == outcome.cubes
    sound(log)
    assert not keeper_logs(log).exists()
    document = outcome.document()
    assert document["keepers"] == 2
    assert (document["levels"], "rounds" in document) == (outcome.rounds, False)
    assert not document["crashes"]


@pytest.mark.slow
def test_who_answers_while_the_machine_stands_still_has_answered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Patience ends at the moment at which the last keeper's answer is taken: the run begins."""
    late = [0.0]

    class Clock:
        time_ns = time.time_ns
        sleep = time.sleep

        @staticmethod
        def monotonic() -> float:
            return time.monotonic() + late[0]

    look_after, wait = FreeDriver._look_after, FreeDriver._wait_for_keepers

    def looks_after(self: FreeDriver, fleet: FreeFleet) -> None:
        look_after(self, fleet)
        late[0] = 1000.0 * (len(self._collector.tails) == self.plan.keepers)

    def waits(self: FreeDriver, *arguments: Any) -> None:
        with monkeypatch.context() as patched:
            patched.setattr(FreeDriver, "_look_after", looks_after)
            wait(self, *arguments)
        late[0] = 0.0

    monkeypatch.setattr(free_driver, "time", Clock)
    monkeypatch.setattr(FreeDriver, "_wait_for_keepers", waits)
    assert run(Plan(system=CHAIN, clock="free", processes=2, keepers=2)).goal_reached


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["process_0", "keeper_0", "keeper_1", "router"])
def test_a_run_with_a_crash_holds(name: str, cubepath_run: RunFixture, tmp_path: Path) -> None:
    """Started again, its processes reach the goal by the same moves, and it says who died."""
    log = tmp_path / "run.mcap"
    plan = Plan(
        system="hex:n=9",
        clock="free",
        processes=2,
        keepers=2,
        on_crash="restart",
        speeds=SLOW,
        log=log,
    )
    outcome = wounded(cubepath_run, plan, name)
    assert outcome.goal_reached
    assert outcome.moves == 88
    sound(log)
    (crash,) = outcome.document()["crashes"]
    assert (crash["name"], crash["restarted"]) == (name, True)
    assert 0 <= crash["idle_seconds"] < 30


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1])
def test_a_run_in_which_everything_dies_again_and_again_holds(
    seed: int, cubepath_run: RunFixture, tmp_path: Path
) -> None:
    """The router, a keeper and a process, one after the other, each some moves after the last."""
    log = tmp_path / "run.mcap"
    plan = Plan(
        system="agv:graph=grid6x6,n=6",
        rule="random",
        clock="free",
        processes=2,
        keepers=2,
        seed=seed,
        speeds=dict.fromkeys(range(6), 0.5),
        on_crash="restart",
        max_rounds=300,
        log=log,
    )
    rig = cubepath_run(plan, links=False, timeout_s=100)
    due = 30
    gone: set[int | None] = {None}
    for name in ("router", "keeper_0", "process_1", "router", "process_0", "keeper_1"):
        rig.until_moves(due)
        while rig.pids.get(name) in gone:  # what was heard before its death is not over yet
            rig.step()
        gone.add(rig.pids[name])
        rig.kill(name)
        due = rig.moves + 60
    assert rig.play().ended == "max-rounds"
    assert len(rig.outcome.crashes) == 6
    sound(log)


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_twenty_restarts_in_a_minute_lose_nothing(cubepath_run: RunFixture, tmp_path: Path) -> None:
    """One each three seconds, of everything in turn, whether the last has come back or not."""
    log = tmp_path / "run.mcap"
    plan = Plan(
        system="agv:graph=grid6x6,n=6",
        rule="random",
        clock="free",
        processes=2,
        keepers=2,
        speeds=dict.fromkeys(range(6), 10.0),
        on_crash="restart",
        max_rounds=1000,
        patience=60.0,
        log=log,
    )
    rig = cubepath_run(plan, links=False, timeout_s=600)
    begun = time.monotonic()
    for number in range(20):
        name = ("router", "keeper_0", "process_0", "keeper_1", "process_1")[number % 5]
        rig.run.until(lambda _, due=begun + 3 * number: time.monotonic() > due)  # type: ignore[misc]
        rig.run.until(lambda run, name=name: name in run.pids)  # type: ignore[misc]
        rig.kill(name)
    assert rig.play().ended == "max-rounds"
    assert len(rig.outcome.crashes) == 20
    sound(log)


def islands() -> Scene:
    """Return two rows that nothing joins, with a vehicle at the left end of each."""
    rows = [[f"{row}{column}" for column in range(6)] for row in "ab"]
    edges = [(one, two) for row in rows for one, two in pairwise(row)]
    system = GraphSystem([vertex for row in rows for vertex in row], edges)
    goals = (("a5",), ("b5",))
    return Scene(
        spec="islands",
        family="",
        system=system,
        start=("a0", "b0"),
        goal=frozenset({"a5", "b5"}),
        goals=goals,
    )


@pytest.mark.thorough
def test_the_living_reach_their_goals_where_the_dead_are_in_nobodys_way(
    cubepath_run: RunFixture, tmp_path: Path
) -> None:
    """One of two vehicles on two islands dies; the other goes to its goal, and the run says so."""
    system, log = tmp_path / "islands.toml", tmp_path / "run.mcap"
    system.write_text(scene_to_toml(islands()))
    plan = Plan(
        system=str(system),
        rule="tswap",
        clock="free",
        processes=2,
        keepers=2,
        on_crash="continue",
        speeds={0: 10.0, 1: 10.0},
        patience=3.0,
        log=log,
    )
    outcome = wounded(cubepath_run, plan, "process_0", after=1, failing=True)
    assert outcome.error == "nothing was committed for 3 s; process_0 had died"
    sound(log)
    ends = [step for record in read_recording(log).of_kind("edges") for step in [record.data]]
    assert b'"b4","b5"' in b"".join(ends) or b'["b4","b5"]' in b"".join(ends)
    (crash,) = outcome.document()["crashes"]
    assert not crash["restarted"]
    assert crash["idle_seconds"] is not None


def test_what_a_plan_cannot_be_is_one_line(tmp_path: Path) -> None:
    """What is for the other clock, and numbers out of range."""
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"speeds": {0: 1.0}}, "speed: only for runs without rounds"),
        ({"on_crash": "restart"}, "on-crash: only for runs without rounds"),
        ({"clock": "free", "keepers": 0}, "keepers=0: expected 1 to 256"),
        ({"clock": "free", "processes": 0}, "processes=0: expected 1 or more"),
        ({"clock": "free", "speeds": {0: 0.0}}, "speed=0=0: expected more than 0"),
        ({"clock": "free", "speeds": {99: 1.0}}, "speed=99=1: no such module"),
        ({"clock": "free", "jitter": -1.0}, "jitter=-1: expected 0 to"),
        ({"clock": "free", "repair": True}, "repair: not for runs without rounds"),
        ({"resume": tmp_path / "none.mcap"}, "system: the run that is resumed has its own"),
    ]
    for options, why in wrong:
        with pytest.raises(InputError, match=why):
            run(Plan(system=CHAIN, log=tmp_path / "run.mcap", **options))
    assert not list(tmp_path.iterdir())


def until(what: Callable[[], bool], patience_s: float = 60.0) -> None:
    """Wait until something holds."""
    end = time.monotonic() + patience_s
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


def started(*arguments: str) -> subprocess.Popen[bytes]:
    """Start the command line."""
    return subprocess.Popen(
        [sys.executable, "-m", "cubepath.coordinator", "run", *arguments, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


RESTLESS = ("hex:n=6", "--rule", "random", "--clock", "free", "--keepers", "2", "--processes", "2")


@pytest.mark.thorough
def test_a_coordinator_that_is_killed_is_taken_up_where_its_keepers_logs_end(
    tmp_path: Path,
) -> None:
    """Both recordings hold, and the second has the moves of the first."""
    log, more = tmp_path / "run.mcap", tmp_path / "more.mcap"
    child = started(*RESTLESS, "--max-rounds", "100000", "--log", str(log))
    journal = keeper_logs(log) / "keeper_0.log"
    until(lambda: journal.is_file() and journal.stat().st_size > 20_000)
    until(lambda: any(True for _ in read_recording(log).of_kind("commit")))
    child.kill()
    child.communicate()
    assert keeper_logs(log).is_dir()
    whole = journal.read_bytes()
    journal.write_bytes(b"".join(whole.splitlines(keepends=True)[:4]))
    with pytest.raises(InputError, match=r"keeper_0\.log: the last .* it is an older log$"):
        run(Plan(resume=log, log=more))
    assert not more.exists()
    journal.write_bytes(whole)
    outcome = run(Plan(resume=log, log=more, max_rounds=1))
    assert outcome.ended == "max-rounds"
    assert outcome.moves >= sum(1 for _ in read_recording(log).of_kind("commit")) > 0
    assert not keeper_logs(log).exists()
    assert not keeper_logs(more).exists()
    sound(more)
    with pytest.raises(InputError, match=r"run\.mcap\.keepers: not there"):
        run(Plan(resume=log, log=tmp_path / "third.mcap"))


@pytest.mark.thorough
def test_a_coordinator_that_is_killed_is_taken_up_where_logs_were_compacted(tmp_path: Path) -> None:
    """The recording has what keepers have forgotten; without that it is refused."""
    log, more, less = tmp_path / "run.mcap", tmp_path / "more.mcap", tmp_path / "less.mcap"
    crowd = ("agv:graph=grid6x6,n=12", "--rule", "random", "--clock", "free", "--keepers", "1")
    child = started(*crowd, "--processes", "2", "--max-rounds", "100000", "--log", str(log))
    journal = keeper_logs(log) / "keeper_0.log"

    def compacted() -> bool:
        return journal.is_file() and b'"compacted"' in journal.read_bytes()[:1000]

    until(lambda: less.exists() or (journal.is_file() and bool(shutil.copy(log, less))))
    until(compacted, 240)
    child.kill()
    child.communicate()
    assert journal.stat().st_size < 1 << 20
    keeper_logs(log).rename(keeper_logs(less))
    with pytest.raises(InputError, match=r"keeper_0\.log: begins after commit \d+, and \d+ were"):
        run(Plan(resume=less, log=more))
    assert not more.exists()
    keeper_logs(less).rename(keeper_logs(log))
    outcome = run(Plan(resume=log, log=more, max_rounds=1))
    assert outcome.ended == "max-rounds"
    assert outcome.moves >= 1000
    sound(more)


@pytest.mark.slow
def test_a_run_that_goes_on_cannot_be_taken_up(tmp_path: Path) -> None:
    """Nothing is written then, and its keepers' logs stay where they are."""
    log, more = tmp_path / "run.mcap", tmp_path / "more.mcap"
    plan = Plan(system=CHAIN, clock="free", keepers=1, processes=1, speeds=SLOW, log=log)
    with start(plan):
        again = started("--from", str(log), "--log", str(more))
        _, said = again.communicate(timeout=60)
        assert again.returncode == 2
        what = "a run is writing there, expected it to end first"
        assert said.decode() == f"cubepath: {keeper_logs(log)}: {what}\n"
        assert not more.exists()
        assert keeper_logs(log).is_dir()


@pytest.mark.thorough
def test_of_two_that_take_up_a_run_one_does(tmp_path: Path) -> None:
    """The other ends with one line and exit code 2."""
    log = tmp_path / "run.mcap"
    plan = Plan(system="hex:n=2", rule="random", clock="free", log=log, keepers=1, patience=1.0)
    assert run(replace(plan, speeds={0: 10_000, 1: 10_000})).ended == "failed"
    more = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    both = [started("--from", str(log), "--log", str(each), "--patience", "1") for each in more]
    said = [each.communicate(timeout=60)[1].decode() for each in both]
    codes = [each.returncode for each in both]
    assert sorted(codes) == [1, 2], said
    loser = codes.index(2)
    assert said[loser].startswith(f"cubepath: {log}"), said
    assert said[loser].count("\n") == 1
    assert [each.exists() for each in more] == [each != loser for each in (0, 1)]


@pytest.mark.thorough
def test_a_keeper_that_stands_still_is_named(cubepath_run: RunFixture, tmp_path: Path) -> None:
    """It has not died, so nobody else says what the run waits for."""
    log = tmp_path / "run.mcap"
    plan = Plan(system=CHAIN, clock="free", keepers=1, patience=5.0, speeds=SLOW, log=log)
    rig = cubepath_run(plan, links=False, timeout_s=100)
    rig.until_moves(4)
    rig.pause("keeper_0")
    outcome = rig.play(failing=True)
    assert outcome.error == "nothing was committed for 5 s; keeper_0 did not answer"


@pytest.mark.thorough
def test_a_run_that_failed_can_be_taken_up(tmp_path: Path) -> None:
    """Nobody moved within the patience; until it is taken up its keepers' logs are kept."""
    log, more = tmp_path / "run.mcap", tmp_path / "more.mcap"
    plan = Plan(system="hex:n=2", rule="random", clock="free", log=log, keepers=1, patience=1.0)
    failed = run(replace(plan, speeds={0: 10_000, 1: 10_000}))
    assert failed.ended == "failed"
    assert keeper_logs(log).is_dir()
    assert run(Plan(resume=log, log=more, max_rounds=0)).ended == "max-rounds"
    assert not keeper_logs(log).exists()
    sound(more)
    with pytest.raises(InputError, match=r"run\.mcap: the run has come to its end"):
        run(Plan(resume=log, log=tmp_path / "third.mcap"))


@pytest.mark.thorough
def test_an_interrupt_closes_the_recording(tmp_path: Path) -> None:
    """With exit code 130, one document, and nothing left of its processes."""
    log = tmp_path / "run.mcap"
    child = started(*RESTLESS, "--max-rounds", "100000", "--log", str(log))
    until(lambda: log.is_file() and log.stat().st_size > 10_000)
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=60)
    assert child.returncode == 130
    assert json.loads(out)["moves"] > 0
    found = read_recording(log)
    assert not found.problems
    assert audit(found).ok


@pytest.mark.thorough
def test_a_run_that_was_interrupted_with_gaps_can_be_taken_up(tmp_path: Path) -> None:
    """A keeper that stood still knows of moves that are not on record, and says so in its log."""
    log, more, said = tmp_path / "run.mcap", tmp_path / "more.mcap", list[str]()
    plan = Plan(system=CHAIN, clock="free", keepers=2, processes=1, speeds=SLOW, log=log)
    with start(plan, say=said.append) as running:
        running.until(lambda run: run.status.moves > 4)
        running.signal("keeper_1", signal.SIGSTOP)
        assert running.stop().ended == "interrupted"
    assert said[-1].startswith("not all moves are on record: ")
    assert run(Plan(resume=log, log=more)).ended == "goal"
    sound(more)


@pytest.mark.thorough
def test_a_schedule_is_carried_out_without_rounds(tmp_path: Path) -> None:
    """The levels are its cubes."""
    log, again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    first = run(Plan(system=CHAIN, processes=0, hesitate=0.4, log=log))
    outcome = run(Plan(schedule=log, clock="free", processes=2, keepers=2, log=again))
    assert outcome.ended == "goal"
    assert outcome.rounds == outcome.schedule_cubes == first.cubes
    sound(again)


def test_no_level_is_begun_where_none_is_allowed(tmp_path: Path) -> None:
    """As with rounds."""
    outcome = run(Plan(system=CHAIN, clock="free", max_rounds=0, log=tmp_path / "run.mcap"))
    assert (outcome.ended, outcome.moves) == ("max-rounds", 0)


@pytest.mark.thorough
def test_modules_are_held_back_where_the_record_does_not_keep_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing is lost then, and the run says how long that took."""
    monkeypatch.setattr(free_driver, "BEHIND_MAX", 3)
    monkeypatch.setattr(free_driver, "BEHIND_MIN", 1)
    log = tmp_path / "run.mcap"
    outcome = run(Plan(system=CHAIN, clock="free", processes=2, keepers=2, log=log))
    assert outcome.goal_reached
    assert outcome.document()["held_back_seconds"] > 0
    sound(log)
    assert not audit(read_recording(log)).missing.messages
