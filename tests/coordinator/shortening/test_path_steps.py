"""What a path's file tells to be drawn: a scene, its steps, and the normal cube path of them."""

import json
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import pytest

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.states import snapshots
from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.shortening.path_steps import PathSteps, read_steps
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.scenes.specs import scene_from_spec

GRID = "agv:graph=grid3x2,n=2"
CROSSING = [
    {"generator": "edge", "at": [[0, 0], [1, 0]]},
    {"generator": "edge", "at": [[0, 1], [0, 0]]},
    {"generator": "edge", "at": [[1, 0], [2, 0]]},
]
NOBODY = {"generator": "edge", "at": [[1, 1], [2, 1]]}
CUBES = [{"moves": CROSSING[:1]}, {"moves": [CROSSING[2], CROSSING[1]]}]


def save(path: Path, lines: Sequence[object]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def steps_in(path: Path, system: str | None = None) -> PathSteps:
    with opened(path) as file:
        return read_steps(file, system)


def contents(before: list[object], after: list[object], *, read: Sequence[object] = ()) -> object:
    support = [*before, *after, *read]
    return {
        "id": json.dumps([before, after]),
        "support": support,
        "trace": [*before, *after],
        "before": [*before, *read],
        "after": [*after, *read],
    }


def test_moves_are_steps_of_one_action(tmp_path: Path) -> None:
    """Each move of a moves file is a step; the cubes are those of shortening."""
    found = steps_in(save(tmp_path / "moves.jsonl", CROSSING), GRID)
    assert (found.step_name, list(map(len, found.steps))) == ("move", [1, 1, 1])
    assert [set(cube) for cube in found.cubes] == [
        set(cube) for cube in normal_cube_path(chain.from_iterable(found.steps))
    ]
    *_, last = snapshots(found.scene, found.steps)
    assert last.sites == ((2, 0), (0, 0))


def test_cubes_are_steps_as_they_are_given(tmp_path: Path) -> None:
    """As lines or as arrays, each cube is a step, however it could be shortened."""
    lazy = [{"moves": [move]} for move in CROSSING]
    given = steps_in(save(tmp_path / "cubes.jsonl", lazy), GRID)
    assert (given.step_name, len(given.steps), len(given.cubes)) == ("cube", 3, 2)
    arrays = steps_in(save(tmp_path / "normal.jsonl", CUBES), GRID)
    assert [set(cube) for cube in arrays.steps] == [set(cube) for cube in given.cubes]


def test_cubes_as_arrays(tmp_path: Path) -> None:
    """What `shorten -o cubes.npz` writes is read with the system beside it."""
    from cubepath.coordinator.commands.main import main

    moves, cubes = save(tmp_path / "moves.jsonl", CROSSING), tmp_path / "cubes.npz"
    assert main(["shorten", str(moves), "--system", GRID, "-o", str(cubes)]) == 0
    found = steps_in(cubes, GRID)
    assert found.step_name == "cube"
    assert [set(cube) for cube in found.steps] == [
        set(cube) for cube in steps_in(moves, GRID).cubes
    ]
    convert(moves, tmp_path / "moves.npz", system=GRID)
    assert steps_in(tmp_path / "moves.npz", GRID).step_name == "move"


def test_moves_of_lattice_cells_stand_for_themselves(tmp_path: Path) -> None:
    """Where they say before and after the start is known, and cells lie where their numbers say."""
    lines = [
        contents([[0, 0]], [[1, 0]], read=[[0, 1]]),
        contents([[1, 0]], [[2, 0]]),
        contents([[0, 1]], [[0, 2]]),
        contents([[2, 0]], [[1, 0]]),
    ]
    found = steps_in(save(tmp_path / "moves.jsonl", lines))
    assert set(found.scene.start) == {(0, 0), (0, 1)}
    assert found.scene.system.positions[2, 0] == (2.0, 0.0)
    ends = [set(snap.sites) for snap in snapshots(found.scene, found.steps)]
    assert ends == [
        {(0, 0), (0, 1)},
        {(1, 0), (0, 1)},
        {(2, 0), (0, 1)},
        {(2, 0), (0, 2)},
        {(1, 0), (0, 2)},
    ]


@pytest.mark.parametrize(
    ("lines", "system", "message"),
    [
        (CUBES, None, ": a cubes file, which does not say where modules start: expected --system"),
        ([{"moves": ["a"]}], GRID, ': cube 1: move "a" is named by an id, expected generator and'),
        ([*CUBES, {"moves": [NOBODY]}], GRID, ": cube 3: edge at .* is not admissible"),
        ([{"moves": [CROSSING[0], CROSSING[0]]}], GRID, ": cube 1: its moves do not commute"),
        ([{"moves": [{"generator": "x", "at": 1}]}], GRID, ": cube 1: unknown generator 'x'"),
        ([*CUBES, {"moves": 1}], GRID, ":3: Expected `array`, got `int`"),
        (CUBES, "hex-connected", "hex-connected: not a local system"),
        ([], None, ": no moves and no --system: nothing says what there is to draw"),
        (
            [{"id": 1, "support": [[0, 0]], "trace": [[0, 0]]}],
            None,
            ": moves without before and after do not say where modules are",
        ),
        (
            [contents([[0, 0, 0]], [[1, 0, 0]])],
            None,
            r": move 1: site \[0,0,0\] is no cell \[x, y\] of a lattice",
        ),
        (
            [contents([[0, 0]], [[1, 0]]), contents(["a"], ["b"])],
            None,
            ': move 2: site "?a"? is no cell',
        ),
        (
            [contents([[0, 0]], [])],
            None,
            ": move 1: . modules before and . after, expected as many",
        ),
        ([{"kind": "else"}], None, ":1: Object contains unknown field `kind`"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    tmp_path: Path, lines: list[object], system: str | None, message: str
) -> None:
    """In one line, with the file and the place in it."""
    path = save(tmp_path / "path.jsonl", lines)
    with pytest.raises(InputError, match=message) as refused:
        steps_in(path, system)
    assert "\n" not in str(refused.value)


def test_an_empty_path_in_a_system_is_its_start(tmp_path: Path) -> None:
    """There are no steps, and modules stand where the scene says."""
    found = steps_in(save(tmp_path / "none.jsonl", []), GRID)
    assert (found.steps, found.scene.start) == ([], scene_from_spec(GRID).start)
