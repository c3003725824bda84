"""Systems whose states are order ideals: sets of steps that hold all that their steps need.

A step takes a place from one letter to the next. Such a system's complex is CAT(0) (Ardila, Owen
and Sullivant, *Geodesics in CAT(0) cubical complexes*, 2012).
"""

from functools import lru_cache
from typing import TypeAlias

from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System

Step: TypeAlias = tuple[Site, int]
"""A place, and the number of the letter that it goes to from the one before."""


@lru_cache(maxsize=8)
def step_needs(system: System) -> frozenset[tuple[Step, Step]] | None:
    """Return which step needs which other to be made before; None if there is no such order.

    Every place then goes through the letters of the system in a line; that a step is made reads
    that what it needs is made, and that what needs it is not.

    >>> len(step_needs(scene_from_spec("assembly:n=2,until=placed").system))
    2
    """
    needs: set[tuple[Step, Step]] = set()
    precedes: set[tuple[Step, Step]] = set()
    made: set[Step] = set()
    for place in system.places if system.letters else ():
        for number in range(len(system.letters) - 1):
            for move in system.moves_at((place, system.letters[number])):
                if move.target == (place, _before(system, number)):
                    continue
                step = place, number + 1
                ranges = _ranges(system, move, number)
                if ranges is None or step in made:
                    return None
                made.add(step)
                for other, least, most in ranges:
                    if least:
                        needs.add((step, (other, least)))
                    if most < len(system.letters) - 1:
                        precedes.add(((other, most + 1), step))
    return frozenset(needs) if made and needs == precedes else None


def _before(system: System, number: int) -> str | None:
    """Return the letter before that of this number."""
    return system.letters[number - 1] if number else None


def _ranges(system: System, move: Move, number: int) -> list[tuple[Site, int, int]] | None:
    """Return between which letters, by number, each other place that a move reads must be.

    None if the move does not just take its place from letter `number` to the next one.
    """
    place, action = system.place_of(move.source), move.action
    step = ((place, system.letters[number]), (place, system.letters[number + 1]))
    if move.motion != (step,) or len(action.trace) > len(step) or action.free or action.guards:
        return None
    (on,) = [end for end in action.ends if step[0] in end]
    found = []
    for other in in_order({system.place_of(site) for site in action.reads}):
        sites = [(other, letter) for letter in system.letters]
        allowed = [at for at, site in enumerate(sites) if site in on] or [
            at for at, site in enumerate(sites) if site not in action.support
        ]
        if not allowed or allowed[-1] - allowed[0] != len(allowed) - 1 or other == place:
            return None
        found.append((other, allowed[0], allowed[-1]))
    return found
