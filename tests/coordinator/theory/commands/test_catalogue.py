"""The commands ``system new|check|show`` on pages."""

import json
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.protocol.scenes.specs import scene_from_spec

FAR = """format = "cubepath-system-1"
start = [[0, 0]]

[lattice]
name = "squares"

[[lattice.generators]]
name = "slide"
support = [[0, 0], [1, 0], [1000000000, 1000000000]]
trace = [[0, 0], [1, 0]]
before = [[0, 0]]
after = [[1, 0]]
goes = [[[0, 0], [1, 0]]]
"""
BAD = """format = "cubepath-system-1"
start = [[0, 0]]

[lattice]
name = "squares"

[[lattice.generators]]
name = "slide"
before = '''
 a .
 # #
'''
after = '''
 . a
 # .
'''

[[lattice.generators]]
name = "old"
support = [[0, 0]]
trace = [[0, 0], [1, 0]]
before = [[0, 0]]
after = [[1, 0]]
goes = [[[0, 0], [1, 0]]]
"""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def answer(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    assert main([*words]) == code
    return capsys.readouterr().out


@pytest.mark.slow
def test_a_new_page_is_without_mistakes(capsys: pytest.CaptureFixture[str]) -> None:
    """It has two scenes and keys, keeps aggregates connected, and nothing is written over it."""
    answer(capsys, "system", "new", "mine.toml")
    text = answer(capsys, "system", "check", "mine.toml", "--modules", "4")
    assert "mine.toml (4 modules), mine.toml:scene=bump (2 modules)" in text
    assert "all stay so" in text
    assert len(scene_from_spec("mine.toml:n=7").start) == 7
    assert main(["system", "new", "mine.toml"]) == 2


def test_every_mistake_has_its_picture(capsys: pytest.CaptureFixture[str]) -> None:
    """A caret is under the mark; a generator that lists its cells has the line of its table."""
    Path("bad.toml").write_text(BAD)
    lines = answer(capsys, "system", "check", "bad.toml", code=1).split("\n")
    assert lines[0].startswith("bad.toml: line 15, column 4, generator 'slide': after: '#' before")
    assert lines[1:4] == ["     . a", "     # .", "       ^"]
    assert lines[4].startswith("bad.toml: line 18: generator 'old': the trace holds (1, 0)")
    found = json.loads(answer(capsys, "system", "check", "bad.toml", "--json", code=1))
    assert [bool(each["picture"]) for each in found["mistakes"]] == [True, False]
    assert main(["run", "bad.toml"]) == 2


def test_moves_are_drawn_as_they_are_written(capsys: pytest.CaptureFixture[str]) -> None:
    """What is shown of a page's generator is its own drawing."""
    text = answer(capsys, "system", "show", "hex-open")
    rows = text.split("\n")[2:6]
    assert rows[0] == "pivot-0-left"
    assert [row.split() for row in rows[1:]] == [
        ["#", "#"],
        ["a", ".", "->", ".", "a"],
        [".", ".", ".", ".", ".", "."],
    ]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_moves_are_drawn_as_a_picture(capsys: pytest.CaptureFixture[str], suffix: str) -> None:
    """Before and after stand side by side."""
    answer(capsys, "system", "show", "sliding:k=1", "-o", f"moves.{suffix}")
    assert Path(f"moves.{suffix}").stat().st_size > 1000


def test_systems_without_generators_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """Vehicles on a graph have no moves that are placed by translation."""
    assert main(["system", "check", "agv"]) == 2
    assert (
        "agv: has no generators, expected one on a lattice (complex explores any)"
        in capsys.readouterr().err
    )


def test_cells_that_are_far_apart_are_not_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    """They are refused before a drawing takes all memory."""
    Path("far.toml").write_text(FAR)
    assert main(["system", "show", "far.toml"]) == 2
    assert "cells too far apart to be drawn" in capsys.readouterr().err


def test_all_scenes_are_tried_wherever_the_page_is(capsys: pytest.CaptureFixture[str]) -> None:
    """A folder may have the name of a key, and a key may end like `scene`."""
    Path("n=4").mkdir()
    text = "map = 'o'\n[keys]\nmyscene = 1\n" + FAR.replace("1000000000", "1").partition("]]\n")[2]
    page = (
        FAR.splitlines()[0] + "\n" + text + "[scenes.a]\n[scenes.b]\nfilled = [[9, '9*myscene']]\n"
    )
    Path("n=4/mine.toml").write_text(page)
    for spec, other in (
        ("n=4/mine.toml", "n=4/mine.toml:scene=b"),
        ("n=4/mine.toml:myscene=2", "n=4/mine.toml:myscene=2,scene=b"),
    ):
        found = answer(capsys, "system", "check", spec, "--modules", "2")
        assert f"{spec} (1 module), {other} (1 module)" in found


@pytest.mark.slow
def test_holes_are_counted_in_the_plane_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """In space nothing is said of them."""
    counted = answer(capsys, "system", "check", "hex", "--modules", "2")
    assert "\nholes " in counted
    assert "holes" not in answer(capsys, "system", "check", "sliding-cubes", "--modules", "1")


def test_a_scene_in_which_nothing_can_move_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """And a rule that does not exist; a single module is no trial of connectedness."""
    text = FAR.replace("1000000000", "1").partition("]]\n")[2]
    Path("alone.toml").write_text(FAR.splitlines()[0] + "\nmap = '# o #'\n" + text)
    found = answer(capsys, "system", "check", "alone.toml", "--modules", "1")
    assert "\nstart " in found
    assert "no module can move in alone.toml" in found
    assert "\nconnected" not in found
    assert main(["run", "alone.toml", "--processes", "0", "--max-rounds", "1"]) == 0
    assert "alone.toml: no module can move at the start" in capsys.readouterr().err
    Path("rule.toml").write_text(FAR.splitlines()[0] + "\nrule = 'leeder'\nmap = 'o'\n" + text)
    assert main(["system", "check", "rule.toml"]) == 2
    assert "unknown rule 'leeder' (did you mean 'leader'?)" in capsys.readouterr().err
