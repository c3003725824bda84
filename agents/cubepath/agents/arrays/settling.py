"""Which claims of a round are granted, in compiled code.

The same as `contest` and `verdict` in `local`, for all claims of an environment at once: two that
conflict are compared by rank, and what does not conflict is granted.
"""

from __future__ import annotations

import numpy as np

from cubepath.agents.arrays.kinds import ANY, OWN
from cubepath.agents.arrays.ranks import digits, rank_claims
from cubepath.agents.arrays.state import Scratch, State
from cubepath.agents.arrays.tables import Ints, Kinds, Places
from cubepath.protocol.compiled import inner

_SLASH = 47
_OPEN, _WON, _BEATEN = 0, 1, 2


@inner
def file_traces(
    places: Places, kinds: Kinds, state: State, environment: int, count: int, scratch: Scratch
) -> None:
    """File all claims by the places of their traces."""
    sensed, items_at, items = places.sensed, kinds.items_at, kinds.items
    place_of, code_of = state.place, state.code
    claimant, moves = scratch.claimant, scratch.move
    head, claims, codes, following = scratch.head, scratch.claim, scratch.code, scratch.following
    filed = 0
    for claim in range(count):
        module, move = claimant[claim], moves[claim]
        own = place_of[environment, module]
        for item in range(items_at[move], items_at[move + 1]):
            if not items[item, 2]:
                continue
            ref, code = items[item, 0], items[item, 1]
            place = own if ref == 0 else sensed[own, ref - 1]
            claims[filed] = claim
            codes[filed] = code_of[environment, module] if code == OWN else code
            following[filed] = head[place]
            head[place] = filed
            filed += 1


@inner
def find_rivals(
    places: Places,
    kinds: Kinds,
    state: State,
    environment: int,
    count: int,
    scratch: Scratch,
    rivals: Ints,
) -> int:
    """Find the claims that conflict: a trace of one meets the support of the other.

    Writes and chains pairs of claims, as `Scratch` has them, and returns how many there are. Only
    the first are written if there is no room for more; then it has to be called again.
    """
    sensed, items_at, items = places.sensed, kinds.items_at, kinds.items
    place_of, code_of = state.place, state.code
    claimant, moves, first = scratch.claimant, scratch.move, scratch.first
    head, claims, codes, following = scratch.head, scratch.claim, scratch.code, scratch.following
    for claim in range(count):
        first[claim] = -1
    found = 0
    for claim in range(count):
        module, move = claimant[claim], moves[claim]
        own = place_of[environment, module]
        for item in range(items_at[move], items_at[move + 1]):
            ref = items[item, 0]
            other = head[own if ref == 0 else sensed[own, ref - 1]]
            while other >= 0:
                rival = claims[other]
                if rival != claim:
                    code = items[item, 1]
                    if code == OWN:
                        code = code_of[environment, module]
                    if code == ANY or codes[other] == ANY or code == codes[other]:
                        if found < len(rivals):
                            rivals[found, 0], rivals[found, 1] = claim, rival
                            rivals[found, 2], rivals[found, 3] = first[claim], first[rival]
                            first[claim], first[rival] = 2 * found, 2 * found + 1
                        found += 1
                other = following[other]
    return found


@inner
def clear(
    places: Places, kinds: Kinds, state: State, environment: int, count: int, scratch: Scratch
) -> None:
    """Take the claims out of the file again."""
    sensed, items_at, items = places.sensed, kinds.items_at, kinds.items
    head = scratch.head
    for claim in range(count):
        own, move = state.place[environment, scratch.claimant[claim]], scratch.move[claim]
        for item in range(items_at[move], items_at[move + 1]):
            if items[item, 2]:
                ref = items[item, 0]
                head[own if ref == 0 else sensed[own, ref - 1]] = -1


@inner
def set_aside(count: int, scratch: Scratch) -> int:
    """List the claims that have rivals, and grant all others; return how many have."""
    waiting = 0
    for claim in range(count):
        if scratch.first[claim] >= 0:
            scratch.granted[claim] = _OPEN
            scratch.waiting[waiting] = claim
            waiting += 1
        else:
            scratch.granted[claim] = _WON
    return waiting


@inner
def grant_by_rank(waiting: int, rivals: Ints, scratch: Scratch) -> None:
    """Grant each of the waiting claims unless a rival that outranks it is granted.

    A claim whose verdict depends on an open one that outranks it is put aside on the stack until
    that is decided; ranks grow along the stack, so it never holds a claim twice.
    """
    granted, first, ranks, stack = scratch.granted, scratch.first, scratch.rank, scratch.stack
    for at in range(waiting):
        stack[0] = scratch.waiting[at]
        depth = 1 if granted[stack[0]] == _OPEN else 0
        while depth > 0:
            claim = stack[depth - 1]
            verdict = _WON
            while first[claim] >= 0:
                pair, side = first[claim] >> 1, first[claim] & 1
                rival = rivals[pair, 1 - side]
                # Whoever has a granted rival is beaten: had it the greater rank, that would not be.
                if granted[rival] == _WON:
                    verdict = _BEATEN
                    break
                if granted[rival] == _OPEN and (
                    ranks[rival] > ranks[claim] or (ranks[rival] == ranks[claim] and rival > claim)
                ):
                    verdict = _OPEN
                    stack[depth] = rival
                    break
                first[claim] = rivals[pair, 2 + side]
            if verdict == _OPEN:
                depth += 1
            else:
                granted[claim] = verdict
                depth -= 1


@inner
def settle(
    places: Places,
    kinds: Kinds,
    state: State,
    environment: int,
    count: int,
    length: int,
    scratch: Scratch,
) -> None:
    """Grant claims by rank, each unless it conflicts with one that was granted before.

    The text to be hashed begins with `length` bytes of the seed.
    """
    file_traces(places, kinds, state, environment, count, scratch)
    rivals = scratch.rivals
    while True:
        pairs = find_rivals(places, kinds, state, environment, count, scratch, rivals)
        if pairs <= len(rivals):
            break
        rivals = np.empty((pairs, 4), np.int32)
    clear(places, kinds, state, environment, count, scratch)
    waiting = set_aside(count, scratch)
    if waiting > 0:
        text = scratch.text
        start = digits(state.round[environment], text, length)
        text[start] = _SLASH
        rank_claims(
            text,
            start + 1,
            scratch.claimant,
            scratch.waiting,
            waiting,
            scratch.hashing,
            scratch.rank,
        )
        grant_by_rank(waiting, rivals, scratch)
