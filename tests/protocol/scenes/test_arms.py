"""Arms that attach, slide the point where they are joined, and detach stay arms at their bases."""

from collections import Counter

import numpy as np
import pytest

from cubepath.agents.environments.world import World
from cubepath.agents.rendering.edges import MARK
from cubepath.agents.rendering.pictures import draw_pixels, draw_text
from cubepath.protocol.core.actions import Action, State, apply
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.arms import arms_catalogue, arms_system
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.listed import TabledSystem
from oracles.complexes import actions_at, states_of

Edge = tuple[int, int, int]
Vertex = tuple[int, int]


def read(state: State) -> tuple[set[Edge], set[Vertex]]:
    """Return the edges that are on and the vertices that are marked."""
    edges = {site for site in state if len(site) == 3}  # type: ignore[arg-type]
    marked = {site[0] for site in state if site[1] == "marked"}  # type: ignore[index]
    return edges, marked  # type: ignore[return-value]


def ends_of(edge: Edge) -> tuple[Vertex, Vertex]:
    x, y, axis = edge
    return (x, y), (x + (axis == 0), y + (axis == 1))


def arms_in(state: State, bases: frozenset[Site]) -> list[list[Edge]]:
    """Walk each arm from its base to its end or to a mark; what is not walked is an error."""
    edges, marked = read(state)
    left = set(edges)
    arms = []
    for base in sorted(bases):  # type: ignore[type-var]
        left.remove(base)  # type: ignore[arg-type]
        at, arm = ends_of(base)[1], list[Edge]()  # type: ignore[arg-type]
        while at not in marked:
            onward = [edge for edge in left if at in ends_of(edge)]
            if not onward:
                break
            (edge,) = onward  # at most two edges meet at a vertex
            left.remove(edge)
            arm.append(edge)
            at = next(end for end in ends_of(edge) if end != at)
        arms.append(arm)
    assert not left
    return arms


def check(scene: Scene, state: State) -> tuple[int, ...]:
    """Check that the state is arms at their bases, joined at marks; return their lengths."""
    edges, marked = read(state)
    met = Counter(end for edge in edges for end in ends_of(edge))
    assert max(met.values()) <= 2
    assert all(met[vertex] == 2 for vertex in marked)
    lettered = [site[0] for site in state if site[1] in ("free", "marked")]  # type: ignore[index]
    assert sorted(lettered) == sorted(site[0] for site in scene.start if len(site) == 2)  # type: ignore[arg-type,index]
    arms = arms_in(state, scene.system.filled)
    assert sum(map(len, arms)) == sum(len(site) == 3 for site in scene.start)  # type: ignore[arg-type]
    bases = sorted(scene.system.filled)  # type: ignore[type-var]
    tips = Counter(tip_of(arm, base) for arm, base in zip(arms, bases, strict=True))  # type: ignore[arg-type]
    # Two arms end at each mark, and nowhere else together.
    assert {vertex for vertex, count in tips.items() if count > 1} == marked
    assert max(tips.values()) <= 2
    return tuple(map(len, arms))


def tip_of(arm: list[Edge], base: Edge) -> Vertex:
    at = ends_of(base)[1]
    for edge in arm:
        at = next(end for end in ends_of(edge) if end != at)
    return at


@pytest.mark.parametrize(
    ("spec", "states", "lengths"),
    [
        ("arms:n=1", 21, {(0, 2), (1, 1), (2, 0)}),
        ("arms", 128, {(0, 4), (1, 3), (2, 2), (3, 1), (4, 0)}),
        ("arms:n=1,m=3", 97, None),
        pytest.param("arms:n=3", 706, None, marks=pytest.mark.slow),
        pytest.param("arms:m=3", 3157, None, marks=pytest.mark.nightly),
    ],
)
def test_every_state_is_arms_at_their_bases(
    spec: str, states: int, lengths: set[tuple[int, ...]] | None
) -> None:
    """Exhaustively: no segment lost, no third one at a vertex, two arms' ends at every mark."""
    scene = scene_from_spec(spec)
    found = states_of(scene)
    known = {check(scene, state) for state in found}
    assert len(found) == states
    assert lengths is None or known == lengths
    assert (scene.goal or frozenset()) | scene.system.filled in found


def after(scene: Scene, state: State, kind: str) -> list[State]:
    """Return the states after each admissible action of this kind."""
    actions = actions_at(scene, state)
    return [apply(action, state) for action in actions if action.label.startswith(kind)]


def test_how_arms_trade_a_segment() -> None:
    """One turns its end inward, the other attaches to it, the mark slides, either one detaches."""
    scene = scene_from_spec("arms")
    turned = apply(scene.system.action("rotate-ru", (0, 1)), scene.start_state)
    (joined,) = after(scene, turned, "attach")
    assert read(joined)[1] == {(1, 1)}
    assert arms_in(joined, scene.system.filled) == [[(0, 0, 1), (0, 1, 0)], [(2, 0, 1), (1, 1, 0)]]
    slid = {check(scene, state): state for state in after(scene, joined, "slide")}
    assert set(slid) == {(1, 3), (3, 1)}
    assert read(slid[3, 1])[1] == {(2, 1)}
    apart = after(scene, slid[3, 1], "attach")
    assert apart
    assert all(not read(state)[1] and check(scene, state) == (3, 1) for state in apart)


def test_marked_points_are_not_torn() -> None:
    """While arms are joined, the mark stays in a flip, slides along one edge, or is undone."""
    scene = scene_from_spec("arms:n=2")
    joined = [state for state in states_of(scene) if read(state)[1]]
    assert joined
    seen = set()
    for state in joined:
        edges, marks = read(state)
        ((x, y),) = marks
        for action in actions_at(scene, state):
            edges_then, marks_then = read(apply(action, state))
            kind = action.label.split("-")[0]
            seen.add(kind)
            if kind == "flip":
                assert marks_then == marks
            elif kind == "slide":
                assert marks_then <= {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)}
                assert edges_then == edges
            else:
                assert kind == "attach"
                assert not marks_then
    assert seen == {"flip", "slide", "attach"}


def test_generators() -> None:
    """Two flips, four quarter turns, three attachments for each way of turning, 18 slides."""
    kinds = Counter(each.name.split("-")[0] for each in arms_catalogue().generators)
    assert kinds == {"flip": 2, "rotate": 4, "attach": 24, "slide": 18}
    for each in arms_catalogue().generators:
        vertices = [cell for cell in each.trace if cell[2] >= 2]
        assert (
            len(vertices)
            == {"flip": 0, "rotate": 0, "attach": 2, "slide": 4}[each.name.split("-")[0]]
        )


def test_an_attachment_in_full() -> None:
    """The end turns from up to the right, where the other arm's last segment goes straight on."""
    attach = arms_catalogue().by_name["attach-urr"]
    up, right, other, free, marked = (0, 0, 1), (0, 0, 0), (1, 0, 0), (1, 0, 2), (1, 0, 3)
    assert set(attach.trace) == {up, right, free, marked}
    assert set(attach.before) == {up, other, free}
    assert set(attach.after) == {right, other, marked}
    left_behind = {(0, 1, 0), (0, 1, 1), (-1, 1, 0)}
    beside = {(1, 0, 1), (1, -1, 1)}
    assert set(attach.support) - set(attach.trace) == {other} | left_behind | beside


def test_a_slide_in_full() -> None:
    """Both arms go on past the segment that they trade; no segment moves."""
    slide = arms_catalogue().by_name["slide-uru"]
    before, traded, behind = (0, -1, 1), (0, 0, 0), (1, 0, 1)
    assert {cell for cell in slide.support if cell[2] < 2} == {before, traded, behind}
    assert set(slide.before) == {before, traded, behind, (0, 0, 3), (1, 0, 2)}
    assert set(slide.after) == {before, traded, behind, (0, 0, 2), (1, 0, 3)}


def test_no_move_is_listed_twice() -> None:
    """The same contents never stand under two names."""
    system = scene_from_spec("arms").system
    assert isinstance(system, TabledSystem)
    actions = [move.action for move in system.listed]
    assert len(set(actions)) == len(actions)


def marked_world() -> tuple[World, World]:
    """Return a world before and one after the arms of one segment have been joined."""
    worlds = World(scene_from_spec("arms:n=2"), seed=0), World(scene_from_spec("arms:n=2"), seed=0)
    for world in worlds:
        step(world, "rotate")
    step(worlds[1], "attach")
    return worlds


def step(world: World, kind: str) -> Move:
    """Make the first admissible move of this kind."""
    for module, site in enumerate(world.sites):
        for action in map(int, world.observe(module)["action_mask"].nonzero()[0][1:]):
            move = world.scene.system.moves(site)[action - 1]
            assert move is not None
            if move.generator.startswith(kind):
                world.step({module: action})
                return move
    raise AssertionError(f"no {kind} is admissible")


def test_vertices_are_agents_that_stay() -> None:
    """Attaching and sliding change the letters of vertices; each agent keeps its place."""
    world = marked_world()[1]
    system = world.scene.system
    places = [system.place_of(site) for site in world.scene.start]
    vertices = [number for number, place in enumerate(places) if len(place) == 2]  # type: ignore[arg-type]
    for kind in ("slide", "slide", "attach"):
        before = list(world.sites)
        step(world, kind)
        changed = [n for n in vertices if world.sites[n] != before[n]]
        assert len(changed) == (2 if kind == "slide" else 1)
        assert all(system.place_of(world.sites[n]) == places[n] for n in vertices)


@pytest.mark.slow
def test_pictures_show_marks() -> None:
    """In text a marked vertex is a star, in pixels a disc; free vertices show nothing."""
    apart, joined = marked_world()
    assert MARK not in draw_text(apart.scene, apart.sites)
    text = draw_text(joined.scene, joined.sites)
    assert text.count(MARK) == 1
    line = next(line for line in text.splitlines() if MARK in line)
    assert line[line.index(MARK) - 3 :].startswith(("---*", "===*"))
    one, other = (draw_pixels(world.scene, world.sites) for world in (apart, joined))
    assert (one != other).any()
    alone = [site for site in joined.sites if site[1] != "marked"]  # type: ignore[index]
    without = draw_pixels(joined.scene, alone)
    rows, columns = np.nonzero((without != other).any(axis=2))
    assert np.ptp(rows) == pytest.approx(np.ptp(columns), abs=2)


def test_what_is_near_follows_from_the_moves() -> None:
    """A place senses the places of its own moves' supports; edges that are not there are none."""
    system = scene_from_spec("arms:n=1").system
    assert isinstance(system, TabledSystem)
    for place in system.places:
        own = [(place, "free"), (place, "marked")] if len(place) == 2 else [place]  # type: ignore[arg-type]
        supports = {
            system.place_of(site)
            for site in own
            for move in system.moves(site)
            if move is not None
            for site in move.action.support
        }
        assert {near for near in system.sensed(place) if near is not None} == supports - {place}
    assert not system.has_place((5, 5, 0))


def test_a_workspace_need_not_be_a_rectangle() -> None:
    """Moves are placed where their trace lies, with the edges that there are."""
    corner = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 1)]
    system = arms_system(corner, [(0, -1, 1)])
    names = {(move.generator, move.at) for move in system.listed}
    assert ("flip-rising", (0, 0)) in names
    assert ("flip-rising", (1, 0)) not in names
    known = {move.action for move in system.listed}
    assert all(isinstance(action, Action) for action in known)
    assert {site for action in known for site in action.support if site == (1, 0, 0)} == set()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("arms:d=3", "d=3: expected an even number, or the arms can never meet"),
        ("arms:m=1", "m=1: expected a whole number of at least 2"),
        ("arms:n=3,h=3", "h=3: expected a whole number of at least 4"),
        ("arms:d=40,h=40", "m=2,d=40,h=40: more than 400 vertices"),
    ],
)
def test_a_spec_that_cannot_be_is_refused(spec: str, message: str) -> None:
    """Each bad value is named with the reason."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)


def test_a_segment_on_a_base_is_refused() -> None:
    """A base is an obstacle."""
    scene = scene_from_spec("arms:n=1")
    start: tuple[Site, ...] = ((0, -1, 1), *scene.start[1:])
    with pytest.raises(InputError, match=r"module starts at \(0, -1, 1\): an obstacle or no place"):
        Scene("own", "", scene.system, start)
