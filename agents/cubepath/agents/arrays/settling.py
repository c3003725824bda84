"""Which claims of a round are granted, in compiled code.

Room: agents. The same as `contest` and `verdict` in `local`, for all claims of an environment at
once: two that conflict are compared by rank, and what does not conflict is granted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.kinds import ANY, OWN
from cubepath.agents.arrays.ranks import digits, rank
from cubepath.agents.arrays.state import Scratch, State
from cubepath.agents.arrays.tables import Ints, Kinds, Places
from cubepath.protocol.compiled import compiled

_SLASH = 47


@compiled
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


@compiled
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

    Writes pairs of claims and returns how many there are; only the first are written if there is no
    room for more.
    """
    sensed, items_at, items = places.sensed, kinds.items_at, kinds.items
    place_of, code_of = state.place, state.code
    claimant, moves, contested = scratch.claimant, scratch.move, scratch.contested
    head, claims, codes, following = scratch.head, scratch.claim, scratch.code, scratch.following
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
                        contested[claim] = contested[rival] = 1
                        if found < len(rivals):
                            rivals[found, 0], rivals[found, 1] = claim, rival
                        found += 1
                other = following[other]
    return found


@compiled
def grant_in_order(order: NDArray[np.int64], rivals: Ints, count: int, scratch: Scratch) -> None:
    """Grant the contested claims from last to first, unless a rival has been granted."""
    granted = scratch.granted
    first = np.full(count, -1, np.int64)
    # Each pair is filed under both claims: entry e is pair e // 2, seen from its side e % 2.
    following = np.zeros(2 * len(rivals), np.int64)
    for entry in range(2 * len(rivals)):
        claim = rivals[entry >> 1, entry & 1]
        following[entry] = first[claim]
        first[claim] = entry
    for at in range(len(order) - 1, -1, -1):
        claim = order[at]
        beaten = False
        entry = first[claim]
        while entry >= 0 and not beaten:
            beaten = granted[rivals[entry >> 1, 1 - (entry & 1)]] != 0
            entry = following[entry]
        if not beaten:
            granted[claim] = 1


@compiled
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


@compiled
def arbitrate(
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
    contested, granted, text = scratch.contested, scratch.granted, scratch.text
    rivals = np.zeros((4 * count, 2), np.int32)
    pairs = find_rivals(places, kinds, state, environment, count, scratch, rivals)
    if pairs > len(rivals):
        rivals = np.zeros((pairs, 2), np.int32)
        find_rivals(places, kinds, state, environment, count, scratch, rivals)
    clear(places, kinds, state, environment, count, scratch)
    waiting = 0
    for claim in range(count):
        granted[claim] = 1 - contested[claim]
        waiting += contested[claim]
    if waiting == 0:
        return
    ranks = np.zeros(waiting, np.uint64)
    chosen = np.zeros(waiting, np.int64)
    digest, words = np.zeros(8, np.uint64), np.zeros(16, np.uint64)
    start = digits(state.round[environment], text, length)
    text[start] = _SLASH
    at = 0
    for claim in range(count):
        if contested[claim]:
            end = digits(scratch.claimant[claim], text, start + 1)
            ranks[at] = rank(text, end, digest, words)
            chosen[at] = claim
            at += 1
    # Stable, so among equal ranks the greater module is last, and goes first.
    order = chosen[np.argsort(ranks, kind="mergesort")]
    grant_in_order(order, rivals[:pairs], count, scratch)
