"""Rules under limits, which every rule takes as keys: wrong sensing, and few notes.

``--rule pibt:misread=0.01`` plays `pibt` with modules that see each place wrongly with this
probability, in every choice anew; ``--rule tswap:notes=20`` lets each module change its note 20
times and then repeat the last. What moves are legal a module always knows: it feels that. When a
rule fails, or chooses an illegal move, because of what it saw wrongly, the module stays.
"""

from dataclasses import dataclass, replace
from typing import Annotated

from msgspec import Meta

from cubepath.agents.local.observation import View
from cubepath.agents.local.random_streams import RandomStream, hashed
from cubepath.protocol.core.system import CLOSED, EMPTY, FILLED, FIRST_LABEL, MODULE, System

_PURPOSE = 1 << 32
"""The draw of a module's stream that is the key of what it misreads; no rule draws as often."""


@dataclass(frozen=True, slots=True)
class RuleLimits:
    """The limits of a rule.

    >>> RuleLimits(misread=0.1).notes
    2147483647
    """

    misread: Annotated[
        float, Meta(ge=0, lt=1, description="probability that a place is seen wrongly")
    ] = 0.0
    notes: Annotated[int, Meta(ge=0, description="how often a module may change its note")] = (
        1 << 31
    ) - 1


class WrongSensing:
    """Makes the views of one module wrong."""

    def __init__(self, probability: float, key: int) -> None:
        """Take the key of the module's own stream."""
        self._probability = probability
        self._stream = RandomStream(hashed(key, _PURPOSE))

    def of(self, view: View) -> View:
        """Return the view with each place where a module can stand shown wrongly, or not."""
        system, numbers = view.system, view.numbers.copy()
        first = system.site_size + 1
        occupied = dict(view.occupied)
        for slot, place in enumerate(system.sensed(view.place)):
            code = int(numbers[first + 2 * slot])
            if place is None or code in (FILLED, CLOSED) or not self._errs():
                continue
            wrong = numbers[first + 2 * slot] = self._other(system, code)
            if wrong == EMPTY:
                del occupied[place]
            else:
                occupied[place] = wrong
        return replace(view, occupied=occupied, numbers=numbers)

    def _errs(self) -> bool:
        return self._stream.fraction() < self._probability

    def _other(self, system: System, code: int) -> int:
        """Return another code that a place could show, each equally likely."""
        codes = [EMPTY, MODULE]
        if system.letters:
            codes = list(range(FIRST_LABEL, FIRST_LABEL + len(system.letters)))
        elif system.labels is not None:
            codes = [EMPTY, *range(FIRST_LABEL, FIRST_LABEL + system.labels)]
        others = [each for each in codes if each != code]
        return others[self._stream.below(len(others))] if others else code
