"""Systems and scenes: neighbourhoods follow from the catalogue; what cannot be is refused."""

import pickle
from importlib import import_module
from pathlib import Path

import pytest

from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes import families
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.families.own import OWN_FAMILIES, OWN_KINDS
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import graph_from_name
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem
from samples.space import SPACE, STICKS

SPECS = [
    "hex:n=4",
    "hex-open:n=3",
    "agv:graph=grid4x3,n=3",
    "agv:graph=K5,n=2",
    "agv-labelled:graph=C6,n=3",
    "arm:n=4",
    "hex:n=3,base=1",
    "sliding:n=3",
    "arm-free:n=3",
    "arms:n=1",
    "polygon:n=7",
    "triangulation:n=9",
    "words:presentation=free2",
    "assembly:n=3",
    STICKS,
]
WITH_MANY_MOVES = [
    *SPECS,
    *(pytest.param(spec, marks=pytest.mark.thorough) for spec in ("compression:n=3", *SPACE[:2])),
]


def places_near(system: System, start: Site) -> list[Site]:
    """Return the places that are within a few reaches of a start."""
    found = {start: None}
    for _ in range(2):
        for place in list(found):
            found.update(dict.fromkeys(system.reach(place)))
    return [place for place in found if system.has_place(place)]


def sites_at(system: System, place: Site) -> list[Site]:
    if isinstance(system, TabledSystem):
        return [place, *((place, letter) for letter in system.letters)]
    return [place] if system.labels is None else [(place, label) for label in range(system.labels)]


def has_walls(system: System) -> bool:
    """Tell whether some moves of the catalogue are missing at some places of a lattice."""
    return isinstance(system, LatticeSystem) and (
        system.workspace is not None or bool(system.obstacles)
    )


@pytest.mark.parametrize("spec", WITH_MANY_MOVES)
def test_sensing_covers_the_supports_of_the_own_moves_and_no_more(spec: str) -> None:
    """The sensed places are those of the supports of a module's moves, less its own place."""
    scene = scene_from_spec(spec)
    system = scene.system
    for place in places_near(system, system.place_of(scene.start[0])):
        needed = {
            system.place_of(site)
            for mine in sites_at(system, place)
            for move in system.moves(mine)
            if move is not None
            for site in move.action.support
        } - {place}
        sensed = {near for near in system.sensed(place) if near is not None}
        if has_walls(system):
            assert needed <= sensed
        else:
            assert needed == sensed


@pytest.mark.parametrize("spec", SPECS)
def test_listening_is_sensing_seen_from_the_other_side(spec: str) -> None:
    """A place hears of exactly the places that it senses."""
    scene = scene_from_spec(spec)
    system = scene.system
    places = places_near(system, system.place_of(scene.start[0]))
    for place in places:
        for other in places:
            assert (other in system.listeners(place)) == (place in system.sensed(other))


@pytest.mark.parametrize("spec", WITH_MANY_MOVES)
def test_reach_is_where_a_competitor_can_stand(spec: str) -> None:
    """Within reach is exactly who could make a move that does not commute with one's own."""
    scene = scene_from_spec(spec)
    system = scene.system
    here = system.place_of(scene.start[0])
    mine = [m for site in sites_at(system, here) for m in system.moves(site) if m]
    along = {system.place_of(source) for move in mine for source, _ in move.motion[1:]}
    for other in places_near(system, here):
        if other == here:
            continue
        theirs = [m for site in sites_at(system, other) for m in system.moves(site) if m]
        conflict = any(not commute(a.action, b.action) for a in mine for b in theirs)
        if conflict:
            assert other in system.reach(here)
        elif not has_walls(system) and other not in along:
            assert other not in system.reach(here)


def hex_distance(one: tuple[int, int], other: tuple[int, int]) -> int:
    q, r = one[0] - other[0], one[1] - other[1]
    return max(abs(q), abs(r), abs(q + r))


def test_hexagons_sense_two_and_claim_three_far() -> None:
    """Every support cell lies within distance 2 of the mover, every competitor within 3."""
    system = scene_from_spec("hex").system
    cells = [(q, r) for q in range(-5, 6) for r in range(-5, 6)]
    within = {far: {c for c in cells if 0 < hex_distance(c, (0, 0)) <= far} for far in (2, 3)}
    assert set(system.sensed((0, 0))) == within[2]
    assert set(system.reach((0, 0))) == within[3]


@pytest.mark.parametrize("spec", WITH_MANY_MOVES)
def test_a_scene_is_the_same_after_a_file(spec: str) -> None:
    """Every built-in system can be written as TOML, read back, and pickled, unchanged."""
    scene = scene_from_spec(spec)
    text = scene_to_toml(scene)
    for again in (scene_from_toml(text, "text"), pickle.loads(pickle.dumps(scene))):  # noqa: S301
        assert scene_to_toml(again) == text
        assert (again.start, again.goal, again.goals) == (scene.start, scene.goal, scene.goals)
        assert again.spec == scene.spec
        for site in scene.start:
            assert again.system.moves(site) == scene.system.moves(site)


def moves_near(system: System, start: Site) -> list[tuple[Site, Move]]:
    """Return the moves at the places within a few reaches, with the site of the mover."""
    return [
        (site, move)
        for place in places_near(system, system.place_of(start))
        for site in sites_at(system, place)
        for move in system.moves(site)
        if move is not None
    ]


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", [*SPECS, "hex-connected", "hex-tunnel"])
def test_equal_actions_are_one_object(spec: str) -> None:
    """The moves from either end and the action by its name hold the same object, pickled too."""
    scene = scene_from_spec(spec)
    for system in (scene.system, pickle.loads(pickle.dumps(scene.system))):  # noqa: S301
        known: dict[tuple[str, Site, Action], Action] = {}
        for site, move in moves_near(system, scene.start[0]):
            assert move.source == site
            assert system.action(move.generator, move.at) is move.action
            named = known.setdefault((move.generator, move.at, move.action), move.action)
            assert named is move.action
            back = system.move_named(move.target, move.generator, move.at)
            assert back is not None
            assert back.action is move.action
            assert back.motion == tuple((after, before) for before, after in move.motion)
        assert known


@pytest.mark.few(8)
@pytest.mark.parametrize("spec", [*SPECS, "hex-connected", "hex-tunnel"])
def test_a_move_is_found_by_its_name_and_by_its_action(spec: str) -> None:
    """By site, generator and place it is that move; by its action all moves that make it."""
    scene = scene_from_spec(spec)
    system = scene.system
    found = moves_near(system, scene.start[0])
    by_action: dict[Action, list[Move]] = {}
    for site, move in found:
        assert system.move_named(site, move.generator, move.at) == move
        assert system.move_named(site, "no such", move.at) is None
        assert system.move_named(site, move.generator, ("nowhere",)) is None
        by_action.setdefault(move.action, []).append(move)
    known = {site for site, _ in found}
    for action, moves in by_action.items():
        making = system.moves_of(action)
        assert [move for move in making if move.source in known] == sorted(
            moves, key=lambda move: list(in_order(known)).index(move.source)
        )
        assert {end for move in making for end in (move.source, move.target)} <= action.trace
        assert {(m.target, m.source) for m in making} == {(m.source, m.target) for m in making}


def test_no_move_makes_an_action_that_is_not_of_the_system() -> None:
    """Neither one of other local states nor one that would move an obstacle or leave."""
    scene = scene_from_spec("hex:n=3,base=1")
    move = next(move for move in scene.system.moves((0, 0)) if move is not None)
    one, other = move.action.ends
    trace = move.action.trace
    assert scene.system.moves_of(Action(trace, trace, one & trace, other & trace)) == ()
    walled = LatticeSystem(page_catalogue("hexagons-1"), empty=[move.target])
    assert walled.moves_of(move.action) == ()


def test_obstacles_may_lie_in_a_support_but_never_in_a_trace() -> None:
    """A filled obstacle serves as a pivot and never moves."""
    system = LatticeSystem(page_catalogue("hexagons-1"), filled=[(0, 0)])
    moves = [move for move in system.moves((1, 0)) if move is not None]
    assert moves
    assert all((0, 0) not in move.action.trace for move in moves)
    assert any((0, 0) in move.action.support for move in moves)
    with pytest.raises(InputError, match="would move an obstacle"):
        system.action("pivot-0-left", (0, 0))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hexx", "unknown system 'hexx'"),
        ("hex:m=3", "cannot read 'm=3', expected KEY=VALUE with a key of n, bend, shift"),
        ("hex:n", "cannot read 'n'"),
        ("hex:n=three", "n=three: expected a whole number"),
        ("hex:n=\uff11\uff12", "n=\uff11\uff12: expected a whole number"),
        ("hex:n=1_0", "n=1_0: expected a whole number"),
        ("hex:n= 3", "n= 3: expected a whole number"),
        ("hex:n=3\n", r"^n='3\\n': expected a whole number"),
        ("hex:n=", "n=: expected a whole number"),
        ("hex:n=" + "9" * 5000, "9: expected a whole number"),
        ("agv:graph=K\uff15", "K\uff15: No such file"),
        ("hex:n=0", "n=0: expected a whole number of at least 1"),
        ("hex:bend=45", "bend=45: expected one of"),
        ("hex:n=3,bend=0,shift=4", "shift=4: expected at most n=3"),
        ("hex:base=2", "base=2: expected a whole number of at least 0, at most 1"),
        ("hex:base=1,bend=0", "bend=0: with base=1 the goal begins next to the base"),
        ("arm:n=3,goal=xy", "goal=xy: expected 3 letters"),
        ("agv:graph=K1", "graph=K1: K takes at least 2"),
        ("agv:graph=K3,n=4", "n=4: the graph has 3 vertices"),
        ("agv:graph=no/such.map", "no/such.map: No such file"),
        ("nowhere.toml", "nowhere.toml: No such file"),
    ],
)
def test_a_spec_that_cannot_be_read_is_refused(spec: str, message: str) -> None:
    """Each mistake in a spec is named with what was expected."""
    with pytest.raises(InputError, match=message) as error:
        scene_from_spec(spec)
    assert "\n" not in str(error.value)


def test_a_number_may_have_a_sign_and_zeros_before_it() -> None:
    """It is written in ASCII digits, and nothing stands around it."""
    for text in ("3", "+3", "03"):
        assert len(scene_from_spec(f"hex:n={text}").start) == 3
    with pytest.raises(InputError, match=r"^n=-3: expected a whole number of at least 1"):
        scene_from_spec("hex:n=-3")


@pytest.mark.parametrize("family", all_families())
def test_every_family_has_a_default_scene_with_a_goal(family: str) -> None:
    """A bare name is a scene with modules that are not yet at the goal; `compression` has none."""
    scene = scene_from_spec(family)
    assert not scene.reached(scene.start)
    assert family == "compression" if scene.goal is None else scene.reached(scene.goal)


@pytest.mark.parametrize("family", ["hex", "hex-open"])
@pytest.mark.parametrize("bend", [60, 120, -60, -120])
def test_hexagons_with_a_base(family: str, bend: int) -> None:
    """The base is an obstacle beside module 0; the goal begins beside it, at this angle."""
    scene = scene_from_spec(f"{family}:n=3,base=1,bend={bend}")
    base = (-1, 0)
    assert scene.system.filled == {base}
    assert scene.start == scene_from_spec(f"{family}:n=3").start

    def turned(cell: tuple[int, int], sixths: int) -> tuple[int, int]:
        q, r = cell[0] - base[0], cell[1] - base[1]
        for _ in range(sixths % 6):
            q, r = -r, q + r
        return q + base[0], r + base[1]

    assert scene.goals[0] == tuple(turned(cell, bend // 60) for cell in scene.start)  # type: ignore[arg-type]


def test_parallel_edges_are_one() -> None:
    """Naming an edge twice, either way round, adds nothing."""
    once = GraphSystem([0, 1, 2], [(0, 1), (1, 2)])
    twice = GraphSystem([0, 1, 2], [(0, 1), (1, 0), (1, 2), (1, 2)])
    assert once.edges == twice.edges
    assert once.moves(1) == twice.moves(1)


@pytest.mark.parametrize(
    ("edges", "message"), [([(0, 0)], "loop"), ([(0, 9)], "no vertex"), ([], "at least one edge")]
)
def test_a_graph_that_is_none_is_refused(edges: list[tuple[Site, Site]], message: str) -> None:
    """Loops, loose ends and edgeless graphs are refused."""
    with pytest.raises(InputError, match=message):
        GraphSystem([0, 1], edges)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((), None, "no module"),
        (((0, 0), (0, 0)), None, "starts twice"),
        (((5, 5),), None, "an obstacle or no place"),
        (((0, 0),), {(5, 5)}, "an obstacle or no place"),
        (((0, 0),), {(0, 0), (1, 0)}, "1 modules start, the goal has 2"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(
    start: tuple[Site, ...], goal: set[Site] | None, message: str
) -> None:
    """Modules start on free places of their own, and as many as the goal has sites."""
    system = LatticeSystem(page_catalogue("hexagons-1"), filled=[(5, 5)])
    with pytest.raises(InputError, match=message):
        Scene("test", "", system, start, None if goal is None else frozenset(goal))


def test_labelled_vehicles_read_every_label_and_write_their_own() -> None:
    """The support holds every label at both ends, the trace the mover's alone."""
    system = scene_from_spec("agv-labelled:graph=P3,n=2").system
    action = system.action("edge", (0, 1, 1))
    assert action.support == {(v, label) for v in (0, 1) for label in (0, 1)}
    assert action.trace == {(0, 1), (1, 1)}


def test_named_graphs_have_their_sizes() -> None:
    """Complete, cycle, path, star and grid graphs have the edges that their names say."""
    sizes = {"K5": (5, 10), "C6": (6, 6), "P4": (4, 3), "S4": (5, 4), "grid3x2": (6, 7)}
    for name, (vertices, edges) in sizes.items():
        graph = graph_from_name(name)
        assert (len(graph.vertices), len(graph.edges)) == (vertices, edges)


def test_families_are_found_by_the_names_that_they_have() -> None:
    """Those of the project are loaded by name: each has that name, and a class by its table."""
    for name, family in OWN_FAMILIES.items():
        assert family.name == name
        assert OWN_KINDS[family.system.table] is family.system
    folder = Path(str(families.__file__)).parent
    modules = (import_module(f"{families.__name__}.{each.stem}") for each in folder.glob("*.py"))
    named = {each.name for found in modules for each in getattr(found, "FAMILIES", ())}
    assert named == OWN_FAMILIES.keys()
