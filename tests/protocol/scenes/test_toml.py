"""Scenes as TOML: what `start`, `goal` and `goals` may hold, and how they are refused."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml

YARD = """
format = "cubepath-system-1"
name = "yard"
start = [["gate", 0], ["dock", 1]]
goal = [["dock", 0], ["lane", 1]]
goals = GOALS

[graph]
vertices = ["gate", "lane", "dock", 1]
edges = [["gate", "lane"], ["lane", "dock"], ["dock", "gate"], ["dock", 1]]
labels = 2
"""
FLOOR = """
format = "cubepath-system-1"
start = START
goals = GOALS

[lattice]
name = "squares"
filled = [[0, 0], [1, 0]]

[[lattice.generators]]
name = "crawl"
support = [[0, 0], [1, 0], [0, -1], [1, -1]]
trace = [[0, 0], [1, 0]]
before = [[0, 0], [0, -1], [1, -1]]
after = [[1, 0], [0, -1], [1, -1]]
goes = [[[0, 0], [1, 0]]]
"""
HOUSE = """
format = "cubepath-system-1"
name = "house"
start = START
goal = GOAL
goals = GOALS

[triangulation]
points = [[0, 0], [4, 0], [4, 3], [2, 5], [0, 3]]
"""


def scene(text: str, **values: str) -> Scene:
    for key, value in values.items():
        text = re.sub(rf"\b{key.upper()}\b", value, text)
    return scene_from_toml(text, "file.toml")


def test_goals_of_labelled_vehicles_are_vertices() -> None:
    """Each vehicle knows its own, by the vertex alone."""
    assert scene(YARD, goals='[["dock"], ["lane"]]').goals == (("dock",), ("lane",))


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ('[["dock"], [7]]', r"goals\[1\]: 7: an obstacle or no place"),
        ('[["dock"], ["dock"]]', r"goals\[1\]: 'dock' is the goal of module 0 too"),
        ('[["dock"]]', r"goals\[1\]: 'dock' is the goal of module 0 too"),
        ('[["dock", "dock"], ["lane"]]', r"goals\[0\]: 'dock' stands twice"),
        ('[["dock"], ["lane"], ["gate"]]', "2 modules, goals for 3 of them"),
        ('[[["dock", 0]], ["lane"]]', "no place, expected a place without a label"),
        ('[["dock"], [true]]', r"goals\[1\]: a site is a JSON .* found true"),
        ('[["dock"], ["gate"]]', r"goals\[1\]: \('gate', 1\) is no site of the goal"),
        ('[["lane"], ["dock"]]', r"goals\[0\]: \('lane', 0\) is no site of the goal"),
        ('[["dock", "lane"]]', r"goals\[0\]: \('lane', 0\) is no site of the goal"),
        ('[["dock"], [1979-05-27]]', r"goals\[1\]: a site is a JSON number, string or list"),
        (
            '["dock", "lane"]',
            r"goals\[0\]: expected a list of sites for each module, or one .* found 'dock'",
        ),
        ('[["dock"], [{a = 1}]]', r"goals\[1\]: a site is a JSON number, string or list"),
    ],
)
def test_goals_of_labelled_vehicles_that_cannot_be(goals: str, message: str) -> None:
    """Count, known places, doubles and types are refused, with the module's number."""
    with pytest.raises(InputError, match=message) as error:
        scene(YARD, goals=goals)
    assert str(error.value).startswith("file.toml: ")


@pytest.mark.parametrize(
    ("start", "goals", "message"),
    [
        ("[[0, 1]]", "[[[1, 0]]]", r"goals\[0\]: \(1, 0\): an obstacle or no place"),
        ("[[0, 1]]", "[[[2, 1], [2.5, 1]]]", r"\(2.5, 1\): a site of lattice squares is 2 integ"),
        ("[[0, 1]]", "[[[2, 1], [true, 1]]]", r"goals\[0\]: a site is .* found true"),
        ("[[true, 1]]", "[]", r"start: a site is .* found true"),
        ('["here"]', "[]", "module starts at 'here': a site of lattice squares is 2 integers"),
        ("[[0, 2147483648]]", "[]", "is too far away, expected numbers to 1073741824"),
    ],
)
def test_cells_that_cannot_be(start: str, goals: str, message: str) -> None:
    """A cell is integers, also where the lattice is open, and a goal is no obstacle."""
    with pytest.raises(InputError, match=message):
        scene(FLOOR, start=start, goals=goals)


TWO = "[[0, 1], [2, 1]]"


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ("[[[3, 1]], [[3, 1]]]", r"goals\[1\]: \(3, 1\) is the goal of module 0 too"),
        ("[[[99, 99]], [[5, 1]]]", r"goals\[0\]: \(99, 99\) is no site of the goal"),
        ("[[[3, 1], [4, 1]]]", r"goals\[0\]: \(4, 1\) is no site of the goal"),
        ("[[[3, 1]], [[5, 1], [4, 1]]]", r"goals\[1\]: \(4, 1\) is no site of the goal"),
    ],
)
def test_goals_that_contradict_the_goal(goals: str, message: str) -> None:
    """What a module knows is of the goal, and no two modules are sent to one place."""
    text = FLOOR.replace("goals =", "goal = [[3, 1], [5, 1]]\ngoals =")
    with pytest.raises(InputError, match=message):
        scene(text, start=TWO, goals=goals)


@pytest.mark.parametrize(
    "goals",
    [
        "[[[5, 1]], [[3, 1]]]",
        "[[[5, 1], [3, 1]]]",
        "[[[3, 1]], []]",
        "[[[3, 1]], [[3, 1], [5, 1]]]",
    ],
)
def test_goals_that_are_part_of_the_goal(goals: str) -> None:
    """A module may know all of it, its own site, or nothing."""
    text = FLOOR.replace("goals =", "goal = [[3, 1], [5, 1]]\ngoals =")
    assert len(scene(text, start=TWO, goals=goals).goals) == 2


@pytest.mark.parametrize(
    ("goal", "goals", "message"),
    [
        ("", "[[[1, 3], [2, 4]]]", r"goals\[0\]: edges \[1, 3\] and \[2, 4\] cross"),
        ("", "[[[1, 3]], [[2, 4]]]", r"goals: edges \[1, 3\] and \[2, 4\] cross"),
        ("goal = [[1, 3], [1, 4]]", "[[[1, 3], [2, 4]]]", r"\(2, 4\) is no site of the goal"),
        ("goal = [[1, 3], [1, 4]]", "[[[0, 2]]]", r"goals\[0\]: \(0, 2\) is no site of the goal"),
    ],
)
def test_goals_that_are_no_triangulation(goal: str, goals: str, message: str) -> None:
    """With a goal and without one, edges that cross are refused."""
    with pytest.raises(InputError, match=message):
        scene(HOUSE.replace("goal = GOAL", goal), start=WHOLE, goals=goals)


def test_goals_of_places_with_letters_may_leave_out_the_letter() -> None:
    """A place alone stands for its site of the goal, and another letter is refused."""
    words = scene_from_spec("words:relations=ab~ba,word=ab,goal=ba")
    for goals in (((0, "b"),), ((1, "a"),)), ((0,), (1,)):
        assert replace(words, goals=goals).goal == words.goal
    with pytest.raises(InputError, match=r"goals\[0\]: \(0, 'a'\) is no site of the goal"):
        replace(words, goals=(((0, "a"),), ((1, "a"),)))


@pytest.mark.parametrize(
    ("text", "goals"),
    [
        (YARD, (("dock",), ("lane",))),
        (FLOOR.replace("goals", "goal = [[3, 1], [5, 1]]\ngoals"), (((3, 1), (5, 1)),) * 2),
        (HOUSE.replace("GOAL", "[[1, 3], [1, 4], [0, 1]]", 1), (((1, 3), (1, 4)),) * 2),
    ],
)
def test_without_goals_each_module_knows_the_whole_goal(
    text: str, goals: tuple[tuple[Site, ...], ...]
) -> None:
    """With labels that is its own vertex; `goals = []` says that no module knows any of it."""
    start = WHOLE if text.startswith(HOUSE[:50]) else TWO
    known = scene(text.replace("goals = GOALS\n", ""), start=start)
    assert known.goals == goals
    for each in (known, replace(known, goals=())):
        assert scene_from_toml(scene_to_toml(each), "again").goals == each.goals


def test_booleans_are_no_labels() -> None:
    """A label is a whole number: true is not 1."""
    with pytest.raises(InputError, match=r"a site is a JSON .* found true"):
        scene(YARD.replace('["dock", 1]', '["dock", true]', 1), goals="[]")
    with pytest.raises(InputError, match=r"with label below 2, found ..lane., .b"):
        scene(YARD.replace('["lane", 1]]', '["lane", "b"]]').replace("goals = GOALS\n", ""))


def test_there_are_no_more_labels_than_vertices() -> None:
    """Each has a vertex of its own, and a move reads all labels at its ends: others cost memory."""
    assert scene(YARD.replace("labels = 2", "labels = 4"), goals="[]")
    with pytest.raises(InputError, match="labels=1073741824: expected at most 4, one a vertex"):
        scene(YARD.replace("labels = 2", f"labels = {1 << 30}"), goals="[]")


@pytest.mark.parametrize("depth", [65, 500, 50_000])
def test_lists_in_lists_are_refused(depth: int) -> None:
    """However deep they are, as a site and in a label, in one line that names the file."""
    deep = "[" * depth + "]" * depth
    for text in (FLOOR.replace("START", f"[{deep}]"), YARD.replace('"yard"', deep)):
        with pytest.raises(InputError, match=r"file\.toml: ") as error:
            scene(text, goals="[]")
        assert "\n" not in str(error.value)


WHOLE = "[[0, 2], [1, 0], [1, 2], [2, 3], [3, 0], [3, 4], [0, 4]]"


def test_start_is_a_whole_triangulation_or_its_diagonals() -> None:
    """Edges of the hull may be left out, and either end may come first, in all three keys."""
    fan = "[[1, 3], [1, 4]]"
    short = scene(HOUSE, start="[[0, 2], [0, 3]]", goal=fan, goals=f"[{fan}]")
    turned = "[[3, 1], [4, 1], [0, 1]]"
    told = scene(HOUSE, start=WHOLE, goal=turned, goals=f"[{turned}]")
    assert (told.start, told.goal, told.goals) == (short.start, short.goal, short.goals)


POINTS = '{"points_x": [0, 4, 4, 2, 0], "points_y": [0, 0, 3, 5, 3], "triangulations": [%s]}'


@pytest.mark.parametrize(
    "edges",
    [
        "[[0, 2], [0, 3]]",
        "[[2, 0], [3, 0]]",
        WHOLE,
        "[[0, 2], [2, 0]]",
        "[[0, 2], [0, 3], [0, 3]]",
        "[[0, 2], [0, 5]]",
        "[[0, 2], [0, 0]]",
        "[[0, 2], [1, 3]]",
        "[[0, 2]]",
    ],
)
def test_toml_and_json_agree_on_triangulations(tmp_path: Path, edges: str) -> None:
    """What one takes the other takes as the same modules; what one refuses the other refuses."""
    path = tmp_path / "house.json"
    path.write_text(POINTS % edges)

    def modules(read: str) -> set[object] | None:
        try:
            if read == "json":
                return set(scene_from_spec(f"triangulation:points={path},start=0,goal=0").start)
            return set(scene(HOUSE, start=edges, goal="[[1, 3], [1, 4]]", goals="[]").start)
        except InputError:
            return None

    assert modules("json") == modules("toml")
