"""The compiled world is the plain one, step by step, for any system and any number of scenes."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings, strategies as st

from cubepath.agents.arrays import batch
from cubepath.agents.arrays.batch import Batch
from cubepath.agents.arrays.tables import UntabledError
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import (
    EDGES,
    LATTICES,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
    Lattice,
    Move,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem
from oracles.stepwise import together
from samples.strategies import SCENES
from samples.switches import ring

CROWDED = (
    "hex:n=12",
    "hex-open:n=30",
    "arm:n=12",
    "arms:n=2",
    "sliding:p=2,q=2,n=6",
    "hex-tunnel",
    "agv:graph=grid6x6,n=20",
    "agv-labelled:graph=grid4x4,n=9",
    "triangulation:n=9",
    "words:presentation=free2",
)
FAMILIES = (*SCENES, *CROWDED)


@pytest.mark.few(8)
@pytest.mark.parametrize("spec", FAMILIES)
def test_every_step_is_that_of_the_plain_world(spec: str) -> None:
    """Sites, observations, masks, notes, moves and lost claims, in two environments at once."""
    counted = together(scene_from_spec(spec), [3, 4], 12, note_length=2)
    assert counted.moves


def test_a_system_of_another_distribution() -> None:
    """It is asked for its moves and neighbourhoods, and nothing else."""
    assert together(ring("ring:n=7", {"n": "7"}), [0, 1], 30).moves


@pytest.mark.nightly
@pytest.mark.parametrize("spec", CROWDED)
def test_many_steps_are_those_of_the_plain_world(spec: str) -> None:
    """Hundreds of moves of each family, with lost claims in plenty."""
    counted = together(scene_from_spec(spec), range(3), 250)
    assert counted.moves > 500
    assert counted.lost > 25


def test_environments_of_a_batch_do_not_know_of_one_another() -> None:
    """Each is as it would be alone, whoever else is there, and after a reset of its own."""
    scene = scene_from_spec("agv:graph=grid4x4,n=8")
    many, alone = Batch(scene, 3), Batch(scene)
    many.reset([5, 6, 7])
    alone.reset([6])
    random = np.random.default_rng(0)
    for step in range(40):
        seen = many.observe().observation[1], alone.observe().observation[0]
        assert seen[0].tolist() == seen[1].tolist()
        if step == 20:
            many.reset([9], [1])
            alone.reset([9])
            many.observe()
            alone.observe()
        actions = random.integers(0, 5, (3, 8))
        live = np.array([random.random() < 0.5, 1, random.random() < 0.5], np.uint8)
        found = many.step(actions, live=live)[1].tolist()
        assert found == alone.step(actions[1:2].copy())[0].tolist()


def test_modules_may_wander_as_far_as_they_like() -> None:
    """Single cells that slide anywhere leave their start behind by hundreds, both ways."""
    slides = [
        Generator(name, ((0, 0), step), ((0, 0), step), ((0, 0),), (step,), (((0, 0), step),))
        for name, step in (("along", (1, 0)), ("up", (0, 1)))
    ]
    system = LatticeSystem(Catalogue(SQUARES, tuple(slides)))
    scene = Scene("two", "", system, ((0, 0), (0, 1)), frozenset({(1, 1), (1, 2)}))
    found = Batch(scene)
    found.reset([0])
    found.observe()
    # Slots: along, back, up, down.
    for _ in range(700):
        found.step(np.array([[2, 3]]))
    assert found.sites() == [(-700, 0), (0, 701)]
    together(scene, [1], 40, batch=found)


@pytest.mark.parametrize("spec", ["hex-open:n=9", "agv-labelled", "assembly:n=3"])
def test_places_that_were_left_behind_are_forgotten(
    spec: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long run takes no more memory than where its modules are, and nobody can tell."""
    monkeypatch.setattr(batch, "PLACES_MAX", 4)
    monkeypatch.setattr(batch, "PLACES_GROWTH", 0)
    scene = scene_from_spec(spec)
    counted = together(scene, [1, 2], 25, note_length=1)
    assert counted.batch.forgotten > 1


CELLS = [(x, y) for x in range(3) for y in range(2)]


@st.composite
def generators(draw: st.DrawFn, name: str) -> Generator:
    """Return a generator over a block of six cells, with free cells and guards."""
    cells = draw(st.permutations(CELLS))
    size = draw(st.integers(1, 2))
    sources, targets = cells[:size], cells[size : 2 * size]
    rest = cells[2 * size :]
    roles = draw(st.lists(st.sampled_from("-01fg"), min_size=len(rest), max_size=len(rest)))
    read = [cell for cell, role in zip(rest, roles, strict=True) if role == "1"]
    free = [cell for cell, role in zip(rest, roles, strict=True) if role in "fg"]
    support = [*sources, *targets, *(c for c, r in zip(rest, roles, strict=True) if r != "-")]
    others = [cell for cell in support if cell not in targets and cell not in sources]
    guards = [
        (cell, draw(st.sampled_from(others)))
        for cell, role in zip(rest, roles, strict=True)
        if role == "g"
    ]
    return Generator(
        name,
        tuple(support),
        (*sources, *targets),
        (*sources, *read),
        (*targets, *read),
        tuple(zip(sources, targets, strict=True)),
        tuple(free),
        tuple((one, other) for one, other in guards if one != other),
    )


@st.composite
def lattices(draw: st.DrawFn) -> Scene:
    """Return modules in a block, with generators of nobody's choosing, walls and obstacles."""
    count = draw(st.integers(1, 3))
    found = tuple(draw(generators(f"g{i}")) for i in range(count))
    try:
        catalogue = Catalogue(SQUARES, found)
    except InputError:  # two are equal
        reject()
    block = [(x, y) for x in range(-1, 5) for y in range(-1, 5)]
    shuffled: list[Cell] = draw(st.permutations(block))
    filled, empty = shuffled[:2], shuffled[2:4]
    workspace = draw(st.sampled_from([None, block, shuffled[:30]]))
    system = LatticeSystem(catalogue, workspace=workspace, filled=filled, empty=empty)
    places = [cell for cell in shuffled if system.has_place(cell)]
    modules = draw(st.integers(1, 12))
    start, goal = places[:modules], places[-modules:]
    return Scene("any", "", system, tuple(start), frozenset(goal), (tuple(goal),) * modules)


@settings(max_examples=25, deadline=None)
@given(scene=lattices(), seed=st.integers(0, 1 << 70))
def test_any_catalogue_among_walls_and_obstacles(scene: Scene, seed: int) -> None:
    """Generators with free cells and guards, of modules that take others along."""
    together(scene, [seed], 12, note_length=1)


@st.composite
def lists(draw: st.DrawFn) -> Scene:
    """Return places with letters, whose moves change letters of one or two of them at once."""
    places, letters = range(5), "abc"

    def site() -> st.SearchStrategy[tuple[int, str]]:
        return st.tuples(st.sampled_from(places), st.sampled_from(letters))

    moves = {}
    for number in range(draw(st.integers(2, 8))):
        changed = draw(st.lists(st.sampled_from(places), min_size=1, max_size=2, unique=True))
        pairs = [(p, *draw(st.permutations(letters))[:2]) for p in changed]
        motion = tuple(((p, one), (p, other)) for p, one, other in pairs)
        before, after = zip(*motion, strict=True)
        read = [each for each in draw(st.lists(site(), max_size=3)) if each[0] not in changed]
        on = {each[0]: each for each in read if draw(st.booleans())}.values()
        trace = [*before, *after]
        action = Action([*trace, *read], trace, [*before, *on], [*after, *on], label=f"m{number}")
        moves[action] = Move(action, "m", number, motion)
    system = TabledSystem(moves.values(), letters=letters, drawing="letters")
    lettered = system.places
    assume(lettered)
    start = tuple((p, draw(st.sampled_from(letters))) for p in lettered)
    goals = tuple(draw(st.sampled_from([(p,), ((p, "a"),), ()])) for p in lettered)
    return Scene("letters", "", system, start, None, goals)


@settings(max_examples=25, deadline=None)
@given(scene=lists(), seed=st.integers(0, 9))
def test_any_list_of_moves_over_letters(scene: Scene, seed: int) -> None:
    """Places stay, and what they show changes."""
    together(scene, [seed], 12)


def test_more_neighbours_than_bits_in_a_word() -> None:
    """A vehicle on a star with a hundred rays, and a move that reads a hundred cells."""
    star = GraphSystem(range(101), [(0, ray) for ray in range(1, 101)])
    together(Scene("star", "", star, tuple(range(40)), frozenset(range(40, 80))), [0], 30)
    row = tuple((x, 0) for x in range(100))
    long = Generator(
        "long", row, row[:2], row[:1] + row[90:], row[1:2] + row[90:], ((row[0], row[1]),)
    )
    system = LatticeSystem(Catalogue(SQUARES, (long,)), filled=row[90:])
    assert together(Scene("row", "", system, ((0, 0), (50, 50))), [0], 20).moves


def test_what_is_sensed_and_not_read_has_no_room_among_the_bits() -> None:
    """A hundred cells of the support are free: one word is for those that are read, and it ends."""
    row = tuple((x, 0) for x in range(100))
    step = Generator("step", row, row[:2], row[:1], row[1:2], ((row[0], row[1]),), row[2:])
    system = LatticeSystem(Catalogue(SQUARES, (step,)))
    scene = Scene("row", "", system, ((90, 0), (0, 0)))
    found = Batch(scene)
    assert system.sensed((0, 0)).index((90, 0)) > 64 * found.tables.words
    # The bits, with a word behind them that is nobody's.
    guarded = np.full((1, 3, found.tables.words), 7, np.uint64)
    found._bits = guarded[:, :2]
    found._follow()
    together(scene, [0], 10, batch=found)
    assert found._bits.base is guarded
    assert guarded[0, 2].tolist() == [7] * found.tables.words


def test_cells_of_an_orbit_without_moves() -> None:
    """A module there senses nothing and can only stay, or be in the way."""
    along = Generator(
        "along",
        ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (1, 0, 0)),
        ((0, 0, 0),),
        ((1, 0, 0),),
        (((0, 0, 0), (1, 0, 0)),),
    )
    system = LatticeSystem(Catalogue(EDGES, (along,)))
    scene = Scene("edges", "", system, ((0, 0, 0), (2, 0, 1), (5, 5, 1)))
    together(scene, [0], 10)


@pytest.mark.slow
@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES.keys())
@pytest.mark.parametrize("modules", [3, 130])
def test_tiles_of_every_lattice(lattice: Lattice, modules: int) -> None:
    """Modules in a row sense beyond the next tile, on both sides of the origin."""
    here = (0,) * lattice.arity
    step, far = [lattice.shift(here, (k, k, 0)[: lattice.dimension]) for k in (1, -9)]
    leap = Generator("leap", (here, step, far), (here, step), (here,), (step,), ((here, step),))
    system = LatticeSystem(Catalogue(lattice, (leap,)))
    cells = [lattice.shift(here, (4 * k - 60, 0, 0)[: lattice.dimension]) for k in range(modules)]
    assert together(Scene("row", "", system, tuple(cells)), [2], 6, note_length=1).moves


class Blind(GraphSystem):
    """Vehicles that do not sense all that their moves read."""

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        return (*super().sensed(place)[1:], None)

    def pattern(self, site: Site) -> None:
        del site


def test_a_system_that_fits_into_no_table_is_named() -> None:
    """So that the plain world can play it."""
    scene = Scene("blind", "", Blind([0, 1], [(0, 1)]), (0,))
    with pytest.raises(UntabledError, match="which it does not sense"):
        Batch(scene)


@pytest.mark.parametrize("seeds", [[-1], [0, -3]])
def test_seeds_that_are_refused(seeds: Sequence[int]) -> None:
    """Below 0 there are none."""
    with pytest.raises(InputError, match=f"seed={min(seeds)}: expected 0 or more"):
        Batch(scene_from_spec("hex:n=2"), len(seeds)).reset(seeds)


def test_room_is_made_for_places_and_not_for_each_module_that_comes_to_one() -> None:
    """Hundreds of environments of one scene meet the same places."""
    batch = Batch(scene_from_spec("hex:n=10"), 300)
    batch.reset(range(300))
    random = np.random.default_rng(0)
    for _ in range(10):
        mask = batch.observe().mask
        batch.step(np.where(mask, random.random(mask.shape), -1.0).argmax(2).astype(np.int64))
    room, count = len(batch.tables.places.background), batch.tables.count
    assert count <= room < 4 * count
