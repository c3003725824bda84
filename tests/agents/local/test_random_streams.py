"""Random streams: SplitMix64 by key and index, uniform and independent, and no way to the seed."""

import copy
import gc
import pickle
from collections.abc import Callable
from functools import _lru_cache_wrapper
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from cubepath.agents.environments.world import World
from cubepath.agents.local.arbitration import RANK, priority
from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import View
from cubepath.agents.local.random_streams import (
    HESITATE,
    PACE,
    RULE,
    draw_below,
    draw_fraction,
    hashed,
    hashed_compiled,
    shared_streams_of,
    stream,
    streams_of,
)
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.rule import InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.obvious_rounds import draw, key_of, rank
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.local_families import LOCAL_FAMILIES

SEED = 918_273_645_546_372_819
PURPOSES = [RULE, HESITATE, PACE, RANK]
SEEDS = st.one_of(st.integers(0, 2**16), st.integers(0, 2**260))
WORDS = st.one_of(st.integers(0, 20), st.integers(0, 2**64 - 1))
BOUNDS = st.one_of(st.integers(1, 20), st.integers(1, 2**32))


@given(WORDS, st.lists(WORDS, min_size=1, max_size=9))
def test_a_draw_is_that_of_splitmix(key: int, indices: list[int]) -> None:
    """Of Python's integers, of arrays, and in compiled code."""
    wanted = [draw(key, index) for index in indices]
    assert [hashed(key, index) for index in indices] == wanted
    assert hashed(np.uint64(key), np.array(indices, np.uint64)).tolist() == wanted
    assert [hashed_compiled(np.uint64(key), np.uint64(index)) for index in indices] == wanted


@pytest.mark.parametrize("left", [PLAIN, COMPILED])
@given(
    st.lists(SEEDS, min_size=1, max_size=4),
    st.integers(1, 3),
    st.sampled_from(PURPOSES),
    st.lists(st.one_of(st.none(), BOUNDS), max_size=9),
)
def test_streams_in_arrays_draw_what_each_draws_by_itself(
    left: int, seeds: list[int], modules: int, purpose: int, bounds: list[int | None]
) -> None:
    """Of any seeds: integers below any bounds and fractions (None), as the definition has them."""
    with plain_steps(left):
        below = draw_below.for_work(1, by_entries=True)
        fraction = draw_fraction.for_work(1, by_entries=True)
    streams = streams_of(seeds, modules, purpose)
    for environment, seed in enumerate(seeds):
        for module in range(modules):
            one, key = stream(seed, module, purpose), draw(key_of(seed, purpose), module)
            for index, bound in enumerate(bounds):
                if bound is None:
                    share = one.fraction()
                    assert fraction(streams, environment, module) == share
                    assert share == (draw(key, index) >> 11) / 2**53
                else:
                    found = one.below(bound)
                    assert below(streams, environment, module, bound) == found
                    assert found == (draw(key, index) >> 32) * bound // 2**32
            assert one.drawn == len(bounds)


@given(SEEDS, st.integers(0, 2**62), st.integers(0, 2**31))
def test_ranks_are_draws(seed: int, number: int, module: int) -> None:
    """As docs/protocol.md specifies them."""
    assert priority(seed, number, module) == rank(seed, number, module)


def grid(purpose: int, seeds: int, modules: int, draws: int) -> NDArray[np.float64]:
    """Return fractions by seed, module and index."""
    streams = streams_of(range(seeds), modules, purpose)
    index = np.arange(draws, dtype=np.uint64)
    return np.asarray(hashed(streams[:, :, np.newaxis], index) / 2.0**64, dtype=np.float64)


def chi_square(cells: NDArray[np.intp], count: int) -> float:
    """Return how far counts are from equal ones, in standard deviations of a chi-square."""
    seen = np.bincount(cells.ravel(), minlength=count)
    expected = cells.size / count
    return float((((seen - expected) ** 2 / expected).sum() - (count - 1)) / (2 * count - 2) ** 0.5)


PAIRS: dict[str, Callable[[NDArray[np.float64]], tuple[Any, Any]]] = {
    "seeds": lambda found: (found[:-1], found[1:]),
    "modules": lambda found: (found[:, :-1], found[:, 1:]),
    "indices": lambda found: (found[:, :, :-1], found[:, :, 1:]),
    "a module and the next index": lambda found: (found[:, 1:, :-1], found[:, :-1, 1:]),
    "a seed and the next module": lambda found: (found[1:, :-1], found[:-1, 1:]),
    "seeds far apart": lambda found: (found[:32], found[32:]),
    "modules far apart": lambda found: (found[:, :32], found[:, 32:]),
}


@pytest.mark.parametrize("purpose", PURPOSES)
def test_draws_are_uniform_and_independent(purpose: int) -> None:
    """Over small seeds, modules and indices, alone and by neighbours: within 4.5 deviations."""
    found = grid(purpose, 64, 64, 64)
    for bits in (0, 16, 32, 40):
        cells = (found * 2.0**bits % 1 * 256).astype(np.intp)
        assert abs(chi_square(cells, 256)) < 4.5, f"from bit {bits}"
    for name, pair in PAIRS.items():
        one, other = pair(found)
        cells = (one * 16).astype(np.intp) * 16 + (other * 16).astype(np.intp)
        assert abs(chi_square(cells, 256)) < 4.5, name


def test_purposes_are_independent() -> None:
    """What a module draws for one tells nothing of what it draws for another."""
    found = [grid(purpose, 64, 64, 16) for purpose in PURPOSES]
    for number, one in enumerate(found):
        for other in found[:number]:
            cells = (one * 16).astype(np.intp) * 16 + (other * 16).astype(np.intp)
            assert abs(chi_square(cells, 256)) < 4.5


def test_each_order_of_ranks_is_as_frequent() -> None:
    """Of four modules over rounds and seeds, and nobody goes before another twice as a rule."""
    orders = []
    for seed in range(40):
        for number in range(60):
            order = sorted(range(4), key=lambda module: priority(seed, number, module))
            orders.append(order[0] * 64 + order[1] * 16 + order[2] * 4 + order[3])
    names, cells = np.unique(orders, return_inverse=True)
    assert len(names) == 24
    assert abs(chi_square(cells, 24)) < 4.5
    again = cells[:-1] * 24 + cells[1:]
    assert abs(chi_square(again, 576)) < 4.5


def test_a_generator_is_that_of_the_key_whatever_was_drawn() -> None:
    """Numpy's, made when it is asked for, once; another one for each seed, module and purpose."""
    one, other = stream(SEED, 3, RULE), stream(SEED, 3, RULE)
    one.fraction()
    assert one.generator is one.generator
    assert one.generator.integers(2**60) == other.generator.integers(2**60)
    given = [(SEED, 3, RULE), (SEED, 4, RULE), (SEED + 1, 3, RULE), (SEED, 3, HESITATE)]
    assert len({stream(*each).generator.random() for each in given}) == len(given)


def test_a_stream_continues_in_another_process() -> None:
    """Pickled or copied, it draws what it would have drawn, with its generator."""
    mine = stream(SEED, 3, RULE)
    before = mine.fraction(), mine.generator.random()
    others = [copy.deepcopy(mine), pickle.loads(pickle.dumps(mine))]  # noqa: S301 - our own
    wanted = mine.fraction(), mine.generator.random()
    assert wanted != before
    assert [(each.fraction(), each.generator.random()) for each in others] == [wanted] * 2


def test_a_negative_seed_is_refused() -> None:
    """It is said which one it is."""
    for refused in (lambda: streams_of([1, -3], 2, RULE), lambda: stream(-3, 0, RULE)):
        with pytest.raises(InputError, match="seed=-3: expected 0 or more"):
            refused()


def reached(found: object, most: int = 200_000) -> list[Any]:
    """Return what can be reached from an object: attributes, items, closures, bound methods.

    Not through modules and classes, which hold the same in every run, nor into what functions keep
    of earlier calls: catalogues keep moves of all runs.
    """
    known: dict[int, object] = {}
    queue = [found]
    while queue and len(known) < most:
        each = queue.pop()
        if id(each) in known or isinstance(each, ModuleType | type | BuiltinFunctionType):
            continue
        known[id(each)] = each
        if isinstance(each, FunctionType):
            cells = each.__closure__ or ()
            queue += [cell.cell_contents for cell in cells]
            queue += [each.__defaults__, each.__kwdefaults__, vars(each)]
        elif isinstance(each, _lru_cache_wrapper):
            queue.append(each.__wrapped__)
        elif isinstance(each, MethodType):
            queue += [each.__func__, each.__self__]
        else:
            queue += gc.get_referents(each)
            if isinstance(each, np.random.Generator):
                queue += [each.bit_generator, each.bit_generator.seed_seq]
    assert len(known) < most
    return list(known.values())


def test_the_modules_of_a_run_share_a_stream() -> None:
    """It follows from the seed alone, has numbers of its own, and is the same in arrays."""
    keys = {stream(SEED, module, RULE).shared for module in range(5)}
    assert len(keys) == 1
    assert not keys & {stream(SEED, module, RULE).key for module in range(100)}
    assert keys != {stream(SEED + 1, 0, RULE).shared}
    assert shared_streams_of([SEED]).tolist() == [list(keys)]


@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_a_rule_reaches_nothing_of_the_run(spec: str) -> None:
    """From its knowledge and its view: its own generator, no scene, no actor, no seed."""
    scene = scene_from_spec(spec)
    given: list[InitialKnowledge | View] = []

    def make(knowledge: InitialKnowledge) -> Rule:
        given.append(knowledge)

        def choose(view: View) -> int:
            given.append(view)
            return int(knowledge.random.integers(1))

        return choose

    rule = RuleType("nosy", "keeps all that it is given", "a test", lambda _: True, make)
    world = World(scene, seed=SEED)
    actors = actors_for(scene, rule, seed=SEED, hesitate=0.5, modules=[0])
    actors[0].act(world.observe(0))
    assert len(given) == 2
    found = reached(given)
    assert not [each for each in found if isinstance(each, Scene | World | Actor | ModuleCore)]
    assert len([each for each in found if isinstance(each, np.random.Generator)]) == 1
    assert SEED not in [each for each in found if type(each) is int]
