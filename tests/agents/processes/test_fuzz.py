"""Junk of every kind told to nodes: nothing is raised, nothing grows, and honest runs go on."""

import tracemalloc
from collections.abc import Callable
from functools import cache
from random import Random

import pytest
from hypothesis import given, strategies as st

from cubepath.agents.processes.config import OUTSIDE
from cubepath.protocol.wire.messages import NoMessageError, decode
from samples.driven import CASES, COORDINATOR, RUN, Driven, fate
from tampering.junk import Junk

Told = list[tuple[int, str, bytes]]


def intruding(
    driven: Driven,
    random: Random,
    most: int,
    allowed: Callable[[str, bytes], bool] = lambda _key, _data: True,
) -> Callable[[], Told]:
    """Return an intruder that tells any node up to so much junk before each message."""
    junk = Junk(random)

    def intruder() -> Told:
        for key, data in driven.put[-4:]:
            junk.heard(key, data)
        told: Told = []
        for _ in range(random.randrange(most + 1)):
            key, data = junk.one()
            if allowed(key, data):
                told.append((random.randrange(COORDINATOR, len(driven.nodes)), key, data))
        return told

    return intruder


@cache
def honest(spec: str, rule: str, rounds: int) -> str:
    """Return the digest of a run without junk."""
    return Driven(spec, rule).play(rounds)


def stranger(driven: Driven) -> Callable[[str, bytes], bool]:
    """Return what a stranger can put where a router guards who puts: all but in others' names."""

    def allowed(key: str, data: bytes) -> bool:
        if key.rpartition("/")[2] not in {"coordinator", *driven.names}:
            return True
        try:
            decode(data)
        except NoMessageError:
            return True
        return (key, data) in driven.put  # what was said can come again

    return allowed


@pytest.mark.slow
@given(case=st.sampled_from(CASES), seed=st.integers(0, 1 << 32))
def test_nothing_is_raised_whatever_is_told(case: tuple[str, str], seed: int) -> None:
    """By nodes in every phase; a coordinator may end the run in one line, and does no more."""
    driven = Driven(*case)
    line = fate(driven, 2, intruding(driven, Random(seed), 2))  # noqa: S311 - not for secrets
    assert "\n" not in line


@pytest.mark.thorough
@given(case=st.sampled_from(CASES), seed=st.integers(0, 1 << 32))
def test_an_honest_run_comes_to_the_same_path(case: tuple[str, str], seed: int) -> None:
    """Whatever strangers say, and whatever is said again or damaged on its way."""
    driven = Driven(*case)
    random = Random(seed)  # noqa: S311 - not for secrets
    found = driven.play(2, intruding(driven, random, 2, stranger(driven)))
    assert found == honest(*case, 2)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "case",
    [
        CASES[1],
        pytest.param(CASES[3], marks=pytest.mark.thorough),
        pytest.param(("hex:n=4", "random"), marks=pytest.mark.thorough),
    ],
)
@pytest.mark.slow
def test_memory_does_not_grow_with_junk(case: tuple[str, str]) -> None:
    """In the middle of a round, that waits for somebody who is silent: forged messages too."""
    driven = Driven(*case)
    random = Random(3)  # noqa: S311 - not for secrets
    driven.play(1)
    tell = intruding(driven, random, 40)
    driven.say_nothing = True
    sizes = []
    tracemalloc.start()
    try:
        for _ in range(5):
            for _ in range(60):
                for number, key, data in tell():
                    driven.tell(number, key, data)
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert sizes[-1] - sizes[1] < 400_000, sizes


@pytest.mark.nightly
@pytest.mark.timeout(400)
def test_two_hundred_thousand_messages() -> None:
    """As above, of many seeds; each tells some hundreds of messages."""
    told = 0
    for seed in range(1 << 20):
        driven = Driven(*CASES[seed % len(CASES)])
        random = Random(seed)  # noqa: S311 - not for secrets
        intruder = intruding(driven, random, 40)

        def counted(intruder: Callable[[], Told] = intruder) -> Told:
            nonlocal told
            found = intruder()
            told += len(found)
            return found

        assert "\n" not in fate(driven, 2, counted)
        if told >= 200_000:
            return


def test_the_cases_have_what_is_needed() -> None:
    """Driven from outside too; several processes that speak."""
    assert OUTSIDE in {rule for _, rule in CASES}
    for case in CASES[:2]:
        driven = Driven(*case)
        driven.play(1)
        assert len(driven.nodes) >= 2
        assert all(key.startswith(f"cubepath/{RUN}/") for key, _ in driven.put)
