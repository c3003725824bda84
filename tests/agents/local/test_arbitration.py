"""Settling: ranks, conflicts, and the set that modules find by messages among themselves."""

from __future__ import annotations

import random
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cubepath.agents.environments.world import World
from cubepath.agents.local.arbitration import Conflicts, maximal, priority, settled
from cubepath.agents.local.module import ModuleCore, ProtocolError
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.actions import Action, apply_in_place, commute
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import addressees
from cubepath.protocol.wire.messages import Claim, Here, Message

SPECS = [
    "hex:n=7",
    "hex-open:n=7",
    "arm:n=7",
    "agv:graph=grid4x4,n=9",
    "agv:graph=C7,n=4",
    "agv-labelled:graph=grid3x3,n=6",
    "sliding:p=2,q=2,n=5",
    "arms:n=2",
]


def random_rounds(spec: str, seed: int, rounds: int) -> Iterator[tuple[World, dict[int, Action]]]:
    """Yield the world and its claims in each round of a random run."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=seed)
    actors = actors_for(scene, RANDOM, seed=seed, hesitate=0.0)
    for _ in range(rounds):
        actions = {m: actor.act(world.observe(m)).action for m, actor in actors.items()}
        claims = {}
        for module, action in actions.items():
            move = scene.system.moves(world.sites[module])[action - 1] if action else None
            if move is not None:
                claims[module] = move.action
        yield world, claims
        world.step(actions)


@pytest.mark.parametrize("spec", SPECS)
def test_what_is_executed_commutes_and_nothing_could_be_added(spec: str) -> None:
    """The settled set commutes pairwise, is maximal, and holds every locally highest claim."""
    lost = 0
    for world, claims in random_rounds(spec, seed=1, rounds=60):
        number = world.round + 1
        winners = settled(claims, 1, number)
        lost += len(claims) - len(winners)
        for module, action in claims.items():
            rivals = [m for m in claims if m != module and not commute(claims[m], action)]
            if module in winners:
                assert not set(rivals) & set(winners)
            else:
                assert set(rivals) & set(winners)
            if all(priority(1, number, module) > priority(1, number, m) for m in rivals):
                assert module in winners
    assert lost > 0


def test_settled_is_nearly_as_much_as_any_maximal_choice() -> None:
    """Over random runs of all systems, at least 99% of what a best maximal choice executes."""
    executed = best = 0
    shuffle = random.Random(0)  # noqa: S311 - a test's own order
    for spec in SPECS:
        for world, claims in random_rounds(spec, seed=2, rounds=80):
            executed += len(settled(claims, 2, world.round + 1))
            order = list(claims)
            shuffle.shuffle(order)
            best += len(maximal(claims, order))
    assert executed >= 0.99 * best


@given(st.lists(st.tuples(st.sets(st.integers(0, 9), min_size=1), st.sets(st.integers(0, 9)))))
def test_conflicts_are_found_by_sites(parts: list[tuple[set[int], set[int]]]) -> None:
    """Looking up by sites finds exactly the actions that do not commute."""
    actions = [Action(trace | more, trace, trace, ()) for trace, more in parts]
    found = Conflicts()
    for number, action in enumerate(actions):
        expected = {m for m in range(number) if not commute(actions[m], action)}
        assert found.with_action(action) == expected
        found.add(number, action)


def test_rank_is_a_fixed_function() -> None:
    """Ranks are the same in every process and differ between rounds, modules and seeds."""
    assert priority(0, 1, 0) == (5988601568097220684, 0)
    values = {priority(seed, number, m)[0] for seed in (0, 1) for number in (1, 2) for m in (0, 1)}
    assert len(values) == 8


class Mail:
    """Delivers messages between module cores in one process, in an order of its own."""

    def __init__(self, scene: Scene, seed: int, order: random.Random) -> None:
        self.scene = scene
        self.order = order
        self.cores = [
            ModuleCore(
                scene.system,
                module=module,
                site=site,
                goals=scene.goals[module] if scene.goals else (),
                seed=seed,
                note_length=0,
            )
            for module, site in enumerate(scene.start)
        ]
        self.post: list[Message] = []

    def deliver(self) -> None:
        """Deliver all that is under way, and what that causes, in random order."""
        at = {core.place: core for core in self.cores}
        while self.post:
            message = self.post.pop(self.order.randrange(len(self.post)))
            for place in addressees(self.scene.system, message) or ():
                if place in at:
                    self.post += at[place].hear(message)

    def round(self, number: int, actors: dict[int, Actor]) -> list[int]:
        """Play a round by messages; return the modules whose claims were executed."""
        for core in self.cores:
            self.post += core.sense(number)
        self.deliver()
        for core in self.cores:
            self.post += core.claim(actors[core.module].act(core.observation()).action, None)
        self.deliver()
        for core in self.cores:
            self.post += core.arbitrate()
        self.deliver()
        assert all(core.finished for core in self.cores)
        reports = [core.report() for core in self.cores]
        return [report.module for report in reports if report.claim == "granted"]


@pytest.mark.parametrize("spec", SPECS)
def test_modules_settle_by_messages_what_is_settled_at_once(spec: str) -> None:
    """In any order of delivery, modules reach by messages the settled set and the same places."""
    lost = 0
    for seed in range(3):
        scene = scene_from_spec(spec)
        world = World(scene, seed=seed)
        mail = Mail(scene, seed, random.Random(seed + 100))  # noqa: S311 - a test's own order
        here = actors_for(scene, RANDOM, seed=seed, hesitate=0.2)
        there = actors_for(scene, RANDOM, seed=seed, hesitate=0.2)
        for number in range(1, 25):
            actions = {m: actor.act(world.observe(m)).action for m, actor in here.items()}
            played = world.step(actions)
            lost += len(played.lost)
            assert mail.round(number, there) == list(played.moves)
            assert [core.site for core in mail.cores] == world.sites
    assert lost > 0


def test_the_state_of_the_world_follows_its_actions() -> None:
    """Where modules are is what applying the executed actions to the state gives."""
    for spec in SPECS:
        scene = scene_from_spec(spec)
        world = World(scene, seed=0)
        actors = actors_for(scene, RANDOM, seed=0, hesitate=0.0)
        state = set(scene.start_state)
        for _ in range(30):
            played = world.step({m: p.act(world.observe(m)).action for m, p in actors.items()})
            for move in reversed(list(played.moves.values())):
                apply_in_place(move.action, state)
            assert state == set(world.sites) | scene.system.filled


def test_a_late_message_is_never_taken_silently() -> None:
    """A message for a phase that is over means that barriers broke: the module says so."""
    scene = scene_from_spec("hex:n=3")
    core = ModuleCore(scene.system, module=0, site=(0, 0), goals=(), seed=0, note_length=0)
    core.sense(1)
    core.observation()
    with pytest.raises(ProtocolError, match="came late"):
        core.hear(Here(1, 1, (1, 0)))
    with pytest.raises(ProtocolError, match="came late"):
        core.hear(Claim(0, 1, (1, 0), "pivot-0-left", (1, 0)))
    with pytest.raises(ProtocolError, match="no move from there"):
        core.hear(Claim(1, 1, (1, 0), "pivot-0-left", (5, 5)))


def test_an_early_message_waits_for_its_round() -> None:
    """A neighbour that is a round ahead is heard when that round begins."""
    scene = scene_from_spec("hex:n=3")
    core = ModuleCore(scene.system, module=0, site=(0, 0), goals=(), seed=0, note_length=0)
    core.hear(Here(1, 1, (1, 0)))
    core.sense(1)
    seen = core.observation()["observation"]
    assert np.count_nonzero(seen[3::2] == 1) == 1
