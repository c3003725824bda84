"""Schedules carried out: they end where the original run ended, or stop where they must."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.agents.environments.rollouts import play
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.rules.schedule import scheduled
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.contents import info, render
from cubepath.coordinator.runs.edge_path import PathDigest
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.runs.schedule import Assignment
from cubepath.coordinator.runs.schedule_reading import assignment_of, read_schedule
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.durations import schedule_from_jsonl
from cubepath.protocol.path_files.moves import write_cubes
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.messages import Executed, Stopped
from marked import some
from samples.local_families import LOCAL_FAMILIES
from samples.recordings import recorded
from samples.schedules import (
    CHAIN,
    LABELLED,
    VEHICLES,
    a_place_on_the_way,
    carry_out,
    original,
    reports_of,
    summary_of,
    with_obstacles,
    without_module,
    without_place,
    written,
)


def moves_by_round(recording: Recording) -> dict[int, set[tuple[str, Site]]]:
    """Return what was done in each round."""
    return {
        step.round: {(move.generator, site_from_json(move.at)) for move in step.executed}
        for step in gathered(recording).steps
    }


def cubes_of(recording: Recording) -> list[set[tuple[str, Site]]]:
    """Return the cubes of the schedule that was carried out."""
    assert recording.schedule is not None
    cubes = schedule_from_jsonl(recording.schedule)
    return [{(move.generator, site_from_json(move.at)) for move in cube} for cube in cubes]


def assert_whole(recording: Recording) -> None:
    """Assert that a recording passes every check, and that replaying gives the same."""
    found = verify(recording)
    assert found.ok, [check for check in found.checks if not check.ok]


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("family", some(LOCAL_FAMILIES, ("hex", "agv-labelled", "assembly")))
def test_a_schedule_ends_where_the_run_ended(family: str) -> None:
    """For every family: one cube a round, and each module ends where it ended."""
    runs = (recorded(family, "random", seed=s, hesitate=0.3, rounds=21) for s in range(5, 10))
    first = next(each for each in runs if gathered(each).heap.cubes > 1)
    outcome, second = carry_out(first.path)
    end = gathered(first)
    assert outcome.goal_reached
    assert outcome.ended == "goal"
    assert outcome.rounds == outcome.cubes == outcome.schedule_cubes == end.heap.cubes
    assert outcome.moves == outcome.reduced_moves == end.heap.reduced_moves
    assert outcome.schedule_stopped is None
    assert gathered(second).sites == end.sites
    assert gathered(second).schedule() == end.schedule()
    assert_whole(second)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("case", [CHAIN, VEHICLES, LABELLED, ("arm:n=6", "word", 30)])
def test_a_goal_that_was_reached_is_reached_by_its_schedule(case: tuple[str, str, int]) -> None:
    """The rules' own runs, in the number of their cubes, without a claim that is lost."""
    first = original(*case)
    outcome, second = carry_out(first.path)
    assert summary_of(first).goal_reached
    assert outcome.goal_reached
    assert outcome.rounds == summary_of(first).cubes <= summary_of(first).rounds
    assert second.scene.goal == first.scene.goal
    assert second.scene.goals == first.scene.goals
    assert {report.claim for report in reports_of(second)} <= {"none", "granted"}


@pytest.mark.thorough
def test_any_number_of_processes_gives_the_path_of_the_environment() -> None:
    """0, 2 and n processes, and the rule in the PettingZoo environment."""
    first = original(*VEHICLES)
    assignment = assignment_of(read_schedule(first.path), first.scene)
    played = play(first.scene, scheduled(assignment.own), max_rounds=len(assignment.cubes))
    digest = PathDigest()
    for done in played.rounds:
        digest.add(done.number, [Executed(m, e.generator, e.at) for m, e in done.moves.items()])
    assert played.reached
    for processes in (0, 2, len(first.scene.start)):
        outcome, _ = carry_out(first.path, processes=processes)
        assert outcome.path_digest == digest.text()
        assert outcome.processes == processes


def test_the_command_carries_out_a_cubes_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What `shorten` writes, `run --schedule` reads; two keys more in the answer."""
    monkeypatch.chdir(tmp_path)
    first = original(*VEHICLES)
    assert main(["shorten", str(first.path), "-o", "cubes.jsonl"]) == 0
    capsys.readouterr()
    arguments = ["--schedule", "cubes.jsonl", "--processes", "0", "--json"]
    assert main(["run", *arguments]) == 2
    assert "names no system: expected one" in capsys.readouterr().err
    assert main(["run", VEHICLES[0], *arguments]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["goal_reached"]
    assert answer["rule"] == "schedule"
    assert answer["rounds"] == answer["schedule_cubes"] == answer["cubes"]
    assert answer["schedule_stopped"] is None
    assert Path(answer["log"]).name.startswith("agv-schedule-0-")
    assert main(["run", "--schedule", answer["log"], "--processes", "0"]) == 0
    assert f"schedule       {answer['cubes']} cubes\n" in capsys.readouterr().out
    read = read_recording(Path(answer["log"]))
    assert read.parameters["schedule"] == "cubes.jsonl"


def test_a_move_may_be_named_from_either_end(tmp_path: Path) -> None:
    """An edge has no direction, so neither has its name."""
    path = tmp_path / "cubes.jsonl"
    write_cubes(path, [[GeneratorPlacement("edge", (1, 0))], [GeneratorPlacement("edge", (1, 2))]])
    outcome, recording = carry_out(path, "agv:graph=P3,n=1")
    assert outcome.rounds == 2
    assert outcome.goal_reached
    assert_whole(recording)


def test_a_way_that_returns_is_gone_to_its_end(tmp_path: Path) -> None:
    """Round a cycle: the end is the start, and still every cube is carried out."""
    path = tmp_path / "cubes.jsonl"
    write_cubes(path, [[GeneratorPlacement("edge", (a, (a + 1) % 4))] for a in range(4)])
    outcome, recording = carry_out(path, "agv:graph=C4,n=1")
    assert (outcome.rounds, outcome.cubes, outcome.goal_reached) == (4, 4, True)
    assert_whole(recording)


def test_a_cube_of_no_moves_is_a_round_of_rest(tmp_path: Path) -> None:
    """Nobody moves in it; and an empty file is a schedule of no rounds."""
    path = tmp_path / "cubes.jsonl"
    write_cubes(path, [[], [GeneratorPlacement("edge", (0, 1))]])
    outcome, recording = carry_out(path, "agv:graph=P3,n=1")
    assert (outcome.rounds, outcome.cubes, outcome.schedule_cubes) == (2, 1, 2)
    assert_whole(recording)
    path.write_text("")
    outcome, recording = carry_out(path, "agv:graph=P3,n=1")
    assert (outcome.rounds, outcome.ended, outcome.schedule_cubes) == (0, "goal", 0)
    assert_whole(recording)


def test_fewer_rounds_than_cubes() -> None:
    """`--max-rounds` ends it before its end, which is no failure."""
    first = original(*VEHICLES)
    outcome, recording = carry_out(first.path, max_rounds=2)
    assert (outcome.rounds, outcome.ended, outcome.goal_reached) == (2, "max-rounds", False)
    assert outcome.schedule_stopped is None
    assert_whole(recording)
    outcome, recording = carry_out(first.path, max_rounds=1000)
    assert outcome.rounds == outcome.schedule_cubes
    assert_whole(recording)


# What has changed since.


def stopped_by(
    recording: Recording, change: Callable[[Scene], Scene]
) -> tuple[Stopped, Recording, list[set[tuple[str, Site]]]]:
    """Carry a schedule out in a changed scene; check all that holds wherever it stops."""
    outcome, second = carry_out(recording.path, written(change(recording.scene)))
    stopped = outcome.schedule_stopped
    assert stopped is not None
    assert outcome.ended == "failed"
    assert outcome.error is not None
    assert outcome.error.startswith(f"the schedule stopped at round {stopped.round}: ")
    assert outcome.error.endswith(stopped.reason)
    assert summary_of(second).error == outcome.error
    assert_whole(second)
    cubes = cubes_of(second)
    made = moves_by_round(second)
    for number, moves in made.items():
        assert moves == cubes[number - 1] or number == stopped.round == outcome.rounds
    assert (stopped.move.generator, site_from_json(stopped.move.at)) in cubes[stopped.round - 1]
    return stopped, second, cubes


def obstacle_in_a_support(recording: Recording) -> tuple[int, Site]:
    """Return a cell that nobody ever enters but moves need free, and the first cube with such."""
    gatherer = gathered(recording)
    cubes = gatherer.heap.cube_path()
    entered = {site for cube in cubes for action in cube for site in action.trace}
    for number, cube in enumerate(cubes, 1):
        for action in cube if number > 3 else ():
            for cell in in_order(action.support - entered - frozenset(recording.scene.start)):
                needs = [
                    n for n, each in enumerate(cubes, 1) if any(cell in a.support for a in each)
                ]
                if needs[0] == number:
                    return number, cell
    raise AssertionError("every cell that is needed is entered")


def test_an_obstacle_beside_the_way_is_named_by_the_module_that_senses_it() -> None:
    """The module stays, and names what in the support is not as it must be."""
    first = original(*CHAIN)
    number, cell = obstacle_in_a_support(first)
    stopped, second, cubes = stopped_by(first, lambda scene: with_obstacles(scene, [cell]))
    assert stopped.round == number == summary_of(second).rounds
    text = "[" + ",".join(map(str, cell)) + "]"  # type: ignore[call-overload]
    assert stopped.reason.endswith(
        f"is not admissible: site {text} is on (an obstacle), expected off"
    )
    (report,) = (r for r in reports_of(second) if r.failed is not None)
    assert (report.module, report.round) == (stopped.module, number)
    assert report.claim == "none"
    due = cubes[number - 1] - {(stopped.move.generator, site_from_json(stopped.move.at))}
    assert moves_by_round(second)[number] == due


def test_an_obstacle_on_the_way_stops_who_would_enter_it() -> None:
    """The others make their moves of the same cube, which commute with it, and nothing later."""
    first = original(*VEHICLES)
    place = a_place_on_the_way(first, 2)
    stopped, second, cubes = stopped_by(first, lambda scene: without_place(scene, place))
    number = stopped.round
    assert number == min(
        n
        for n, cube in enumerate(cubes, 1)
        if any(place in at for _, at in cube)  # type: ignore[operator]
    )
    assert stopped.module is not None
    assert stopped.reason.endswith("is no edge of the graph")
    assert moves_by_round(second)[number] == {
        (generator, at)
        for generator, at in cubes[number - 1]
        if place not in at  # type: ignore[operator]
    }


def test_the_same_from_a_cubes_file(tmp_path: Path) -> None:
    """A cubes file does not know the scene that it is from, and stops at the same cube."""
    first = original(*CHAIN)
    path = tmp_path / "cubes.jsonl"
    write_cubes(path, gathered(first).schedule())
    way = gathered(first).heap.cube_path()[2:]
    entered = {site for cube in way for action in cube for site in action.trace}
    cell = in_order(entered - {*first.scene.start, *(first.scene.goal or ())})[0]
    scene = written(with_obstacles(first.scene, [cell]))
    one, _ = carry_out(first.path, scene)
    other, recording = carry_out(path, scene)
    assert one.schedule_stopped == other.schedule_stopped
    assert one.path_digest == other.path_digest
    assert one.schedule_stopped is not None
    assert one.schedule_stopped.module is not None
    assert_whole(recording)


def test_a_missing_mover_stops_before_its_cube() -> None:
    """Nobody can make the move: its cube is not begun, and the reason says where nobody stands."""
    first = original(*VEHICLES)
    for module in range(len(first.scene.start)):
        stopped, second, _ = stopped_by(first, lambda scene, m=module: without_module(scene, m))  # type: ignore[misc]
        assert stopped.module is None
        assert "no module stands at" in stopped.reason
        assert summary_of(second).rounds == stopped.round - 1


def test_a_missing_neighbour_is_missed_by_who_would_pivot_about_it() -> None:
    """A module that only has to be there: who needs it says that its site is off."""
    first = original(*CHAIN)
    movers = {report.module for report in reports_of(first) if report.move is not None}
    pivot = min(set(range(5)) - movers)
    stopped, _, _ = stopped_by(first, lambda scene: without_module(scene, pivot))
    assert stopped.module is not None
    assert stopped.reason.endswith("is off, expected on")


def test_another_start(tmp_path: Path) -> None:
    """A module that stands elsewhere, in the way of another, or where nobody waits for it."""
    first = original("agv:graph=P4,n=1", "tswap", 9)
    scene = first.scene
    for start, reason in (
        ((3,), "no module stands at 0 or 1"),
        ((0, 1), "somebody stands at 0 and 1"),
    ):
        changed = replace(scene, start=start, goal=None, goals=())
        stopped, _, _ = stopped_by(first, lambda _, changed=changed: changed)  # type: ignore[misc]
        assert stopped.round == 1
        assert reason in stopped.reason


def test_the_command_says_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, one line, and the same in the document, the table and `cubepath log info`."""
    monkeypatch.chdir(tmp_path)
    first = original(*VEHICLES)
    scene = written(without_place(first.scene, a_place_on_the_way(first, 2)))
    arguments = ["run", scene, "--schedule", str(first.path), "--processes=0"]
    assert main([*arguments, "--json"]) == 1
    captured = capsys.readouterr()
    stopped = json.loads(captured.out)["schedule_stopped"]
    assert set(stopped) == {"round", "module", "move", "reason"}
    assert set(stopped["move"]) == {"generator", "at"}
    where, line = captured.err.splitlines()
    assert where.startswith("cubepath: endpoint ")
    assert line == (
        f"cubepath: the schedule stopped at round {stopped['round']}:"
        f" module_{stopped['module']}: {stopped['reason']}"
    )
    assert main([*arguments, "--log", "log.mcap"]) == 1
    assert f"cubes, stopped at round {stopped['round']}: " in capsys.readouterr().out
    document = info(read_recording(Path("log.mcap")))
    assert json.loads(json.dumps(document["schedule_stopped"])) == stopped
    assert f"cubes, stopped at round {stopped['round']}\n" in render(document)


# Repaired by the rule.


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("case", [VEHICLES, LABELLED])
def test_the_rule_goes_on_from_there(case: tuple[str, str, int]) -> None:
    """With a place closed: the same goal, the same path in any number of processes."""
    first = original(*case)
    scene = without_place(first.scene, a_place_on_the_way(first, 2))
    digests = set()
    for processes in (0, 2):
        outcome, second = carry_out(first.path, written(scene), repair=True, processes=processes)
        digests.add(outcome.path_digest)
        assert outcome.goal_reached
        assert (outcome.ended, outcome.error, outcome.rule) == ("goal", None, "schedule")
        assert outcome.schedule_stopped is not None
        assert outcome.rounds > outcome.schedule_stopped.round
        assert second.parameters["repair"] == case[1]
        assert second.scene.goal == first.scene.goal
        assert_whole(second)
    assert len(digests) == 1


@pytest.mark.slow
@pytest.mark.parametrize("case", [VEHICLES, LABELLED])
def test_without_a_module_the_others_get_to_their_ends(case: tuple[str, str, int]) -> None:
    """The goal is then where those that are there ended."""
    first = original(*case)
    outcome, second = carry_out(first.path, written(without_module(first.scene, 1)), repair=True)
    assert outcome.goal_reached
    ends = gathered(first).sites
    assert second.scene.goal == frozenset(ends[:1] + ends[2:])
    assert_whole(second)


@pytest.mark.slow
def test_a_mended_schedule_of_random_moves_has_its_own_goals() -> None:
    """Where the original run did not end at the goal of its scene, its end is the goal."""
    spec = "arm:n=6"
    first = recorded(spec, "random", seed=7, rounds=40)
    cubes = list(gathered(first).schedule())
    del cubes[1]
    path = first.path.with_suffix(".jsonl")
    write_cubes(path, cubes)
    stop = carry_out(path, spec)[0].schedule_stopped
    assert stop is not None
    outcome, second = carry_out(path, spec, repair=True)
    assert outcome.goal_reached
    assert_whole(second)


@pytest.mark.slow
def test_a_scene_that_tells_nobody_its_goal_can_be_repaired() -> None:
    """Each module knows its own end from the schedule."""
    first = original(*VEHICLES)
    scene = replace(without_place(first.scene, a_place_on_the_way(first, 2)), goals=())
    outcome, second = carry_out(first.path, written(scene), repair=True)
    assert outcome.goal_reached
    assert second.scene.goals == tuple((end,) for end in gathered(first).sites)
    assert_whole(second)


@pytest.mark.slow
def test_another_rule_can_be_asked_for() -> None:
    """`--rule` is what repairs; at random, it only goes on as long as it may."""
    first = original(*VEHICLES)
    scene = written(without_place(first.scene, a_place_on_the_way(first, 2)))
    outcome, second = carry_out(first.path, scene, repair=True, rule="random", max_rounds=15)
    assert outcome.ended in ("max-rounds", "goal")
    assert outcome.rounds <= 15
    assert second.parameters["repair"] == "random"
    assert_whole(second)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_the_chain_rule_cannot_go_on_from_the_middle(processes: int) -> None:
    """It begins with straight chains only, and says so, after where the schedule stopped."""
    first = original(*CHAIN)
    _, cell = obstacle_in_a_support(first)
    scene = written(with_obstacles(first.scene, [cell]))
    outcome, second = carry_out(first.path, scene, repair=True, processes=processes)
    assert outcome.ended == "failed"
    assert outcome.schedule_stopped is not None
    assert outcome.error is not None
    assert outcome.error.startswith("the schedule stopped at round ")
    assert "; then rule 'chain'" in outcome.error
    assert_whole(second)


def test_a_schedule_that_stops_nowhere_needs_no_repair() -> None:
    """`--repair` changes nothing then."""
    first = original(*VEHICLES)
    one, _ = carry_out(first.path)
    other, recording = carry_out(first.path, repair=True)
    assert one.path_digest == other.path_digest
    assert other.ended == "goal"
    assert not [each for each in recording.of_kind("go") if b'"over"' in each.data]


# What is on record.


@pytest.mark.thorough
def test_recordings_of_schedules_can_be_replayed_drawn_and_recovered(tmp_path: Path) -> None:
    """One that stopped, and one that was repaired."""
    first = original(*VEHICLES)
    scene = written(without_place(first.scene, a_place_on_the_way(first, 2)))
    for repair in (False, True):
        outcome, second = carry_out(first.path, scene, repair=repair)
        again = replay(second)
        assert again.same, again.differences
        assert main(["view", outcome.log, "-o", str(tmp_path / f"{repair}.png")]) == 0
        out = tmp_path / f"{repair}.mcap"
        out_of_it = recover(second.path, out)
        assert out_of_it.problems == ()
        assert read_recording(out).schedule == second.schedule
        assert_whole(read_recording(out))


@pytest.mark.thorough
def test_what_was_repaired_is_a_schedule_again() -> None:
    """The recording of a repaired run can be carried out in its scene, and stops nowhere."""
    first = original(*VEHICLES)
    scene = written(without_place(first.scene, a_place_on_the_way(first, 2)))
    repaired, _ = carry_out(first.path, scene, repair=True)
    outcome, second = carry_out(Path(repaired.log))
    assert outcome.goal_reached
    assert outcome.schedule_stopped is None
    assert outcome.rounds == repaired.cubes
    assert_whole(second)


# Who knows what.


def test_a_process_is_handed_the_moves_of_its_modules_alone() -> None:
    """And each module is the mover of all that is on its list."""
    first = original(*VEHICLES)
    assignment = assignment_of(read_schedule(first.path), first.scene)
    fleet = LockstepFleet(first.scene, "tswap", processes=2, schedule=assignment.own)
    for modules in fleet.modules_of:
        handed = fleet._own(modules)
        assert handed is not None
        assert handed.keys() == set(modules)
        assert all(handed[module] == assignment.own.get(module, {}) for module in modules)


def test_who_is_taken_along_is_followed() -> None:
    """In an arm a flip takes a second module along, which has nothing on its list for that."""
    first = original("arm:n=6", "word", 30)
    assignment: Assignment = assignment_of(read_schedule(first.path), first.scene)
    assert assignment.stop is None
    assert frozenset(assignment.ends) == first.scene.goal
    assert list(assignment.ends) == gathered(first).sites
    moves = sum(len(own) for own in assignment.own.values())
    assert moves == sum(len(cube) for cube in assignment.cubes)


# What cannot be run.


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('{"moves":["a"]}', 'cube 1: move "a" is named by an id, expected generator and place'),
        ('{"moves":[7]}', "cube 1: move 7 is named by an id"),
        ('{"moves":[{"generator":"jump","at":[0,1]}]}', "cube 1: unknown generator 'jump'"),
        ('{"moves":[{"generator":"edge","at":[0]}]}', "cube 1: generator edge: 'at' has 2 entries"),
        ('{"moves":[{"generator":"edge","at":[1,1]}]}', "edge [1, 1] is a loop"),
        ('{"moves":[{"generator":"edge","at":[0,null]}]}', ":1: a site is a JSON number"),
        ('{"moves":[{"generator":"edge","at":null}]}', ":1: a site is a JSON number"),
        (
            '{"moves":[{"generator":"edge","at":[0,1]},{"generator":"edge","at":[1,2]}]}',
            "cube 1: its moves do not commute",
        ),
        ('{"cubes":[]}', "cubes.jsonl:1: "),
        ("{", "cubes.jsonl:1: "),
    ],
)
def test_what_is_no_schedule_of_the_system_is_one_line_and_exit_code_2(
    line: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Refused before anything is begun, with the file and the cube; nothing is written."""
    monkeypatch.chdir(tmp_path)
    Path("cubes.jsonl").write_text(line + "\n")
    assert main(["run", "agv:graph=P3,n=1", "--schedule", "cubes.jsonl"]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("cubepath: cubes.jsonl")
    assert captured.err.count("cubes.jsonl") == 1
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["cubes.jsonl"]


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({"hesitate": 0.5}, "hesitate=0.5: a schedule has a round for every cube"),
        ({"rule": "tswap"}, "rule=tswap: a schedule needs none, only repair continues with one"),
        ({"rule": "chain", "repair": True}, "not for this system: rule 'chain'"),
        ({"schedule": None, "repair": True}, "repair: there is no schedule that could need it"),
        ({"schedule": Path("/no/such")}, "/no/such: No such file or directory"),
        ({"system": "hex"}, "cube 1: unknown generator 'edge'"),
        ({"system": "hex-connected"}, "not a local system"),
        ({"max_rounds": -1}, "max-rounds=-1: expected 0 or more"),
    ],
)
def test_bad_usage_is_refused(plan: dict[str, object], message: str, tmp_path: Path) -> None:
    """In one line, before anything is begun."""
    log = tmp_path / "a.mcap"
    first = original(*VEHICLES)
    with pytest.raises(InputError) as refused:
        run(Plan(**{"schedule": first.path, "log": log} | plan))  # type: ignore[arg-type]
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not log.exists()


def test_a_listed_move_that_is_gone_stops_before_its_cube(tmp_path: Path) -> None:
    """Of a system that is a list of moves nothing more is known than the list."""
    path = tmp_path / "cubes.jsonl"
    first = recorded("words", "random", seed=6, rounds=9)
    move = next(move for cube in gathered(first).schedule() for move in cube)
    write_cubes(path, [[move], [GeneratorPlacement(move.generator, (99,))]])
    outcome, recording = carry_out(path, "words")
    stopped = outcome.schedule_stopped
    assert stopped is not None
    assert (stopped.round, stopped.module, outcome.rounds) == (2, None, 1)
    assert "there is no move at (99,)" in stopped.reason
    assert_whole(recording)


def test_a_damaged_recording_is_no_schedule(tmp_path: Path) -> None:
    """Part of a run would end elsewhere; how to get at it is said."""
    data = original(*VEHICLES).path.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: 2 * len(data) // 3])
    with pytest.raises(InputError, match=r"truncated.*log recover .* OUT"):
        read_schedule(path)


def test_an_empty_recording_is_no_schedule_of_no_cubes(tmp_path: Path) -> None:
    """An empty cubes file is one."""
    (tmp_path / "run.mcap").touch()
    with pytest.raises(InputError, match=r"run\.mcap: empty file"):
        read_schedule(tmp_path / "run.mcap")
    (tmp_path / "cubes.jsonl").touch()
    assert not read_schedule(tmp_path / "cubes.jsonl").cubes
