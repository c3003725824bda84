"""Checking a refutation of clauses: each lemma of a log follows by unit propagation.

Part of `cubepath verify`. A forward checker of DRUP logs, with two watched literals to a clause: a
lemma is accepted if the clauses and lemmas so far lead to a conflict by unit propagation once all
its literals are false. Clauses that the log deletes are no longer used, but for those that are
unit, as in drat-trim. Sources: Goldberg and Novikov, Verification of Proofs of Unsatisfiability for
CNF Formulas (2003); Wetzler, Heule and Hunt, DRAT-trim (2014), also for the binary form of logs.

Literals are ``2 * variable`` and, negated, ``2 * variable + 1``, as in binary logs.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.core.errors import CheckError

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

_FOUND, _TRAIL, _HEAD, _POOL, _WATCHES, _LEMMAS, _AT, _FAULT, _CLAUSES = range(9)
"""Entries of `_State.numbers`."""
_NOT_IMPLIED, _NO_VARIABLE, _NO_RECORD = 1, 2, 3
_FAULTS = {
    _NOT_IMPLIED: "does not follow by unit propagation",
    _NO_VARIABLE: "has a literal of no variable",
    _NO_RECORD: "is neither the addition nor the deletion of a clause",
}
_HEADER = 2
"""Before its literals a clause has the next clause of equal hash, and its size."""
_ADD, _DELETE = ord("a"), ord("d")
_NO_CLAUSE = 0
_PIECE = 1 << 16
"""Bytes of a log that are checked at a time: an interrupt is seen in between."""


class _State(NamedTuple):
    """What the checker knows.

    `pool` holds the clauses: the next one of equal hash, the size (negative once deleted) and the
    literals, of which the first two are watched; a clause is known by the place of its first
    literal. The watches of literal ``l`` are `watch_size[l]` pairs (another literal, clause) in
    `watches` from `watch_at[l]` on, with room for `watch_room[l]`. `value` is 1, -1 or 0 for a
    literal that is true, false or unknown; `trail` lists the true ones, the first ``_TRAIL`` of
    them permanently, and `reason` says for each variable why.
    """

    pool: Ints
    heads: Ints
    watches: Ints
    watch_at: Longs
    watch_size: Ints
    watch_room: Ints
    value: NDArray[np.int8]
    trail: Ints
    reason: Ints
    numbers: Longs


class Refuter:
    r"""Clauses, and the lemmas that were found to follow from them.

    >>> clauses = [[2, 4], [2, 5], [3, 4], [3, 5]]
    >>> refuter = Refuter(2, np.concatenate(clauses).astype(np.int32), np.arange(2, 10, 2))
    >>> refuter.refuted
    False
    >>> refuter.check(b"a\x02\x00")
    >>> refuter.refuted, refuter.lemmas
    (True, 1)
    """

    def __init__(self, variables: int, literals: Ints, ends: Longs) -> None:
        """Take clauses: clause ``c`` is ``literals[ends[c - 1]:ends[c]]``, each literal once."""
        count, size = len(ends), 2 * variables + 2
        room = len(literals) + (_HEADER + 1) * count + 16
        watched = np.zeros(size, dtype=np.int32)
        _count_watches(literals, ends, watched)
        rooms = watched + watched // 4 + 2
        at = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(rooms, dtype=np.int64)))
        self._state = _State(
            np.zeros(room, dtype=np.int32),
            np.zeros(1 << (count + (1 << 16)).bit_length(), dtype=np.int32),
            np.zeros(2 * int(at[-1]) + 16, dtype=np.int32),
            at[:-1].copy(),
            np.zeros(size, dtype=np.int32),
            rooms.astype(np.int32),
            np.zeros(size, dtype=np.int8),
            np.zeros(variables + 1, dtype=np.int32),
            np.zeros(variables + 1, dtype=np.int32),
            np.zeros(9, dtype=np.int64),
        )
        numbers = self._state.numbers
        numbers[_POOL], numbers[_WATCHES] = _HEADER + 1, at[-1]
        _load(self._state, literals, ends)
        self._left = b""
        self._bytes = 0
        self._run(b"")

    @property
    def refuted(self) -> bool:
        """Whether the clauses are refuted, by unit propagation and the lemmas so far."""
        return bool(self._state.numbers[_FOUND])

    @property
    def lemmas(self) -> int:
        """The number of lemmas that were checked."""
        return int(self._state.numbers[_LEMMAS])

    def check(self, chunk: bytes) -> str | None:
        """Check the next bytes of a log; return why it is refused, None if it is not.

        What comes after a refutation is not looked at. A lemma may begin in one chunk and end in
        another.
        """
        for begin in range(0, len(chunk), _PIECE):
            if self.refuted:
                return None
            why = self._run(chunk[begin : begin + _PIECE])
            if why is not None:
                return why
        return None

    def cut_off(self) -> bool:
        """Return whether the log so far ends within a lemma."""
        return bool(self._left)

    def follow(self, log: Iterable[bytes], tell: Callable[[str, int], object]) -> int:
        """Check a whole log and return how many lemmas it took; CheckError if it refutes nothing.

        `tell` is called with "lemmas" and how many there were since the last call.
        """
        for chunk in log:
            before = self.lemmas
            why = self.check(chunk)
            if why is not None:
                raise CheckError(why)
            tell("lemmas", self.lemmas - before)
            if self.refuted:
                break
        if not self.refuted:
            end = "ends within a lemma" if self.cut_off() else "ends"
            raise CheckError(f"the log {end}, and nothing is refuted yet")
        return self.lemmas

    def _run(self, piece: bytes) -> str | None:
        data = np.frombuffer(self._left + piece, dtype=np.uint8)
        self._make_room(len(data))
        watches = _check(self._state, self._state.watches, data)
        self._state = self._state._replace(watches=watches)
        numbers = self._state.numbers
        done, fault = int(numbers[_AT]), int(numbers[_FAULT])
        if fault:
            if fault == _NO_RECORD:
                return f"byte {self._bytes + done} of the log {_FAULTS[fault]}"
            return f"lemma {self.lemmas + 1} of the log {_FAULTS[fault]}"
        self._left = data[done:].tobytes()
        self._bytes += done
        return None

    def _make_room(self, size: int) -> None:
        """Make room for all clauses that this many bytes could hold."""
        pool = self._state.pool
        need = int(self._state.numbers[_POOL]) + 3 * size + 16
        if need > len(pool):
            found = np.zeros(max(need, len(pool) + len(pool) // 2), dtype=np.int32)
            found[: len(pool)] = pool
            self._state = self._state._replace(pool=found)


def dimacs(variables: int, literals: Ints, ends: Longs) -> Iterator[bytes]:
    """Yield clauses as the lines of a DIMACS file."""
    yield b"p cnf %d %d\n" % (variables, len(ends))
    signed = np.where(literals & 1, -(literals >> 1), literals >> 1)
    begin = 0
    for end in ends.tolist():
        yield b"%s0\n" % b"".join(b"%d " % each for each in signed[begin:end].tolist())
        begin = end


@compiled
def _count_watches(literals: Ints, ends: Longs, watched: Ints) -> None:
    begin = 0
    for end in ends:
        if end - begin > 1:
            watched[literals[begin]] += 1
            watched[literals[begin + 1]] += 1
        begin = end


@inner
def _hash(heads: Ints, literals: Ints, begin: int, end: int) -> int:
    """Return the row of a clause in the hash table, whatever the order of its literals."""
    one, other = 0, 0
    for place in range(begin, end):
        mixed = (literals[place] + 1) * 0x9E3779B1
        one += mixed ^ mixed >> 15
        other ^= mixed * mixed
    mixed = one * 0x2545F491 + other
    return (mixed ^ mixed >> 29) & (len(heads) - 1)


@compiled
def _load(state: _State, literals: Ints, ends: Longs) -> None:
    """Store the clauses and watch them; the unit ones become true, and an empty one refutes."""
    begin = 0
    for end in ends:
        clause = literals[begin:end]
        good = min(end - begin, 2)
        if good == 1 and state.value[clause[0]] == -1:
            good = 0
        _add(state, state.watches, clause, end - begin, good)
        begin = end


@compiled
def _check(state: _State, watches: Ints, data: Bytes) -> Ints:
    """Follow the log as far as it has whole records; return the watches, which may have moved.

    First what is known to be true is propagated, which is all that happens without data.
    """
    pool, _, _, watch_at, watch_size, watch_room, value, trail, reason, numbers = state
    lemma = np.empty(max(len(data), 1), dtype=np.int32)
    at, tried, length = 0, 0, 0
    numbers[_AT] = 0
    trying = False
    while not numbers[_FOUND]:
        # Propagate, permanently or on trial: the literals of a lemma are false.
        tail = numbers[_TRAIL] if not trying else tried
        head = numbers[_HEAD]
        conflict = False
        while head < tail and not conflict:
            gone = trail[head] ^ 1
            head += 1
            first = watch_at[gone]
            old, kept, end = first, first, first + watch_size[gone]
            while old < end:
                if value[watches[2 * old]] == 1:
                    watches[2 * kept] = watches[2 * old]
                    watches[2 * kept + 1] = watches[2 * old + 1]
                    old += 1
                    kept += 1
                    continue
                clause = watches[2 * old + 1]
                old += 1
                size = pool[clause - 1]
                if size < 0:
                    continue
                other = pool[clause] ^ pool[clause + 1] ^ gone
                if value[other] == 1:
                    watches[2 * kept], watches[2 * kept + 1] = other, clause
                    kept += 1
                    continue
                found = -1
                for place in range(clause + 2, clause + size):
                    if value[pool[place]] >= 0:
                        found = place
                        break
                if found >= 0:
                    literal = pool[found]
                    pool[clause], pool[clause + 1], pool[found] = other, literal, gone
                    if watch_size[literal] == watch_room[literal]:
                        watches = _roomier(state, watches, literal)
                    there = 2 * (watch_at[literal] + watch_size[literal])
                    watches[there], watches[there + 1] = other, clause
                    watch_size[literal] += 1
                    continue
                watches[2 * kept], watches[2 * kept + 1] = other, clause
                kept += 1
                if value[other] == -1:
                    conflict = True
                    break
                value[other], value[other ^ 1] = 1, -1
                reason[other >> 1] = clause
                trail[tail] = other
                tail += 1
            while old < end:
                watches[2 * kept], watches[2 * kept + 1] = watches[2 * old], watches[2 * old + 1]
                old += 1
                kept += 1
            watch_size[gone] = kept - first
        if trying:
            for place in range(numbers[_TRAIL], tail):
                value[trail[place]] = value[trail[place] ^ 1] = 0
            trying = False
            if not conflict:
                numbers[_FAULT] = _NOT_IMPLIED
                break
            # Watch literals that are not permanently false, so that nothing is missed later.
            numbers[_LEMMAS] += 1
            good = 0
            for place in range(length):
                if good < 2 and value[lemma[place]] >= 0:
                    lemma[good], lemma[place] = lemma[place], lemma[good]
                    good += 1
            watches = _add(state, watches, lemma, length, good)
            numbers[_AT] = at
            continue
        numbers[_TRAIL] = tail
        numbers[_HEAD] = tail
        if conflict:
            numbers[_FOUND] = 1
            break
        # The next record that needs a trial; what follows from deletions alone is nothing.
        while not trying and at < len(data):
            kind, begin = data[at], at
            if kind not in (_ADD, _DELETE):
                numbers[_FAULT] = _NO_RECORD
                break
            at += 1
            length, literal, shift, whole = 0, 0, 0, False
            while at < len(data) and not whole:
                literal |= (np.int64(data[at]) & 127) << shift
                shift += 7
                if data[at] < 128:
                    if literal == 0:
                        whole = True
                    elif literal >= len(value) or literal < 2:
                        numbers[_FAULT] = _NO_VARIABLE
                        break
                    else:
                        lemma[length] = literal
                        length += 1
                    literal, shift = 0, 0
                elif shift > 28:
                    numbers[_FAULT] = _NO_VARIABLE
                    break
                at += 1
            if numbers[_FAULT]:
                break
            if not whole:
                at = len(data) + 1
                numbers[_AT] = begin
                break
            if kind == _DELETE:
                _delete(state, lemma, length)
                numbers[_AT] = at
                continue
            # Literals that are permanently true, or that stand with their negation, make it hold.
            tried = numbers[_TRAIL]
            count, holds = 0, False
            for place in range(length):
                literal = lemma[place]
                if value[literal] == 1:
                    holds = True
                    break
                if value[literal] == 0:
                    value[literal], value[literal ^ 1] = -1, 1
                    trail[tried] = literal ^ 1
                    tried += 1
                elif _stands(lemma, count, literal):
                    continue
                lemma[count] = literal
                count += 1
            if holds:
                for place in range(numbers[_TRAIL], tried):
                    value[trail[place]] = value[trail[place] ^ 1] = 0
                numbers[_LEMMAS] += 1
                numbers[_AT] = at
                continue
            length = count
            trying = True
        if not trying:
            break
    return watches


@inner
def _stands(lemma: Ints, count: int, literal: int) -> bool:
    for place in range(count):
        if lemma[place] == literal:
            return True
    return False


@inner
def _roomier(state: _State, watches: Ints, literal: int) -> Ints:
    """Move the watches of a literal to the end, where they have twice the room."""
    room = 2 * state.watch_room[literal] + 2
    old, new = state.watch_at[literal], state.numbers[_WATCHES]
    if 2 * (new + room) > len(watches):
        longer = np.empty(2 * (new + room) + len(watches), dtype=np.int32)
        longer[: len(watches)] = watches
        watches = longer
    for place in range(2 * state.watch_size[literal]):
        watches[2 * new + place] = watches[2 * old + place]
    state.watch_at[literal], state.watch_room[literal] = new, room
    state.numbers[_WATCHES] = new + room
    return watches


@inner
def _add(state: _State, watches: Ints, lemma: Ints, length: int, good: int) -> Ints:
    """Add a lemma; of its first two literals `good` are not permanently false."""
    pool, numbers = state.pool, state.numbers
    clause = numbers[_POOL] + _HEADER
    for place in range(length):
        pool[clause + place] = lemma[place]
    pool[clause - 1] = length
    row = _hash(state.heads, lemma, 0, length)
    pool[clause - 2] = state.heads[row]
    state.heads[row] = clause
    numbers[_POOL] = clause + length
    if good == 0:
        numbers[_FOUND] = 1
    elif good == 1:
        literal = lemma[0]
        if state.value[literal] == 0:
            state.value[literal], state.value[literal ^ 1] = 1, -1
            state.reason[literal >> 1] = clause
            state.trail[numbers[_TRAIL]] = literal
            numbers[_TRAIL] += 1
    else:
        for place in range(2):
            literal = lemma[place]
            if state.watch_size[literal] == state.watch_room[literal]:
                watches = _roomier(state, watches, literal)
            there = 2 * (state.watch_at[literal] + state.watch_size[literal])
            watches[there], watches[there + 1] = lemma[1 - place], clause
            state.watch_size[literal] += 1
    return watches


@inner
def _delete(state: _State, lemma: Ints, length: int) -> None:
    """Delete a clause with these literals, if there is one that is not unit."""
    pool, value = state.pool, state.value
    row = _hash(state.heads, lemma, 0, length)
    link, clause = -1, state.heads[row]
    while clause != _NO_CLAUSE:
        if pool[clause - 1] == length:
            same = True
            for place in range(length):
                if not _stands(pool[clause : clause + length], length, lemma[place]):
                    same = False
                    break
            if same:
                break
        link, clause = clause, pool[clause - 2]
    if clause == _NO_CLAUSE:
        return
    for place in range(min(length, 2)):
        literal = pool[clause + place]
        if value[literal] == 1 and state.reason[literal >> 1] == clause:
            return
    if link < 0:
        state.heads[row] = pool[clause - 2]
    else:
        pool[link - 2] = pool[clause - 2]
    pool[clause - 1] = -length
