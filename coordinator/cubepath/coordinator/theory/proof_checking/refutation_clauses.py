"""The clauses of a refutation, written again from what its variables mean.

Part of `cubepath verify`: nothing here is shared with the code that makes proofs. The clauses are
those of docs/proofs.md, in the order of this module.

A literal of a clause is ``2 * variable`` or, negated, ``2 * variable + 1``. Variables are numbers
of the file, from 1. Inside, each has a *slot*: first the sites at times, then the moves in rounds,
then the prefixes of ladders.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.proof_checking.refutation_moves import (
    IN_TRACE,
    IS_FREE,
    Ints,
    Longs,
    ProofWindows,
    SupportTable,
)
from cubepath.protocol.compiled import compiled, inner

TRUE, FALSE = -1, -2
ON, OFF, STAY, READ = 0, 1, 2, 3
"""What a move does to a site: it toggles it to on or off, holds it in its trace, or reads it."""
PAIRS_TO = 6
"""Among this many moves that toggle a site the same way, each pair excludes each other."""
PAIRS_WITH_READERS_TO = 36
"""The same for moves that hold a site: the product of their number and that of all of them."""
GROUP_TO = 64
"""Among this many sites of a group that can be on, each pair excludes each other."""


class Slots(NamedTuple):
    """Where variables have their slots, and which number the file gives to each slot.

    Site ``s`` at time ``t`` has the slot ``x_at[s] + t - x_first[s]`` if both values are possible,
    directed move ``m`` in round ``t`` has ``y_at[m] + t - first[m]``, prefix ``i`` of ladder ``l``
    has ``p_at[l] + i - 1``.
    """

    rounds: int
    ahead: Ints
    latest: Ints
    first: Ints
    last: Ints
    x_first: Ints
    x_at: Longs
    y_at: Longs
    p_at: Longs
    variable: Ints


class Roles(NamedTuple):
    """By site and role the directed moves: ``moves[at[4 * s + role]:at[4 * s + role + 1]]``."""

    at: Longs
    moves: Ints


class Ladders(NamedTuple):
    """The ladders of the file: site, round and role of each, and its moves as variables."""

    sites: Ints
    rounds: Ints
    roles: Ints
    at: Longs
    members: Ints


class Groups(NamedTuple):
    """Groups of sites: of which exactly one is on, not only at most one; and their sites."""

    exact: NDArray[np.bool_]
    at: Longs
    sites: Ints


class ProofClauses(NamedTuple):
    """Clauses one after another: clause ``c`` is ``literals[ends[c - 1]:ends[c]]``."""

    literals: Ints
    ends: Longs

    @classmethod
    def empty(cls) -> Self:
        """Return the empty clause alone, which nothing satisfies."""
        return cls(np.zeros(0, dtype=np.int32), np.zeros(1, dtype=np.int64))


def slots_of(windows: ProofWindows, ladder_sizes: Longs) -> Slots:
    """Return the slots of all variables that there must be; the file's numbers are still 0."""
    latest = (windows.rounds - windows.behind).astype(np.int32)
    begin = windows.ahead.reshape(-1, 2).max(axis=1)
    times = np.maximum(latest.reshape(-1, 2).min(axis=1) - begin + 1, 0)
    rounds = np.maximum(windows.last - windows.first + 1, 0)
    sizes = np.concatenate((times, rounds, ladder_sizes)).astype(np.int64)
    at = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(sizes)))
    moves, ladders = len(times), len(times) + len(rounds)
    return Slots(
        windows.rounds,
        windows.ahead,
        latest,
        windows.first,
        windows.last,
        begin.astype(np.int32),
        at[: moves + 1],
        at[moves : ladders + 1],
        at[ladders:],
        np.zeros(at[-1], dtype=np.int32),
    )


def roles_of(table: SupportTable, windows: ProofWindows, sites: int) -> Roles:
    """Return what moves that can be made do to sites."""
    action = np.repeat(np.arange(len(table.starts) - 1), np.diff(table.starts))
    moves = np.concatenate((2 * action, 2 * action + 1))
    says = np.concatenate((table.says, table.says >> 1 & 1 | table.says << 1 & 2 | table.says & ~3))
    role = np.where(says & IN_TRACE, STAY, READ)
    role[says & 3 == 1], role[says & 3 == 2] = OFF, ON
    keys = 4 * np.tile(table.sites, 2).astype(np.int64) + role
    able = (windows.first <= windows.last)[moves]
    moves, keys = moves[able], keys[able]
    order = np.lexsort((moves, keys))
    at = np.searchsorted(keys[order], np.arange(4 * sites + 1))
    return Roles(at.astype(np.int64), moves[order].astype(np.int32))


@inner
def collect(slots: Slots, roles: Roles, site: int, role: int, time: int, found: Ints) -> int:
    """Fill in the moves of a round that have a role at a site; return how many there are."""
    count = 0
    for place in range(roles.at[4 * site + role], roles.at[4 * site + role + 1]):
        move = roles.moves[place]
        if slots.first[move] <= time <= slots.last[move]:
            found[count] = move
            count += 1
    return count


@inner
def _numbered(slots: Slots, slot: int | np.integer) -> int:
    """Return the variable of a slot."""
    return int(slots.variable[slot])


@inner
def _is(slots: Slots, site: int, time: int, value: int) -> int:
    """Return the literal that says that a site has a value at a time, or TRUE or FALSE."""
    on = slots.ahead[2 * site + 1] <= time <= slots.latest[2 * site + 1]
    off = slots.ahead[2 * site] <= time <= slots.latest[2 * site]
    if on and off:
        return 2 * _numbered(slots, slots.x_at[site] + time - slots.x_first[site]) + 1 - value
    return TRUE if on == (value == 1) else FALSE


@inner
def _made(slots: Slots, move: int, time: int) -> int:
    """Return the literal that says that a move is made in a round."""
    return 2 * _numbered(slots, slots.y_at[move] + time - slots.first[move])


@inner
def _put(literals: Ints, state: Longs, literal: int) -> None:
    """Add a literal to the current clause; with no room in `literals` only count it.

    `state` holds the literals so far, the clauses so far, whether the current one is satisfied, and
    where it begins.
    """
    if literal == TRUE:
        state[2] = 1
    elif literal != FALSE:
        if state[0] < len(literals):
            literals[state[0]] = literal
        state[0] += 1


@inner
def _close(ends: Longs, state: Longs) -> None:
    """End the current clause, or drop it if it is satisfied."""
    if state[2]:
        state[0] = state[3]
        state[2] = 0
        return
    if state[1] < len(ends):
        ends[state[1]] = state[0]
    state[1] += 1
    state[3] = state[0]


@compiled
def _moves(table: SupportTable, slots: Slots, literals: Ints, ends: Longs, state: Longs) -> None:
    """A move has its local state before it and the other after it; what is free stays; guards."""
    for move in range(len(slots.first)):
        action, end = move >> 1, move & 1
        for time in range(slots.first[move], slots.last[move] + 1):
            refused = _made(slots, move, time) ^ 1
            for place in range(table.starts[action], table.starts[action + 1]):
                site, says = table.sites[place], table.says[place]
                if says & IS_FREE:
                    for value in range(2):
                        _put(literals, state, refused)
                        _put(literals, state, _is(slots, site, time - 1, 1 - value))
                        _put(literals, state, _is(slots, site, time, value))
                        _close(ends, state)
                    continue
                _put(literals, state, refused)
                _put(literals, state, _is(slots, site, time - 1, says >> end & 1))
                _close(ends, state)
                _put(literals, state, refused)
                _put(literals, state, _is(slots, site, time, says >> (1 - end) & 1))
                _close(ends, state)
            for place in range(table.guard_starts[action], table.guard_starts[action + 1]):
                if table.guards[place, 0] == table.guards[place, 1]:
                    continue
                _put(literals, state, refused)
                _put(literals, state, _is(slots, table.guards[place, 0], time - 1, 0))
                _put(literals, state, _is(slots, table.guards[place, 1], time - 1, 1))
                _close(ends, state)


@compiled
def _frames(slots: Slots, roles: Roles, literals: Ints, ends: Longs, state: Longs) -> None:
    """What changes is toggled by some move of the round."""
    for site in range(len(slots.x_first)):
        for time in range(1, slots.rounds + 1):
            for role in range(2):
                value = 1 if role == ON else 0
                now, before = _is(slots, site, time, 1 - value), _is(slots, site, time - 1, value)
                if now == TRUE or before == TRUE:
                    continue
                _put(literals, state, now)
                _put(literals, state, before)
                for place in range(roles.at[4 * site + role], roles.at[4 * site + role + 1]):
                    move = roles.moves[place]
                    if slots.first[move] <= time <= slots.last[move]:
                        _put(literals, state, _made(slots, move, time))
                _close(ends, state)


@compiled
def _pairs(slots: Slots, roles: Roles, literals: Ints, ends: Longs, state: Longs) -> None:
    """Moves of a round that do not commute exclude each other, where they are few."""
    one, other = np.empty(len(slots.first), np.int32), np.empty(len(slots.first), np.int32)
    for site in range(len(slots.x_first)):
        for time in range(1, slots.rounds + 1):
            for role in range(3):
                count = collect(slots, roles, site, role, time, one)
                readers = 0
                if role == STAY and count:
                    readers = collect(slots, roles, site, READ, time, other)
                if needs_ladder(role, count, readers):
                    continue
                for place in range(count):
                    refused = _made(slots, one[place], time) ^ 1
                    for later in range(place + 1, count):
                        _put(literals, state, refused)
                        _put(literals, state, _made(slots, one[later], time) ^ 1)
                        _close(ends, state)
                    for reader in range(readers):
                        _put(literals, state, refused)
                        _put(literals, state, _made(slots, other[reader], time) ^ 1)
                        _close(ends, state)


@inner
def needs_ladder(role: int, count: int, readers: int) -> bool:
    """Return whether this many moves, and readers of what they hold, are too many for pairs."""
    if role == STAY:
        return count * (count + readers) > PAIRS_WITH_READERS_TO
    return count > PAIRS_TO


@compiled
def _ladders(
    slots: Slots, roles: Roles, ladders: Ladders, literals: Ints, ends: Longs, state: Longs
) -> None:
    """At most one move of a ladder is made, and none that reads what one of them holds."""
    readers = np.empty(len(slots.first), np.int32)
    for ladder in range(len(ladders.sites)):
        begin, size = ladders.at[ladder], ladders.at[ladder + 1] - ladders.at[ladder]
        prefixes = slots.p_at[ladder + 1] - slots.p_at[ladder]
        for number in range(1, size + 1):
            made = 2 * int(ladders.members[begin + number - 1])
            here = (
                2 * _numbered(slots, slots.p_at[ladder] + number - 1) if number <= prefixes else 0
            )
            before = 2 * _numbered(slots, slots.p_at[ladder] + number - 2) if number > 1 else 0
            if here:
                _put(literals, state, made ^ 1)
                _put(literals, state, here)
                _close(ends, state)
            if here and before:
                _put(literals, state, before ^ 1)
                _put(literals, state, here)
                _close(ends, state)
            if before:
                _put(literals, state, made ^ 1)
                _put(literals, state, before ^ 1)
                _close(ends, state)
        if ladders.roles[ladder] == STAY:
            all_of_them = 2 * _numbered(slots, slots.p_at[ladder] + size - 1)
            time = ladders.rounds[ladder]
            count = collect(slots, roles, ladders.sites[ladder], READ, time, readers)
            for place in range(count):
                _put(literals, state, _made(slots, readers[place], time) ^ 1)
                _put(literals, state, all_of_them ^ 1)
                _close(ends, state)


@compiled
def _groups(slots: Slots, groups: Groups, literals: Ints, ends: Longs, state: Longs) -> None:
    """Of the sites of a group at most one is on, or exactly one, at each time."""
    for group in range(len(groups.exact)):
        begin, end = groups.at[group], groups.at[group + 1]
        for time in range(slots.rounds + 1):
            possible = 0
            for place in range(begin, end):
                possible += _is(slots, groups.sites[place], time, 1) != FALSE
            if possible <= GROUP_TO:
                for place in range(begin, end):
                    refused = _is(slots, groups.sites[place], time, 0)
                    if refused == TRUE:
                        continue
                    for later in range(place + 1, end):
                        _put(literals, state, refused)
                        _put(literals, state, _is(slots, groups.sites[later], time, 0))
                        _close(ends, state)
            if groups.exact[group]:
                for place in range(begin, end):
                    _put(literals, state, _is(slots, groups.sites[place], time, 1))
                _close(ends, state)


def clauses_of(
    table: SupportTable, slots: Slots, roles: Roles, ladders: Ladders, groups: Groups
) -> ProofClauses:
    """Return the clauses that say that there is a schedule; the slots must have their variables."""
    found = ProofClauses(np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64))
    for _ in range(2):  # the first time they are only counted
        state = np.zeros(4, dtype=np.int64)
        _moves(table, slots, *found, state)
        _frames(slots, roles, *found, state)
        _pairs(slots, roles, *found, state)
        _ladders(slots, roles, ladders, *found, state)
        _groups(slots, groups, *found, state)
        literals, clauses = state[:2].tolist()
        if len(found.ends) < clauses:
            found = ProofClauses(
                np.empty(literals, dtype=np.int32), np.empty(clauses, dtype=np.int64)
            )
    return found
