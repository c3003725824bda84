"""Published benchmarks of vehicles as scenes: what a file says is what is built, or a line is."""

from pathlib import Path

import pytest

from cubepath.agents import play
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec, spec_within
from cubepath.protocol.systems.benchmarks import task_from_scen

DATA = Path(__file__).parents[2] / "data" / "imports"
MAPS, SCENARIOS, ROOM = DATA / "rooms.yaml", DATA / "rooms-mapf.yaml", DATA / "room.map"


def built(keys: str) -> tuple[list[object], list[object]]:
    """Return the starts and the goals of labelled vehicles as (x, y)."""
    scene = scene_from_spec(f"agv-labelled:{keys}")
    assert scene.goals is not None
    return [site[0] for site in scene.start], [goals[0] for goals in scene.goals]  # type: ignore[index]


@pytest.mark.parametrize("entry", ["Scenario-004", "4", "004"])
def test_a_scenario_of_pogema_is_played_on_its_map(entry: str) -> None:
    """By its name or number; rows and columns become x and y; n takes the first vehicles."""
    keys = f"graph={MAPS},scene={SCENARIOS},entry={entry}"
    starts = [(0, 0), (0, 1), (4, 3)]
    assert built(keys) == (starts, [(4, 0), (4, 1), (0, 3)])
    assert built(f"{keys},n=2") == (starts[:2], [(4, 0), (4, 1)])
    assert play(f"agv-labelled:{keys},n=1", max_rounds=20).reached


def test_maps_of_pogema_are_graphs() -> None:
    """With what is drawn at random, or without; all but # is free."""
    scene = scene_from_spec(f"agv:graph={MAPS},entry=room-001,n=9,seed=3")
    assert len(scene.start) == len({*scene.start}) == 9
    with pytest.raises(InputError, match="n=11: the graph has 10 vertices"):
        scene_from_spec(f"agv:graph={MAPS},entry=1,n=11")


def test_a_movingai_scenario_is_played_on_its_map() -> None:
    """Its first n lines, on the map that it names."""
    keys = f"graph={ROOM},scene={DATA / 'room.scen'},n=2"
    assert built(keys) == ([(1, 0), (2, 0)], [(1, 2), (2, 3)])
    assert play(f"agv-labelled:{keys}", max_rounds=30).reached


def test_files_of_benchmarks_stay_in_their_folder() -> None:
    """As all files that a sweep's file names."""
    spec = "agv:graph=rooms.yaml,scene=rooms-mapf.yaml,entry=4"
    assert spec_within(DATA, spec) == f"agv:graph={MAPS},scene={SCENARIOS},entry=4"
    with pytest.raises(InputError, match="leads out of"):
        spec_within(DATA, "agv:graph=rooms.yaml,scene=../../conftest.py")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("graph={MAPS}", "rooms.yaml: entry=: 0 of its 2 maps, expected one as room-000"),
        ("graph={MAPS},entry=7", "entry=7: 0 of its 2 maps, expected one as room-000"),
        ("graph={SCENARIOS},entry=4", "entry=4: 0 of its 0 maps, expected one as in the YAML"),
        (
            "graph={MAPS},scene={MAPS},entry=4",
            "entry=4: 0 of its 0 scenarios, expected one as in the",
        ),
        ("scene={SCENARIOS},entry=4", "on room-000, expected graph=FILE.yaml with that map"),
        ("scene={SCEN},n=2", "room.scen: on room.map, expected graph=FILE of that name"),
        ("graph={MAPS},scene={SCENARIOS},entry=4,n=4", "n=4: the scene has 3 vehicles"),
    ],
)
def test_what_does_not_fit_together_is_one_line(keys: str, said: str) -> None:
    """What was found in which file, and what was expected."""
    given = keys.format(MAPS=MAPS, SCENARIOS=SCENARIOS, SCEN=DATA / "room.scen")
    with pytest.raises(InputError) as error:
        scene_from_spec(f"agv-labelled:{given}")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        (MAPS, "..#..\n  .....", "..#.\n  .....", "map room-000: found the row '..#.', expected 5"),
        (MAPS, "..#..", "..T..", "found the row '..T..', expected 5 cells of .@$!#"),
        (SCENARIOS, "[0, 0], ", "[0, 2], ", "start 0 at [2, 0] is no free cell"),
        (SCENARIOS, "[0, 0], ", "[1, 0], ", "start 1 at [0, 1] is taken twice"),
        (SCENARIOS, "[0, 0], ", "", "scenario Scenario-004: 2 starts and 3 goals"),
        (SCENARIOS, "[0, 0], ", "[0, 0, 0], ", "agents_xy: expected [[row, column], ...]"),
        (SCENARIOS, "[0, 0], ", "&a ", "agents_xy: expected [[row, column], ...]"),
        (SCENARIOS, "targets_xy", "targets", "targets_xy: expected [[row, column], ...]"),
        (SCENARIOS, "map_name: room-000", "map: room-000", "no map_name, expected the name of"),
        (SCENARIOS, "map_name: room-000", "map_name: room-2", "entry=room-2: 0 of its 2 maps"),
        (SCENARIOS, "Scenario-012", "Task-4", "entry=4: 2 of its 2 scenarios, expected one as"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, file: Path, old: str, new: str, said: str) -> None:
    """It names the file, the entry and what is wrong."""
    for each in (MAPS, SCENARIOS):
        text = each.read_text()
        (tmp_path / each.name).write_text(text.replace(old, new, 1) if each == file else text)
    keys = f"graph={tmp_path / MAPS.name},scene={tmp_path / SCENARIOS.name},entry=4"
    with pytest.raises(InputError) as error:
        scene_from_spec(f"agv-labelled:{keys}")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_an_empty_scenario_is_refused(tmp_path: Path) -> None:
    """In one line that names the file."""
    (tmp_path / "empty.scen").write_text("", "utf-8")
    with pytest.raises(InputError, match=r"empty\.scen: no vehicle, expected a first line"):
        task_from_scen(tmp_path / "empty.scen")
