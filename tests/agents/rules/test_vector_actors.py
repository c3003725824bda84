"""All modules of many environments at once choose what the actor of each would choose."""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from cubepath.agents.local.observation import SILENT, View, observe
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.chain import CHAIN
from cubepath.agents.rules.chain_task import minus, plus
from cubepath.agents.rules.compression import COMPRESSION
from cubepath.agents.rules.registry import BUILT_IN, find_rule
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.uniform import RANDOM
from cubepath.agents.rules.vector_actors import vector_actors_for
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Move
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from oracles.stacked import Side, stacked
from samples.local_families import LOCAL_FAMILIES

CHAINS = [
    "hex:n=6,bend=60",
    "hex:n=5,bend=-120",
    "hex:n=6,bend=0,shift=4",
    "hex:n=5,bend=0,shift=0",
    "hex-open:n=5,bend=120",
    "hex-open:n=5,bend=0,shift=5",
    "hex:n=1",
    "hex:n=2,bend=-60",
]
SEEDS = [0, 3, 2**70 + 1]
WAYS = [(PLAIN, 0.4), (COMPILED, 0.0), (COMPILED, 0.4)]
"""How many steps are made in plain Python, and how often modules hesitate."""


scene_of = cache(scene_from_spec)


def given_scene(start: Iterable[Cell], goals: Iterable[Cell], system: LatticeSystem) -> Scene:
    """Return a scene of a chain, whose goal every module knows."""
    start, goals = tuple(start), tuple(goals)
    return Scene(
        "by hand", "hex", system, start=start, goal=frozenset(goals), goals=(goals,) * len(start)
    )


# --- Whole runs --------------------------------------------------------------------------------


@pytest.mark.few(4)
@pytest.mark.parametrize(("left", "hesitate"), WAYS)
@pytest.mark.parametrize("spec", ["hex:n=5", "arms", "agv:graph=grid4x4,n=5", "polygon:n=6"])
def test_random_modules_draw_the_same(spec: str, hesitate: float, left: int) -> None:
    """Each from its own stream, and hesitates in the same rounds."""
    with plain_steps(left):
        assert Side(scene_from_spec(spec), RANDOM, SEEDS, hesitate).play(15) > 15


@pytest.mark.few(8)
@pytest.mark.parametrize(("left", "hesitate"), WAYS)
@pytest.mark.parametrize("spec", CHAINS)
def test_chains_walk_the_same(spec: str, hesitate: float, left: int) -> None:
    """Until all of them have reached their goals, each in its own time."""
    with plain_steps(left):
        side = Side(scene_from_spec(spec), CHAIN, SEEDS, hesitate)
        side.play(400)
    assert not side.playing.any() or all(map(side.scene.reached, (w.sites for w in side.worlds)))


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(("left", "hesitate"), WAYS)
def test_compressing_modules_step_the_same(hesitate: float, left: int) -> None:
    """They draw the same patterns, which others than their own streams give them."""
    with plain_steps(left):
        assert Side(scene_from_spec("compression:n=6"), COMPRESSION, SEEDS, hesitate).play(60) > 15


@pytest.mark.slow
@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_every_family_has_the_random_rule(spec: str) -> None:
    """Whatever its sites and moves are."""
    with plain_steps(COMPILED):
        assert Side(scene_from_spec(spec), RANDOM, [1, 2], 0.3).play(5)


@pytest.mark.slow
@pytest.mark.parametrize("values", ["temperature=0.5", "temperature=3,cooling=0.9"])
@pytest.mark.parametrize("spec", [*LOCAL_FAMILIES, "hex-shapes:n=5", "agv-labelled:graph=K4,n=3"])
def test_every_family_has_metropolis(spec: str, values: str) -> None:
    """With one goal a module or several, taken or free, at any temperature."""
    rule = find_rule(f"metropolis:{values}")
    assert rule is not None
    assert Side(scene_from_spec(spec), rule, [1, 2], 0.3).play(16)


def test_metropolis_chooses_the_same_when_it_forgets_sites(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long run of many modules meets more sites than it keeps."""
    monkeypatch.setattr("cubepath.agents.rules.vector_metropolis._BYTES_MAX", 0)
    rule = find_rule("metropolis")
    assert rule is not None
    assert Side(scene_from_spec("hex-open:n=5"), rule, [1, 2], 0.0).play(30)


@pytest.mark.thorough
@pytest.mark.parametrize("spec", ["hex:n=25,bend=60", "hex:n=20,bend=0,shift=13", "hex-open:n=20"])
@pytest.mark.parametrize("hesitate", [0.0, 0.2])
def test_long_chains_walk_the_same(spec: str, hesitate: float) -> None:
    """Many seeds, with a dozen modules on their way at once."""
    with plain_steps(COMPILED):
        side = Side(scene_from_spec(spec), CHAIN, range(4), hesitate)
        side.play(600)
    assert all(side.scene.reached(world.sites) for world in side.worlds)


# --- Any observation ---------------------------------------------------------------------------


@cache
def hexagons(*, keeps_topology: bool, backwards: bool, walls: bool) -> LatticeSystem:
    """Return one of both catalogues, listed in either order, with walls or without."""
    known = page_catalogue("hexagons-1" if keeps_topology else "hexagons-2")
    order = known.generators[::-1] if backwards else known.generators
    box = [(q, r) for q in range(-9, 10) for r in range(-9, 10)]
    return LatticeSystem(Catalogue(known.lattice, order), workspace=box if walls else None)


@st.composite
def chain_scenes(draw: st.DrawFn) -> Scene:
    """Draw a scene with modules anywhere on the lines of a goal: some find no chain there."""
    count, by = draw(st.integers(2, 5)), draw(st.integers(0, 5))
    (q, r), (dq, dr) = draw(st.tuples(*[st.integers(-7, 7)] * 2)), HEX_DIRECTIONS[by]
    goals: list[Cell] = [(q + step * dq, r + step * dr) for step in range(count)]
    lines = {
        (end[0] + steps * across, end[1] + steps * up)
        for end in (goals[0], goals[-1])
        for across, up in HEX_DIRECTIONS
        for steps in range(count + 1)
    }
    cells = st.sampled_from([*goals * 4, *sorted(lines)])
    start = draw(st.lists(cells, min_size=count, max_size=count, unique=True))
    system = hexagons(
        keeps_topology=draw(st.booleans()), backwards=draw(st.booleans()), walls=draw(st.booleans())
    )
    assume(all(map(system.has_place, [*goals, *start])))
    return given_scene(start, goals, system)


NEAR = [(q, r) for q in range(-2, 3) for r in range(-2, 3) if (q, r) != (0, 0) and abs(q + r) <= 2]
"""The cells within two of a hexagon."""
CROWDS = st.one_of(
    st.integers(0, 2**18 - 1), st.sampled_from([1 << NEAR.index(each) for each in HEX_DIRECTIONS])
)
"""Which of these are on, as bits: any, or one that touches."""


def refused_alike(scene: Scene, rule: RuleType) -> bool:
    """Return whether a module refuses the scene; then all at once refuse it in the same words."""
    try:
        actors_for(scene, rule, seed=0, hesitate=0.0)
    except InputError as error:
        with pytest.raises(InputError, match=f"^{re.escape(str(error))}$"):
            vector_actors_for(scene, rule, seeds=[0])
        return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize("left", [PLAIN, COMPILED])
@settings(max_examples=30)
@given(chain_scenes(), st.data())
def test_chains_choose_the_same_in_any_crowd(left: int, scene: Scene, data: st.DataObject) -> None:
    """Also those that find no chain, have two lines to choose from, or first look elsewhere."""
    if refused_alike(scene, CHAIN):
        return
    side = Side(scene, CHAIN, [0])
    goals, ends = frozenset(scene.goal or ()), scene.goals[0][:: len(scene.start) - 1]
    for number in range(4):
        row = []
        for start in scene.start:
            (q, r), crowd = HEXAGONS.check(start), data.draw(CROWDS)
            if number or data.draw(st.integers(0, 9)) == 0:
                about, by = (
                    data.draw(st.sampled_from([start, *ends])),
                    data.draw(st.sampled_from(NEAR)),
                )
                q, r = plus(HEXAGONS.check(about), by)
            on = {(q + dq, r + dr) for bit, (dq, dr) in enumerate(NEAR) if crowd >> bit & 1}
            row.append(observe(scene.system, (q, r), {cell: cell for cell in on}, goals=goals))
        with plain_steps(left):
            side.choose([row])


@pytest.mark.slow
@given(st.data())
def test_chains_begin_the_same(data: st.DataObject) -> None:
    """Straight chains and nearly straight ones, from either end of the goal and along it."""
    scene = scene_of(data.draw(st.sampled_from(CHAINS[:6])))
    moved = data.draw(st.sets(st.integers(0, len(scene.start) - 1), max_size=2))
    on = {cell: cell for module, cell in enumerate(scene.start) if module not in moved}
    row = [observe(scene.system, cell, on, goals=frozenset(scene.goals[0])) for cell in scene.start]
    Side(scene, CHAIN, [0]).choose([row])


@pytest.mark.parametrize("spec", CHAINS[:6])
def test_past_the_end_of_the_goal_nobody_has_arrived(spec: str) -> None:
    """A walker that stands in line with the goal, next to its last cell, goes on about it."""
    scene = scene_of(spec)
    side = Side(scene, CHAIN, [0])
    side.choose(side.views())
    first, last = (HEXAGONS.check(each) for each in (scene.goals[0][0], scene.goals[0][-1]))
    past = plus(last, minus(last, HEXAGONS.check(scene.goals[0][-2])))
    goals = frozenset(scene.goals[0])
    (choices,) = side.choose(
        [[observe(scene.system, past, {last: last, first: first}, goals=goals)] * len(scene.start)]
    )
    assert any(each.action for each in choices.values()) or set(scene.start) <= goals


# --- Rules of one's own, and what goes wrong ------------------------------------------------------


def vectorised(
    act: Callable[[VectorView, VectorChoice], Iterable[RuleFailure]],
) -> Callable[[VectorKnowledge], VectorRule]:
    """Return what makes this function the vectorised form of a rule."""
    return lambda _: act


def counting(knowledge: InitialKnowledge) -> Rule:
    """Say how often each third module was asked, and hear the greatest number about."""
    asked = 0

    def choose(view: View) -> Choice:
        nonlocal asked
        asked += 1
        heard = max((note[0] for note in view.notes.values()), default=0)
        note = (asked, heard) if asked % 3 == knowledge.module % 3 else None
        return Choice(note=note, failed="tired\nof it" if asked == 5 + knowledge.module else None)

    return choose


def counting_vectorised(knowledge: VectorKnowledge) -> VectorRule:
    """Do the same for all modules."""
    asked = np.zeros(knowledge.environments, np.int64)
    modules = np.arange(knowledge.modules)

    def choose(seen: VectorView, chosen: VectorChoice) -> list[RuleFailure]:
        asked[seen.playing] += 1
        heard = np.where(seen.notes == SILENT, 0, seen.notes)[..., 0].max(axis=2, initial=0)
        speaks = (asked[:, np.newaxis] % 3 == modules % 3) & seen.playing[:, np.newaxis]
        said = np.stack(np.broadcast_arrays(asked[:, np.newaxis], heard), axis=2)
        chosen.notes[speaks] = said[speaks]
        tired = (asked[:, np.newaxis] == 5 + modules) & seen.playing[:, np.newaxis]
        return [RuleFailure(e, m, "tired\nof it") for e, m in np.argwhere(tired).tolist()]

    return choose


COUNTING = RuleType(
    "counting", "counts", "a test", lambda _: True, counting, lambda _: 2, None, counting_vectorised
)


def test_a_rule_of_ones_own_speaks_and_gives_up() -> None:
    """Notes are kept where none is given, and reasons are told in one line, of the first module."""
    side = Side(scene_from_spec("hex:n=4"), COUNTING, [1, 2, 3])
    gave_up = []
    for number in range(9):
        side.playing = np.array([True, number % 2 == 0, number < 4])
        for world, choices in zip(side.worlds, side.choose(side.views()), strict=True):
            said = {m: each.note for m, each in choices.items() if each.note}
            world.step({}, said)
        gave_up.append(side.vector.failed.get(0))
    assert gave_up[4:8] == [f"module_{each}: tired of it" for each in range(4)]


def test_who_has_no_vectorised_form() -> None:
    """Rules that offer none, that do not fit, or that do not know the system."""
    scene, arm = scene_from_spec("hex:n=4"), scene_from_spec("arm:n=3")
    assert [name for name, rule in BUILT_IN.items() if rule.vectorised] == [
        "random",
        "metropolis",
        "chain",
        "compression",
    ]
    for rule in (BUILT_IN["tswap"], replace(RANDOM, vectorised=lambda _: None)):
        assert vector_actors_for(scene, rule, seeds=[0]) is None
    assert vector_actors_for(arm, CHAIN, seeds=[0]) is None


class Shuffled(LatticeSystem):
    """A lattice whose moves are not in the order of its catalogue."""

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        return super().moves(site)[::-1]


def test_slots_of_another_order_are_left_to_actors() -> None:
    """A table by slot would be wrong there."""
    scene = scene_from_spec("hex:n=3")
    assert scene.system.catalogue is not None
    other = replace(scene, system=Shuffled(scene.system.catalogue))
    assert vector_actors_for(other, CHAIN, seeds=[0]) is None
    assert vector_actors_for(scene, CHAIN, seeds=[0]) is not None


@pytest.mark.parametrize("act", ["illegal", "negative", "silent", "raises"])
def test_a_rule_that_fails_is_named(act: str) -> None:
    """With the module and its legal actions, or with the error in one line."""

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        if act == "raises":
            raise ValueError("first\nsecond")
        if act == "silent":
            chosen.notes[1, 2] = SILENT
        else:
            chosen.actions[1, 2] = 99 if act == "illegal" else -1
        return ()

    told = {
        "illegal": "rule 'own', vectorised, module_2: chose action 99, legal were [0",
        "negative": "rule 'own', vectorised, module_2: chose action -1, legal were [0",
        "silent": "rule 'own', vectorised: a note with -2147483648, expected more and an int32",
        "raises": "rule 'own', vectorised: ValueError: first second",
    }
    rule = replace(COUNTING, name="own", vectorised=vectorised(choose))
    scene = scene_from_spec("hex:n=4")
    side = Side(scene, rule, [0, 1])
    with pytest.raises(RuleError, match=f"^{re.escape(told[act])}"):
        side.choose(side.views())


def test_arrays_of_another_shape_are_refused() -> None:
    """Compiled code would read past their ends."""
    scene = scene_from_spec("hex:n=4")
    actors = vector_actors_for(scene, RANDOM, seeds=[0, 1])
    assert actors is not None
    length, slots = 3 + 2 * scene.system.sense_slots, scene.system.move_slots + 1
    seen, mask = np.zeros((2, 4, length), np.int32), np.ones((2, 4, slots), np.int8)
    out = np.zeros((2, 4), np.int32)
    wide: Any = mask.astype(np.int32)
    actors.act(seen, mask, None, out)
    with pytest.raises(InputError, match=r"^observation: int32 of shape \(2, 3, "):
        actors.act(seen[:, :3], mask, None, out)
    with pytest.raises(InputError, match=r"^action_mask: int32 of shape"):
        actors.act(seen, wide, None, out)
    with pytest.raises(InputError, match=r"^out: .* expected int32 of shape \(2, 4\)$"):
        actors.act(seen, mask, None, out[:1])


def test_environments_that_are_over_draw_nothing() -> None:
    """They stay, and if they went on they would draw what comes next."""
    scene = scene_from_spec("hex:n=4")
    side = Side(scene, RANDOM, [4, 5], 0.5)
    for number in range(6):
        side.playing = np.array([True, number > 2])
        side.choose(side.views())


def test_what_is_given_is_not_changed_and_need_not_be_in_order() -> None:
    """Arrays of any memory layout, read-only ones as well, give the same actions."""
    scene = scene_from_spec("hex:n=4")
    side = Side(scene, RANDOM, [4, 5])
    one = vector_actors_for(scene, RANDOM, seeds=[4, 5])
    assert one is not None
    views = side.views()
    seen = [stacked(views, name) for name in ("observation", "action_mask")]
    out, other = np.zeros((2, 4), np.int32), np.zeros((2, 8), np.int32)
    side.vector.act(seen[0], seen[1], None, out)
    strange = [np.asfortranarray(each) for each in seen]
    for each in strange:
        each.flags.writeable = False
    one.act(strange[0], strange[1], None, other[:, ::2])
    assert (other[:, ::2] == out).all()
    assert not other[:, 1::2].any()
