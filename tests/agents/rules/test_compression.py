"""The rule `compression`: its patterns, its exact kernel, and what long runs of it sample."""

from collections.abc import Iterator
from itertools import combinations, product
from math import prod

import numpy as np
import pytest
from numpy.typing import NDArray

from cubepath.agents import InitialKnowledge, RuleType, play_many
from cubepath.agents.environments.vector_environment import CubepathVectorEnv
from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import view_of
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.compression import COMPRESSION, PATTERNS, compression_rule, way
from cubepath.agents.rules.registry import find_rule
from cubepath.agents.rules.rule import as_choice
from cubepath.agents.rules.vector_actors import vector_actors_for
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.catalogue import HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Message, Report, parts_of
from cubepath.protocol.wire.nodes import Keep
from oracles.slow_compression import shares_without_rounds
from samples.compressed import (
    Shape,
    all_shapes,
    at_origin,
    distance,
    neighbours,
    pairs_in,
    shares,
    shares_up_to_symmetry,
    total_variation,
)
from samples.slow_turns import shapes_in_turns

SYSTEM = scene_from_spec("compression:n=2").system
KEYS = {RandomStream(key).below(PATTERNS): key for key in range(1000)}
"""For each pattern a key of a shared stream that begins with it."""
DUE = shares_up_to_symmetry(4, bias=4.0)


class Coin(float):
    """A drawn number that notes what it is compared with; it is less."""

    against = 1.0

    def __lt__(self, other: float) -> bool:
        Coin.against = other
        return True


class CoinStream(RandomStream):
    """A stream of such coins."""

    def fraction(self) -> float:
        return Coin(0)


def partner(cell: Cell, pattern: int) -> Cell | None:
    """Return the other cell of a cell's pair."""
    turn = way(pattern, *cell)
    return None if turn < 0 else neighbours(cell)[turn]


def window(pattern: int) -> set[frozenset[Cell]]:
    """Return the pairs of a pattern near the origin."""
    cells: list[Cell] = [(q, r) for q in range(-8, 9) for r in range(-8, 9)]
    pairs = ((cell, partner(cell, pattern)) for cell in cells)
    return {frozenset((cell, other)) for cell, other in pairs if other is not None}


@pytest.mark.parametrize("pattern", range(PATTERNS))
def test_the_moves_of_a_pattern_commute(pattern: int) -> None:
    """Its pairs are of neighbours, no cell is in two, and no pair is in the support of another."""
    pairs = window(pattern)
    moves = []
    for here, there in pairs:
        assert there in neighbours(here)
        assert partner(here, pattern) == there
        assert partner(there, pattern) == here
        ring = {*neighbours(here), *neighbours(there)}
        moves.append(Action(ring, (here, there), [here], [there]))
    assert len(pairs) > 17 * 17 // 6
    assert all(commute(one, other) for one, other in combinations(moves, 2))


def test_each_pair_is_in_one_of_the_fifteen_patterns() -> None:
    """So all are drawn equally often, wherever they lie."""
    found = [pair for pattern in range(PATTERNS) for pair in window(pattern)]
    inner = [(q, r) for q in range(-6, 7) for r in range(-6, 7)]
    for cell in inner:
        for near in neighbours(cell):
            assert found.count(frozenset((cell, near))) == 1


def scene_at(shape: Shape) -> Scene:
    """Return the scene of a shape."""
    return Scene(spec="compressed", family="", system=SYSTEM, start=shape)


def chances(rule: RuleType, shape: Shape, pattern: int) -> Iterator[dict[Cell, float]]:
    """Yield for each module where it goes with which probability, as its rule decides."""
    world = World(scene_at(shape), seed=0)
    for module, cell in enumerate(shape):
        stream = CoinStream(module, KEYS[pattern])
        knowledge = InitialKnowledge(SYSTEM, module, len(shape), cell, (), stream)
        Coin.against = 1.0
        view = view_of(SYSTEM, world.observe(module))
        action = as_choice(rule.made(knowledge)(view)).action
        move = view.moves[action - 1] if action else None
        if move is None:
            yield {cell: 1.0}
        else:
            yield {HEXAGONS.check(move.target): Coin.against, cell: 1 - Coin.against}


def kernel(rule: RuleType, shapes: list[Shape]) -> NDArray[np.float64]:
    """Return the probability that a round leads from one shape to another, exactly."""
    number = {shape: n for n, shape in enumerate(shapes)}
    found = np.zeros((len(shapes), len(shapes)))
    for shape, pattern in product(shapes, range(PATTERNS)):
        for ends in product(*(each.items() for each in chances(rule, shape, pattern))):
            after = at_origin(cell for cell, _ in ends)
            found[number[shape], number[after]] += prod(share for _, share in ends) / PATTERNS
    return found


@pytest.mark.parametrize(
    ("count", "bias"),
    [
        (2, 4.0),
        (3, 4.0),
        pytest.param(4, 4.0, marks=pytest.mark.thorough),
        pytest.param(4, 0.5, marks=pytest.mark.thorough),
        pytest.param(5, 4.0, marks=pytest.mark.nightly),
        pytest.param(5, 2.0, marks=pytest.mark.nightly),
    ],
)
def test_a_round_keeps_the_distribution(count: int, bias: float) -> None:
    """Detailed balance holds exactly, and from each shape each other is reached."""
    shapes = all_shapes(count)
    assert len(shapes) == [1, 3, 11, 44, 186][count - 1]
    found, due = kernel(compression_rule(bias), shapes), np.array(shares(shapes, bias))
    flow = due[:, np.newaxis] * found
    assert np.abs(found.sum(axis=1) - 1).max() < 1e-12
    assert np.abs(flow - flow.T).max() < 1e-12
    assert np.abs(due @ found - due).max() < 1e-12
    assert found.diagonal().min() > 0
    assert (np.linalg.matrix_power(found, 4 * count) > 0).all()


def sampled(rounds: int, *, seed: int, hesitate: float = 0.0) -> Iterator[Shape]:
    """Yield the shape after each round of a run of four modules."""
    scene = scene_from_spec("compression:n=4")
    world = World(scene, seed=seed)
    actors = actors_for(scene, COMPRESSION, seed=seed, hesitate=hesitate)
    for _ in range(rounds):
        world.step({module: actors[module].act(world.observe(module)).action for module in actors})
        yield at_origin(world.sites)


def sampled_side_by_side(runs: int, rounds: int, *, hesitate: float) -> list[list[Shape]]:
    """Return the shapes of runs in arrays, from round 200 on."""
    env = CubepathVectorEnv("compression:n=4", num_envs=runs, max_cycles=rounds + 1, copy=False)
    actors = vector_actors_for(env.scene, COMPRESSION, seeds=range(runs), hesitate=hesitate)
    assert actors is not None
    found: list[list[Shape]] = [[] for _ in range(runs)]
    actions = np.zeros((runs, 4), np.int32)
    seen, _ = env.reset(seed=0)
    for number in range(rounds):
        actors.act(seen["observation"], seen["action_mask"], None, actions)
        seen, *_ = env.step(actions)
        if number >= 200:
            for run, cells in zip(found, seen["observation"][:, :, :2].tolist(), strict=True):
                run.append(at_origin(map(tuple, cells)))
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("hesitate", [0.0, 0.3])
def test_long_runs_have_the_distribution(hesitate: float) -> None:
    """Also where modules hesitate: up to symmetry, the interval of the distance is below 0.03."""
    found = distance(sampled_side_by_side(32, 10_000, hesitate=hesitate), DUE)
    print(found)
    assert found.most < 0.03


@pytest.mark.slow
def test_short_runs_are_near_the_distribution() -> None:
    """As near as can be expected of 6,400 rounds, and far from that of another lambda."""
    sample = sampled_side_by_side(16, 600, hesitate=0.0)
    assert distance(sample, DUE).found < 0.1
    assert distance(sample, shares_up_to_symmetry(4, 1.0)).found > 0.3


def wire_sites(rounds: int, *, seed: int) -> dict[int, dict[int, Site]]:
    """Return by round and module where modules were after it, in two processes over zenoh."""
    found: dict[int, dict[int, Site]] = {}

    def sink(kept: Keep[Message], wall_ns: int) -> None:
        for part in parts_of(kept.message):
            if isinstance(part, Report):
                found.setdefault(part.round, {})[part.module] = site_from_json(part.site)

    scene = scene_from_spec("compression:n=4")
    with LockstepFleet(
        scene, "compression", seed=seed, hesitate=0.0, processes=2, sink=sink
    ) as fleet:
        for _ in fleet.rounds(rounds):
            pass
    return found


@pytest.mark.thorough
def test_on_the_wire_rounds_are_the_same() -> None:
    """Two processes make the rounds of the environment, so what long runs sample is the same."""
    rounds = wire_sites(1_000, seed=1)
    on_the_wire = [at_origin(rounds[number].values()) for number in sorted(rounds)]
    assert on_the_wire == list(sampled(1_000, seed=1))


@pytest.mark.timeout(3600)
@pytest.mark.nightly
def test_on_the_wire_the_distribution_is_the_same() -> None:
    """The whole interval is below 0.03; some twenty minutes, at 75 rounds a second."""
    rounds = wire_sites(100_000, seed=2)
    found = distance([[at_origin(rounds[number].values()) for number in sorted(rounds)]], DUE)
    print(found)
    assert found.most < 0.03


@pytest.mark.slow
def test_without_rounds_shares_are_exact_only_if_turns_take_no_time() -> None:
    """The total variation falls with the latency, in proportion: it is exact in the limit."""
    exact = shares_up_to_symmetry(3, bias=4.0)
    far = {
        latency: total_variation(shares_without_rounds(3, latency, bias=4.0), exact)
        for latency in (1e-6, 0.02, 0.1, 0.5)
    }
    print(far)
    assert far[1e-6] < 1e-6
    assert 0.001 < far[0.02] < 0.0015
    assert 0.005 < far[0.1] < 0.006
    assert 0.018 < far[0.5] < 0.019


@pytest.mark.nightly
@pytest.mark.parametrize("latency", [0.1, 2.0])
def test_without_rounds_shares_are_as_computed(latency: float) -> None:
    """What the keeper refuses in a run has the effect that it has in the exact shares."""
    shapes, refused = shapes_in_turns(3, latency, end=4_000, seed=1)
    found = distance([shapes], shares_without_rounds(3, latency, bias=4.0))
    print(found, refused)
    assert found.found < 0.03
    assert 0 < refused < 0.5


@pytest.mark.slow
def test_lines_of_twelve_compress() -> None:
    """No claim is lost, nobody gives up, and there are soon many more pairs of neighbours."""
    runs = play_many("compression:n=12", "compression", range(8), max_rounds=1_000)
    assert not runs.lost.any()
    assert not runs.failed
    pairs = [pairs_in(map(HEXAGONS.check, sites)) for sites in runs.sites]
    assert sum(pairs) / len(pairs) > 17 > pairs_in((q, 0) for q in range(12))


@pytest.mark.parametrize("bias", ["0", "-1", "1e7", "nan", "four"])
def test_a_lambda_out_of_bounds_is_refused(bias: str) -> None:
    """One line says what was expected."""
    with pytest.raises(InputError, match=r"lambda=.*: expected"):
        find_rule(f"compression:lambda={bias}")
