"""The clauses of "a path of N rounds leads from start to goal", and what they mean.

Variables are values of sites at times and moves in rounds, where the windows leave them open;
docs/proofs.md lists the clauses. One compiled function builds them twice: first it counts them,
then it fills them in.

Sources: planning as satisfiability (Kautz and Selman 1992), with explanatory frame axioms; at most
one of many by a sequential counter (Sinz 2005).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability.met_moves import (
    FREE,
    IN_TRACE,
    LiteralWindows,
    MetMoves,
    MoveArrays,
    SiteGroup,
    groups_of,
    windows_of,
)
from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CubepathError

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
    """What the clauses are built from; see `MoveArrays` and `met_moves`.

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


CubePath = tuple[tuple[Action, ...], ...]
LITERALS_MAX = 40_000_000
"""The greatest number of literals of clauses about moves: solvers take some 50 bytes for each."""
VALUES_MAX = 40_000_000
"""The greatest number of sites, each at each time, of which values are laid out."""


class TooLargeError(CubepathError):
    """The clauses would be more than a solver can take."""


@dataclass(frozen=True)
class Encoding:
    """Clauses that can be satisfied iff a path of at most `rounds` rounds leads to the goal.

    Clause c is ``literals[ends[c - 1]:ends[c]]``, the first from 0 on. `variables` has a row for
    each variable from 1 on: its kind, index and time, as docs/proofs.md defines them; `prefixes` of
    them at the end are of ladders, whose rows are site, round, kind, number of members and first
    prefix, with their members one after another in `members`. `impossible` says that the windows
    alone refute such a path; then there are no variables, and the only clause is an empty one.
    """

    rounds: int
    met: MetMoves
    variables: Numbers
    literals: Numbers
    ends: Offsets
    ladders: Numbers
    members: Numbers
    groups: tuple[SiteGroup, ...]
    impossible: bool

    @cached_property
    def made(self) -> NDArray[np.int64]:
        """The places of the variables of moves, which are all but those of sites and prefixes."""
        return np.flatnonzero(self.variables[:, 0] == MOVE)

    def schedule(self, true: NDArray[np.bool_]) -> CubePath:
        """Return the rounds in which moves are made, given the truth of each variable.

        `true` has shape (variables,). Empty rounds are left out.
        """
        made = self.made[true[self.made]]
        cubes: list[list[Action]] = [[] for _ in range(self.rounds)]
        for _, index, turn in self.variables[made].tolist():
            cubes[turn - 1].append(self.met.actions[index // 2])
        return tuple(tuple(cube) for cube in cubes if cube)


def encode(met: MetMoves, rounds: int, *, literals_max: int | None = None) -> Encoding:
    """Return the clauses of a path of at most `rounds` rounds between the ends of `met`.

    Raises TooLargeError if those about moves have more than `literals_max` literals, by default
    `LITERALS_MAX`, or if there are more than `VALUES_MAX` sites and times. What `met` spends
    between two parts of the work may end it.
    """
    met.reach(rounds)
    moves, start, goal = met.arrays(), met.on(0), met.on(1)
    if len(start) * (rounds + 1) > VALUES_MAX:
        raise TooLargeError(
            f"clauses for {rounds} rounds have {len(start) * (rounds + 1):,} values of sites,"
            f" {VALUES_MAX:,} at most"
        )
    windows = windows_of(moves, start, goal, rounds, met.spend)
    if windows.refuted():
        return refuted_by_windows(met, rounds)
    value, sites = _values(windows.value_possible())
    met.spend(0)
    lasting = np.maximum(windows.last - windows.first + 1, 0)
    begins = np.concatenate([[0], np.cumsum(lasting)])
    made = (sites + 1 + begins[:-1] - windows.first).astype(np.int32)
    variables = sites + int(begins[-1])
    problem = EncodingProblem(
        rounds,
        *moves,
        windows.first,
        windows.last,
        value,
        made,
        *_users(moves, lasting, len(start)),
    )
    empty = ClauseBuffer(*_arrays(np.zeros(5, dtype=np.int64)))
    met.spend(0)
    counted = write(problem, empty, variables, False)
    met.spend(0)
    most = LITERALS_MAX if literals_max is None else literals_max
    if counted[0] > most:
        raise TooLargeError(
            f"clauses for {rounds} rounds have {counted[0]:,} literals, {most:,} at most"
        )
    out = ClauseBuffer(*_arrays(counted))
    write(problem, out, variables, True)
    met.spend(0)
    groups = groups_of(met, moves, windows)
    more, more_ends = _of_groups(groups, value)
    met.spend(0)
    return Encoding(
        rounds,
        met,
        _meanings(value, windows, lasting, out, sites),
        np.concatenate([out.literals, more]),
        np.concatenate([out.ends, len(out.literals) + more_ends]),
        out.ladders,
        out.members,
        groups,
        impossible=False,
    )


def refuted_by_windows(met: MetMoves, rounds: int) -> Encoding:
    """Return the clauses of a path that the windows refute: an empty one, and no variables."""
    nothing = ClauseBuffer(*_arrays(np.zeros(5, dtype=np.int64)))
    return Encoding(
        rounds,
        met,
        np.zeros((0, 3), dtype=np.int32),
        nothing.literals,
        np.zeros(1, dtype=np.int64),
        nothing.ladders,
        nothing.members,
        (),
        impossible=True,
    )


def prepare() -> None:
    """Compile all that clauses are built by, which takes some seconds after an installation."""
    step = Action("ab", "ab", "a", "b")
    encode(MetMoves(None, [step], frozenset("a"), frozenset("b")), 1)


def _values(possible: NDArray[np.bool_]) -> tuple[Numbers, int]:
    """Return the literal of each site at each time, and how many variables that takes."""
    off, on = possible[:, 0], possible[:, 1]
    both = on & off
    found = np.where(on, TRUE, FALSE).astype(np.int32)
    count = int(both.sum())
    found[both] = np.arange(1, count + 1)
    return found, count


def _users(moves: MoveArrays, lasting: Numbers, sites: int) -> tuple[Numbers, Numbers, Numbers]:
    """Return the directed moves that can be made, by the sites of their supports."""
    sizes = np.diff(moves.starts)
    action = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    both = np.concatenate([2 * action, 2 * action + 1])
    at, codes = np.tile(moves.sites, 2), np.tile(moves.codes, 2)
    kept = lasting[both] > 0
    both, at, codes = both[kept], at[kept], codes[kept]
    order = np.lexsort((both, at))
    users = np.searchsorted(at[order], np.arange(sites + 1)).astype(np.int32)
    return users, both[order].astype(np.int32), codes[order].astype(np.int32)


def _arrays(counted: Offsets) -> tuple[Numbers, Offsets, Numbers, Numbers]:
    literals, clauses, _, ladders, members = counted.tolist()
    return (
        np.empty(literals, dtype=np.int32),
        np.empty(clauses, dtype=np.int64),
        np.empty((ladders, 5), dtype=np.int32),
        np.empty(members, dtype=np.int32),
    )


def _meanings(
    value: Numbers, windows: LiteralWindows, lasting: Numbers, out: ClauseBuffer, sites: int
) -> Numbers:
    """Return kind, index and time of each variable."""
    at = np.argwhere((value > 0) & (value != TRUE))
    of_sites = np.column_stack([np.full(sites, SITE), at])
    moved = np.repeat(np.arange(len(lasting)), lasting)
    offset = np.arange(len(moved)) - np.repeat(np.cumsum(lasting) - lasting, lasting)
    of_moves = np.column_stack([np.full(len(moved), MOVE), moved, windows.first[moved] + offset])
    kinds, counts = out.ladders[:, 2], out.ladders[:, 3]
    sizes = np.where(kinds == STAY, counts, counts - 1)
    ladder = np.repeat(np.arange(len(sizes)), sizes)
    place = np.arange(len(ladder)) - np.repeat(np.cumsum(sizes) - sizes, sizes) + 1
    of_prefixes = np.column_stack([np.full(len(ladder), PREFIX), ladder, place])
    return np.concatenate([of_sites, of_moves, of_prefixes]).astype(np.int32)


def _of_groups(groups: Iterable[SiteGroup], value: Numbers) -> tuple[Numbers, Offsets]:
    """Return the clauses of groups of sites of which at most one is on."""
    rows: list[Numbers] = [np.empty(0, dtype=np.int32)]
    sizes: list[Offsets] = [np.empty(0, dtype=np.int64)]
    for group in groups:
        for here in value[list(group.sites)].T:
            if (here == TRUE).any():
                # All others are then known to be off, unless the windows are wider than that.
                rest = here[(here != TRUE) & (here != FALSE)]
                rows.append(-rest)
                sizes.append(np.ones(len(rest), dtype=np.int64))
                continue
            open_ = here[here != FALSE]
            if group.exactly:
                rows.append(open_)
                sizes.append(np.array([len(open_)]))
            if len(open_) <= GROUP_MAX:
                one, other = np.triu_indices(len(open_), 1)
                rows.append(-np.column_stack([open_[one], open_[other]]).ravel())
                sizes.append(np.full(len(one), 2))
    return np.concatenate(rows).astype(np.int32), np.cumsum(np.concatenate(sizes))
