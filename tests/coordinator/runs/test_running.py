"""A run under way: stepped, watched, tapped, asked, and ended whatever happens."""

import gc
import signal
import weakref
from dataclasses import fields
from pathlib import Path
from typing import Literal

import pytest
import zenoh

from cubepath.coordinator.runs.asking import ask
from cubepath.coordinator.runs.listeners import Tap, TappedMessage
from cubepath.coordinator.runs.plan import Plan, PlanOptions
from cubepath.coordinator.runs.run import Run, run, start
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, subscribe
from processes.living import is_there

VEHICLES = "agv-labelled:graph=grid4x4,n=6"


@pytest.mark.slow
def test_a_stepped_run_is_the_run_that_was_not_stepped(tmp_path: Path) -> None:
    """Looking at a run, tapping it and going round by round changes no message and no move."""
    plan = Plan(VEHICLES, "random", seed=4, hesitate=0.2, max_rounds=12)
    whole = run(plan, processes=0, log=tmp_path / "a.mcap")
    with start(plan, processes=2, log=tmp_path / "b.mcap") as stepped:
        claims, reports = stepped.tap("claim"), stepped.tap("report")
        assert (stepped.round, stepped.goes_on, stepped.status.moves) == (0, True, 0)
        assert stepped.step()
        assert (stepped.round, len(reports)) == (1, 6)
        assert {each.round for each in claims} == {1}
        assert not claims
        stepped.until(lambda each: each.round == 5)
        assert stepped.sites == tuple(stepped.gathered.sites)
        outcome = stepped.play()
    assert (outcome.path_digest, outcome.rounds) == (whole.path_digest, 12)
    assert outcome.schedule == whole.schedule
    assert verify(read_recording(tmp_path / "b.mcap")).ok


def test_an_outcome_has_path_cubes_bound_and_log(tmp_path: Path) -> None:
    """The path leads from the start to the goal, and its cubes are those that are counted."""
    outcome = run("hex:n=4", processes=0, log=str(tmp_path / "a.mcap"))
    assert outcome.goal_reached
    assert len(outcome.path) == outcome.moves == sum(len(step.actions) for step in outcome.steps)
    assert (len(outcome.steps), len(outcome.schedule)) == (outcome.rounds, outcome.cubes)
    assert 0 < outcome.bound.cubes <= outcome.cubes
    assert outcome.recording().parameters["rule"] == "chain"
    assert outcome.log == str(tmp_path / "a.mcap")


def test_a_run_takes_a_scene_or_a_plan_with_other_fields(tmp_path: Path) -> None:
    """A scene runs as its spec does; what is named beside a plan counts instead of its field."""
    scene = scene_from_spec("hex:n=3")
    plan = Plan("hex:n=3", processes=4, seed=2)
    by_scene = run(scene, processes=0, seed=2, log=tmp_path / "a.mcap")
    by_plan = run(plan, processes=0, log=tmp_path / "b.mcap")
    assert by_scene.path_digest == by_plan.path_digest
    assert by_plan.processes == 0


def test_an_unknown_option_is_named() -> None:
    """With what was meant."""
    with pytest.raises(
        TypeError, match=r"unexpected argument 'proceses' \(did you mean 'processes'"
    ):
        run("hex:n=3", proceses=2)  # type: ignore[call-arg] # pyright: ignore[reportCallIssue]


def test_options_are_the_fields_of_a_plan() -> None:
    """All of them but the system and the rule, which have places of their own."""
    assert {"system", "rule", *PlanOptions.__annotations__} == {each.name for each in fields(Plan)}


@pytest.mark.slow
def test_a_block_that_is_left_ends_the_run(tmp_path: Path) -> None:
    """By an exception, in the middle: no process stays, and the recording is whole so far."""
    log, pids = tmp_path / "a.mcap", [0]
    with (
        pytest.raises(ZeroDivisionError),
        start("hex:n=5", "random", processes=2, max_rounds=10**6, log=log) as running,
    ):
        running.step(3)
        pids = list(running.pids.values())
        assert len(pids) == 3
        assert all(map(is_there, pids))
        print(1 // 0)
    assert not any(map(is_there, pids))
    assert (running.outcome.ended, running.outcome.rounds) == ("interrupted", 3)
    recording = read_recording(log)
    assert recording.problems == ()
    assert verify(recording).ok


@pytest.mark.slow
def test_a_process_that_is_killed_ends_the_run(tmp_path: Path) -> None:
    """The outcome names it, and what was awaited is said not to have come."""
    with start("hex:n=4", "random", processes=2, log=tmp_path / "a.mcap") as running:
        running.step(2)
        assert running.modules_of(running.process_of(3)) == (2, 3)
        running.signal(running.process_of(3))
        with pytest.raises(CheckError, match=r"ended before that: .*process 1.* signal 9.*round"):
            running.until(lambda each: each.round == 500)
        assert not running.step()
    assert running.outcome.ended == "failed"


@pytest.mark.thorough
def test_a_run_without_rounds_is_listened_to(tmp_path: Path) -> None:
    """Steps are moves, a keeper is killed and started again, and the goal is reached."""
    plan = Plan("hex:n=5", clock="free", keepers=2, processes=2, on_crash="continue")
    with start(plan, log=tmp_path / "a.mcap") as running:
        moves = running.tap("commit")
        running.step(3)
        assert running.gathered.moves >= 3
        assert len(moves) >= 3
        for name, told in (
            ("keeper_1", "^keeper_1: lives, expected a process that has died$"),
            ("proces_0", r"^proces_0: .*did you mean 'process_0'.* keeper_1$"),
            ("router", "^router: cannot be started again, expected one of process_0, process_1, "),
        ):
            with pytest.raises(InputError, match=told):
                running.restart(name)
        assert ask(running.endpoint).moves == running.status.moves >= 3  # and others can still join
        running.signal("keeper_1", signal.SIGKILL)
        running.until(lambda each: "keeper_1" not in each.pids)
        running.restart("keeper_1")
        pids = list(running.pids.values())
        outcome = running.play()
    assert outcome.goal_reached
    assert [(crash.name, crash.restarted) for crash in outcome.crashes] == [("keeper_1", False)]
    assert not any(map(is_there, pids))
    assert verify(read_recording(tmp_path / "a.mcap")).ok


def test_whoever_may_join_may_listen(tmp_path: Path) -> None:
    """A guest hears at the endpoint what is said, on the keys of the run."""
    heard: list[str] = []
    with (
        start("hex:n=3", processes=0, log=tmp_path / "a.mcap") as running,
        open_client(running.endpoint) as guest,
    ):
        subscribe(
            guest, f"cubepath/{running.run}/**", lambda each: heard.append(str(each.key_expr))
        )
        running.until(lambda _: any("/to/" in key for key in heard))


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_whoever_may_join_may_ask(clock: Literal["lockstep", "free"], tmp_path: Path) -> None:
    """A guest is told where the run stands, by its name or not, and gets no answer afterwards."""
    keepers = 1 if clock == "free" else 4
    plan = Plan("agv-labelled:graph=grid3x3,n=2", clock=clock, processes=1, keepers=keepers)
    with start(plan, log=tmp_path / "a.mcap") as running:
        begun = ask(running.endpoint)
        assert (begun.round, begun.sites, begun.goal_reached) == (0, running.scene.start, False)
        running.until(lambda each: each.goal_reached)
        endpoint, name = running.endpoint, running.run
        if running.goes_on:
            with pytest.raises(CheckError, match=r"0123 did not answer at unixsock"):
                ask(endpoint, "0123", timeout_s=0.2)
    with pytest.raises(CubepathError, match="no zenoh router at"):
        ask(endpoint, name, timeout_s=0.2)


def test_two_runs_at_one_router_are_told_apart(tmp_path: Path) -> None:
    """Who asks names one; each answers for itself after each round."""
    with Router("tcp/127.0.0.1:0") as router:
        plan = Plan("hex:n=3", processes=0, connect=router.endpoint)
        with (
            start(plan, log=tmp_path / "a.mcap") as one,
            start(plan, log=tmp_path / "b.mcap") as other,
        ):
            one.step(2)
            assert (ask(router.endpoint, one.run).round, other.status.round) == (2, 0)
            assert ask(router.endpoint, other.run) == other.status
            with pytest.raises(CheckError, match=f"2 runs answer at .*{one.run}"):
                ask(router.endpoint)


def test_what_is_no_answer_of_a_run_is_not_taken_for_one(tmp_path: Path) -> None:
    """At a router that is open to all, whoever answers for a run that is not theirs."""
    with Router("tcp/127.0.0.1:0") as router, open_client(router.endpoint) as other:

        def answer(query: zenoh.Query) -> None:
            for key, data in (
                ("x", b"\xff"),
                ("y", b'{"run":"y"}'),
                ("z", whole.replace(b"?", b"y")),
            ):
                query.reply(f"cubepath/{key}/state", data)

        whole = b'{"run":"?","round":0,"sites":[[0]],"moves":0,"cubes":0,"goal_reached":false}'
        other.declare_queryable("cubepath/*/state", answer)
        with pytest.raises(CheckError, match=r"^a run did not answer at"):
            ask(router.endpoint, timeout_s=1)
        plan = Plan("hex:n=3", processes=0, connect=router.endpoint)
        with start(plan, log=tmp_path / "a.mcap") as running:
            assert ask(router.endpoint, timeout_s=1) == running.status


def test_a_kind_that_no_message_has_is_refused(tmp_path: Path) -> None:
    """At once, with what was meant; those of parts are known."""
    running = start("hex:n=3", processes=0, log=tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"^unknown kind 'clam' \(did you mean 'claim'\?\), exp"):
        running.tap("report", "clam")
    with pytest.raises(InputError, match=r"^unknown kind 'summry'"):
        running.messages("summry")
    with pytest.raises(InputError, match=r"^kind 5: expected the name of a kind"):
        running.tap(5)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]
    running.tap("claim", "attempt", "turn", "place", "commit", "summary", "certificate")


@pytest.mark.slow
def test_a_tap_that_nobody_holds_is_gone(tmp_path: Path) -> None:
    """It holds no messages for nobody; the others go on."""
    with start("hex:n=3", processes=0, log=tmp_path / "a.mcap") as running:
        kept, gone = running.tap("claim"), weakref.ref(running.tap("claim"))
        gc.collect()
        assert gone() is None
        running.step()
        assert len(kept) > 0
        del kept
        running.step()


def test_messages_go_on_to_the_end(tmp_path: Path) -> None:
    """As an iterator: it plays the run, and the last of all is the summary."""
    with start("hex:n=3", processes=0, log=tmp_path / "a.mcap") as running:
        kinds = [each.kind for each in running.messages("report", "cube", "summary")]
    assert kinds.count("report") == 3 * running.outcome.rounds
    assert kinds[-1] == "summary"
    assert kinds.count("cube") == running.outcome.cubes


def test_a_tap_is_bounded() -> None:
    """What nobody takes is dropped, the oldest first, and counted."""
    tap = Tap(("go",), most=2)
    for number, kind in enumerate(("go", "go", "claim", "go", "go")):
        tap.hear(TappedMessage(kind, number, None, 0))
    assert [each.round for each in tap] == [3, 4]
    assert (len(tap), tap.dropped) == (0, 2)


def test_what_is_asked_of_a_run_too_early_or_late_is_told(tmp_path: Path) -> None:
    """Before it begins, when it has no such process, and while it goes on."""
    running = start("hex:n=3", processes=0, log=tmp_path / "a.mcap")
    assert isinstance(running, Run)
    with pytest.raises(CheckError, match="has not begun"):
        running.step()
    with running:
        with pytest.raises(CheckError, match="the run goes on"):
            print(running.outcome)
        with pytest.raises(InputError, match="process_7: expected one of router"):
            running.signal("process_7")
        with pytest.raises(InputError, match="module_3: expected module_0 to module_2"):
            running.process_of(3)
        with pytest.raises(InputError, match="only in runs without rounds"):
            running.restart("process_0")
    with pytest.raises(CheckError, match="no processes"):
        print(running.pids)
