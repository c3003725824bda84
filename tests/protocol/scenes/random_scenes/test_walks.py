"""Random walks: each step is an admissible move, each as likely, and the end can be reached."""

from collections import Counter

import pytest

from chances import as_chance_has_it
from cubepath.protocol.core.actions import State, apply
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.random_scenes import Stream, walked
from cubepath.protocol.scenes.specs import scene_from_spec
from marked import some
from oracles.complexes import actions_at
from samples.local_families import LOCAL_FAMILIES


def after(scene: Scene, moves: int, seed: int) -> State:
    ends = walked(scene.system, scene.start, moves, Stream("walk", seed))
    assert len(set(ends)) == len(scene.start)
    return frozenset(ends) | scene.system.filled


@pytest.mark.slow
@pytest.mark.parametrize("family", some(LOCAL_FAMILIES, {"hex", "agv-labelled", "triangulation"}))
def test_every_step_is_an_admissible_move_and_never_the_one_back(family: str) -> None:
    """A walk of more steps begins as the shorter one; each step is a move of the system."""
    scene = scene_from_spec(family)
    before: State = scene.start_state
    last = None
    for moves in range(1, 9):
        state = after(scene, moves, 5)
        if state == before:  # the walk is back where it began, and is said to be one step shorter
            state = scene.start_state
        actions = actions_at(scene, before)
        (action,) = [each for each in actions if apply(each, before) == state]
        assert action != last or len(actions) == 1
        before, last = state, action


@pytest.mark.parametrize("spec", ["hex:n=4", "sliding:n=3", "agv:graph=grid3x3,n=3", "polygon:n=6"])
def test_each_first_step_is_as_likely(spec: str) -> None:
    """Whichever module makes it, and in runs of squares whichever proposes it."""
    scene = scene_from_spec(spec)
    options = {apply(each, scene.start_state) for each in actions_at(scene, scene.start_state)}
    found = Counter(after(scene, 1, seed) for seed in range(100 * len(options)))
    assert found.keys() == options
    assert as_chance_has_it(found.values(), 100)


def test_a_walk_goes_back_where_it_must_but_does_not_end_there() -> None:
    """A vehicle on a path of two has one other place to be, and on a path of three two."""
    two, three = (scene_from_spec(f"agv:graph=P{size},n=1") for size in (2, 3))
    for moves in range(1, 7):
        assert walked(two.system, two.start, moves, Stream("walk", 0)) == (1,)
        (site,) = walked(three.system, three.start, moves, Stream("walk", 0))
        assert site == (2 if moves % 4 == 2 else 1)


def test_where_nobody_can_move_there_is_no_walk() -> None:
    """It is said how far it came."""
    scene = scene_from_spec("agv:graph=C4,n=4")
    with pytest.raises(InputError, match="walk=3: no module can move"):
        walked(scene.system, scene.start, 3, Stream("walk", 0))


def test_modules_stay_in_the_order_in_which_they_start() -> None:
    """So vehicles keep their labels, and each goal is that of its own vehicle."""
    scene = scene_from_spec("agv-labelled:graph=grid3x3,n=4")
    ends = walked(scene.system, scene.start, 9, Stream("walk", 1))
    assert [scene.system.label_of(site) for site in ends] == [0, 1, 2, 3]
    assert ends != scene.start
