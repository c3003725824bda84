"""Moves and configurations of Pathfinder: read as an independent reading of the same files does."""

import json
from collections.abc import Iterator
from itertools import permutations, product
from pathlib import Path
from typing import Any

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec

SLIDES: list[list[list[str]]] = [[["?!", "##"]], [["?x", "#!"]]]
PIVOTS: list[list[list[str]]] = [[["xx", "?!", "##"]], [["xx", "?xx", "#!x"]]]
LEAPFROG: list[list[list[str]]] = [[["xx", "?!#", "#"]], [[" xx", "#?!", "  #"]]]
MONKEY: list[list[list[str]]] = [[["xxx", "?x!", "#x#"]]]
ROLL: list[list[list[str]]] = [[[" x"], ["?", " !"], ["", "#"]]]
"""A dodecahedron goes round the one below it; layers from below, two coordinates a step."""
Moves = list[list[list[str]]]
Cells = frozenset[tuple[int, ...]]


def written(folder: Path, moves: Moves, order: int, **modules: list[list[int]]) -> str:
    """Write the files of a scene; `start`, `fixed`, `goal` and `closed` are positions.

    Return the path of the file that names them.
    """
    entries = [
        {"name": f"Move {number}", "order": 3 if len(each) > 1 else 2, "def": each}
        for number, each in enumerate(moves)
    ]
    (folder / "moves.json").write_text(json.dumps({"moves": entries}))
    for name, key in (("initial", "start"), ("final", "goal")):
        listed = [
            {"position": cell, "static": static}
            for static, cells in ((False, modules.get(key, [])), (True, modules.get("fixed", [])))
            for cell in cells
        ]
        table = {"order": order, "modules": listed, "boundaries": modules.get("closed", [])}
        (folder / f"{name}.json").write_text(json.dumps(table))
    table = {"moves": "moves.json", "initial": "initial.json"}
    table |= {"final": "final.json"} if "goal" in modules else {}
    lines = [
        "format = 'cubepath-system-1'",
        "[pathfinder]",
        *(f"{k} = '{table[k]}'" for k in table),
    ]
    (folder / "scene.toml").write_text("\n".join(lines))
    return str(folder / "scene.toml")


def directed(moves: Moves, order: int) -> set[frozenset[tuple[tuple[int, ...], str]]]:
    """Return the moves in all orientations, each as marks by offset from the mover."""
    found = set()
    for move in moves:
        marks: dict[tuple[int, ...], str] = {}
        for z, layer in enumerate(move):
            for y, row in enumerate(layer):
                marks |= {(x, y, z)[:order]: mark for x, mark in enumerate(row) if mark != " "}
        (at,) = (cell for cell, mark in marks.items() if mark == "?")
        for axes in permutations(range(order)):
            for signs in product((1, -1), repeat=order):
                found.add(
                    frozenset(
                        (tuple(signs[i] * (cell[axes[i]] - at[axes[i]]) for i in range(order)), m)
                        for cell, m in marks.items()
                    )
                )
    return found


def successors(state: Cells, fixed: Cells, moves: set[Any]) -> Iterator[Cells]:
    """Yield the states one move away, as Pathfinder checks marks against occupied cells."""
    for cell in state:
        for move in moves:
            at = {tuple(map(sum, zip(cell, offset, strict=True))): m for offset, m in move}
            if all((each in state or each in fixed) == (m in "?#") for each, m in at.items()):
                (there,) = (each for each, m in at.items() if m == "!")
                yield state - {cell} | {there}


def within(scene: Scene, far: int) -> set[frozenset[Any]]:
    """Return the states that the system reaches in so many moves."""
    found = level = {scene.start_state}
    for _ in range(far):
        level = {
            state - {move.source} | {move.target}
            for state in level
            for site in state
            for move in scene.system.moves(site)
            if move is not None and move.possible(state)
        } - found
        found = found | level
    return found


LINE = [[0, 0], [1, 0], [2, 0], [3, 0]]
SCENES = [
    (SLIDES, 2, LINE, [[0, 1]], 8),
    (PIVOTS, 2, LINE, [[0, 1]], 8),
    (PIVOTS + LEAPFROG + MONKEY, 2, LINE, [[0, 1], [3, 1]], 20),
    (SLIDES, 3, [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 0]], 24),
    (ROLL, 3, [[1, 1, 1], [2, 2, 1]], [[1, 2, 2], [2, 1, 2]], 24),
]


@pytest.mark.few(3)
@pytest.mark.parametrize("sample", SCENES, ids=["slides", "pivots", "all", "cubes", "rolls"])
def test_moves_and_states_are_those_of_another_reading(tmp_path: Path, sample: Any) -> None:
    """As many moves, each with the one back, and the same states within four moves."""
    moves, order, start, fixed, count = sample
    scene = scene_from_spec(written(tmp_path, moves, order, start=start, fixed=fixed))
    catalogue = scene.system.catalogue
    assert catalogue is not None
    wanted = directed(moves, order)
    assert len(catalogue.generators) == count == len(wanted) / 2
    first = catalogue.lattice.check(scene.start[0])
    by = tuple(here - there for here, there in zip(start[0], first, strict=True))
    shift = catalogue.lattice.shift
    states = level = {frozenset(map(tuple, start))}
    obstacles = frozenset(map(tuple, fixed))
    for _ in range(4):
        level = {n for each in level for n in successors(each, obstacles, wanted)} - states
        states = states | level
    mine = [state - scene.system.filled for state in within(scene, 4)]
    found = {
        frozenset(shift(catalogue.lattice.check(cell), by) for cell in state) for state in mine
    }
    assert found == states
    assert len(found) > 20


def test_a_goal_lies_where_the_static_modules_say(tmp_path: Path) -> None:
    """The corner of their box in the second file is put where it is in the first."""
    files = written(tmp_path, SLIDES, 2, start=LINE, fixed=[[0, 1]], goal=LINE, closed=[[5, 5]])
    final = json.loads((tmp_path / "final.json").read_text())
    for module in final["modules"]:
        module["position"][1] += 7 if module["static"] else 4
    (tmp_path / "final.json").write_text(json.dumps(final))
    scene = scene_from_spec(files)
    assert scene.goal == frozenset((x, y - 3) for x, y in LINE)
    assert [*scene.system.filled, *scene.system.empty] == [(0, 1), (5, 5)]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"def": [["?#"]]}, "expected one '?', where the mover is, and one '!', where it goes"),
        ({"def": [["?!o"]]}, "mark 'o', expected ?, !, #, x or a blank"),
        ({"def": [["?!", "##"]], "permGen": False}, "no move of the catalogue undoes it"),
        ({"def": [["?!"], ["##"]]}, "order 2 and 2 layers, in 2 dimensions"),
        ({"def": [["?!"]], "propertyChecks": [{}]}, "it checks or changes properties"),
    ],
)
def test_a_move_that_is_none_is_named(tmp_path: Path, change: dict[str, Any], what: str) -> None:
    """With the file, its name and what is wrong."""
    files = written(tmp_path, [], 2, start=LINE)
    table = {"moves": [{"name": "Odd", "order": 2, **change}]}
    (tmp_path / "moves.json").write_text(json.dumps(table))
    with pytest.raises(InputError) as caught:
        scene_from_spec(files)
    assert str(caught.value).startswith(f"{files}: {tmp_path / 'moves.json'}: move 'Odd': ")
    assert what in str(caught.value)


def test_no_file_outside_the_folder_is_read(tmp_path: Path) -> None:
    """Neither moves nor configurations."""
    text = Path(written(tmp_path, SLIDES, 2, start=LINE)).read_text()
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "scene.toml").write_text(text.replace("= 'initial", "= '../initial"))
    with pytest.raises(InputError, match="leads out of"):
        scene_from_spec(str(inner / "scene.toml"))


def test_files_of_pathfinder_have_no_keys(tmp_path: Path) -> None:
    """Values are refused, not passed over."""
    path = written(tmp_path, SLIDES, 2, start=LINE)
    with pytest.raises(InputError, match=r"keys: cannot read 'n=3', expected no keys$"):
        scene_from_spec(f"{path}:n=3")
