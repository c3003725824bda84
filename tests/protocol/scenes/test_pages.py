"""Pages: keys, arithmetic, maps, shapes and several scenes, expanded into plain scenes."""

from pathlib import Path

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.page_keys import number_of
from cubepath.protocol.scenes.random_scenes import Stream, grown_shape, walked
from cubepath.protocol.scenes.specs import files_in, scene_from_spec, spec_within
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml

HEAD = 'format = "cubepath-system-1"\n'
SLIDES = """
[lattice]
name = "squares"
WALLS
[[lattice.generators]]
name = "slide-{turn}-{side}"
symmetry = "all"
before = '''
a .
# #'''
after = '''
. a
# #'''
"""


def page(top: str, scenes: str = "", *, walls: str = "", values: str = "") -> Scene:
    text = HEAD + top + SLIDES.replace("WALLS", walls) + scenes
    return scene_from_toml(text, "page.toml", values)


def test_a_map_says_where_all_is() -> None:
    """The first mark of the lowest row is the origin; modules count in reading order."""
    scene = page("map = '''\n. o . \n# @ x\n. ! .'''")
    assert scene.start == ((1, 2), (1, 1))
    assert scene.goal == frozenset([(1, 1), (2, 1)])
    assert scene.goals == (((1, 1), (2, 1)),) * 2
    assert scene.system.filled == frozenset([(0, 1)])
    assert scene.system.empty == frozenset([(1, 0)])
    assert scene.system.has_place((2, 2))
    assert not scene.system.has_place((3, 0))


def test_a_map_without_other_cells_has_no_border() -> None:
    """The workspace is the whole lattice then."""
    assert page("map = 'o o x x'").system.has_place((99, 99))


def test_shapes_follow_the_keys() -> None:
    """A line, a box, a random shape and the end of a walk, with arithmetic over the keys."""
    keys = "[keys]\nn = {default = 2, most = 9}\n"
    line = page("start = {line = '2*n - 1', from = [0, 'n'], along = [0, -1]}\n" + keys)
    assert line.start == ((0, 2), (0, 1), (0, 0))
    assert page("start = {box = ['n', 2]}\n" + keys, values="n=3").start[-1] == (2, 1)
    moves = {"start": "start = {random = 'n + 3', seed = 'seed'}\n", "goal": "goal = {walk = 9}\n"}
    scene = page("".join(moves.values()) + keys + "seed = 3\n")
    lattice = scene.system.catalogue
    assert lattice is not None
    assert scene.start == grown_shape(5, lattice.lattice, Stream("start shape", 3))
    assert scene.goals[0] == walked(scene.system, scene.start, 9, Stream("walk", 0))


def test_a_scene_is_chosen_by_its_key() -> None:
    """The first is the default; what a scene leaves out is that of the page."""
    scenes = "[scenes.one]\nstart = [[0, 0]]\n[scenes.two]\nfilled = '#'\nstart = [[5, 5]]\n"
    walls = "empty = [[9, 9]]"
    assert page("", scenes, walls=walls).start == ((0, 0),)
    two = page("", scenes, walls=walls, values="scene=two")
    assert two.start == ((5, 5),)
    assert two.system.filled | two.system.empty == {(0, 0), (9, 9)}


def test_modules_of_a_page_know_its_goal() -> None:
    """Also where it is a list; other files say that by `goals`."""
    goal = "start = [[0, 0]]\ngoal = [[1, 0]]\n"
    assert page(goal).goals == page("", f"[scenes.a]\n{goal}").goals == (((1, 0),),)


def test_a_page_survives_as_a_plain_file() -> None:
    """Processes and recordings get the expanded scene, its rule included."""
    scene = page("rule = 'metropolis'\nmap = 'o o x x'")
    again = scene_from_toml(scene_to_toml(scene), "again")
    assert scene_to_toml(again) == scene_to_toml(scene)
    assert again.rule == "metropolis"


def test_names_of_pages_have_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path takes values as a family does, and stays in the folder of a sweep's file."""
    monkeypatch.chdir(tmp_path)
    text = HEAD + "start = {line = 'n'}\n" + SLIDES.replace("WALLS", "") + "[keys]\nn = 4\n"
    Path("mine.toml").write_text(text)
    assert len(scene_from_spec("mine.toml:n=7").start) == 7
    assert scene_from_spec("./mine.toml").spec == "./mine.toml"
    assert files_in("mine.toml:n=7") == ["mine.toml"]
    assert spec_within(tmp_path, "mine.toml:n=7") == f"{tmp_path}/mine.toml:n=7"
    with pytest.raises(InputError, match="leads out of"):
        spec_within(tmp_path, "../mine.toml:n=7")
    with pytest.raises(
        InputError, match=r"^mine.toml: keys: cannot read 'm=7', expected KEY=VALUE with"
    ):
        scene_from_spec("mine.toml:m=7")


@pytest.mark.parametrize(
    ("text", "value"), [("2*n - 1", 7), ("-n // 3", -2), ("(n + 1) % 3", 2), (" 7 ", 7)]
)
def test_arithmetic_is_of_whole_numbers(text: str, value: int) -> None:
    """The operators are those of Python."""
    assert number_of(text, {"n": 4}, "line") == value


@pytest.mark.parametrize(
    "text",
    [
        *("m", "2**n", "n / 2", "abs(n)", "1.5", "n // 0", "n if n else 1", "True", "(" * 150),
        *("0x10", "1_0", "1or 2", "n" * 190 + "!"),
    ],
)
def test_arithmetic_is_nothing_else(text: str) -> None:
    """All that is no such number is refused in one line."""
    with pytest.raises(InputError, match="line: expected a whole number or arithmetic over n with"):
        number_of(text, {"n": 4}, "line")


@pytest.mark.parametrize(
    ("top", "scenes", "values", "message"),
    [
        ("start = {line = 'm'}", "", "", "start: line: expected a whole number or arithmetic"),
        ("start = {line = 0}", "", "", "start: line: expected 1 to 100000 cells, found 0"),
        ("start = {box = [2]}", "", "", "start: box: expected 2 numbers, found 1"),
        ("start = {}", "", "", "start: expected one of line, box, random"),
        ("start = {line = 2, box = [2, 2]}", "", "", "start: expected one of line, box, random"),
        ("goal = {walk = 2, line = 2}", "", "", "goal: expected one of line, box, random"),
        ("map = 3", "", "", "map: nothing is drawn"),
        (
            "start = [[0, 0]]\ngoal = {walk = 9, sed = 1}",
            "",
            "",
            r"goal: unknown key 'sed' \(did you mean 'seed'\?\), expected one of line, box",
        ),
        ("map = 'o o'\nstart = [[0, 0]]", "", "", "line 2, map: it has 'start', which the page"),
        ("map = '''\no\n %'''", "", "", "line 4, column 2, map: unknown mark '%', expected"),
        ("[keys]\nn = 4", "", "n=x", r"n=x: expected a whole number of at least 0"),
        ("[keys]\nn = 4.5", "", "", "keys: n: default: expected a whole number, found a decimal"),
        ("[keys]\nn = {default = 1, min = 1}", "", "", "keys: n: unknown key 'min'"),
        ("[keys]\nn = {default = 1, least = 2}", "", "", "keys: n: default: expected 2 to"),
        ("map = 'o'\n[keys]\no = 4", "", "", "keys: 'o' is unused, expected it in a number of"),
        ("start = 4", "", "", "start: expected a list of sites, a drawing or a shape, found 4"),
        ("strat = 4", "[scenes.a]\nmap = 'o'", "", "unknown key 'strat'"),
        ("[latice]\nname = 'cubes'", "", "", r"unknown key 'latice' \(did you mean 'lattice'\?"),
        ("start = [[0, 0]]", "", "n=4", "keys: cannot read 'n=4', expected no keys"),
        ("[keys]\nscene = 4", "", "", "keys: 'scene': expected a name of letters that is not res"),
        ("[keys]\nin = 4", "", "", "keys: 'in': expected a name of letters that is not reserved"),
        ("", "[scenes.a]\nmap = 'o'", "scene=b", "scene=b: expected one of a"),
        ("rule = 'mine.py:MINE'\nmap = 'o'", "", "", "rule: expected the name of a rule, not of a"),
        ("rule = '/rules/mine'\nmap = 'o'", "", "", "rule: expected the name of a rule, not of a"),
        ("", "[scenes.a]\nmap = 'o o x'", "", "scene a: .*2 modules start, the goal has 1 site"),
        ("", "[scenes.a]\nmaps = 'o'", "", "scenes.a: unknown key 'maps', expected one of start"),
        ("", "[scenes.a]\nmap = 'oz'", "", "line 16, column 9, scenes.a: map: unknown mark 'z'"),
        ("", "[scenes.a]\ngoal = [\n[1, 1]\n]\nmap = 'oz'", "", "line 19, column 9, scenes.a: map"),
    ],
)
def test_mistakes_of_pages_are_one_line(top: str, scenes: str, values: str, message: str) -> None:
    """They name the key, and the line and the column of a drawing."""
    with pytest.raises(InputError, match=f"^page.toml: {message}"):
        page(top, scenes, values=values)


def test_generators_that_are_wrong_are_all_found() -> None:
    """The error has the first, with its line, and how many more there are."""
    wrong = SLIDES.replace("WALLS", "") + SLIDES.partition("WALLS\n")[2]
    wrong += "\n[[lattice.generators]]\nname = 'b'\nbefore = 'a.'\nafter = '.a'\n"
    wrong += "\n[[lattice.generators]]\nname = 'c'\nbefore = 'a .'\nafters = '. a'\n"
    with pytest.raises(InputError, match=r"line 15: generator .* equals .* \(and 2 more\)"):
        scene_from_toml(HEAD + "start = [[0, 0]]" + wrong, "page.toml")


def test_what_is_no_page_has_no_keys_and_no_traceback() -> None:
    """A graph, generators that are no tables, and other files are refused in one line."""
    graph = "start = ['a']\n[graph]\nvertices = ['a', 'b']\nedges = [['a', 'b']]\n"
    with pytest.raises(InputError, match=r"^yard.toml: keys: cannot read 'n=3', expected no keys$"):
        scene_from_toml(HEAD + graph, "yard.toml", "n=3")
    numbers = "start = [[0, 0]]\n[lattice]\nname = 'squares'\ngenerators = [1]\n"
    with pytest.raises(InputError, match=r"none.toml: lattice: generators\[0\]: expected a"):
        scene_from_toml(HEAD + numbers, "none.toml")
    for text, what in (
        ("", "no scene, expected format = 'cubepath-system-1'"),
        ("format = 'page'", "format is 'page', expected 'cubepath-system-1'"),
    ):
        with pytest.raises(InputError, match=f"^none.toml: {what}"):
            scene_from_toml(text, "none.toml")
