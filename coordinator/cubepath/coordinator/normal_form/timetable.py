"""Moves of unequal duration: earliest starts over the dependencies, and the makespan.

A *timetable* of a path gives each of its moves a start time, such that moves which do not commute
never overlap and keep their order. Moves overlap if the open intervals from their starts to their
ends meet; one may begin at the very moment at which another ends. Moves in progress at the same
time commute pairwise, so no move touches what another one needs while it is halfway: at every
moment the moves in progress span a cube of the state complex at the state reached so far, and the
timetable is a path through those cubes, along each direction at its own pace. Ordered by their
starts, the moves are the path again with commuting moves swapped, so the homotopy class is the
same.

*Earliest start is optimal.* A move cannot begin until all earlier moves of the path that do not
commute with it have ended; let it begin then. So each move begins when a chain of moves, each not
commuting with the next, has run one after another, and the makespan is the length of the longest
chain. No timetable of the moves is shorter, since the moves of that chain never overlap. If the
path is reduced, no timetable in the homotopy class is shorter either, whatever detours it makes:
every path of the class contains the moves of the reduced one, with those that do not commute in the
same order (see `cubepath.coordinator.verification.proof`). If every duration is 1, a move begins at
one less than the number of its cube in the normal cube path.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import count
from math import lcm
from typing import NamedTuple

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.durations import Durations
from cubepath.protocol.path_files.moves import PathMove


class Timetable(NamedTuple):
    """When each move of a path begins, in the order of the path, and when the last one ends.

    `critical` holds the places, from 0, of moves that follow each other without a pause from time 0
    to the end, each not commuting with the next. They are the reason why no timetable is shorter.
    """

    starts: tuple[Fraction, ...]
    makespan: Fraction
    critical: tuple[int, ...]


def earliest(path: Sequence[Action], durations: Sequence[Fraction]) -> Timetable:
    """Return the timetable in which every move of the path begins as early as possible.

    `durations` has a positive number for each move. One pass, each move at the cost of its support,
    in exact arithmetic: integers, after bringing all durations to a common denominator. The path
    should be reduced, since its detours are run too. ValueError if the numbers of durations and
    moves differ.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> far = Action([8, 9], [8, 9], [8], [9])
    >>> found = earliest([left, far, right], [Fraction(1, 2), Fraction(2), Fraction(1)])
    >>> [str(start) for start in found.starts], str(found.makespan), found.critical
    (['0', '0', '1/2'], '2', (1,))
    """
    unit = lcm(*(duration.denominator for duration in durations))
    # For each site: when the last move ends that writes it, and the last that uses it at all, each
    # with minus its place, so that of moves that end together the first in the path is taken.
    written: dict[Site, tuple[int, int]] = {}
    touched: dict[Site, tuple[int, int]] = {}
    nobody = (0, 1)
    starts: list[int] = []
    waits_for: list[int] = []
    end = nobody
    for place, action, duration in zip(count(), path, durations, strict=False):
        begin = nobody
        for site in action.trace:
            begin = max(begin, touched.get(site, nobody))
        for site in action.reads:
            begin = max(begin, written.get(site, nobody))
        starts.append(begin[0])
        waits_for.append(-begin[1])
        ended = (begin[0] + duration.numerator * (unit // duration.denominator), -place)
        for site in action.trace:
            written[site] = touched[site] = ended
        for site in action.reads:
            touched[site] = max(ended, touched.get(site, nobody))
        end = max(end, ended)
    if not len(path) == len(durations) == len(starts):
        raise ValueError(f"{len(durations)} durations, expected one for each of {len(path)} moves")
    critical: list[int] = []
    last = -end[1]
    while last >= 0:
        critical.append(last)
        last = waits_for[last]
    return Timetable(
        tuple(Fraction(start, unit) for start in starts),
        Fraction(end[0], unit),
        tuple(critical[::-1]),
    )


def durations_of(moves: Sequence[PathMove], durations: Durations) -> list[Fraction]:
    """Return how long each move of a path takes.

    A duration given for one name of a move counts for equal moves under other names: an edge has
    two names. InputError if a duration is given that fits no move of the path, or if two equal
    moves take different times: a move is what it does, whatever its name, so equal moves are
    interchangeable.

    >>> from fractions import Fraction
    >>> path = shorten(play("hex:n=3")).given.moves
    >>> set(durations_of(path, Durations(default=Fraction(3, 2))))
    {Fraction(3, 2)}
    """
    unused = durations.unused(move.name for move in moves) if moves else None
    if unused is not None:
        raise InputError(f"a duration is given, but {unused} of this path")
    # A duration given for a place applies by name if the move has that name, otherwise by action.
    placed: dict[Action, Fraction] = {}
    for move in moves:
        if durations.is_placed(move.name):
            placed.setdefault(move.action, durations.of(move.name))
    found: list[Fraction] = []
    first: dict[Action, int] = {}
    for place, move in enumerate(moves):
        by_name = durations.of(move.name)
        by_action = None if durations.is_placed(move.name) else placed.get(move.action)
        found.append(by_action or by_name)
        known = first.setdefault(move.action, place)
        if found[known] != found[place]:
            raise InputError(
                f"moves {known + 1} and {place + 1} are equal, but take {found[known]} and"
                f" {found[place]}: expected one duration for both"
            )
    return found
