"""Plain lists of moves, and how a plan's format is found."""

from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import FORMS, form_of, read_plan
from samples.plans import DATA, actions_read, moves_read, plain_text, save
from samples.strategies import random_walk, scene

PIVOTS, SLIDES = DATA / "pivots.txt", DATA / "slides.txt"
# Two moves from one place to another that differ in what they read.
TWO_WAYS = """format = "cubepath-system-1"
start = [[0, 1]]
[lattice]
name = "squares"
filled = [[0, 0], [0, 2]]
""" + "".join(
    f"""
[[lattice.generators]]
name = "{name}"
support = [[0, 0], [1, 0], [0, {side}]]
trace = [[0, 0], [1, 0]]
before = [[0, 0], [0, {side}]]
after = [[1, 0], [0, {side}]]
goes = [[[0, 0], [1, 0]]]
"""
    for name, side in (("over", -1), ("under", 1))
)


def test_pivots() -> None:
    """Hexagons with and without the one they pivot about, in round or square brackets."""
    moves = moves_read(PIVOTS, system="hex:n=3")
    assert [move.name for move in moves] == [
        GeneratorPlacement("pivot-1-right", (0, 0)),
        GeneratorPlacement("pivot-0-right", (0, 1)),
        GeneratorPlacement("pivot-2-right", (1, 0)),
        GeneratorPlacement("pivot-1-left", (2, 0)),
        GeneratorPlacement("pivot-1-right", (0, 1)),
    ]


def test_slides() -> None:
    """A run is named by its first square, by its last, or by what gets free and what gets taken."""
    moves = moves_read(SLIDES, system="sliding:p=3,q=1,n=3")
    assert [move.name for move in moves] == [GeneratorPlacement("row-2", (0, 1))] * 3


def test_words_are_sites(tmp_path: Path) -> None:
    """A vertex with a name is written as it is."""
    yard = save(tmp_path / "yard.txt", "gate lane\nlane dock\n")
    path = save(tmp_path / "moves.txt", "dock -> lane\n\nlane -> gate # on\n")
    moves = moves_read(path, system=f"agv:graph={yard},n=1")
    assert [move.before for move in moves] == [frozenset({"dock"}), frozenset({"lane"})]


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(0, 15),
    st.sampled_from(
        [
            "hex:n=5",
            "hex-open:n=4",
            "sliding:p=2,q=1,n=4",
            "agv-labelled:graph=grid3x3,n=3",
            "arm:n=5",
        ]
    ),
)
def test_a_list_read_back_is_the_path(
    tmp_path_factory: pytest.TempPathFactory, seed: int, length: int, spec: str
) -> None:
    """A random walk written move by move gives its own normal cube path."""
    where = scene(spec)
    word = random_walk(spec, length, seed)
    path = tmp_path_factory.mktemp("plain") / "moves.txt"
    save(path, plain_text(word, where.system, where.start_state))
    assert normal_cube_path(actions_read(path, "plain", system=spec)) == normal_cube_path(word)


BAD_LINES = {
    "off": ("(5,5) -> (5,6)", ":2: [5,5] -> [5,6]: site [5,5] is off, expected on"),
    "blocked": (
        "(1,0) -> (1,1)",
        ":2: [1,0] -> [1,1]: pivot-1-left at [1, 0] is not admissible: site (0, 1) is off,",
    ),
    "no move": ("(0,0) -> (5,5)", ":2: [0,0] -> [5,5]: no move of the system goes so"),
    "occupied": ("(0,0) -> (2,0)", "no move of the system goes so, and [2,0] is on"),
    "about": ("(0,0) -> (0,1) about (7,7)", "about [7,7]: site [7,7] is off, expected on"),
    "about another": ("(0,0) -> (0,1) about (2,0)", "about [2,0]: no move of the system goes so"),
    "no arrow": ("(0,0) (0,1)", ":2: found '(0,0) (0,1)', expected '(0,0) -> (1,0)', maybe with"),
    "no site": ("(0,0) -> (0,", ":2: '(0,' is no site"),
    "null": ("(0,0) -> null", ":2: a site is a JSON number, string or list, found null"),
}


@pytest.mark.parametrize("name", BAD_LINES)
def test_a_line_that_is_no_move_is_refused(tmp_path: Path, name: str) -> None:
    """The line, the move, and what in its support is not as it must be."""
    line, told = BAD_LINES[name]
    path = save(tmp_path / "moves.txt", f"# first\n{line}\n")
    with pytest.raises(InputError) as caught:
        moves_read(path, "plain", system="hex:n=3")
    assert str(caught.value).startswith(f"{path}:2: ")
    assert told in str(caught.value)


def test_what_could_be_two_moves_is_refused_with_both(tmp_path: Path) -> None:
    """The candidates are named, and `about` tells them apart."""
    system = str(save(tmp_path / "two.toml", TWO_WAYS))
    path = save(tmp_path / "moves.txt", "(0,1) -> (1,1)\n")
    with pytest.raises(InputError, match=r"over at \[0, 1\]; under at \[0, 1\] all do that"):
        moves_read(path, system=system)
    save(path, "(0,1) -> (1,1) about (0,2)\n")
    assert [move.name for move in moves_read(path, system=system)] == [
        GeneratorPlacement("under", (0, 1))
    ]


def test_a_list_needs_its_system(tmp_path: Path) -> None:
    """No system, one that is not local, or a file beside: refused in one line."""
    with pytest.raises(InputError, match="a list of moves, expected --system SYSTEM"):
        read_plan(PIVOTS)
    with pytest.raises(InputError, match="not a local system"):
        read_plan(PIVOTS, system="hex-connected")
    with pytest.raises(InputError, match="needs no other file, expected no --with"):
        read_plan(PIVOTS, system="hex:n=3", companions=[SLIDES])


# Formats by name and by content


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ("mapf", "unknown format 'mapf' (did you mean 'mapf-agents'?), expected one of mapf-log, "),
        ("", "unknown format '', expected one of"),
        ("mapf-json:major=x", "cannot read 'major=x', expected KEY=VALUE with a key of by, order"),
        ("mapf-json:by", "cannot read 'by', expected KEY=VALUE"),
        ("mapf-json:by=step,by=step", "key 'by' stands twice"),
        ("plain:x=1", "cannot read 'x=1', expected no keys"),
    ],
)
def test_a_format_that_is_none_is_refused(spec: str, told: str) -> None:
    """The part that is wrong, and what there is."""
    with pytest.raises(InputError) as caught:
        read_plan(PIVOTS, spec)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("content", "form"),
    [
        ("", "moves"),
        ("\n\n", "moves"),
        ('{"generator": "edge", "at": [[0, 0], [1, 0]]}\n', "moves"),
        ('{"id": "(0,0) -> (1,0)", "support": ["solution="], "trace": ["solution="]}\n', "moves"),
        ("what is this\n", "moves"),
        ('{"starts": [], "goals": [], "moves": []}\n', "scenario"),
        ('{\n"goals": [],\n"starts": []}\n', "scenario"),
        ('{"moves": []}\n', "cubes"),
        ('\n{"moves": ["a"]}\n{"moves": ["b"]}\n', "cubes"),
        ('{"moves": [], "steps": []}\n', "moves"),
        ("cubepath proof 1\n", "proof"),
        ("cubepath following proof 1\n", "following proof"),
        ('{"format":"cubepath-following-1"}\n', "following timetable"),
        ('{"format": "cubepath-certificate-1"}', "certificate"),
    ],
)
def test_a_file_is_what_its_content_says(tmp_path: Path, content: str, form: str) -> None:
    """What is of no known form is a moves file, and none of these is a plan but a scenario."""
    path = save(tmp_path / "file", content)
    assert form_of(path).name == form
    if form != "scenario":
        with pytest.raises(InputError, match="expected"):
            read_plan(path)


@pytest.mark.parametrize(
    ("name", "form"), [("a.mcap", "recording"), ("a.npz", "binary moves"), ("a.proof", "proof")]
)
def test_a_file_with_unknown_content_is_what_its_name_says(
    tmp_path: Path, name: str, form: str
) -> None:
    """So its reader says what is wrong with it; only where that is no text."""
    assert form_of(save(tmp_path / name, "what is this\n")).name == form


@pytest.mark.parametrize("name", ["train.instance.json", "kite.instance.json"])
def test_an_instance_is_no_plan(name: str) -> None:
    """An instance in the place of its solution is told apart."""
    with pytest.raises(InputError, match="an instance without moves, expected its solution"):
        read_plan(DATA / name)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    """One line, whatever the format."""
    for name in [form.name for form in FORMS.values() if form.plan]:
        with pytest.raises(InputError):
            read_plan(tmp_path / "none", name, companions=[tmp_path / "no map"], system="hex:n=3")
    with pytest.raises(InputError, match="No such file"):
        read_plan(tmp_path / "none")
