"""Relative observations: what each entry says, that all are bounded, local and without a place."""

import gc
import weakref
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import goal_sets, observe
from cubepath.agents.local.relative import (
    NEVER,
    RelativeLayout,
    RelativeObserver,
    Sites,
    _spread,
    relative_layout,
    relative_observer,
    sites_of,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FAR, FIRST_LABEL, Scene, System
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from samples.local_families import LOCAL_FAMILIES
from samples.space import SPACE
from samples.switches import RING, Ring

PLANE = ["hex:n=5", "hex-open:n=4", "hex-tunnel", "sliding:p=2,q=1,n=4", "arm:n=5", "arm-free"]
LATTICES = [*PLANE, *SPACE]
SPECS = [
    *dict.fromkeys((*LOCAL_FAMILIES, *LATTICES)),
    "agv:graph=K5,n=3",
    "agv:graph=P7,n=3",
    "agv-labelled:graph=C6,n=4",
    "agv-labelled:graph=grid4x3,n=5",
    "ring",
]

Relative = NDArray[np.float32]


@cache
def scene_of(spec: str) -> Scene:
    """Return the scene of a specification, the same each time."""
    return RING.build("ring", {"n": "6"}) if spec == "ring" else scene_from_spec(spec)


def played(scene: Scene, choices: Sequence[int]) -> World:
    """Return the world after rounds in which all modules take legal actions by these choices."""
    world = World(scene, seed=1)
    for choice in choices:
        actions = {}
        for module in range(len(scene.start)):
            legal = world.observe(module)["action_mask"].nonzero()[0]
            actions[module] = int(legal[(choice + 7 * module) % len(legal)])
        world.step(actions)
    return world


def numbers_of(world: World, module: int) -> NDArray[np.int32]:
    """Return the absolute observation of a module."""
    return world.observe(module)["observation"].astype(np.int32, copy=False)


def observer_of(scene: Scene, module: int) -> RelativeObserver:
    """Return what makes the relative observations of a module."""
    return relative_observer(scene.system, scene.goals[module] if scene.goals else ())


def relative(world: World, module: int) -> Relative:
    """Return the relative observation of a module."""
    return observer_of(world.scene, module).of(numbers_of(world, module))


worlds = st.builds(
    played, st.sampled_from(SPECS).map(scene_of), st.lists(st.integers(0, 50), max_size=6)
)


def place_of_goal(system: System, goal: Site) -> Site:
    """Return the place of a goal, which in a labelled system is one."""
    return goal if system.labels is not None else system.place_of(goal)


def moves_to_goal(system: System, site: Site, goals: frozenset[Site]) -> int | None:
    """Return how many moves of its own a lone module is from its nearest goal, by a search."""
    seen, queue = {site}, deque([(site, 0)])
    while queue:
        here, moves = queue.popleft()
        if here in goals or system.place_of(here) in goals:
            return moves
        for move in system.moves_at(here):
            if move.target not in seen:
                seen.add(move.target)
                queue.append((move.target, moves + 1))
    return None


def sign_of_move(system: System, site: Site, target: Site, goals: frozenset[Site]) -> int:
    """Return 1 if a move leads nearer to the goals, -1 if farther away, else 0."""
    before, after = (moves_to_goal(system, each, goals) for each in (site, target))
    if before == after:
        return 0
    if before is None:
        return 1
    return 1 if after is not None and after < before else -1


def told(world: World, module: int) -> list[float]:
    """Return the relative observation, from the state and the docstring of the layout."""
    system, site, goals = world.scene.system, world.sites[module], goal_sets(world.scene)[module]
    place = system.place_of(site)
    found: list[float] = [float(place in goals or site in goals)]
    if system.catalogue is not None:
        size = system.catalogue.lattice.dimension
        cells = {cell[size:] for each in system.catalogue.generators for cell in each.support}
        assert isinstance(site, tuple)
        found += [float(site[size:] == orbit) for orbit in sorted(cells)] if len(cells) > 1 else []
    found += [float(isinstance(site, tuple) and site[-1] == each) for each in system.letters]
    if system.dimension:
        own = map(Fraction, system.coordinates(place))
        spots = [system.coordinates(place_of_goal(system, goal)) for goal in goals]
        axes = zip(own, zip(*spots, strict=True), strict=True)
        way = [sum(map(Fraction, axis)) / Fraction(len(goals)) - x for x, axis in axes]
        found += [float(step / (1 + max(map(abs, way)))) for step in way]
    if system.catalogue is None:
        found += [
            0.0 if move is None else sign_of_move(system, site, move.target, goals)
            for move in system.moves(site)
        ]
    on = {system.place_of(each): each for each in (*world.sites, *system.filled)}
    for near in system.sensed(place):
        occupant = None if near is None else on.get(near)
        free = near is not None and occupant is None and system.has_place(near)
        kinds = [free, False, occupant in system.filled and occupant is not None, False]
        letters = [False] * len(system.letters)
        if occupant is not None and not kinds[2]:
            code = system.code_of(occupant)
            if system.letters and code >= FIRST_LABEL:
                letters[code - FIRST_LABEL] = True
            else:
                kinds[1] = True
        kinds[3] = not any(kinds + letters)
        wanted = near is not None and (near in goals or occupant in goals)
        found += map(float, [*kinds, *letters, wanted])
    return found


@given(worlds, st.integers(0, 99))
def test_each_entry_says_what_the_layout_has(world: World, number: int) -> None:
    """All as found from the state by another way; numbers are bounded, and as many as announced."""
    module = number % len(world.sites)
    seen, layout = relative(world, module), relative_layout(world.scene.system)
    assert seen.dtype == np.float32
    assert seen.shape == (layout.length,) == (observer_of(world.scene, module).length,)
    assert (layout.low <= seen).all()
    assert (seen <= 1).all()
    expected = np.array(told(world, module), np.float32)
    way = layout.parts["way"]
    assert np.allclose(seen[way], expected[way], atol=1e-6, rtol=0)
    expected[way] = seen[way]  # one rounding more or less
    assert seen.tolist() == expected.tolist()


def translated(scene: Scene, by: tuple[int, ...]) -> Scene:
    """Return a scene on a lattice with everything in it moved."""
    system = scene.system
    assert isinstance(system, LatticeSystem)
    lattice = system.catalogue.lattice

    def put(sites: Sequence[Site] | frozenset[Site]) -> list[Site]:
        return [lattice.shift(lattice.check(site), by) for site in sites]

    moved = LatticeSystem(
        system.catalogue,
        workspace=None if system.workspace is None else put(system.workspace),
        filled=put(system.filled),
        empty=put(system.empty),
    )
    return replace(
        scene,
        system=moved,
        start=tuple(put(scene.start)),
        goal=None if scene.goal is None else frozenset(put(scene.goal)),
        goals=tuple(tuple(put(goals)) for goals in scene.goals),
    )


@settings(max_examples=15)
@given(
    st.sampled_from(LATTICES).map(scene_of),
    st.lists(st.integers(0, 50), max_size=4),
    st.tuples(*[st.integers(-(10**6), 10**6).map(lambda half: 2 * half)] * 3),
)
def test_a_scene_looks_the_same_wherever_it_lies(
    scene: Scene, choices: list[int], by: tuple[int, int, int]
) -> None:
    """Moved as a whole, on a lattice, it is the same to the last bit; the absolute one is not."""
    way = by[: scene.system.dimension]
    here, there = played(scene, choices), played(translated(scene, way), choices)
    for module in range(len(scene.start)):
        assert relative(here, module).tobytes() == relative(there, module).tobytes()
        same = numbers_of(here, module).tolist() == numbers_of(there, module).tolist()
        assert same == (not any(way))


@given(worlds, st.integers(0, 99))
def test_what_is_out_of_sight_changes_nothing(world: World, number: int) -> None:
    """Where modules stand that are not sensed, what numbers and goals they have: all the same."""
    system, module = world.scene.system, number % len(world.sites)
    site = world.sites[module]
    near = system.sensed(system.place_of(site))
    occupants = {system.place_of(each): each for each in world.sites}
    left = {place: occupants[place] for place in near if place in occupants}
    goals = world.scene.goals[module]
    seen = observe(system, site, left, goals=frozenset(goals))
    numbers = seen["observation"].astype(np.int32, copy=False)
    fresh = RelativeObserver(system, RelativeLayout(system), goals)
    assert fresh.of(numbers).tobytes() == relative(world, module).tobytes()


def test_an_example_on_a_map() -> None:
    """Round a wall: the way leads through it, and the moves that lead nearer lead round it."""
    free = [(x, y) for x in range(3) for y in range(3) if (x, y) not in ((1, 0), (1, 1))]
    edges = [
        (a, b)
        for a in free
        for b in free
        if sum(abs(p - q) for p, q in zip(a, b, strict=True)) == 1
    ]
    system = GraphSystem(free, edges, compass=True)
    scene = Scene("wall", "", system, start=((0, 0), (2, 1)), goals=(((2, 0),), ((0, 1),)))
    world = World(scene, seed=0)
    first = [0, 2 / 3, 0, 0, 1, 0, 0]
    expected = np.array([*first, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, *[0, 0, 0, 1, 0] * 2], np.float32)
    assert relative(world, 0).tolist() == expected.tolist()
    world.step({0: 2})
    assert world.sites[0] == (0, 1)
    parts = relative_layout(system).parts
    assert relative(world, 0)[parts["nearer"]].tolist() == [0, 1, 0, -1]
    assert relative(world, 1)[parts["nearer"]].tolist() == [0, 1, 0, -1]
    assert relative(world, 1)[parts["way"]].tolist() == np.array([-2 / 3, 0], np.float32).tolist()


def test_nothing_leads_nearer_where_no_goal_can_be_reached() -> None:
    """Nor without goals; a way is told all the same where places have coordinates."""
    system = GraphSystem([0, 1, 2, 3], [(0, 1), (2, 3)])
    seen = observe(system, 0, {}, goals=frozenset({2}))["observation"].astype(np.int32, copy=False)
    for goals in ((2,), ()):
        assert relative_observer(system, goals).of(seen)[1:2].tolist() == [0]
    assert relative_observer(system, (1,)).of(seen)[1:2].tolist() == [1]
    hexagons = scene_from_spec("hex:n=3").system
    numbers = observe(hexagons, (5, 7), {}, goals=frozenset())["observation"]
    found = relative_observer(hexagons, ()).of(numbers.astype(np.int32, copy=False))
    assert found[:3].tolist() == [0, 0, 0]


def test_labels_make_no_difference() -> None:
    """A labelled module looks like any other to others; its own goals alone are its own."""
    scene = scene_from_spec("agv-labelled:graph=P6,n=3")
    plain = scene_from_spec("agv:graph=P6,n=3")
    one, other = World(scene, seed=0), World(plain, seed=0)
    for module in range(3):
        assert relative(one, module).tobytes() == relative(other, module).tobytes()


def listed(scale: float, positions: Sequence[int] = (0, 1, 3)) -> str:
    """Return a file of a module on a path of three places, drawn at some scale."""
    drawn = ", ".join(f"[{place}, {scale * place}, {scale}]" for place in positions)
    moves = "\n".join(
        f'[[listed.moves]]\ngenerator = "go"\nat = {a}\nsupport = [{a}, {b}]\ntrace = [{a}, {b}]\n'
        f"before = [{a}]\nafter = [{b}]\ngoes = [[{a}, {b}]]"
        for a, b in ((0, 1), (1, 3))
    )
    return (
        'format = "cubepath-system-1"\nstart = [0]\ngoal = [3]\ngoals = [[3]]\n'
        f'[listed]\ndrawing = "graph"\npositions = [{drawn}]\n{moves}\n'
    )


@pytest.mark.parametrize("scale", [1.0, 1e-3, 250.0, 2.0**900])
def test_positions_of_a_picture_count_in_moves(scale: float) -> None:
    """However large a picture is, its moves are one long on average."""
    scene = scene_from_toml(listed(scale), "text")
    assert scene.system.dimension == 2
    seen = relative(World(scene, seed=0), 0)
    assert np.allclose(seen[:4], [0, 2 / 3, 0, 1], atol=1e-6, rtol=0)


@pytest.mark.parametrize("text", [listed(0.0), listed(1.0, (0, 1)), listed(1.0, ())])
def test_a_picture_without_a_scale_tells_no_way(text: str) -> None:
    """All places at one spot, a place without position, no positions: no entries."""
    system = scene_from_toml(text, "text").system
    assert (system.dimension, system.coordinates(0)) == (0, ())
    parts = relative_layout(system).parts
    assert parts["way"].start == parts["way"].stop < parts["nearer"].stop


def test_a_goal_that_is_too_far_away_is_refused() -> None:
    """Where a lattice has no end a goal may lie anywhere, but not beyond all observations."""
    system = scene_from_spec("hex:n=3").system
    relative_observer(system, ((FAR - 1, 0),))
    with pytest.raises(InputError, match=r"goal \(2147483648, 0\): too far away to tell the way"):
        relative_observer(system, ((FAR, 0),))


@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), max_size=30),
    st.sets(st.integers(0, 8)),
)
def test_compiled_and_in_python_moves_are_counted_the_same(
    pairs: list[tuple[int, int]], goals: set[int]
) -> None:
    """On any graph, to any number of goals; and as a search from each vertex counts them."""
    edges = [*((a, b) for a, b in pairs if a != b), (0, 1)]
    system = GraphSystem(range(9), edges)
    sites = Sites(system)
    found = sites.hops(goals)
    expected = [moves_to_goal(system, vertex, frozenset(goals)) for vertex in range(9)]
    assert found.tolist() == [NEVER if each is None else each for each in expected]
    again = np.full(9, NEVER, np.uint16)
    again[sorted(goals)] = 0
    queue = np.array([*sorted(goals), *[0] * (9 - len(goals))], np.int64)
    _spread(sites._first, sites._sources, again, queue, len(goals))
    assert again.tolist() == found.tolist()


@pytest.mark.parametrize("places", [NEVER + 1, NEVER // 2 + 1])
def test_of_too_many_sites_nothing_says_what_leads_nearer(places: int) -> None:
    """A table for each goal would be large: the entries are left out. Letters count, too."""
    system = Ring(places)
    assert sites_of(system) is None
    parts = RelativeLayout(system).parts
    assert parts["nearer"].start == parts["nearer"].stop == 1 + len(system.letters)


@pytest.mark.thorough
def test_modules_with_the_same_goals_share_what_they_know() -> None:
    """And nobody keeps it longer than the system and its modules."""
    scene = scene_from_spec("agv:graph=grid3x3,n=2")
    one, other = (observer_of(scene, module) for module in (0, 1))
    assert one is not other
    assert one is observer_of(scene, 0)
    assert one.layout is other.layout is relative_layout(scene.system)
    kept = weakref.ref(one.layout)
    del one, other, scene
    gc.collect()
    assert kept() is None
