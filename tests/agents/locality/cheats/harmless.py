"""A rule that is local: a cache that saves work, generators of its own, time in a library."""

import logging
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cubepath.agents import InitialKnowledge, Rule, RuleType, View

asked: dict[int, int] = {}


@lru_cache
def square(number: int) -> int:
    """Return the square: the same, whoever asked first."""
    asked[number] = number * number
    return number * number


def make(knowledge: InitialKnowledge) -> Rule:
    class Pair(NamedTuple):  # which looks at its caller's frame
        one: int
        other: int

    own = np.random.default_rng(knowledge.module)
    (more,) = knowledge.random.spawn(1)
    known: list[int] = []

    def choose(view: View) -> int:
        known.append(square(len(view.occupied)))
        pair = Pair(int(own.integers(5)), int(knowledge.random.integers(5) + more.integers(2)))
        logging.getLogger("harmless").debug("asked %s", pair)
        legal = view.mask.nonzero()[0]
        return int(legal[(sum(known) + pair.one + pair.other) % len(legal)])

    return choose


RULE = RuleType("harmless", "local", "a test", lambda _: True, make)
