"""The rule tswap without rounds: goals are never lost or doubled, each commit comes nearer."""

import random
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.free_world import ActionResult, FreeWorld
from cubepath.agents.environments.rollouts import FreeRollout
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import Choice
from cubepath.agents.rules.tswap import TSWAP
from cubepath.agents.rules.tswap_free import NOTHING, GoalRegister
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.graph import GraphSystem
from samples.free_plays import Pace, paces
from samples.vehicle_scenes import cycle, scene_on


class Goals:
    """Checks after every commit that the goals are there, and come nearer."""

    def __init__(self, scene: Scene) -> None:
        assert isinstance(scene.system, GraphSystem)
        self.scene = scene
        self.index = scene.system.index
        self.roads = roads_of(scene.system.graph)
        self.rotations = 0
        self.left: int | None = None

    def __call__(self, world: FreeWorld, acted: ActionResult) -> None:
        """Look at all registers."""
        if acted.moved is None:
            return
        held: list[int] = []
        left = 0
        for module, note in enumerate(world.registers):
            place = self.index[world.sites[module]]
            own = [self.index[self.scene.goals[module][0]]]
            if note:
                register = GoalRegister(*note)
                own = [goal for goal in (register.goal, register.carried) if goal != NOTHING]
            held += own
            left += sum(self.roads.distances(goal)[place] ** 2 for goal in own)
        assert sorted(held) == sorted(self.index[goal] for goal in self.scene.goal or ())
        written = [note for *_, note in acted.moved.notes if note is not None]
        self.rotations += any(note[0] == NOTHING for note in written)
        posts = acted.moved.generator is None and len(written) == 1
        if self.left is not None:
            assert left == self.left if posts else left < self.left
        self.left = left


def played(scene: Scene, pace: Pace, *, max_cycles: int = 4000) -> tuple[FreeRollout, Goals]:
    goals = Goals(scene)
    return pace.play(scene, TSWAP, max_cycles=max_cycles, watch=goals), goals


@st.composite
def crowded(draw: st.DrawFn) -> Scene:
    """Return vehicles on a random connected graph, most of them with few empty vertices or none.

    It is a tree, or rings and ears, with chords.
    """
    size = draw(st.integers(2, 9))
    if size > 2 and draw(st.booleans()):
        edges = cycle(size)
        for _ in range(draw(st.integers(0, 2))):
            ear = [draw(st.integers(0, size - 1)), *range(size, size + draw(st.integers(1, 5)))]
            size += len(ear) - 1
            edges += pairwise(ear)
            edges.append((ear[-1], draw(st.integers(0, ear[1] - 1))))
    else:
        edges = [(draw(st.integers(0, vertex - 1)), vertex) for vertex in range(1, size)]
    pairs = st.tuples(st.integers(0, size - 1), st.integers(0, size - 1))
    edges += [pair for pair in draw(st.lists(pairs, max_size=3)) if pair[0] != pair[1]]
    vehicles = max(1, draw(st.sampled_from([size, size - 1, size - 2, (size + 1) // 2])))
    starts = draw(st.permutations(range(size)))[:vehicles]
    goals = draw(st.permutations(range(size)))[:vehicles]
    return scene_on(edges, starts, goals)


@pytest.mark.slow
@settings(max_examples=25, derandomize=True)
@given(crowded(), paces())
def test_every_connected_instance_is_reached(scene: Scene, pace: Pace) -> None:
    """Under every scheduler, with late views, hesitation and vehicles that lose their memory."""
    assert played(scene, pace)[0].reached


@pytest.mark.nightly
@settings(max_examples=350, derandomize=True)
@given(crowded(), paces())
def test_very_many_connected_instances_are_reached(scene: Scene, pace: Pace) -> None:
    """The same, on many more."""
    assert played(scene, pace)[0].reached


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize("size", [3, 8, pytest.param(21, marks=pytest.mark.nightly)])
@pytest.mark.parametrize(
    "pace",
    [Pace("random"), Pace("unfair", lag=4), Pace("turns"), Pace("random", lag=5, slow=50)],
    ids=["random", "unfair, late", "turns", "one slow"],
)
def test_a_ring_that_blocks_itself_turns(size: int, pace: Pace) -> None:
    """Everybody wants the vertex ahead, and one of the goals is off the ring."""
    goals = [(vertex + (size + 2) // 3) % size for vertex in range(size)]
    goals[size - 1] = size
    scene = scene_on([*cycle(size), (0, size)], range(size), goals)
    done, seen = played(scene, pace, max_cycles=20000)
    assert done.reached
    assert seen.rotations


@pytest.mark.parametrize(("stint", "gives"), [(5, True), (4, False)])
def test_only_a_probe_of_the_present_stint_finds_a_cycle(stint: int, gives: bool) -> None:
    """An older one of its own may have come from elsewhere: the vehicle goes on waiting."""
    scene = scene_on(cycle(3), [0, 1, 2], [1, 2, 0])
    world = FreeWorld(scene, seed=0, note_length=TSWAP.length(3, "free"))
    registers = [
        GoalRegister(1, 1, 0, 5, 0, 5, 0, 0, NOTHING),
        GoalRegister(2, 2, 1, 9, 0, stint, 2, 1, NOTHING),
        GoalRegister(0, 0, 2, 3, 0, stint, 1, 1, NOTHING),
    ]
    for module, register in enumerate(registers):
        world.look(module)
        world.act(module, Choice(note=tuple(register)))
    actor = actors_for(scene, TSWAP, seed=0, hesitate=0.0, clock="free")[0]
    choice = actor.act(world.look(0))
    given = {place: GoalRegister(*note) for place, note in choice.exchanges.items()}
    assert {place: (note.goal, note.carried) for place, note in given.items()} == (
        {1: (1, 2)} if gives else {}
    )


@pytest.mark.slow
def test_a_crowded_grid_is_reached() -> None:
    """Twenty-four vehicles on six by six, which see up to ten commits late."""
    places = [(x, y) for x in range(6) for y in range(6)]
    index = {place: number for number, place in enumerate(places)}
    edges = [
        (index[x, y], index[x + dx, y + dy])
        for x, y in places
        for dx, dy in ((1, 0), (0, 1))
        if (x + dx, y + dy) in index
    ]
    chosen = random.Random(2)  # noqa: S311 - a test's instance is no secret
    scene = scene_on(edges, chosen.sample(range(36), 24), chosen.sample(range(36), 24))
    assert played(scene, Pace(lag=10))[0].reached


def test_a_vehicle_without_a_way_gives_up() -> None:
    """In one line, in its first turn."""
    scene = scene_on([(0, 1), (2, 3)], [0], [3])
    failed = played(scene, Pace())[0].failed
    assert failed == "module_0: no way from 0 to the goal 3"
