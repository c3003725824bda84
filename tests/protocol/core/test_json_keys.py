"""Keys that stand twice in one JSON object: refused in every JSON text that users write."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.path_files.certificates import read_certificate
from cubepath.protocol.path_files.durations import read_durations, schedule_from_jsonl
from cubepath.protocol.path_files.moves import read_cubes, read_moves
from cubepath.protocol.path_files.numbered import IrregularError, read_path
from cubepath.protocol.scenes.families.triangulations import read_points
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graphs import scenario_from_json
from samples.plans import DATA

GRID = scene_from_spec("agv:graph=grid3x2,n=2")


def cubes(path: Path) -> object:
    return list(read_cubes(path))


def moves(path: Path) -> object:
    return list(read_moves(path))


def placed(path: Path) -> object:
    return list(read_moves(path, GRID))


def schedule(path: Path) -> object:
    return schedule_from_jsonl(path.read_bytes())


def of_train(path: Path) -> object:
    return read_plan(path, companions=[DATA / "train.instance.json"])


def with_instance(path: Path) -> object:
    return read_plan(DATA / "train.solution.json", companions=[path])


TWICE: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "moves, contents": (
        moves,
        '{"id":1,"support":[1],"trace":[1]}\n{"id":1,"support":[1],"trace":[1],"trace":[1]}',
        'file.json:2: key "trace"',
    ),
    "moves, the id": (moves, '{"id":1,"support":[1],"trace":[1],"id":2}', 'file.json:1: key "id"'),
    "moves, escaped": (
        moves,
        '{"id":1,"support":[1],"trace":[1],"\\u0069d":2}',
        'file.json:1: key "id"',
    ),
    "moves, generator": (
        placed,
        '{"generator":"edge","at":[[0,0],[1,0]]}\n{"generator":"edge","at":[1],"at":[[0,0],[1,0]]}',
        'file.json:2: key "at"',
    ),
    "cubes": (cubes, '{"moves":[]}\n\n{"moves":[1],"moves":[2]}', 'file.json:3: key "moves"'),
    "cubes, a move": (
        cubes,
        '{"moves":[{"generator":"a","at":1},{"generator":"a","at":1,"at":2}]}',
        'file.json:1: key "at"',
    ),
    "schedule": (schedule, '{"moves":[]}\n{"moves":[],"moves":[]}', 'line 2: key "moves"'),
    "durations": (
        read_durations,
        '{"format":"cubepath-durations-1",\n "ids":{"a":1,\n "a":2}}',
        'line 3: key "a"',
    ),
    "certificate": (
        read_certificate,
        (
            '{"format":"cubepath-certificate-1","moves":0,"cancelled":[],\n"cubes":[],"chain":[],'
            '"moves":0}'
        ),
        'line 2: key "moves"',
    ),
    "2021, a step": (
        of_train,
        '{"instance":"train",\n"steps":[{"0":"N",\n"0":"S"}]}',
        'file.json:3: key "0"',
    ),
    "2021, the solution": (
        of_train,
        '{"instance":"train","steps":[],\n"steps":[]}',
        'file.json:2: key "steps"',
    ),
    "2021, the instance": (
        with_instance,
        '{"starts":[[0,0]],"targets":[[0,0]],"obstacles":[],\n"meta":{"a":1,"a":1}}',
        'file.json:2: key "a"',
    ),
    "scenario": (
        scenario_from_json,
        '{"starts":[[0,0]],\n"goals":[[0,0]],\n"goals":[[0,0]]}',
        'file.json:3: key "goals"',
    ),
    "points": (
        read_points,
        '{"points_x":[0,1,0],"points_y":[0,0,1],\n"points_x":[0,1,0]}',
        'file.json:2: key "points_x"',
    ),
}


@pytest.mark.parametrize("name", TWICE)
def test_a_key_that_stands_twice_is_refused(tmp_path: Path, name: str) -> None:
    """In each kind of file, with the line and the key."""
    read, text, told = TWICE[name]
    path = tmp_path / "file.json"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read(path)
    assert told in str(caught.value)
    assert "stands twice in one object, expected once" in str(caught.value)


@pytest.mark.parametrize(
    "line",
    [
        '{"id":1,"support":[1],"trace":[1],"id":1}',
        '{"id":1,"support":[1],"trace":[1],"before":[],"after":[1],"before":[]}',
        '{"id":1,"support":[":"],"trace":[":"],"id" : 1}',
    ],
)
def test_the_fast_reader_leaves_them_to_the_other(tmp_path: Path, line: str) -> None:
    """What takes a million lines sees a key that stands twice, and gives up; the other names it."""
    path = tmp_path / "moves.jsonl"
    path.write_text(f"{line}\n")
    with pytest.raises(IrregularError):
        read_path(path)
    with pytest.raises(InputError, match=r":1: key .* stands twice in one object"):
        list(read_moves(path))


def test_the_fast_reader_takes_colons_in_names(tmp_path: Path) -> None:
    """Sites and ids that hold colons, quotes and braces are no keys."""
    path = tmp_path / "moves.jsonl"
    lines = [
        {"id": '"id":', "support": ["{a:b}", '":'], "trace": ['":']},
        {"id": "robot:1", "support": ["\\"], "trace": ["\\"], "before": [], "after": ["\\"]},
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert read_path(path).names == [line["id"] for line in lines]


texts = st.text(st.sampled_from('ab":{}[],\\ \n\u00e9'), max_size=3)
"""Keys and values that look like what stands between them."""


class Pairs(list[tuple[str, Any]]):
    """An object as its keys and values, of which some may come twice."""


values = st.recursive(
    st.one_of(texts, st.integers(), st.none()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.lists(st.tuples(texts, inner), max_size=4).map(Pairs)
    ),
    max_leaves=10,
)


def written(value: Any) -> str:
    if isinstance(value, Pairs):
        return "{" + ",".join(f"{json.dumps(k)} :{written(v)}" for k, v in value) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(written, value)) + "]"
    return json.dumps(value)


def twice(value: Any) -> bool:
    """Tell by the definition whether a key stands twice."""
    if isinstance(value, Pairs):
        keys = [key for key, _ in value]
        return len(set(keys)) < len(keys) or any(twice(inner) for _, inner in value)
    return isinstance(value, list) and any(map(twice, value))


@given(values)
def test_keys_are_found_by_the_definition(value: Any) -> None:
    """Whatever names and values look like, at any depth."""
    text = written(value).encode()
    if twice(value):
        with pytest.raises(InputError, match="stands twice"):
            check_keys(text, 0, where="FILE:")
    else:
        check_keys(text, 0)
