"""The rule `metropolis`, for every system: random moves, of which those to the goal are favoured.

Source: Metropolis, Rosenbluth, Rosenbluth, Teller and Teller, Equation of state calculations by
fast computing machines (1953).

A module draws one of its legal actions, stay among them. A move that brings it nearer to its goals,
or leaves it as near, is made; one that takes it `d` further is made with probability
exp(-d / temperature). How far it is says `OwnPotential`; goals where it sees another module do not
count. It keeps nothing in mind but the number of its choices: in each, the temperature is `cooling`
times that in the last one. It says nothing.

Nothing is guaranteed but that each move is legal. In a component that holds the goal a module with
a temperature above 0 makes each of its legal moves with a positive probability, so without cooling
(``cooling=1``) the goal is reached with probability one, at some time. The robot does not tend to
the stationary distribution of Metropolis: modules move at one time, claims are lost to one another,
and the number of legal moves differs from state to state. `compression` does better at that.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import exp
from typing import Annotated

from msgspec import Meta

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.potential import OwnPotential
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.vector_metropolis import vector_metropolis
from cubepath.protocol.core.options import keys_of, options_from_values


@dataclass(frozen=True, slots=True)
class MetropolisOptions:
    """The keys of the rule."""

    temperature: Annotated[float, Meta(gt=0, description="in moves; higher is more random")] = 0.5
    cooling: Annotated[
        float, Meta(gt=0, le=1, description="factor of the temperature after each choice")
    ] = 1.0


def metropolis(options: MetropolisOptions) -> RuleType:
    """Return the rule with these options."""

    def make(knowledge: InitialKnowledge) -> Rule:
        potential, stream = OwnPotential(knowledge), knowledge.stream
        temperature = options.temperature / options.cooling

        def choose(view: View) -> int:
            nonlocal temperature
            temperature *= options.cooling
            legal = view.legal()
            drawn = stream.below(len(legal) + 1)
            chance = stream.fraction()
            if drawn == len(legal):
                return STAY
            action, move = legal[drawn]
            further = potential.of(move.target, view.occupied) - potential.of(
                view.site, view.occupied
            )
            if further <= 0 or (temperature > 0 and chance < exp(-further / temperature)):
                return action
            return STAY

        return choose

    return RuleType(
        name="metropolis",
        summary="any legal action, but moves away from the goal only now and then",
        source="Metropolis, Rosenbluth, Rosenbluth, Teller and Teller",
        fits=lambda _: True,
        make=make,
        vectorised=partial(vector_metropolis, options.temperature, options.cooling),
        free=FreeRule(why="every commit is a legal move, and nothing more is promised"),
        keys=_KEYS,
        configure=_configured,
        to_goal=False,
    )


def _configured(values: Mapping[str, str]) -> RuleType:
    return metropolis(options_from_values(MetropolisOptions, values))


_KEYS = keys_of(MetropolisOptions)
METROPOLIS = metropolis(MetropolisOptions())
