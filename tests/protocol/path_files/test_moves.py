"""Moves and cubes files: what comes in goes out, and what is wrong is named by file and line."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.moves import PathMove, read_cubes, read_moves, write_cubes
from cubepath.protocol.path_files.numbered import IrregularError, read_path
from cubepath.protocol.path_files.path_lines import write_moves
from cubepath.protocol.scenes.specs import scene_from_spec

SYSTEM = "agv:graph=P4,n=1"
"""One vehicle at 0 of the path 0-1-2-3."""
PLACED = '{"generator": "edge", "at": [0, 1]}'
STEP = '{"id": "s", "support": [1, 2], "trace": [1, 2], "before": [1], "after": [2]}'
NAMED = '{"id": "a", "support": [1, 2], "trace": [2]}'


def step(name: str | int, on: object, off: object, **others: object) -> dict[str, Any]:
    """Return a line for a vehicle that goes from one site to another."""
    both = [on, off]
    return {"id": name, "support": both, "trace": both, "before": [on], "after": [off], **others}


def written(folder: Path, *lines: str | dict[str, Any], ending: str = "\n") -> Path:
    path = folder / "moves.jsonl"
    texts = [line if isinstance(line, str) else json.dumps(line) for line in lines]
    path.write_bytes("".join(text + ending for text in texts).encode())
    return path


def read(path: Path, system: str | None = None) -> list[PathMove]:
    return list(read_moves(path, None if system is None else scene_from_spec(system)))


BAD: dict[str, tuple[str | None, list[str | dict[str, Any]], int, str]] = {
    "no JSON": (None, ["move 1"], 1, "found no whole JSON object, expected one a line: JSON is"),
    "cut in the first line": (SYSTEM, [PLACED[:30]], 1, "found no whole JSON object"),
    "lists in lists": (
        SYSTEM,
        ['{"generator": "edge", "at": ' + "[" * 65 + "]" * 65 + "}"],
        1,
        "a site is lists in lists 64 deep at most, found more - at `$.at`",
    ),
    "a site that is none": (
        SYSTEM,
        ['{"generator": "edge", "at": [1, null]}'],
        1,
        "a site is a JSON number, string or list, found null - at `$.at`",
    ),
    "no object": (None, ["[1, 2]"], 1, "Expected `object`, got `array`; a line has the keys"),
    "a number after moves": (SYSTEM, [PLACED, "7"], 2, "Expected `object`, got `int`"),
    "two objects in a line": (None, [STEP + STEP], 1, "found no whole JSON object"),
    "unknown key": (None, [{**step(1, 1, 2), "cost": 3}], 1, "contains unknown field `cost`"),
    "unknown key by generator": (
        SYSTEM,
        [PLACED, '{"generator": "edge", "at": [1, 2], "id": "a"}'],
        2,
        'contains unknown field `id`; a line has the keys "generator" and "at"',
    ),
    "missing key": (None, ['{"id": "a", "support": [1]}'], 1, "missing required field `trace`"),
    "missing id": (None, ['{"support": [1], "trace": [1]}'], 1, "missing required field `id`"),
    "missing place": (SYSTEM, ['{"generator": "edge"}'], 1, "missing required field `at`"),
    "id is no name": (None, [{**step(1, 1, 2), "id": [1]}], 1, "Expected `int | str`, got `array`"),
    "support is no list": (None, [step(1, 1, 2, support=1)], 1, "Expected `array`, got `int`"),
    "site is an object": (
        None,
        [step(1, 1, 2), step(2, {"x": 1}, 2)],
        2,
        "a site is a JSON number, string or list, found {'x': 1}",
    ),
    "site is null": (None, [step(1, None, 2)], 1, "a site is a JSON number, string or list"),
    "before without after": (
        None,
        [NAMED, '{"id": "b", "support": [1], "trace": [1], "before": [1]}'],
        2,
        'found "before" without "after", expected both or neither',
    ),
    "after without before": (
        None,
        ['{"id": "b", "support": [1], "trace": [1], "after": [1]}'],
        1,
        'found "after" without "before", expected both or neither',
    ),
    "trace outside support": (
        None,
        ['{"id": "b", "support": [1], "trace": [1, 3]}'],
        1,
        '"b": the trace holds 3, which is not in the support',
    ),
    "trace outside support with states": (
        None,
        [STEP, step("b", 1, 2, support=[2, 3])],
        2,
        '"b": the trace holds 1, which is not in the support',
    ),
    "empty trace": (None, [{"id": "b", "support": [1], "trace": []}], 1, "the trace is empty"),
    "state outside support": (None, [step(1, 1, 2, before=[5])], 1, "a local state holds 5"),
    "change off the trace": (
        None,
        [step(1, 1, 2, trace=[1])],
        1,
        "the local states differ at 2, which is off the trace",
    ),
    "no change": (None, [step(1, 1, 2, after=[1])], 1, "the two local states are equal"),
    "one id with two supports": (
        None,
        [NAMED, NAMED, '{"id": "a", "support": [1, 2, 3], "trace": [2]}'],
        3,
        'id "a" has another support in line 1, expected the same',
    ),
    "one id with two traces": (
        None,
        ["", NAMED, '{"id": "a", "support": [1, 2], "trace": [1]}'],
        3,
        'id "a" has another trace in line 2, expected the same',
    ),
    "an id that named an action": (
        None,
        [NAMED, step("a", 1, 2)],
        2,
        'id "a" has no "before" and "after" in line 1, where it names the action',
    ),
    "an id that was a label": (
        None,
        [STEP, '{"id": "s", "support": [1, 2], "trace": [1, 2]}'],
        2,
        'id "s" has "before" and "after" in line 1, but not here',
    ),
    "generator without a system": (
        None,
        [PLACED],
        1,
        "generator 'edge' without a system, expected --system SYSTEM",
    ),
    "unknown generator": (
        SYSTEM,
        [PLACED, '{"generator": "fly", "at": [0, 1]}'],
        2,
        "unknown generator 'fly', expected edge",
    ),
    "no place for the generator": (
        SYSTEM,
        [PLACED, '{"generator": "edge", "at": [0, 2]}'],
        2,
        "is no edge of the graph",
    ),
    "both forms, generator first": (
        SYSTEM,
        [PLACED, NAMED],
        2,
        'neither, where those before have the keys "generator" and "at": expected one form',
    ),
    "both forms, contents first": (
        SYSTEM,
        [NAMED, "", PLACED],
        3,
        'a line with the keys "generator" and "at", where those before have the keys "id"',
    ),
    "inadmissible by generator": (
        SYSTEM,
        [PLACED, '{"generator": "edge", "at": [2, 3]}'],
        2,
        "is not admissible: site 2 is off, expected on",
    ),
    "onto a site that is on": (
        None,
        [step(1, "x", "y"), step("by hand", "z", "y")],
        2,
        'move "by hand" is not admissible: site "y" is on, expected off',
    ),
    "from a site that is off": (
        None,
        [step(1, [0, 0], [0, 1]), step(2, [0, 0], [1, 0])],
        2,
        "move 2 is not admissible: site [0,0] is off, expected on",
    ),
    "against what a support read": (
        None,
        [step(1, 1, 2, support=[1, 2, 3]), step(2, 3, 4)],
        2,
        "move 2 is not admissible: site 3 is off, expected on",
    ),
    "against the start": (SYSTEM, [STEP], 1, "site 1 is off, expected on"),
    "against the start, off": (
        "agv:graph=P4,n=2",
        [step(1, 0, 1)],
        1,
        "site 1 is on, expected off",
    ),
    "true and 1": (
        None,
        [step(1, 1, 2), step(2, 2, True)],
        2,
        "a site is a JSON number, string or list, found true",
    ),
    "1 and true, in lists": (
        None,
        [step(1, ["a", 1], 2), step(2, 2, ["a", True])],
        2,
        "found true",
    ),
    "false alone": (None, [step(1, ["a", [False]], 2)], 1, "found false"),
    "true in the place of a generator": (
        SYSTEM,
        ['{"generator": "edge", "at": [0, true]}'],
        1,
        "found true",
    ),
    "nested too deeply": (
        None,
        [NAMED, f'{{"id": 1, "support": [{"[" * 600}{"]" * 600}], "trace": []}}'],
        2,
        "",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_line_is_named_with_file_line_and_reason(tmp_path: Path, case: str) -> None:
    """Every refusal begins with FILE:LINE and says what was found and what was expected."""
    system, lines, number, reason = BAD[case]
    path = written(tmp_path, *lines)
    with pytest.raises(InputError) as caught:
        read(path, system)
    text = str(caught.value)
    assert text.startswith(f"{path}:{number}: ")
    assert reason in text
    assert "\n" not in text


def test_moves_before_a_bad_line_are_given_out_as_they_are_read(tmp_path: Path) -> None:
    """Reading is a stream: what comes before the bad line has been yielded."""
    moves = read_moves(written(tmp_path, NAMED, "oops"))
    assert next(moves).name == "a"
    with pytest.raises(InputError, match=":2: "):
        next(moves)


def test_a_truncated_last_line_is_named(tmp_path: Path) -> None:
    """A file that ends within a line is refused at that line."""
    path = tmp_path / "cut.jsonl"
    path.write_text(NAMED + "\n" + NAMED[:20])
    with pytest.raises(InputError, match=r"cut\.jsonl:2: found no whole JSON object.*truncated"):
        read(path)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    """Invalid UTF-8 is named like any other bad line."""
    path = tmp_path / "latin.jsonl"
    path.write_bytes(b'{"id": "\xe9", "support": [1], "trace": [1]}\n')
    with pytest.raises(InputError, match=r"latin\.jsonl:1: found no whole JSON object"):
        read(path)


@pytest.mark.parametrize("name", ["missing.jsonl", "."])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    """A missing file and a folder are refused in one line."""
    with pytest.raises(InputError, match=str(tmp_path)):
        read(tmp_path / name)


@pytest.mark.parametrize("content", [b"", b"\n\r\n  \n", b"\xef\xbb\xbf"])
def test_an_empty_file_is_a_path_of_no_moves(tmp_path: Path, content: bytes) -> None:
    """So is one of empty lines."""
    path = tmp_path / "empty.jsonl"
    path.write_bytes(content)
    assert read(path) == []


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\n\n", "\r\n\r\n \t\r\n"])
def test_line_endings_and_empty_lines_do_not_matter(tmp_path: Path, ending: str) -> None:
    """CRLF and empty lines are read as if they were not there; nor is a last newline needed."""
    path = written(tmp_path, "\ufeff" + NAMED, NAMED, ending=ending)
    moves = read(path)
    assert [move.name for move in moves] == ["a", "a"]
    path.write_bytes(path.read_bytes().rstrip())
    assert read(path) == moves


def test_a_name_without_states_is_the_action(tmp_path: Path) -> None:
    """Without local states, moves are equal iff their ids are; they commute by support and trace.

    Order and repetition within the lists do not matter.
    """
    path = written(
        tmp_path,
        NAMED,
        '{"id": "b", "support": [1, 2], "trace": [2]}',
        '{"id": "a", "trace": [2], "support": [2, 1, 2], "before": null, "after": null}',
        '{"id": 1, "support": [1, 5], "trace": [5]}',
        '{"id": "1", "support": [7], "trace": [7]}',
    )
    a, b, again, reader, apart = [move.action for move in read(path)]
    assert a == again
    assert len({a, b, again, reader, apart}) == 4
    assert not commute(a, b)
    assert not commute(a, again)
    assert commute(a, reader)
    assert commute(reader, apart)


def test_contents_with_states_are_the_action(tmp_path: Path) -> None:
    """With local states the id is a label: equal contents are one action, either way round."""
    path = written(tmp_path, step("out", 1, 2), step("back", 2, 1), step("out", 1, 2))
    out, back, again = read(path)
    assert out.action == back.action == again.action
    assert [move.before for move in (out, back, again)] == [frozenset([on]) for on in (1, 2, 1)]
    labels = [move.action.label for move in (out, back, again)]
    assert labels == ['"out"', '"back"', '"out"']


def test_the_same_line_again_undoes_the_move(tmp_path: Path) -> None:
    """The pair of local states has no order: a line read where `after` is shown goes back."""
    first, second = read(written(tmp_path, step(1, 1, 2), step(1, 1, 2)))
    assert (first.before, second.before) == (frozenset([1]), frozenset([2]))


def test_an_id_may_label_two_contents_that_say_their_states(tmp_path: Path) -> None:
    """One id with two contents is refused only where it names the action."""
    first, second = read(written(tmp_path, step("go", 1, 2), step("go", 2, 3)))
    assert first.action != second.action


def test_after_a_move_without_states_its_trace_is_unknown(tmp_path: Path) -> None:
    """What it wrote can be anything after it; what it read stays as it was."""
    blind: dict[str, Any] = {"id": "?", "support": [1, 2, 3], "trace": [2]}
    assert len(read(written(tmp_path, step(1, 1, 2), blind, step(2, 4, 2)))) == 3
    with pytest.raises(InputError, match="site 1 is off, expected on"):
        read(written(tmp_path, step(1, 1, 2), blind, step(2, 1, 4)))
    assert len(read(written(tmp_path, step(1, 0, 1), blind, step(2, 1, 2)), SYSTEM)) == 3
    with pytest.raises(InputError, match=r":3: .* site 0 is off, expected on"):
        read(written(tmp_path, step(1, 0, 1), blind, step(2, 0, 2)), SYSTEM)


def test_numbers_texts_and_lists_are_sites(tmp_path: Path) -> None:
    """A site is any of these; floats that are whole are the integers."""
    path = written(tmp_path, step(1, "true", "b"), step(2, "b", [1.5, ["a", []]]))
    assert [move.name for move in read(path)] == [1, 2]
    assert len(read(written(tmp_path, step(1, 1, 2), step(2, 2.0, 1.0)))) == 2


def test_generators_are_placed_by_the_system(tmp_path: Path) -> None:
    """A generator's line gives the system's own action, written as the input wrote it."""
    path = written(tmp_path, PLACED, '{"at": [1, 0], "generator": "edge"}')
    there, back = read(path, SYSTEM)
    system = scene_from_spec(SYSTEM).system
    assert there.action == back.action == system.action("edge", (0, 1))
    assert (there.name, back.name) == (
        GeneratorPlacement("edge", (0, 1)),
        GeneratorPlacement("edge", (1, 0)),
    )
    assert (there.before, back.before) == (frozenset([0]), frozenset([1]))


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """Moves of each form survive a round trip, names, actions and local states."""
    for system, lines in (
        (SYSTEM, [PLACED, PLACED]),
        (None, [NAMED, STEP, step(3, 2, ["q", [1, "ü"]], support=[["q", [1, "ü"]], 2, 9]), NAMED]),
    ):
        moves = read(written(tmp_path, *lines), system)
        again = tmp_path / "again.jsonl"
        write_moves(again, moves)
        assert read(again, system) == moves


def test_guards_are_not_written_as_contents(tmp_path: Path) -> None:
    """An action with free sites cannot be said by two local states, and nothing is written."""
    from cubepath.protocol.core.actions import Action

    dotted = Action([1, 2, 3], [1, 2], [1], [2], free=[3], label='"d"')
    path = tmp_path / "out.jsonl"
    with pytest.raises(InputError, match="free sites or guards"):
        write_moves(path, [PathMove(dotted, "d", frozenset([1]))])
    assert list(tmp_path.iterdir()) == []
    write_moves(path, [PathMove(dotted, "d")])
    assert path.read_text() == '{"id":"d","support":[1,2,3],"trace":[1,2]}\n'


def test_cubes_are_written_and_read_back(tmp_path: Path) -> None:
    """A cubes file has one cube a line, each move by its name."""
    path = tmp_path / "cubes.jsonl"
    cubes = [("a", 7), (GeneratorPlacement("edge", ((0, 0), (0, 1))),)]
    write_cubes(path, cubes)
    assert path.read_text() == (
        '{"moves":["a",7]}\n{"moves":[{"generator":"edge","at":[[0,0],[0,1]]}]}\n'
    )
    assert list(read_cubes(path)) == cubes
    write_cubes(path, [])
    assert path.read_bytes() == b""
    path.write_text('{"moves":["a"]}\n{"cube":[]}\n')
    with pytest.raises(InputError, match=r"cubes\.jsonl:2: .*the key \"moves\""):
        list(read_cubes(path))


def test_a_key_more_is_refused_in_moves_and_left_alone_in_cubes(tmp_path: Path) -> None:
    """A line of a moves file says no more than it may; a cube's move may carry a remark."""
    move = '{"generator": "edge", "at": [0, 1], "remark": "first"}'
    moves, cubes = tmp_path / "moves.jsonl", tmp_path / "cubes.jsonl"
    moves.write_text(f"{move}\n")
    with pytest.raises(InputError, match="unknown field `remark`"):
        list(read_moves(moves, scene_from_spec(SYSTEM)))
    with pytest.raises(IrregularError, match="unknown field `remark`"):
        read_path(moves, scene_from_spec(SYSTEM))
    cubes.write_text(f'{{"moves": [{move}]}}\n')
    assert list(read_cubes(cubes)) == [(GeneratorPlacement("edge", (0, 1)),)]
