"""One round of all environments of a batch, in compiled code: claims and moves.

The plain world is the reference, and tests compare the two step by step. Two claims that conflict
are compared by rank; a claim without conflicts is granted.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.observing import (
    BatchState,
    ObservationArrays,
    guards_hold,
    hear_all,
    mask_all,
    observe_all,
    place_at,
)
from cubepath.agents.arrays.tables import ANY, OWN, Bits, Goals, Ints, MoveKinds, Places, Stands
from cubepath.agents.local.random_streams import hashed_compiled
from cubepath.protocol.compiled import compiled, inner

STAYED, GRANTED, LOST, ILLEGAL = 0, 1, 2, 3
"""The result of a module's action."""


class Scratch(NamedTuple):
    """Memory for the claims of one environment."""

    head: Ints
    """By place, the last site of a trace there, -1 for none."""
    claim: Ints
    """By such site, whose it is; the claims are numbered in the order of the modules."""
    place: Ints
    code: Ints
    following: Ints
    claimant: Ints
    """By claim, the module."""
    move: Ints
    """By claim, the number of its move among all kinds."""
    first: Ints
    """By claim, the first entry with a rival, -1 for none: entry 2 p + s is pair p from side s."""
    granted: NDArray[np.uint8]
    """By claim: 0 while it is open, 1 if it is granted."""
    waiting: Ints
    """The claims with rivals."""
    stack: Ints
    rivals: Ints
    """Shape (pairs, 4): two claims, and for each of them its next entry."""
    rank: Bits
    """By claim, if it has rivals."""
    movers: Ints
    fresh: Ints
    """The modules that came to new stands; those of environment e are numbered from e * modules."""


@inner
def is_unknown(places: Places, kind: Ints, codes: int, place: int, code: int) -> bool:
    """Return whether a module that shows `code` at a place has to be prepared for."""
    shift, around, sensed, reach = places.shift, places.around, places.sensed, places.reach
    block = place >> shift
    row = places.first[block] + (place & ((1 << shift) - 1))
    found = bool(kind[row * codes + (code if codes > 1 else 0)] < 0)
    if around.shape[1] > 1:
        for slot in range(sensed.shape[1]):
            found |= bool(around[block, sensed[row, slot] >> shift] < 0)
        for slot in range(reach.shape[1]):
            found |= bool(around[block, reach[row, slot] >> shift] < 0)
    return found


_OPEN, _WON, _BEATEN = 0, 1, 2


@inner
def file_traces(
    places: Places,
    kinds: MoveKinds,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
) -> int:
    """File all claims by the places of their traces; return how many sites were filed."""
    shift, first_row, around = places.shift, places.first, places.around
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
            place = place_at(shift, first_row, around, sensed, own, ref)
            claims[filed] = claim
            scratch.place[filed] = place
            codes[filed] = code_of[environment, module] if code == OWN else code
            following[filed] = head[place]
            head[place] = filed
            filed += 1
    return filed


@inner
def find_rivals(
    places: Places,
    kinds: MoveKinds,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
    rivals: Ints,
) -> int:
    """Find the claims that conflict: a trace of one meets the support of the other.

    Writes and chains pairs of claims, as `Scratch` has them, and returns how many there are. Only
    the first are written if there is no room for more; then it has to be called again.
    """
    shift, first_row, around = places.shift, places.first, places.around
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
            other = head[place_at(shift, first_row, around, sensed, own, ref)]
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
                # A claim with a granted rival is lost: had it the greater rank, that would not be.
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
    kinds: MoveKinds,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
) -> None:
    """Grant claims by rank, each unless it conflicts with one that was granted before."""
    filed = file_traces(places, kinds, state, environment, count, scratch)
    rivals = scratch.rivals
    while True:
        pairs = find_rivals(places, kinds, state, environment, count, scratch, rivals)
        if pairs <= len(rivals):
            break
        rivals = np.empty((pairs, 4), np.int32)
    for site in range(filed):
        scratch.head[scratch.place[site]] = -1
    waiting = set_aside(count, scratch)
    if waiting > 0:
        key = hashed_compiled(state.key[environment], np.uint64(state.round[environment]))
        for at in range(waiting):
            claim = scratch.waiting[at]
            scratch.rank[claim] = hashed_compiled(key, np.uint64(scratch.claimant[claim]))
        grant_by_rank(waiting, rivals, scratch)


@inner
def claim_all(
    places: Places,
    stands: Stands,
    kinds: MoveKinds,
    codes: int,
    state: BatchState,
    environment: int,
    actions: NDArray[np.int64],
    scratch: Scratch,
    outcomes: NDArray[np.int8],
) -> int:
    """Note the claims that the actions of an environment make; return how many."""
    kind_of, usable = stands.kind, stands.usable
    care, want, guards_at, guards = kinds.care, kinds.want, kinds.guards_at, kinds.guards
    bits, move_slots = state.bits, usable.shape[1]
    shift, first = places.shift, places.first
    inside = (1 << shift) - 1
    count = 0
    for module in range(actions.shape[1]):
        action = actions[environment, module]
        outcomes[environment, module] = STAYED
        if action == 0:
            continue
        outcomes[environment, module] = ILLEGAL
        if not 0 < action <= move_slots:
            continue
        place = state.place[environment, module]
        stand = (first[place >> shift] + (place & inside)) * codes
        if codes > 1:
            stand += state.code[environment, module]
        move = kind_of[stand] * move_slots + action - 1
        legal = usable[place if len(usable) > 1 else 0, action - 1] != 0
        for word in range(bits.shape[2]):
            legal &= (bits[environment, module, word] & care[move, word]) == want[move, word]
        if legal and guards_hold(guards_at, guards, move, bits, environment, module):
            scratch.claimant[count] = module
            scratch.move[count] = move
            count += 1
    return count


@inner
def execute_all(
    places: Places,
    stands: Stands,
    kinds: MoveKinds,
    codes: int,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
    outcomes: NDArray[np.int8],
    fresh: int,
) -> int:
    """Move the modules of the granted claims, and add those that come to new stands to `fresh`.

    Returns how many are in there then.
    """
    sensed, background, final = places.sensed, places.background, places.final
    shift, first_row, around = places.shift, places.first, places.around
    motion_at, motion = kinds.motion_at, kinds.motion
    place_of, code_of = state.place, state.code
    shown, module_at = state.shown, state.module
    movers = scratch.movers
    for claim in range(count):
        module, move = scratch.claimant[claim], scratch.move[claim]
        if scratch.granted[claim] != 1:
            outcomes[environment, module] = LOST
            continue
        outcomes[environment, module] = GRANTED
        own, label = place_of[environment, module], code_of[environment, module]
        first, last = motion_at[move], motion_at[move + 1]
        for pair in range(first, last):
            ref = motion[pair, 0]
            place = place_at(shift, first_row, around, sensed, own, ref)
            mover = module_at[environment, place]
            movers[pair - first] = mover
            shown[environment, place] = background[place]
            module_at[environment, place] = -1
            if final[place] == code_of[environment, mover]:
                state.at_goal[environment] -= 1
        for pair in range(first, last):
            mover, ref, code = movers[pair - first], motion[pair, 2], motion[pair, 3]
            place = place_at(shift, first_row, around, sensed, own, ref)
            if code == OWN:
                code = label
            elif code == ANY:
                code = code_of[environment, mover]
            place_of[environment, mover] = place
            code_of[environment, mover] = code
            shown[environment, place] = code
            module_at[environment, place] = mover
            if final[place] == code:
                state.at_goal[environment] += 1
            if is_unknown(places, stands.kind, codes, place, code):
                scratch.fresh[fresh] = environment * place_of.shape[1] + mover
                fresh += 1
    return fresh


@compiled
def play_round(
    place_arrays: Any,
    goal_arrays: Any,
    knower: Ints,
    stand_arrays: Any,
    kind_arrays: Any,
    codes: int,
    state_arrays: Any,
    actions: NDArray[np.int64],
    live: NDArray[np.uint8],
    scratch_arrays: Any,
    outcomes: NDArray[np.int8],
    observed_arrays: Any,
    only_observe: bool,  # noqa: FBT001 - compiled functions are called with positions
) -> int:
    """Play one round in every live environment; return how many modules came to a new stand.

    If none did, what all modules observe is written too; with `only_observe` nothing else. The
    probes must be those of the present state. The tuples come as plain ones: those take a third of
    the time to be handed over.
    """
    places, stands, kinds = Places(*place_arrays), Stands(*stand_arrays), MoveKinds(*kind_arrays)
    state, scratch = BatchState(*state_arrays), Scratch(*scratch_arrays)
    fresh = 0
    for environment in range(0 if only_observe else len(actions)):
        if not live[environment]:
            for module in range(actions.shape[1]):
                outcomes[environment, module] = STAYED
            continue
        state.round[environment] += 1
        count = claim_all(
            places, stands, kinds, codes, state, environment, actions, scratch, outcomes
        )
        settle(places, kinds, state, environment, count, scratch)
        fresh = execute_all(
            places, stands, kinds, codes, state, environment, count, scratch, outcomes, fresh
        )
    if fresh == 0:
        observed = ObservationArrays(*observed_arrays)
        goals = Goals(*goal_arrays)
        observe_all(places, goals, knower, stands, kinds, codes, state, observed.observation)
        mask_all(places, stands, kinds, codes, state, observed.mask)
        if state.notes.shape[2] > 0:
            hear_all(places, state, observed.notes)
    return fresh
