"""The rule `compression`: shapes with many pairs of neighbours are more likely.

Source: Cannon, Daymude, Randall and Richa, A Markov chain algorithm for compression in
self-organizing particle systems (PODC 2016, arXiv 1603.07991). There modules step one at a time;
the rounds are our own.

A module senses the cells within two steps. It remembers nothing but how much it has drawn, and says
nothing. It has no goal, and never gives up. Its runs sample shapes: in the limit a connected shape
without holes, up to translation, has the probability pi, proportional to lambda ** pairs, where
`pairs` counts its pairs of neighbours.

Under the lockstep clock. In each round all modules draw the same one of 15 patterns (`way`)
from a stream that they share. A pattern is a set of pairs of neighbouring cells, of which any two
are at least two steps apart. A module whose cell is in a pair may step to the other cell of the
pair. If that is legal, it does so with probability 0.9 min(1, lambda ** gained), where `gained` is
by how much the number of its neighbours grows.

A round keeps pi exactly.

1. The pattern follows from the seed and the number of the round alone. It does not depend on where
   modules are or on what they draw by themselves.
2. Given the pattern, pairs do not affect each other. Whether a step is legal and what it gains
   depends on the pair and the eight cells round it. No cell of another pair is among these ten, so
   the steps of other pairs change neither. The moves commute, no claim is lost, and a round is the
   product of one kernel for each pair, in any order.
3. The kernel of a pair is reversible: a step back belongs to the same pair and gains the opposite,
   and pi(s) min(1, lambda ** gained) = pi(t) min(1, lambda ** -gained) for a step from s to t. So
   each kernel keeps pi, and so do their product and the mean over patterns. As the kernels of a
   pattern commute, a round is reversible, too.

From every shape the probabilities tend to pi. A pair stays as it is with probability 0.1 or more,
so each step of the paper's chain is made alone with some probability, and its steps lead from each
connected shape without holes to each other (paper). A hesitation P makes 1 - P of the 0.9, no more.

Under the free clock each turn draws one of six directions from the module's own stream. If turns
are atomic and come in an order that does not depend on the shape, pi is kept for the same reasons.
If a turn takes time, it is refused when a cell of its support has changed meanwhile. That happens
more often in some shapes than in others, so pi is kept only approximately:
`tests/bench/bench_compression.py` measures by how much.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.local.random_streams import (
    DRAW_STEPS,
    RandomStream,
    Streams,
    draw_below,
    draw_fraction,
)
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.vector_chain import moves_by_orbit
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Generator, Move
from cubepath.protocol.core.options import keys_of, options_from_values
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

_FORMS = ((1, 3), (3, 1), (2, 3))
_PERIOD = 5
PATTERNS = len(_FORMS) * _PERIOD
_WILLING = 0.9
_STEPS = 3
"""Microseconds in plain Python, to find a module's pair and its move."""

_Chance: TypeAlias = Callable[[Move], float]


def way(pattern: int, q: int, r: int) -> int:
    """Return the direction, 0 to 5, from cell (q, r) to the other cell of its pair; -1 for none.

    Pattern 5 a + c pairs each cell whose number is c with the next one in direction a. Cells are
    numbered modulo 5 by the form ``q + 3 r`` for a = 0, turned by 60 degrees for each further one.
    From direction a on, counter-clockwise, a step adds 1, 3, 2, 4, 2, 3. So of the cells beside one
    with number c or c + 1 the partner alone has one of these: pairs are at least two steps apart.
    """
    axis = pattern // _PERIOD
    number = (_FORMS[axis][0] * q + _FORMS[axis][1] * r - pattern) % _PERIOD
    return axis + 3 * number if number < 2 else -1


_way = compiled(way)


def _around(site: Site) -> tuple[Site, ...]:
    return HEXAGONS.beside(HEXAGONS.check(site))


def _turn(move: Move) -> int:
    return _around(move.source).index(move.target)


def _gained(move: Move) -> int:
    """Return by how much the number of the mover's neighbours grows."""
    on = next(end for end in move.action.ends if move.source in end) - {move.source}
    return len(on.intersection(_around(move.target))) - len(on.intersection(_around(move.source)))


def _step(view: View, turn: int, chance: _Chance, stream: RandomStream) -> int:
    """Return the action of stepping in a direction, if that is legal and the draw allows it."""
    for action in view.mask.nonzero()[0].tolist():
        move = view.moves[action - 1] if action != STAY else None
        if move is not None and _turn(move) == turn:
            return action if stream.fraction() < chance(move) else STAY
    return STAY


class _Slots(NamedTuple):
    """In which direction the move of a slot leads, and with which probability it is made."""

    turns: NDArray[np.int64]
    chances: NDArray[np.float64]


@compiled
def _step_all(
    seen: VectorView, slots: _Slots, shared: Streams, streams: Streams, actions: NDArray[np.int32]
) -> None:
    """Do for all modules what `_step` does."""
    for environment in range(actions.shape[0]):
        if not seen.playing[environment]:
            continue
        pattern = int(draw_below(shared, environment, 0, PATTERNS))
        for module in range(actions.shape[1]):
            q, r = (
                seen.observation[environment, module, 0],
                seen.observation[environment, module, 1],
            )
            turn = _way(pattern, q, r)
            for slot in range(len(slots.turns)):
                legal = seen.action_mask[environment, module, slot + 1] != 0
                if legal and slots.turns[slot] == turn:
                    if draw_fraction(streams, environment, module) < slots.chances[slot]:
                        actions[environment, module] = slot + 1
                    break


def _make_all(knowledge: VectorKnowledge, chance: _Chance) -> VectorRule | None:
    tabled = moves_by_orbit(knowledge.system, knowledge.starts)
    if tabled is None:
        return None
    (moves,) = tabled.values()
    slots = _Slots(np.array([*map(_turn, moves)]), np.array([*map(chance, moves)]))
    shared, streams = knowledge.shared_streams(), knowledge.streams()
    steps = knowledge.environments * knowledge.modules * (DRAW_STEPS + _STEPS)

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        step = _step_all.for_work(steps, by_entries=True)
        step(seen, slots, shared, streams, chosen.actions)
        return ()

    return choose


def _is_step(generator: Generator) -> bool:
    """Return whether one module steps to a cell beside it, and the state of all around is exact."""
    (here, there), *others = generator.motion
    near = {*_around(here), *_around(there)}
    return not others and not generator.free and near == set(generator.support)


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    return (
        catalogue is not None
        and catalogue.lattice == HEXAGONS
        and all(map(_is_step, catalogue.generators))
    )


@dataclass(frozen=True, slots=True)
class CompressionOptions:
    """The key of the rule; the name of the field ends with _ because Python has that word."""

    lambda_: Annotated[
        float, Meta(gt=0, le=1e6, description="shapes are likelier by this factor for each pair")
    ] = 4.0


def compression_rule(bias: float = 4.0) -> RuleType:
    """Return the rule with this lambda, which is more than 0 and at most a million."""

    def chance(move: Move) -> float:
        return _WILLING * min(1.0, bias ** _gained(move))

    def in_rounds(knowledge: InitialKnowledge) -> Rule:
        shared, stream = knowledge.shared_stream(), knowledge.stream

        def choose(view: View) -> int:
            turn = way(shared.below(PATTERNS), *HEXAGONS.check(view.place))
            return _step(view, turn, chance, stream)

        return choose

    def in_turns(knowledge: InitialKnowledge) -> Rule:
        stream = knowledge.stream
        return lambda view: _step(view, stream.below(len(HEX_DIRECTIONS)), chance, stream)

    return RuleType(
        name="compression",
        summary="shapes with more neighbours are likelier, by lambda for each pair",
        source="Cannon, Daymude, Randall, Richa (PODC 2016), a Markov chain; rounds our own",
        fits=_fits,
        make=in_rounds,
        free=FreeRule(
            why="every commit is a step of the chain; its probabilities hold if turns are short",
            make=in_turns,
        ),
        vectorised=lambda knowledge: _make_all(knowledge, chance),
        keys=_KEYS,
        configure=_configured,
        to_goal=False,
    )


def _configured(values: Mapping[str, str]) -> RuleType:
    return compression_rule(options_from_values(CompressionOptions, values).lambda_)


_KEYS = keys_of(CompressionOptions)


COMPRESSION = compression_rule()
