"""Systems listed move by move: neighbourhoods follow from the list; what cannot be is refused."""

import pickle
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from cubepath.agents.environments.world import World
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FIRST_LABEL, Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import read_scene, scene_from_toml, scene_to_toml
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.listed import TabledSystem


def slide(name: str, *motion: tuple[Site, Site], reads: Iterable[Site] = ()) -> Move:
    """Return a move of these modules, which reads that further sites are off."""
    before, after = zip(*motion, strict=True)
    trace = [*before, *after]
    return Move(Action([*trace, *reads], trace, before, after, label=name), name, name, motion)


def train() -> TabledSystem:
    """Return places in a row on which one module pulls another along, and a far reader of one."""
    return TabledSystem(
        [
            slide("pull", (1, 2), (0, 1)),
            slide("step", (2, 3), reads=[4]),
            slide("far", (8, 9), reads=[3]),
            slide("apart", (20, 21)),
        ],
        fixed=[50],
        drawing="graph",
    )


BUILD: dict[str, Callable[[], TabledSystem]] = {"train": train}


def tabled(spec: str) -> TabledSystem:
    system = BUILD[spec]() if spec in BUILD else scene_from_spec(spec).system
    if isinstance(system, FlipSystem):
        return system.whole
    assert isinstance(system, TabledSystem)
    return system


SYSTEMS = [
    "train",
    "polygon:n=7",
    "triangulation:n=9",
    "words",
    "words:presentation=free2",
    "assembly",
]


def moves_at(system: TabledSystem, place: Site) -> list[Move]:
    """Return all moves, either way, whose mover is at a place, from the list alone."""
    both = [
        move
        for one in system.listed
        for move in (one, replace(one, motion=tuple((b, a) for a, b in one.motion)))
    ]
    return [move for move in both if system.place_of(move.source) == place]


def along(system: TabledSystem, move: Move) -> set[Site]:
    return {system.place_of(source) for source, _ in move.motion[1:]}


@pytest.mark.parametrize("spec", SYSTEMS)
def test_sensing_is_the_supports_of_the_own_moves(spec: str) -> None:
    """Sensed are exactly the places of the supports of a module's moves, less its own."""
    system = tabled(spec)
    for place in system.places:
        needed = {
            system.place_of(site)
            for move in moves_at(system, place)
            for site in move.action.support
        } - {place}
        sensed = system.sensed(place)
        assert {near for near in sensed if near is not None} == needed
        assert len(sensed) == system.sense_slots
        for other in system.places:
            assert (other in system.listeners(place)) == (place in system.sensed(other))


@pytest.mark.parametrize("spec", SYSTEMS)
def test_reach_is_where_competitors_and_followers_stand(spec: str) -> None:
    """Exactly the movers whose moves do not commute with one's own, and who is taken along.

    Whom one's moves take along and whose moves take one along both count.
    """
    system = tabled(spec)
    moves = {place: moves_at(system, place) for place in system.places}
    for place, mine in moves.items():
        expected = set().union(*(along(system, move) for move in mine))
        for other, theirs in moves.items():
            if any(place in along(system, move) for move in theirs) or any(
                not commute(one.action, their.action) for one in mine for their in theirs
            ):
                expected.add(other)
        assert set(system.reach(place)) == expected - {place}
    assert system.reach_slots == max(1, *(len(system.reach(place)) for place in system.places))


@pytest.mark.parametrize("spec", SYSTEMS)
def test_a_module_may_propose_what_starts_at_its_site(spec: str) -> None:
    """Moves by site are those of the list, each from both of its ends, and found by name."""
    system = tabled(spec)
    found = {
        (move.generator, move.at, move.motion)
        for place in system.places
        for site in (place, *((place, letter) for letter in system.letters))
        for move in system.moves(site)
        if move is not None
    }
    expected = {(m.generator, m.at, m.motion) for p in system.places for m in moves_at(system, p)}
    assert found == expected
    assert len(expected) == 2 * len(system.listed)
    for move in system.listed:
        assert system.action(move.generator, move.at) == move.action


@pytest.mark.parametrize("spec", SYSTEMS)
def test_sites_are_numbers_and_codes_and_back(spec: str) -> None:
    """A site comes back from its numbers, and what is on at a place from what the place shows."""
    system = tabled(spec)
    for place in set(system.places) - system.filled:
        lettered: list[Site] = [(place, letter) for letter in system.letters]
        for site in lettered or [place]:
            numbers = system.encode_site(site)
            assert len(numbers) == system.site_size
            assert system.decode_site(numbers, None) == site
            assert system.site_at(place, system.code_of(site)) == site
            assert system.code_of(site) < system.codes
        assert system.has_place(place)
        assert system.site_at(place, 0) is None
    for place in system.filled:
        assert not system.has_place(place)
        assert system.site_at(place, system.background(place)) == place


def test_letters_have_codes_in_their_order() -> None:
    """The code of a letter is its number in the list, after those that every system has."""
    system = tabled("assembly")
    codes = [system.code_of(((0, 0), letter)) for letter in ("open", "placed", "welded")]
    assert codes == [FIRST_LABEL, FIRST_LABEL + 1, FIRST_LABEL + 2]


def test_a_module_that_is_taken_along() -> None:
    """One move changes the places of both; the observation shows the goal at the sensed place."""
    scene = Scene("train", "", train(), (1, 0), frozenset([2, 1]), ((2,), (1,)))
    world = World(scene, seed=0)
    # Its own place; place 0 with a module on it; place 2, free and of the goal; no further place.
    assert world.observe(0)["observation"].tolist() == [1, 0, 1, 0, 0, 1, 3, 0, 3, 0]
    world.step({0: 1})
    assert world.sites == [2, 1]


# What is refused.

build: Callable[..., TabledSystem] = partial(TabledSystem, drawing="graph")
GOOD = slide("good", (1, 2))


@pytest.mark.parametrize(
    ("moves", "keywords", "message"),
    [
        ([], {}, "at least one move, found none"),
        ([GOOD, slide("good", (2, 3))], {}, "good at 'good' stands twice among the moves"),
        ([GOOD], {"drawing": "oil"}, "drawing 'oil': expected one of chords, letters"),
        ([GOOD], {"letters": ["a", "b", "a"]}, "letter 'a' stands twice"),
        ([GOOD], {"fixed": [2]}, "good: its trace holds 2, which is fixed"),
        ([GOOD], {"letters": ["a"], "fixed": [(7, "a")]}, r"\(7, 'a'\) is fixed and has a letter"),
        ([replace(GOOD, motion=())], {}, "good: 'goes' must take every site"),
        ([replace(GOOD, motion=((1, 3),))], {}, "good: 'goes' must take every site"),
        ([replace(GOOD, motion=((1, 2), (1, 2)))], {}, "good: 'goes' must take every site"),
        ([GOOD], {"positions": {1: (0.0, float("nan"))}}, "position of 1: expected two numbers"),
        ([GOOD], {"drawing": "chords"}, "chord 1: expected a pair of points that have positions"),
        (
            [slide("flip", ((0, 2), (1, 3)))],
            {"drawing": "chords", "positions": {0: (0, 0), 1: (1, 0), 2: (1, 1)}},
            r"chord \(1, 3\): expected a pair of points",
        ),
    ],
)
def test_lists_that_are_refused(moves: list[Move], keywords: dict[str, Any], message: str) -> None:
    """Each contradiction is named."""
    with pytest.raises(InputError, match=message):
        build(moves, **keywords)


@pytest.mark.parametrize(
    ("generator", "at", "message"),
    [
        ("push", 1, "unknown generator 'push', expected one of apart, far, pull, step"),
        ("pull", 1, "generator 'pull': there is no move at 1"),
    ],
)
def test_moves_that_are_not_listed(generator: str, at: Site, message: str) -> None:
    """The error says whether the generator or the place is unknown."""
    with pytest.raises(InputError, match=message):
        train().action(generator, at)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (((0, "a"),), "start: no letter is on at place 1"),
        (((0, "a"), (1, "b"), (1, "a")), "starts twice at 1"),
        (((0, "a"), (1, "z")), "start: no letter is on at place 1"),
        (((0, "a"), (1, "b"), (2, "a")), "an obstacle or no place"),
    ],
)
def test_starts_without_one_letter_at_each_place(start: tuple[Site, ...], message: str) -> None:
    """Each place has one letter, of those that there are."""
    system = scene_from_spec("words:relations=ab~ba,word=ab").system
    with pytest.raises(InputError, match=message):
        Scene("own", "", system, start)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        (((0, 1), (2, 1)), None, "own: start: label 1 is on twice, at 0 and 2"),
        (((0, 0), (2, 1)), {(0, 1), (1, 1)}, "own: goal: label 1 is on twice"),
        (((0, 0), (2, 2)), None, "label below 2"),
    ],
)
def test_labels_on_twice_are_refused(
    start: tuple[Site, ...], goal: set[Site] | None, message: str
) -> None:
    """No two labelled vehicles have one label, at the start or at the goal."""
    system = GraphSystem(range(3), [(0, 1), (1, 2)], labels=2)
    with pytest.raises(InputError, match=message):
        Scene("own", "", system, start, None if goal is None else frozenset(goal))


def test_labels_in_another_order() -> None:
    """The label of a vehicle is that of its start, whatever its number."""
    system = GraphSystem(range(4), [(0, 1), (1, 2), (2, 3)], labels=2)
    scene = Scene("own", "", system, ((0, 1), (3, 0)))
    from cubepath.agents.rules.actor import actors_for
    from cubepath.agents.rules.registry import rule_named

    world = World(scene, seed=0)
    actors = actors_for(scene, rule_named("random", system), seed=0, hesitate=0.0)
    for _ in range(6):
        world.step({m: actors[m].act(world.observe(m)).action for m in (0, 1)})
    assert {site[1] for site in world.sites if isinstance(site, tuple)} == {0, 1}


# Files.

TOML = """
format = "cubepath-system-1"
name = "kiln"
start = [["door", "open"], ["fire", "cold"]]

[listed]
letters = ["open", "shut", "cold", "hot"]
fixed = ["mains"]
drawing = "letters"
positions = [["door", 0, 0.5], ["fire", 1, 0]]

[[listed.moves]]
generator = "swing"
at = "door"
support = [["door", "open"], ["door", "shut"], ["fire", "hot"]]
trace = [["door", "open"], ["door", "shut"]]
before = [["door", "open"]]
after = [["door", "shut"]]
goes = [[["door", "open"], ["door", "shut"]]]

[[listed.moves]]
generator = "burn"
at = "fire"
support = [["fire", "cold"], ["fire", "hot"], ["door", "open"], "mains", "smoke", "flue"]
trace = [["fire", "cold"], ["fire", "hot"]]
before = [["fire", "cold"], "mains"]
after = [["fire", "hot"], "mains"]
free = ["smoke", "flue"]
guards = [["smoke", "flue"]]
goes = [[["fire", "cold"], ["fire", "hot"]]]
"""


def test_a_list_is_the_same_after_a_file() -> None:
    """Letters, fixed sites, positions, free sites and guards are read and written."""
    scene = scene_from_toml(TOML, "text")
    system = scene.system
    assert isinstance(system, TabledSystem)
    assert system.letters == ("open", "shut", "cold", "hot")
    assert system.filled == {"mains"}
    assert system.positions == {"door": (0.0, 0.5), "fire": (1.0, 0.0)}
    burn = system.action("burn", "fire")
    assert burn.free == {"smoke", "flue"}
    assert burn.guards == {("smoke", "flue")}
    for again in (scene_from_toml(scene_to_toml(scene), "t"), pickle.loads(pickle.dumps(scene))):  # noqa: S301
        assert scene_to_toml(again) == scene_to_toml(scene)
        assert isinstance(again.system, TabledSystem)
        assert again.system.by_name == system.by_name
        assert again.system.moves(("door", "shut")) == system.moves(("door", "shut"))


def changed(edit: Callable[[dict[str, Any]], object]) -> str:
    table = tomllib.loads(TOML)
    edit(table)
    return tomli_w.dumps(table)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda t: t.pop("listed"), r"expected one of the tables \[lattice\], \[graph\]"),
        (lambda t: t.update(graph={"vertices": [], "edges": []}), "expected one of the tables"),
        (lambda t: t["listed"].pop("moves"), "listed: key 'moves' is missing"),
        (lambda t: t["listed"].update(moves=[]), "a system has at least one move"),
        (lambda t: t["listed"].update(colour="red"), "listed: unknown key 'colour'"),
        (lambda t: t["listed"].update(drawing="oil"), "drawing 'oil': expected one of"),
        (lambda t: t["listed"]["letters"].append("hot"), "letter 'hot' stands twice"),
        (
            lambda t: t["listed"]["moves"][0].pop("goes"),
            r"listed: moves\[0\]: key 'goes' is missing",
        ),
        (lambda t: t["listed"]["moves"][0].update(goes=[]), "swing at \"door\": 'goes' must"),
        (lambda t: t["listed"]["moves"][0].update(trace=["roof"]), "the trace holds 'roof'"),
        (
            lambda t: t["listed"]["moves"][0].update(after=[["fire", "hot"]]),
            r"differ at \('fire', 'hot'\), which is off the trace",
        ),
        (lambda t: t["listed"]["moves"].append(t["listed"]["moves"][0]), "stands twice among"),
        (lambda t: t["start"].pop(), "start: no letter is on at place 'fire'"),
        (lambda t: t["start"].append("mains"), "'mains': an obstacle or no place"),
    ],
)
def test_files_that_are_refused(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], message: str
) -> None:
    """One line that names the file and the thing."""
    path = tmp_path / "kiln.toml"
    path.write_text(changed(edit))
    with pytest.raises(InputError, match=message) as error:
        read_scene(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
