"""Clauses that say that a path of so many rounds leads from one state to another, in compiled code.

Variables are values of sites at times and moves in rounds, as far as the windows leave them open;
docs/proofs.md lists the clauses. Everything is built twice by the same function: first counted,
then filled in.

Sources: planning as satisfiability (Kautz and Selman 1992), with explanatory frame axioms; at most
one of many by a sequential counter (Sinz 2005).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability.literal_windows import FREE, IN_TRACE
from cubepath.protocol.compiled import compiled, inner

Numbers = NDArray[np.int32]
Offsets = NDArray[np.int64]

SITE, MOVE, PREFIX = 0, 1, 2
"""Kinds of variables."""
ON, OFF, STAY = 0, 1, 2
"""Kinds of ladders: moves that toggle a site to on, to off, or hold it in their trace."""
PAIRS_MAX = 6
"""A group of this many moves, at most one of which can be made, is excluded pair by pair."""
STAY_PAIRS_MAX = 36
"""The same for moves that hold a site, times all that have it in their support."""
GROUP_MAX = 64
"""More sites of which one is on than this are not excluded pair by pair."""
TRUE, FALSE = 1 << 30, -(1 << 30)
"""Constants in place of literals."""


class EncodingProblem(NamedTuple):
    """What the clauses are built from; see `MoveArrays` and `literal_windows`.

    ``value[s, t]`` is the literal that says that site s is on at time t: a variable's number,
    `TRUE` or `FALSE`. ``made[m] + t`` is the variable of directed move m in round t, for rounds
    from ``first[m]`` to ``last[m]``. ``users[s]`` to ``users[s + 1]`` is where the directed moves
    with site s in their support begin in `by_site`, with their codes there in `by_site_code`.
    """

    rounds: int
    starts: Numbers
    sites: Numbers
    codes: Numbers
    guard_starts: Numbers
    guards: Numbers
    first: Numbers
    last: Numbers
    value: Numbers
    made: Numbers
    users: Numbers
    by_site: Numbers
    by_site_code: Numbers


class ClauseBuffer(NamedTuple):
    """Where clauses are written: all literals in a row, and where each clause ends."""

    literals: Numbers
    ends: Offsets
    ladders: Numbers
    members: Numbers


@inner
def _clause(out: ClauseBuffer, at: Offsets, fill: bool, one: int, two: int, three: int) -> None:
    """Write a clause of three literals; 0 and `FALSE` stand for none, `TRUE` leaves it out."""
    if one == TRUE or two == TRUE or three == TRUE:
        return
    for literal in (np.int64(one), np.int64(two), np.int64(three)):
        if literal != 0 and literal != FALSE:
            if fill:
                out.literals[at[0]] = literal
            at[0] += 1
    if fill:
        out.ends[at[1]] = at[0]
    at[1] += 1


@inner
def _exclude(
    out: ClauseBuffer,
    at: Offsets,
    fill: bool,
    group: Numbers,
    count: int,
    site: int,
    turn: int,
    kind: int,
) -> int:
    """Write that at most one of a group is true; return the last prefix, 0 if pair by pair.

    A prefix says that one of the first moves is made; their variables are the next numbers.
    """
    pairwise = count <= PAIRS_MAX
    if pairwise and kind != STAY:
        for later in range(1, count):
            for earlier in range(later):
                _clause(out, at, fill, -group[earlier], -group[later], 0)
        return 0
    prefixes = count if kind == STAY else count - 1
    first = at[2] + 1
    for place in range(prefixes):
        _clause(out, at, fill, -group[place], first + place, 0)
        if place:
            _clause(out, at, fill, -(first + place - 1), first + place, 0)
    for place in range(1, count):
        _clause(out, at, fill, -group[place], -(first + place - 1), 0)
    at[2] += prefixes
    if fill:
        ladder = at[3]
        out.ladders[ladder, 0], out.ladders[ladder, 1] = site, turn
        out.ladders[ladder, 2], out.ladders[ladder, 3] = kind, count
        out.ladders[ladder, 4] = first
        for place in range(count):
            out.members[at[4] + place] = group[place]
    at[3] += 1
    at[4] += count
    last: int = first + prefixes - 1
    return last


@compiled
def write(problem: EncodingProblem, out: ClauseBuffer, variables: int, fill: bool) -> Offsets:
    """Write all clauses about moves; return how much there is of everything.

    That is literals, clauses, variables, ladders and members of ladders. With `fill` false nothing
    is written, and the arrays of `out` may be empty. `variables` is the number of variables of
    sites and moves; prefixes are numbered from there on.
    """
    at = np.zeros(5, dtype=np.int64)
    at[2] = variables
    _write_moves(problem, out, at, fill)
    _write_sites(problem, out, at, fill)
    return at


@inner
def _write_moves(problem: EncodingProblem, out: ClauseBuffer, at: Offsets, fill: bool) -> None:
    """Write what each move needs and what it changes."""
    value = problem.value
    for move in range(len(problem.first)):
        action, way = move // 2, move % 2
        for turn in range(problem.first[move], problem.last[move] + 1):
            made = problem.made[move] + turn
            for place in range(problem.starts[action], problem.starts[action + 1]):
                site, code = problem.sites[place], problem.codes[place]
                old, new = value[site, turn - 1], value[site, turn]
                if code & FREE:
                    if old != new:
                        _clause(out, at, fill, -made, -old, new)
                        _clause(out, at, fill, -made, old, -new)
                    continue
                _clause(out, at, fill, -made, old if (code >> way) & 1 else -old, 0)
                _clause(out, at, fill, -made, new if (code >> (1 - way)) & 1 else -new, 0)
            for place in range(problem.guard_starts[action], problem.guard_starts[action + 1]):
                one, other = problem.guards[place, 0], problem.guards[place, 1]
                _clause(out, at, fill, -made, -value[one, turn - 1], value[other, turn - 1])


@inner
def _write_sites(problem: EncodingProblem, out: ClauseBuffer, at: Offsets, fill: bool) -> None:
    """Write why a site changes, and which moves exclude each other there."""
    most = 0
    for site in range(len(problem.users) - 1):
        most = max(most, problem.users[site + 1] - problem.users[site])
    ups, downs = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    stays, reads = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    for site in range(len(problem.users) - 1):
        for turn in range(1, problem.rounds + 1):
            up = down = stay = read = 0
            for place in range(problem.users[site], problem.users[site + 1]):
                move, code = problem.by_site[place], problem.by_site_code[place]
                if not problem.first[move] <= turn <= problem.last[move]:
                    continue
                made = problem.made[move] + turn
                if not code & IN_TRACE:
                    reads[read] = made
                    read += 1
                elif (code >> (move % 2)) & 1 == (code >> (1 - move % 2)) & 1:
                    stays[stay] = made
                    stay += 1
                elif (code >> (1 - move % 2)) & 1:
                    ups[up] = made
                    up += 1
                else:
                    downs[down] = made
                    down += 1
            old, new = problem.value[site, turn - 1], problem.value[site, turn]
            _frame(out, at, fill, old, -new, ups, up)
            _frame(out, at, fill, -old, new, downs, down)
            if up > 1:
                _exclude(out, at, fill, ups, up, site, turn, ON)
            if down > 1:
                _exclude(out, at, fill, downs, down, site, turn, OFF)
            if stay and stay + read > 1:
                if stay * (stay + read) <= STAY_PAIRS_MAX:
                    for one in range(stay):
                        for other in range(one):
                            _clause(out, at, fill, -stays[one], -stays[other], 0)
                        for other in range(read):
                            _clause(out, at, fill, -stays[one], -reads[other], 0)
                else:
                    held = _exclude(out, at, fill, stays, stay, site, turn, STAY)
                    for other in range(read):
                        _clause(out, at, fill, -reads[other], -held, 0)


@inner
def _frame(
    out: ClauseBuffer, at: Offsets, fill: bool, old: int, new: int, group: Numbers, count: int
) -> None:
    """Write that a site keeps its value if no move of the group is made."""
    if old == TRUE or new == TRUE:
        return
    for literal in (np.int64(old), np.int64(new)):
        if literal != FALSE:
            if fill:
                out.literals[at[0]] = literal
            at[0] += 1
    for place in range(count):
        if fill:
            out.literals[at[0]] = group[place]
        at[0] += 1
    if fill:
        out.ends[at[1]] = at[0]
    at[1] += 1
