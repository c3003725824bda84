"""What no rule can tell without notes: pairs of scenes that look the same to a module."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import pytest

from cubepath.agents.local.observation import observe
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.arms import DEADLOCK, arm_of
from cubepath.protocol.scenes.specs import scene_from_spec

Sites = tuple[Site, ...]
"""Where each module stands."""


def moves(scene: Scene, sites: Sites) -> Iterator[tuple[int, int, Sites]]:
    """Return the legal moves: the mover, its action, and where all stand then."""
    state = frozenset(sites) | scene.system.filled
    for module, site in enumerate(sites):
        for action, move in enumerate(scene.system.moves(site), 1):
            if move is not None and move.possible(state):
                goes = dict(move.motion)
                yield module, action, tuple(goes.get(each, each) for each in sites)


def component(scene: Scene, first: Sites) -> dict[Sites, int]:
    """Return where all can stand, each state once, by how many moves it is from the first."""
    met, found = {frozenset(first)}, {first: 0}
    rim = [first]
    for sites in rim:
        for _, _, after in moves(scene, sites):
            if frozenset(after) not in met:
                met.add(frozenset(after))
                found[after] = found[sites] + 1
                rim.append(after)
    return found


def seen(scene: Scene, sites: Sites, module: int) -> bytes:
    """Return all that a module senses."""
    standing = {scene.system.place_of(site): site for site in (*sites, *scene.system.filled)}
    goals = frozenset(scene.goals[module])
    observed = observe(scene.system, sites[module], standing, goals=goals)
    return observed["observation"].tobytes()


def spelt(letters: str) -> Sites:
    return tuple(enumerate(letters))


class Alike(NamedTuple):
    """Two starts; the others' sites, where the starts say nothing of them, are those of the scene.

    In the first start, an action of a module is the only move that leads nearer to the goal.
    """

    spec: str
    one: Sites
    other: Sites
    module: int
    action: int
    before: tuple[int, int]
    """How far the starts are from the goal."""


ARM = ((-1, 0, 0), (-1, 0, 1), (-1, 1, 1))
PAIRS = [
    Alike("words", spelt("cbacbc"), spelt("abacba"), 2, 2, (1, 6)),
    Alike("arm-free:n=6", arm_of("urdddd"), arm_of("rrdldd"), 5, 6, (16, 13)),
    Alike(
        "arms:n=3",
        (*ARM, (2, 0, 1), (2, 1, 1), (-1, 2, 1)),
        (*ARM, (2, 0, 1), (1, 1, 0), (1, 0, 1)),
        0,
        2,
        (4, 11),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS, ids=[pair.spec for pair in PAIRS])
def test_a_move_leads_to_the_goal_or_away_and_looks_the_same(pair: Alike) -> None:
    """Here nothing else leads nearer, there it leads away: by its view a module cannot choose."""
    scene = scene_from_spec(pair.spec)
    one, other = ((*sites, *scene.start[len(sites) :]) for sites in (pair.one, pair.other))
    far = {
        frozenset(each): far for each, far in component(scene, in_order(scene.goal or ())).items()
    }
    nearer, away = (
        [
            (module, action)
            for module, action, after in moves(scene, sites)
            if far[frozenset(after)] - far[frozenset(sites)] == change
        ]
        for sites, change in ((one, -1), (other, 1))
    )
    assert (far[frozenset(one)], far[frozenset(other)]) == pair.before
    assert nearer == [(pair.module, pair.action)]
    assert (pair.module, pair.action) in away
    assert one[pair.module] == other[pair.module]
    assert seen(scene, one, pair.module) == seen(scene, other, pair.module)


@pytest.mark.slow
def test_no_segment_by_itself_knows_whether_the_goal_can_be_reached() -> None:
    """The goal is a deadlocked arm; each segment may have the same part in one that is not."""
    scene = scene_from_spec("arm-free:n=7")
    goal = arm_of(DEADLOCK)
    reached = component(scene, scene.start)
    assert not any(set(sites) == set(goal) for sites in reached)
    for segment, edge in enumerate(goal):
        assert any(sites[segment] == edge for sites in reached)
