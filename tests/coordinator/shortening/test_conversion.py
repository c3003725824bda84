"""Converting paths: every form gives the same cubes, and bad moves are found in every form."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from msgspec.json import encode

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.admissibility import InadmissibleMove, carried_out
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.shortening.path_input import read_input
from cubepath.protocol.core.actions import Action, apply
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.moves import PathMove, read_moves
from cubepath.protocol.path_files.npz import read_moves_npz, write_moves_npz
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves
from samples.strategies import SCENES, scene, walk

DATA = Path(__file__).parents[2] / "data" / "agv"
CROSSING = "agv:graph=grid3x2,n=2"
LINES = """\
{"generator": "edge", "at": [[0, 0], [1, 0]]}
{"generator": "edge", "at": [[0, 1], [1, 1]]}
{"generator": "edge", "at": [[1, 0], [2, 0]]}
"""


@pytest.fixture
def crossing(tmp_path: Path) -> Path:
    path = tmp_path / "crossing.jsonl"
    path.write_text(LINES)
    return path


def test_all_forms_of_a_path_give_the_same_cubes(crossing: Path, tmp_path: Path) -> None:
    """Lines, arrays, and lines again; cubes as lines, and by way of arrays."""
    arrays, lines = tmp_path / "m.npz", tmp_path / "again.jsonl"
    assert (
        main(["shorten", str(crossing), "--convert", "-o", str(arrays), "--system", CROSSING]) == 0
    )
    assert main(["shorten", str(arrays), "--convert", "-o", str(lines)]) == 0
    assert json.loads(lines.read_text().splitlines()[2]) == json.loads(LINES.splitlines()[2])
    cubes = tmp_path / "cubes.jsonl"
    assert main(["shorten", str(crossing), "--system", CROSSING, "-o", str(cubes)]) == 0
    assert main(["shorten", str(arrays), "-o", str(tmp_path / "cubes.npz")]) == 0
    assert (
        main(
            [
                "shorten",
                str(tmp_path / "cubes.npz"),
                "--convert",
                "-o",
                str(tmp_path / "other.jsonl"),
            ]
        )
        == 0
    )
    assert (tmp_path / "other.jsonl").read_bytes() == cubes.read_bytes()
    # The binary form is self-contained; with a system it is checked from that system's start.
    assert shorten(arrays, system=CROSSING).named == shorten(arrays).named
    with pytest.raises(InputError, match=r"m\.npz: moves\[0\]: .* is not admissible: site"):
        shorten(arrays, system="arm:n=5")


def test_a_scenario_becomes_a_moves_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With what was written told as a document."""
    source, target = DATA / "grid8-12agents.json", tmp_path / "m.npz"
    assert main(["shorten", str(source), "--convert", "-o", str(target), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "what": "moves",
        "count": 71,
        "output": str(target),
    }
    assert encode(shorten(target).named) == encode(shorten(source).named)


def test_a_bad_move_is_named_by_the_reader_of_lines(tmp_path: Path) -> None:
    """Compiled, the path is found not to fit; which line and why, the reader of lines says."""
    path = tmp_path / "m.jsonl"
    path.write_text(LINES + LINES[: LINES.index("\n")])
    with pytest.raises(InputError, match=r"m\.jsonl:4: .* site \(0, 0\) is off, expected on"):
        shorten(path, system=CROSSING)


def test_unusual_files_are_read_line_by_line(tmp_path: Path) -> None:
    """A site that begins with NUL could be an id, so the reader of lines decides."""
    path = tmp_path / "m.jsonl"
    path.write_text('{"id": 1, "support": ["\\u0000a"], "trace": ["\\u0000a"]}\n' * 3)
    counts: list[int] = []
    found = shorten(path, progress=counts.append)
    assert (found.moves, found.reduced_moves, sum(counts)) == (3, 1, 3)


@pytest.mark.slow
@pytest.mark.parametrize("spec", SCENES)
@settings(max_examples=25)
@given(choices=st.lists(st.integers(0, 59), max_size=30), data=st.data())
def test_the_compiled_check_says_what_the_definition_says(
    spec: str, choices: list[int], data: st.DataObject
) -> None:
    """A walk fits; with moves exchanged it fits as far as it is admissible one by one."""
    where = scene(spec)
    word, _ = walk(where, where.start_state, choices)
    if data.draw(st.booleans()):
        word = data.draw(st.permutations(word))
    path = number_moves(
        PathMove(action, GeneratorPlacement("any", place)) for place, action in enumerate(word)
    )
    state, expected = where.start_state, None
    shown = []
    for place, action in enumerate(word):
        shown.append(state)
        try:
            state = apply(action, state)
        except InputError:
            expected = place
            break
    found = carried_out(path, where.start_state)
    assert (found.move if isinstance(found, InadmissibleMove) else None) == expected
    if not isinstance(found, InadmissibleMove):
        for action, end, before in zip(word, found.ends.tolist(), shown, strict=True):
            fixed = action.support - action.free
            assert action.ends[end] == fixed & before
    else:
        sites = {site for action in word for site in action.support}
        assert found.state == state & sites


def test_what_a_move_without_states_wrote_is_unknown(tmp_path: Path) -> None:
    """In the binary form as in lines: the next move says what is there."""
    path = tmp_path / "m.jsonl"
    state = '"before": [], "after": [1]'
    lines = [
        f'{{"id": 1, "support": [1], "trace": [1], {state}}}',
        '{"id": "x", "support": [1, 2], "trace": [1]}',
        '{"id": 2, "support": [1, 2], "trace": [2], "before": [], "after": [2]}',
    ]
    path.write_text("\n".join(lines))
    assert len(list(read_moves(path))) == 3
    target = tmp_path / "m.npz"
    write_moves_npz(target, read_input(path).numbered)
    assert shorten(target).named == shorten(path).named == ((1,), ("x",), (2,))
    path.write_text("\n".join([lines[0], lines[2]]))
    with pytest.raises(InputError, match=r"m\.jsonl:2: move 2 is not admissible"):
        shorten(path)
    forced = read_moves_npz(target)
    bad = NumberedPath(
        forced.actions,
        forced.action_names,
        forced.stated,
        np.array([0, 0], np.int32),
        np.array([0, 0], np.int8),
    )
    # Of one action two moves always fit, for what is there is known: the second goes back.
    assert not isinstance(carried_out(bad, None), InadmissibleMove)
    other = Action([1, 3], [3], [], [3], label="3")
    bad = NumberedPath(
        [*forced.actions, other],
        [*forced.action_names, 3],
        [*forced.stated, True],
        np.array([0, len(forced.actions)], np.int32),
        np.array([0, 0], np.int8),
    )
    write_moves_npz(target, bad)
    with pytest.raises(InputError, match=r"moves\[1\]: 3 is not admissible: site 1 is on"):
        shorten(target)
