"""The rule `compression`: shapes with many pairs of neighbours are more likely.

Source: Cannon, Daymude, Randall and Richa, A Markov chain algorithm for compression in
self-organizing particle systems (PODC 2016, arXiv 1603.07991). There modules step one at a time;
the rounds are our own.

A module senses the cells within two steps. It remembers nothing but how much it has drawn, and says
nothing. It has no goal, and never gives up. The runs sample shapes: in the limit a connected shape
without holes, up to translation, has the probability pi, proportional to lambda ** pairs, where
`pairs` counts its pairs of neighbours. For lambda > 2 + sqrt(2) large shapes are compact, for
lambda < 2.17 they are not (both in the paper and its journal version).

Under the lockstep clock. In each round all modules draw the same one of 15 patterns (`partner`)
from a stream that they share. A pattern is a set of pairs of neighbouring cells, of which any two
are at least two steps apart. A module whose cell is in a pair may step to the other cell of the
pair. If that is legal, it does with probability 0.9 * min(1, lambda ** gained), where `gained` is
by how much the number of its neighbours grows.

A round keeps pi exactly.

1. The pattern follows from the seed and the number of the round alone. It does not depend on where
   modules are or on what they draw by themselves.
2. Given the pattern, pairs do not affect each other. Whether a step is legal and what it gains
   depends on the pair and the eight cells round it. No cell of another pair is among these ten, so
   their steps change neither. The moves commute, no claim is lost, and a round is the product
   of one kernel for each pair, in any order.
3. The kernel of a pair is reversible: a step back belongs to the same pair and gains the opposite,
   and pi(s) min(1, lambda ** gained) = pi(s') min(1, lambda ** -gained). So each kernel keeps pi,
   and so do their product and the mean over patterns. As the kernels of a pattern commute, a round
   is reversible, too.

From any shape the probabilities tend to pi. A pair stays as it is with probability 0.1 or more, so
each step of the paper's chain is made alone with some probability, and its steps lead from
each connected shape without holes to each other (paper). Hesitation P makes 0.9 smaller, no more.

Under the free clock each turn draws one of six directions from the module's own stream. If turns
are atomic and come in an order that does not depend on the shape, pi is kept for the same reasons.
If a turn takes time, it is refused when a cell of its support has changed meanwhile. That happens
more often in some shapes than in others, so pi is kept only approximately:
`tests/bench/bench_compression.py` measures by how much.
"""

from __future__ import annotations

from itertools import chain

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import real_number
from cubepath.protocol.core.system import System

_FORMS = ((1, 3), (3, 1), (2, 3))
"""By axis the form whose value modulo 5 numbers the cells; along the axis it grows by one."""
_PERIOD = 5
PATTERNS = len(_FORMS) * _PERIOD
_WILLING = 0.9
_BIAS_MAX = 1e6


def partner(cell: Cell, pattern: int) -> Cell | None:
    """Return the other cell of the pair of a pattern that a cell is in; None if it is in none.

    Pattern 5 a + c pairs each cell whose number is c with the next one along axis a. Cells are
    numbered modulo 5 by the form ``q + 3 r`` for axis 0, turned by 60 degrees for each further one.
    Two cells with the same number are at least 2 steps apart, and two pairs of a pattern also.
    """
    axis, offset = divmod(pattern, _PERIOD)
    along, up = _FORMS[axis]
    number = (along * cell[0] + up * cell[1] - offset) % _PERIOD
    if number > 1:
        return None
    return _around(cell)[axis + 3 * number]


def _around(cell: Cell) -> list[Cell]:
    return [(cell[0] + along, cell[1] + up) for along, up in HEX_DIRECTIONS]


def _step(view: View, target: Cell | None, bias: float, stream: RandomStream) -> int:
    """Return the action of stepping to a cell, if that is legal and the draw allows it."""
    legal = view.mask.nonzero()[0].tolist()[1:]
    moves = ((action, view.moves[action - 1]) for action in legal)
    found = next((action for action, move in moves if move and move.target == target), STAY)
    if target is None or found == STAY:
        return STAY
    place = HEXAGONS.check(view.place)
    gained = sum(cell in view.occupied for cell in _around(target))
    gained -= sum(cell in view.occupied for cell in _around(place))
    return found if stream.fraction() < _WILLING * min(1.0, bias**gained) else STAY


def _is_step(generator: Generator) -> bool:
    """Return whether one module steps to a cell beside it, and all cells round both are read."""
    (here, there), *others = generator.motion
    near = chain(_around(here), _around(there))
    return not others and there in _around(here) and set(generator.support).issuperset(near)


def _fits(system: System) -> bool:
    catalogue = system.catalogue
    return (
        catalogue is not None
        and catalogue.lattice == HEXAGONS
        and all(map(_is_step, catalogue.generators))
    )


def compression_rule(bias: float = 4.0) -> RuleType:
    """Return the rule with this lambda; InputError if it is not above 0, or above a million."""
    if not 0 < real_number("lambda", bias) <= _BIAS_MAX:
        raise InputError(f"lambda={bias}: expected more than 0, at most {_BIAS_MAX:g}")

    def in_rounds(knowledge: InitialKnowledge) -> Rule:
        shared, stream = knowledge.shared_stream(), knowledge.stream

        def choose(view: View) -> int:
            pattern = shared.below(PATTERNS)
            return _step(view, partner(HEXAGONS.check(view.place), pattern), bias, stream)

        return choose

    def in_turns(knowledge: InitialKnowledge) -> Rule:
        stream = knowledge.stream

        def choose(view: View) -> int:
            near = _around(HEXAGONS.check(view.place))
            return _step(view, near[stream.below(len(near))], bias, stream)

        return choose

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
    )


COMPRESSION = compression_rule()
