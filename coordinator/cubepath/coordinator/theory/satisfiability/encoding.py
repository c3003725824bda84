"""The clauses of "a path of so many rounds leads from start to goal", and what they mean."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability.clauses import (
    FALSE,
    GROUP_MAX,
    MOVE,
    PREFIX,
    SITE,
    STAY,
    TRUE,
    ClauseBuffer,
    EncodingProblem,
    write,
)
from cubepath.coordinator.theory.satisfiability.literal_windows import (
    LiteralWindows,
    MoveArrays,
    windows_of,
)
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves, SiteGroup, groups_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CubepathError

Numbers = NDArray[np.int32]
Offsets = NDArray[np.int64]
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
