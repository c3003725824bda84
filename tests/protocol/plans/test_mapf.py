"""Plans of multi-agent path finding: each form is read as it says, or refused where it is wrong."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.systems.graphs import scenario_from_json
from samples.plans import (
    DATA,
    Steps,
    actions_read,
    agents_text,
    log_text,
    map_text,
    moves_read,
    save,
    timesteps,
    vehicle_moves,
)
from samples.strategies import Word, scene, walks

AGV = Path(__file__).parents[2] / "data" / "agv"
ROOM = DATA / "room.map"
GRID = [(x, y) for x in range(3) for y in range(3)]
VEHICLES = "agv:graph=grid3x3,n=3"
PLAN: Steps = [[(1, 0), (2, 0)], [(2, 0), (2, 1)], [(2, 0), (2, 2)]]
"""Agent 0 follows agent 1, which goes through the gap of the room."""


@pytest.mark.parametrize("name", ["lacam.txt", "eecbs.txt", "lns2.txt", "paths.json"])
@pytest.mark.parametrize("scenario", [(), (DATA / "room.scen",)], ids=["map", "map and scenario"])
def test_samples_hold_one_plan(name: str, scenario: Sequence[Path]) -> None:
    """Every form of the sample, detected by content, gives the same moves and 4 rounds."""
    found = read_plan(DATA / name, companions=[*scenario, ROOM])
    assert found is not None
    assert found.rounds == 4
    moves = list(found.moves)
    expected = moves_read(DATA / "lacam.txt", companions=[ROOM])
    assert [move.name for move in moves] == [move.name for move in expected]
    assert len(moves) == 8
    assert len(normal_cube_path([move.action for move in moves])) == 5
    where = found.scene()
    assert where.start == ((1, 0), (2, 0), (4, 3))
    assert found.labelled_goals


def test_a_log_finds_the_map_that_it_names_in_its_own_folder(tmp_path: Path) -> None:
    """By its name alone: a path to another folder is not followed."""
    (tmp_path / "plans").mkdir()
    for folder, named in ((".", "room.map"), ("plans", "../room.map"), ("plans", str(ROOM))):
        text = log_text(PLAN).replace("map_file=room.map", f"map_file={named}")
        path = save(tmp_path / folder / "log.txt", text)
        if folder == ".":
            save(tmp_path / "room.map", ROOM.read_text())
            assert len(moves_read(path)) == 3
        else:
            with pytest.raises(InputError, match="expected the map"):
                read_plan(path)
    save(tmp_path / "plans" / "room.map", ROOM.read_text())
    assert len(moves_read(tmp_path / "plans" / "log.txt", companions=[])) == 3


@pytest.mark.parametrize("named", ["m" * 5000, "a\0b", "..", "."])
def test_a_map_with_a_name_that_no_file_has_is_one_that_is_missing(
    named: str, tmp_path: Path
) -> None:
    """The line names the plan and what was expected."""
    path = save(tmp_path / "log.txt", log_text(PLAN).replace("room.map", named))
    with pytest.raises(InputError, match=r"log\.txt: a plan on a map: expected the map"):
        read_plan(path)


def test_lists_by_timestep_read_as_by_agent_are_refused_with_the_way_to_say_it(
    tmp_path: Path,
) -> None:
    """Two agents on one cell are most often two timesteps of an agent that waits."""
    path = save(tmp_path / "paths.json", [[(1, 0), (2, 0)], [(1, 0), (2, 0)]])
    with pytest.raises(InputError, match=r"start at .*; a list for each timestep is --format"):
        read_plan(path, companions=[ROOM])


def test_a_follower_waits_for_whom_it_follows() -> None:
    """In the first round agent 1 goes first, though agent 0 comes before it in the file."""
    names = [move.name for move in moves_read(DATA / "lacam.txt", companions=[ROOM])][:2]
    assert [name.at for name in names] == [((2, 0), (2, 1)), ((1, 0), (2, 0))]  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_real_plan_as_a_log(tmp_path: Path) -> None:
    """The 30 agents on random-32-32-10 come back from LaCAM's form with the known figures."""
    known = scenario_from_json(AGV / "random-32-32-10-30agents.json")
    steps = timesteps(known.starts, known.moves)  # type: ignore[arg-type]
    path = save(tmp_path / "log.txt", log_text(steps))
    found = read_plan(path, companions=[AGV / "random-32-32-10.map"])
    assert found is not None
    cubes = normal_cube_path([move.action for move in found.moves])
    assert (found.rounds, sum(map(len, cubes)), len(cubes)) == (known.planner_rounds, 719, 53)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(walks(VEHICLES), st.sampled_from(["log", "xy", "rc", "json", "by=step"]))
def test_a_plan_read_back_is_the_path(
    tmp_path_factory: pytest.TempPathFactory, word: Word, form: str
) -> None:
    """A random legal plan, in any form, gives the normal cube path of the moves themselves."""
    where = scene(VEHICLES)
    steps = timesteps(where.start, vehicle_moves(word, where.start_state))  # type: ignore[arg-type]
    folder = tmp_path_factory.mktemp("plan")
    room = save(folder / "grid.map", map_text(GRID))
    if form == "log":
        path, spec = save(folder / "log.txt", log_text(steps)), None
    elif form in ("xy", "rc"):
        path = save(folder / "paths.txt", agents_text(steps, order=form))
        spec = f"mapf-agents:order={form}"
    else:
        table = steps if form == "by=step" else list(zip(*steps, strict=True))
        path = save(folder / "paths.json", table)
        spec = "mapf-json:by=step" if form == "by=step" else None
    found: list[Action] = actions_read(path, spec, companions=[room])
    assert normal_cube_path(found) == normal_cube_path(word)


def test_the_order_is_what_the_map_allows(tmp_path: Path) -> None:
    """Where one order alone fits the map it is taken; where both do it has to be said."""
    steps: Steps = [[(0, 0), (3, 2)], [(1, 0), (3, 3)]]
    for text in (agents_text(steps, order="rc"), agents_text(steps, order="xy")):
        path = save(tmp_path / "paths.txt", text)
        with pytest.raises(InputError, match=r"as \(x, y\) and as \(row, column\): expected"):
            read_plan(
                path,
                companions=[save(tmp_path / "free.map", map_text([*GRID, (3, 3), (2, 3), (3, 2)]))],
            )
    path = save(tmp_path / "paths.txt", agents_text(PLAN, order="rc"))
    moves = moves_read(path, companions=[ROOM])
    assert [move.name for move in moves_read(path, "mapf-agents:order=rc", companions=[ROOM])] == [
        move.name for move in moves
    ]
    with pytest.raises(InputError, match=r"agent 0 starts at \[0,1\], an obstacle or outside"):
        read_plan(path, "mapf-agents:order=xy", companions=[ROOM])


BAD_STEPS: dict[str, tuple[Steps, str]] = {
    "occupied": (
        [[(1, 0), (2, 0)], [(2, 0), (2, 0)]],
        ":9: timestep 1, agent 0, [1,0] to [2,0]: [2,0] is occupied by agent 1, which stays",
    ),
    "obstacle": (
        [[(1, 0), (2, 0)], [(1, 1), (2, 0)]],
        "agent 0, [1,0] to [1,1]: [1,1] is an obstacle or outside, expected free",
    ),
    "jump": (
        [[(1, 0), (2, 0)], [(1, 0), (2, 1)], [(1, 0), (3, 2)]],
        ":10: timestep 2, agent 1, [2,1] to [3,2]: no edge of the grid",
    ),
    "swap": (
        [[(1, 0), (2, 0)], [(2, 0), (1, 0)]],
        "agent 0, [1,0] to [2,0]: agent 1 comes the other way",
    ),
    "two in one": (
        [[(1, 0), (3, 0)], [(2, 0), (2, 0)]],
        "agent 1, [3,0] to [2,0]: agent 0 enters [2,0] too, expected one",
    ),
    "rotation": (
        [[(0, 2), (1, 2), (1, 3), (0, 3), (4, 0)], [(1, 2), (1, 3), (0, 3), (0, 2), (3, 0)]],
        "timestep 1, agent 0, [0,2] to [1,2]: agents 0, 1, 2 and 3 rotate, each into the cell",
    ),
    "start": ([[(0, 1), (2, 0)]], "agent 0 starts at [0,1], an obstacle or outside"),
    "start twice": ([[(2, 0), (2, 0)]], "agent 0 and agent 1 start at [2,0]"),
}


@pytest.mark.parametrize("name", BAD_STEPS)
def test_an_illegal_plan_is_refused_at_its_first_bad_move(tmp_path: Path, name: str) -> None:
    """Line, timestep, agent, move, and what in its way is not as it must be."""
    steps, told = BAD_STEPS[name]
    path = save(tmp_path / "log.txt", log_text(steps, soc=None))
    with pytest.raises(InputError) as caught:
        moves_read(path, companions=[ROOM])
    assert told in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_moves_before_the_first_bad_one_are_yielded(tmp_path: Path) -> None:
    """A plan is read as a stream: what is legal comes before the refusal."""
    path = save(tmp_path / "log.txt", log_text(BAD_STEPS["jump"][0]))
    found = read_plan(path, companions=[ROOM])
    assert found is not None
    assert next(found.moves).before == frozenset({(2, 0)})
    with pytest.raises(InputError):
        next(found.moves)


BAD_LOGS: dict[str, tuple[str, str]] = {
    "no map": ("", "a plan on a map: expected the map room.map, --with FILE"),
    "count": (log_text(PLAN, agents=3), "agents=3, but 2 in the solution"),
    "starts": (log_text(PLAN, starts="(0,0),(2,0),"), "timestep 0 differs from starts="),
    "goals": (log_text(PLAN, goals="(0,0),"), "1 goals, expected one for each agent"),
    "unsolved": (log_text(PLAN).partition("0:(")[0], "a log without a solution"),
    "gap": (
        log_text(PLAN).replace("\n1:", "\n2:"),
        ":9: found '2:(2,0),(2,1),', expected timestep",
    ),
    "lost agent": (log_text(PLAN).replace("2:(2,0),(2,2),", "2:(2,0),"), ":10: 1 cells, expected"),
    "no cells": (
        log_text(PLAN).replace("1:(2,0)", "1:(2;0)"),
        ":9: found '(2;0),(2,1),', expected",
    ),
    "tasks": (
        log_text(PLAN).replace("0:(1,0),", "0:(1,0)->(2,4):-1,"),
        ":8: found '(1,0)->(2,4):-1,(2,0),', expected cells",
    ),
    "head": ("agents\nsolution=\n", ":1: found 'agents', expected KEY=VALUE"),
}


@pytest.mark.parametrize("name", BAD_LOGS)
def test_a_log_that_contradicts_itself_is_refused(tmp_path: Path, name: str) -> None:
    """The line and what was expected there."""
    content, told = BAD_LOGS[name]
    path = save(tmp_path / "log.txt", content or log_text(PLAN))
    with pytest.raises(InputError) as caught:
        moves_read(path, "mapf-log", companions=[ROOM] if content else [])
    assert told in str(caught.value)


BAD_AGENTS: dict[str, tuple[str, str]] = {
    "number": ("Agent 1: (0,1)->\n", ":1: found 'Agent 1: (0,1)->', expected 'Agent 0:"),
    "cell": ("Agent 0: (0,1)->(0;2)->\n", ":1: agent 0, timestep 1: expected a cell"),
    "no path": ("Agent 0:\n", ":1: agent 0, timestep 0: expected a cell"),
    "none": ("\n", "no agent found"),
    "rest": ("Agent 0: (0,1)->\nend\n", ":2: found 'end', expected 'Agent 1:"),
}


@pytest.mark.parametrize("name", BAD_AGENTS)
def test_paths_that_are_none_are_refused(tmp_path: Path, name: str) -> None:
    """The line, the agent and what was expected there."""
    content, told = BAD_AGENTS[name]
    path = save(tmp_path / "paths.txt", content)
    with pytest.raises(InputError) as caught:
        read_plan(path, "mapf-agents", companions=[ROOM])
    assert told in str(caught.value)


BAD_LISTS: dict[str, tuple[object, str, str]] = {
    "no cells": ([[1, 2]], "mapf-json", "Expected `array`, got `int` - at `$[0][0]`"),
    "no start": ([[]], "mapf-json", "agent 0 has no cell"),
    "lost agent": ([[[0, 0]], []], "mapf-json:by=step", "timestep 1 has 0 cells"),
    "by": ([], "mapf-json:by=time", "by=time: expected agent or step"),
    "order": ([[[0, 0]]], "mapf-json:order=yx", "order=yx: expected xy or rc"),
}


@pytest.mark.parametrize("name", BAD_LISTS)
def test_lists_that_are_no_plan_are_refused(tmp_path: Path, name: str) -> None:
    """The place in the document, or the key that is wrong."""
    content, spec, told = BAD_LISTS[name]
    path = save(tmp_path / "paths.json", content)
    with pytest.raises(InputError) as caught:
        read_plan(path, spec, companions=[ROOM])
    assert told in str(caught.value)


def test_no_agents_make_no_moves(tmp_path: Path) -> None:
    """An empty list is a plan of no moves in no rounds."""
    found = read_plan(save(tmp_path / "none.json", []), companions=[ROOM])
    assert found is not None
    assert (found.rounds, list(found.moves)) == (0, [])


SCENARIOS: dict[str, tuple[str, str]] = {
    "other start": (
        "version 1\n0\troom.map\t5\t4\t0\t0\t1\t2\t2\n0 room.map 5 4 2 0 2 3 3\n",
        "agent 0 starts at [1,0], in the scenario at [0,0]",
    ),
    "too few": ("version 1\n0 room.map 5 4 1 0 1 2 2\n", "2 agents, in the scenario 1"),
    "no line": (
        "version 1\n0 room.map 5 4 1 0\n",
        ":2: found '0 room.map 5 4 1 0', expected bucket",
    ),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_that_is_not_of_the_plan_is_refused(tmp_path: Path, name: str) -> None:
    """The agent or the line that differs."""
    content, told = SCENARIOS[name]
    path = save(tmp_path / "log.txt", log_text(PLAN))
    with pytest.raises(InputError) as caught:
        read_plan(path, companions=[ROOM, save(tmp_path / "room.scen", content)])
    assert told in str(caught.value)


def test_one_map_and_no_system(tmp_path: Path) -> None:
    """Two maps, or a system beside a map, are refused."""
    path = save(tmp_path / "log.txt", log_text(PLAN))
    with pytest.raises(InputError, match="a second map, expected one"):
        read_plan(path, companions=[ROOM, ROOM])
    with pytest.raises(InputError, match="a plan on a map, expected no --system"):
        read_plan(path, companions=[ROOM], system=VEHICLES)
