"""One round of all environments of a batch, in compiled code: claims, moves, observations.

The plain world is the reference, and tests compare the two step by step. Two claims that conflict
are compared by rank; a claim without conflicts is granted.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import ANY, OWN, Bits, Goals, Ints, MoveKinds, Places, Stands
from cubepath.agents.local.random_streams import hashed_compiled
from cubepath.protocol.compiled import compiled, inner

STAYED, GRANTED, LOST, ILLEGAL = 0, 1, 2, 3
"""The result of a module's action."""
SILENT = np.iinfo(np.int32).min


class BatchState(NamedTuple):
    """Where the modules are; the first axis is the environment."""

    place: Ints
    """Shape (environments, modules): the number of the place of each module."""
    code: Ints
    """What each module shows."""
    shown: Ints
    """Shape (environments, places): what each place shows."""
    module: Ints
    """The module at each place, -1 for none."""
    bits: Bits
    """Shape (environments, modules, words): the probes of each module, when it last observed."""
    at_goal: NDArray[np.int64]
    """How many modules of each environment are on sites of the goal."""
    round: NDArray[np.int64]
    key: Bits
    """What the ranks of claims are drawn under, by the seed of each environment."""
    said: Ints
    """Shape (environments, modules, note_length): the last notes."""


class ObservationArrays(NamedTuple):
    """What all modules observe, as `observe` documents it."""

    observation: Ints
    """Shape (environments, modules, observation_length)."""
    mask: NDArray[np.int8]
    """Shape (environments, modules, move_slots + 1)."""
    notes: Ints
    """Shape (environments, modules, reach_slots, note_length)."""


class Scratch(NamedTuple):
    """Memory for the claims of one environment."""

    head: Ints
    """By place, the last site of a trace there, -1 for none."""
    claim: Ints
    """By such site, whose it is; the claims are numbered in the order of the modules."""
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


_FREE, _CLOSED = 0, 3

# Arrays are taken out of their tuples once, and small functions take arrays alone: a tuple that is
# passed on costs an atomic count of references for each array in it.


@inner
def guards_hold(
    guards_at: Ints, guards: Ints, move: int, bits: Bits, environment: int, module: int
) -> bool:
    """Return whether the probes of a module agree with the guards of a move."""
    one = np.uint64(1)
    for guard in range(guards_at[move], guards_at[move + 1]):
        first, second = guards[guard, 0], guards[guard, 1]
        if (bits[environment, module, first >> 6] >> np.uint64(first & 63)) & one and not (
            (bits[environment, module, second >> 6] >> np.uint64(second & 63)) & one
        ):
            return False
    return True


@inner
def is_goal(knower: Ints, code: Ints, following: Ints, entry: Any, who: int, found: int) -> bool:
    """Return whether a place that shows `found`, with this entry, is a goal of somebody."""
    flag = False
    while entry >= 0:
        if knower[entry] == who:
            flag |= code[entry] == ANY or code[entry] == found
        entry = following[entry]
    return flag


@inner
def observe_all(
    places: Places,
    goals: Goals,
    knower: Ints,
    stands: Stands,
    kinds: MoveKinds,
    codes: int,
    state: BatchState,
    observed: ObservationArrays,
) -> None:
    """Write what all modules of all environments observe."""
    environments, modules = state.place.shape
    sensed, goal = places.sensed, places.goal
    goal_knower, goal_code, following = goals.knower, goals.code, goals.following
    kind_of, encoded, usable = stands.kind, stands.encoded, stands.usable
    care, want, guards_at, guards = kinds.care, kinds.want, kinds.guards_at, kinds.guards
    shown, bits = state.shown, state.bits
    out, mask = observed.observation, observed.mask
    slots, size, move_slots = sensed.shape[1], encoded.shape[1], usable.shape[1]
    words = bits.shape[2]
    one = np.uint64(1)
    # Most systems have neither guards nor more than 64 probes: a third of the time for masks.
    simple = words == 1 and guards_at[-1] == 0
    for environment in range(environments):
        for module in range(modules):
            place, code = state.place[environment, module], state.code[environment, module]
            stand = place * codes + (code if codes > 1 else 0)
            kind, who = kind_of[stand], knower[module]
            for at in range(size):
                out[environment, module, at] = encoded[stand, at]
            for word in range(words):
                bits[environment, module, word] = 0
            out[environment, module, size] = is_goal(
                goal_knower, goal_code, following, goal[place], who, shown[environment, place]
            )
            for word in range((slots + 63) >> 6):
                probed = np.uint64(0)
                for slot in range(64 * word, min(slots, 64 * word + 64)):
                    near = sensed[place, slot]
                    found = shown[environment, near]
                    out[environment, module, size + 1 + 2 * slot] = found
                    out[environment, module, size + 2 + 2 * slot] = is_goal(
                        goal_knower, goal_code, following, goal[near], who, found
                    )
                    probed |= np.uint64((found != _FREE) & (found != _CLOSED)) << np.uint64(
                        slot & 63
                    )
                if codes == 1 and word < words:
                    bits[environment, module, word] = probed
            if codes > 1:
                first = kinds.probes_at[kind]
                for probe in range(first, kinds.probes_at[kind + 1]):
                    near = sensed[place, kinds.probes[probe, 0]]
                    if shown[environment, near] == kinds.probes[probe, 1]:
                        bit = probe - first
                        bits[environment, module, bit >> 6] |= one << np.uint64(bit & 63)
            mask[environment, module, 0] = 1
            first_move = kind * move_slots
            if simple:
                own = bits[environment, module, 0]
                for slot in range(move_slots):
                    met = own & care[first_move + slot, 0] == want[first_move + slot, 0]
                    mask[environment, module, slot + 1] = met & (usable[stand, slot] != 0)
                continue
            for slot in range(move_slots):
                move = first_move + slot
                legal = usable[stand, slot] != 0
                for word in range(words):
                    legal &= (bits[environment, module, word] & care[move, word]) == want[
                        move, word
                    ]
                if legal and guards_at[move] < guards_at[move + 1]:
                    legal = guards_hold(guards_at, guards, move, bits, environment, module)
                mask[environment, module, slot + 1] = legal


@inner
def hear_all(places: Places, state: BatchState, notes: Ints) -> None:
    """Write the notes that all modules hear: from the second round on, the last of each module."""
    environments, modules = state.place.shape
    reach, module_at, said = places.reach, state.module, state.said
    note_length = said.shape[2]
    for environment in range(environments):
        heard = state.round[environment] > 0
        for module in range(modules):
            place = state.place[environment, module]
            for slot in range(reach.shape[1]):
                other = module_at[environment, reach[place, slot]] if heard else -1
                for at in range(note_length):
                    notes[environment, module, slot, at] = (
                        said[environment, other, at] if other >= 0 else SILENT
                    )


_OPEN, _WON, _BEATEN = 0, 1, 2


@inner
def file_traces(
    places: Places,
    kinds: MoveKinds,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
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
    places: Places,
    kinds: MoveKinds,
    state: BatchState,
    environment: int,
    count: int,
    scratch: Scratch,
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
        key = hashed_compiled(state.key[environment], np.uint64(state.round[environment]))
        for at in range(waiting):
            claim = scratch.waiting[at]
            scratch.rank[claim] = hashed_compiled(key, np.uint64(scratch.claimant[claim]))
        grant_by_rank(waiting, rivals, scratch)


@inner
def claim_all(
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
    count = 0
    for module in range(actions.shape[1]):
        action = actions[environment, module]
        outcomes[environment, module] = STAYED
        if action == 0:
            continue
        outcomes[environment, module] = ILLEGAL
        if not 0 < action <= move_slots:
            continue
        stand = state.place[environment, module] * codes
        if codes > 1:
            stand += state.code[environment, module]
        move = kind_of[stand] * move_slots + action - 1
        legal = usable[stand, action - 1] != 0
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
) -> bool:
    """Move the modules of the granted claims; return whether one came to a new stand."""
    sensed, background, final = places.sensed, places.background, places.final
    motion_at, motion = kinds.motion_at, kinds.motion
    place_of, code_of = state.place, state.code
    shown, module_at = state.shown, state.module
    movers = scratch.movers
    fresh = False
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
            place = own if ref == 0 else sensed[own, ref - 1]
            mover = module_at[environment, place]
            movers[pair - first] = mover
            shown[environment, place] = background[place]
            module_at[environment, place] = -1
            if final[place] == code_of[environment, mover]:
                state.at_goal[environment] -= 1
        for pair in range(first, last):
            mover, ref, code = movers[pair - first], motion[pair, 2], motion[pair, 3]
            place = own if ref == 0 else sensed[own, ref - 1]
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
            stand = place * codes + (code if codes > 1 else 0)
            if stands.kind[stand] < 0:
                fresh = True
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
) -> bool:
    """Play one round in every live environment; return whether a module came to a new stand.

    If none did, what all modules observe is written too; with `only_observe` nothing else. The
    probes must be those of the present state. The tuples come as plain ones: those take a third of
    the time to be handed over.
    """
    places, stands, kinds = Places(*place_arrays), Stands(*stand_arrays), MoveKinds(*kind_arrays)
    state, scratch = BatchState(*state_arrays), Scratch(*scratch_arrays)
    fresh = False
    for environment in range(0 if only_observe else len(actions)):
        if not live[environment]:
            for module in range(actions.shape[1]):
                outcomes[environment, module] = STAYED
            continue
        state.round[environment] += 1
        count = claim_all(stands, kinds, codes, state, environment, actions, scratch, outcomes)
        settle(places, kinds, state, environment, count, scratch)
        if execute_all(places, stands, kinds, codes, state, environment, count, scratch, outcomes):
            fresh = True
    if not fresh:
        observed = ObservationArrays(*observed_arrays)
        goals = Goals(*goal_arrays)
        observe_all(places, goals, knower, stands, kinds, codes, state, observed)
        if state.said.shape[2] > 0:
            hear_all(places, state, observed.notes)
    return fresh
