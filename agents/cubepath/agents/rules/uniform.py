"""The random rule, for every system: any of the legal actions, including stay.

Without rounds every chosen move is safe too: its support is checked when it is committed.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import View
from cubepath.agents.local.random_streams import DRAW_STEPS, Streams, draw_below
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.compiled import compiled


def make(knowledge: InitialKnowledge) -> Rule:
    """Return a rule that picks uniformly among the legal actions from the module's own stream."""

    def choose(view: View) -> int:
        legal = view.mask.nonzero()[0]
        return int(legal[knowledge.stream.below(len(legal))])

    return choose


def _make_all(knowledge: VectorKnowledge) -> VectorRule:
    """Return the rule of all modules, each of which draws from its own stream."""
    streams = knowledge.streams()
    steps = knowledge.environments * knowledge.modules * (DRAW_STEPS + 1)

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        draw = _draw.for_work(steps, by_entries=True)
        draw(seen.action_mask, seen.playing, streams, chosen.actions)
        return ()

    return choose


@compiled
def _draw(
    mask: NDArray[np.int8], playing: NDArray[np.bool_], streams: Streams, actions: NDArray[np.int32]
) -> None:
    """Draw one of the actions in the mask for each module."""
    for environment in range(mask.shape[0]):
        if not playing[environment]:
            continue
        for module in range(mask.shape[1]):
            legal = 0
            for action in range(mask.shape[2]):
                if mask[environment, module, action] != 0:
                    legal += 1
            left = draw_below(streams, environment, module, legal)
            for action in range(mask.shape[2]):
                if mask[environment, module, action] != 0:
                    if left == 0:
                        actions[environment, module] = action
                        break
                    left -= 1


RANDOM = RuleType(
    name="random",
    summary="any legal action with equal probability, stay among them",
    source="none needed",
    fits=lambda _: True,
    make=make,
    free=FreeRule(why="every commit is a legal move, and nothing more is promised"),
    vectorised=_make_all,
    to_goal=False,
)
