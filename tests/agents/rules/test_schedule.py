"""The rule that carries out one module's part of a schedule."""

import numpy as np
import pytest

from cubepath.agents.environments.rollouts import Rollout, play
from cubepath.agents.environments.world import World
from cubepath.agents.local.module import ModuleCore
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.rule import Choice
from cubepath.agents.rules.schedule import scheduled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEXAGONS, Catalogue, GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.durations import OwnMoves, schedule_from_jsonl, schedule_to_jsonl
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.wire.messages import Note

Own = dict[int, OwnMoves]


def made(played: Rollout) -> list[tuple[int, int, Site]]:
    """Return round, module and place of each move that was made."""
    return [(each.number, m, move.at) for each in played.rounds for m, move in each.moves.items()]


def vehicles(*starts: int) -> Scene:
    """Return vehicles on a path of six places."""
    system = scene_from_spec("agv:graph=P6,n=1").system
    return Scene("a path", "", system, starts)


def test_each_module_moves_in_its_rounds_and_stays_in_others() -> None:
    """Two vehicles, one of which waits a round."""
    own: Own = {
        0: {1: GeneratorPlacement("edge", (0, 1)), 3: GeneratorPlacement("edge", (1, 2))},
        1: {2: GeneratorPlacement("edge", (4, 5))},
    }
    played = play(vehicles(0, 4), scheduled(own), max_rounds=4)
    assert made(played) == [(1, 0, (0, 1)), (2, 1, (4, 5)), (3, 0, (1, 2))]
    assert played.failed is None
    assert played.sites == (2, 5)


def test_a_module_knows_its_own_moves_only() -> None:
    """Whatever is on the list of others, a module with an empty one stays."""
    own: Own = {1: {1: GeneratorPlacement("edge", (0, 1))}}
    played = play(vehicles(0, 3), scheduled(own), max_rounds=2)
    assert made(played) == []
    assert played.failed == "module_1: edge at [0,1] is no move from 3"


@pytest.mark.parametrize(
    ("starts", "at", "reason"),
    [
        ((0, 1), (0, 1), "edge at [0,1] is not admissible: site 1 is on, expected off"),
        ((0,), (2, 3), "edge at [2,3] is no move from 0"),
        ((0,), (0, 3), "generator edge: [0, 3] is no edge of the graph"),
    ],
)
def test_what_cannot_be_done_is_said(
    starts: tuple[int, ...], at: tuple[int, ...], reason: str
) -> None:
    """The module stays, and says in one line what is not as it must be."""
    own: Own = {0: {1: GeneratorPlacement("edge", at)}}
    played = play(vehicles(*starts), scheduled(own), max_rounds=2)
    assert played.failed == f"module_0: {reason}"
    assert made(played) == []
    assert len(played.rounds) == 1


def test_others_make_their_moves_of_the_same_round() -> None:
    """They do not hear of it before the round is over, and theirs commute with what is not done."""
    own: Own = {
        0: {1: GeneratorPlacement("edge", (0, 1))},
        2: {1: GeneratorPlacement("edge", (4, 5))},
    }
    played = play(vehicles(0, 1, 4), scheduled(own), max_rounds=3)
    assert made(played) == [(1, 2, (4, 5))]
    assert played.failed is not None


def hexagons(start: tuple[Site, ...], filled: tuple[Site, ...] = ()) -> Scene:
    """Return hexagons on the open plane, with obstacles."""
    catalogue: Catalogue = page_catalogue("hexagons-1")
    assert catalogue.lattice == HEXAGONS
    return Scene("hexagons", "", LatticeSystem(catalogue, filled=filled), start)


def a_pivot(scene: Scene) -> tuple[GeneratorPlacement, Action]:
    """Return the first move that module 0 can make."""
    state = scene.start_state
    move = next(
        m for m in scene.system.moves(scene.start[0]) if m is not None and m.possible(state)
    )
    return GeneratorPlacement(move.generator, move.at), move.action


def test_what_is_wrong_in_the_support_is_named() -> None:
    """An obstacle, another module, or nobody to pivot about."""
    scene = hexagons(((0, 0), (1, 0)))
    placed, action = a_pivot(scene)
    own: Own = {0: {1: placed}}
    assert play(scene, scheduled(own), max_rounds=1).failed is None
    beside = min(action.support - action.trace - {(1, 0)})  # type: ignore[type-var]
    text = str(list(beside)).replace(" ", "")  # type: ignore[call-overload]
    expected = {
        hexagons(((0, 0), (1, 0)), (beside,)): f"{text} is on (an obstacle), expected off",
        hexagons(((0, 0), (1, 0), beside)): f"{text} is on, expected off",
        hexagons(((0, 0),)): "[1,0] is off, expected on",
    }
    for changed, reason in expected.items():
        failed = play(changed, scheduled(own), max_rounds=1).failed
        assert failed is not None
        assert failed.endswith(f" is not admissible: site {reason}")
    (target,) = action.trace - {(0, 0)}
    blocked = hexagons(((0, 0), (1, 0)), (target,))
    failed = play(blocked, scheduled(own), max_rounds=1).failed
    assert failed is not None
    assert failed.endswith(f"it would move an obstacle, {target!r}")


def test_the_edge_of_the_workspace_is_told() -> None:
    """A support that leaves the workspace has no move."""
    scene = hexagons(((0, 0), (1, 0)))
    placed, action = a_pivot(scene)
    system = LatticeSystem(page_catalogue("hexagons-1"), workspace=action.trace | {(1, 0)})
    own: Own = {0: {1: placed}}
    failed = play(Scene("a corner", "", system, scene.start), scheduled(own), max_rounds=1).failed
    assert failed is not None
    assert "it would leave the workspace, to which (" in failed


def test_it_acts_through_observation_and_mask_alone() -> None:
    """The same observation with the move masked out: the module stays."""
    scene = vehicles(0)
    actor = actors_for(
        scene,
        scheduled({0: dict.fromkeys((1, 2), GeneratorPlacement("edge", (0, 1)))}),
        seed=0,
        hesitate=0.0,
    )[0]
    seen = World(scene, seed=0).observe(0)
    first = actor.act(seen)
    assert first.action != 0
    assert first.failed is None
    seen["action_mask"] = np.array([1] + [0] * (len(seen["action_mask"]) - 1), dtype=np.int8)
    second: Choice = actor.act(seen)
    assert second.action == 0
    assert second.failed is not None


def test_another_rule_is_silent_until_its_first_choice() -> None:
    """When a module follows another rule from round 3 on, it has nothing to say before round 4."""
    scene = vehicles(0)
    core = ModuleCore(scene.system, module=0, site=0, goals=(), seed=0, note_length=0)
    said: dict[int, bool] = {}
    for number in range(1, 6):
        if number == 3:
            core.follow(2)
        said[number] = any(isinstance(each, Note) for each in core.sense(number))
        note = (7, 8) if number >= 3 else None
        assert ("notes" in core.observation()) == (number >= 3)
        core.claim(0, note)
        core.arbitrate()
        assert core.finished
        core.report()
    assert said == {1: False, 2: False, 3: False, 4: True, 5: True}


def test_a_pilot_may_be_born_where_its_module_stands() -> None:
    """The rule that takes over is told its place, not where the run began."""
    scene = vehicles(0, 3)
    born: list[Site] = []

    def make(knowledge: object) -> object:
        born.append(knowledge.start)  # type: ignore[attr-defined]
        return lambda _: 0

    rule = scheduled({})
    rule = type(rule)(rule.name, rule.summary, rule.source, rule.fits, make)  # type: ignore[arg-type]
    found: dict[int, Actor] = actors_for(
        scene, rule, seed=0, hesitate=0.0, modules=[1], sites={1: 5}
    )
    assert (born, list(found)) == ([5], [1])


def test_a_schedule_as_text() -> None:
    """What is written is read back; sites are JSON."""
    cubes = ((GeneratorPlacement("edge", (0, 1)), GeneratorPlacement("edge", ("a", (1, 2)))), ())
    assert schedule_from_jsonl(schedule_to_jsonl(cubes)) == cubes
