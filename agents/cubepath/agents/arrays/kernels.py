"""The lockstep world in compiled code: what all modules observe, and a round of claims.

Room: agents. The same as `observe`, `contest`, `verdict` and `site_after` in `local`, by number
instead of by name, for every module of every environment of a batch. The plain world is the
reference: tests hold the two together step by step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.kinds import ANY, OWN
from cubepath.agents.arrays.ranks import digits, rank
from cubepath.agents.arrays.tables import Bits, Goals, Ints, Kinds, Places, Stands
from cubepath.protocol.compiled import compiled

STAYED, GRANTED, LOST, ILLEGAL = 0, 1, 2, 3
"""What came of a module's action."""
SILENT = np.iinfo(np.int32).min
_FREE, _CLOSED, _SLASH = 0, 3, 47


class State(NamedTuple):
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
    said: Ints
    """Shape (environments, modules, note_length): the last notes."""


class Observed(NamedTuple):
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
    contested: NDArray[np.uint8]
    granted: NDArray[np.uint8]
    text: NDArray[np.uint8]
    movers: Ints


# Arrays are taken out of their tuples once, and small functions take arrays alone: a tuple that is
# passed on costs an atomic count of references for each array in it.


@compiled
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


@compiled
def observe_all(
    places: Places,
    goals: Goals,
    knower: Ints,
    stands: Stands,
    kinds: Kinds,
    codes: int,
    state: State,
    observed: Observed,
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
    for environment in range(environments):
        for module in range(modules):
            place, code = state.place[environment, module], state.code[environment, module]
            stand = place * codes + (code if codes > 1 else 0)
            kind, who = kind_of[stand], knower[module]
            for at in range(size):
                out[environment, module, at] = encoded[stand, at]
            for word in range(words):
                bits[environment, module, word] = 0
            for slot in range(-1, slots):  # -1: the own place, of which only the flag is written
                near = place if slot < 0 else sensed[place, slot]
                found, entry, flag = shown[environment, near], goal[near], 0
                while entry >= 0:
                    if goal_knower[entry] == who:
                        flag |= goal_code[entry] == ANY or goal_code[entry] == found
                    entry = following[entry]
                at = size + 1 + 2 * slot
                out[environment, module, at + 1] = flag
                if slot < 0:
                    continue
                out[environment, module, at] = found
                if codes == 1 and found != _FREE and found != _CLOSED:
                    bits[environment, module, slot >> 6] |= one << np.uint64(slot & 63)
            if codes > 1:
                first = kinds.probes_at[kind]
                for probe in range(first, kinds.probes_at[kind + 1]):
                    near = sensed[place, kinds.probes[probe, 0]]
                    if shown[environment, near] == kinds.probes[probe, 1]:
                        bit = probe - first
                        bits[environment, module, bit >> 6] |= one << np.uint64(bit & 63)
            mask[environment, module, 0] = 1
            for slot in range(move_slots):
                move = kind * move_slots + slot
                legal = usable[stand, slot] != 0
                for word in range(words):
                    legal &= (bits[environment, module, word] & care[move, word]) == want[
                        move, word
                    ]
                if legal and guards_at[move] < guards_at[move + 1]:
                    legal = guards_hold(guards_at, guards, move, bits, environment, module)
                mask[environment, module, slot + 1] = legal


@compiled
def hear_all(places: Places, state: State, notes: Ints) -> None:
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


@compiled
def claim_all(
    stands: Stands,
    kinds: Kinds,
    codes: int,
    state: State,
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
            scratch.contested[count] = 0
            count += 1
    return count


@compiled
def execute_all(
    places: Places,
    stands: Stands,
    kinds: Kinds,
    codes: int,
    state: State,
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
        if not scratch.granted[claim]:
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
def step_all(
    places: Places,
    stands: Stands,
    kinds: Kinds,
    codes: int,
    state: State,
    actions: NDArray[np.int64],
    prefixes: NDArray[np.uint8],
    lengths: Ints,
    live: NDArray[np.uint8],
    scratch: Scratch,
    outcomes: NDArray[np.int8],
) -> bool:
    """Play one round in every live environment; return whether a module came to a new stand.

    The probes must be those of the present state. `prefixes` are the seeds as text, with a slash,
    of which `lengths` bytes count.
    """
    fresh = False
    for environment in range(len(actions)):
        if not live[environment]:
            outcomes[environment] = STAYED
            continue
        state.round[environment] += 1
        count = claim_all(stands, kinds, codes, state, environment, actions, scratch, outcomes)
        length = lengths[environment]
        scratch.text[:length] = prefixes[environment, :length]
        arbitrate(places, kinds, state, environment, count, length, scratch)
        moved = execute_all(
            places, stands, kinds, codes, state, environment, count, scratch, outcomes
        )
        fresh = fresh or moved
    return fresh


@compiled
def play_round(
    places: Any,
    goals: Any,
    knower: Ints,
    stands: Any,
    kinds: Any,
    codes: int,
    state: Any,
    actions: NDArray[np.int64],
    prefixes: NDArray[np.uint8],
    lengths: Ints,
    live: NDArray[np.uint8],
    scratch: Any,
    outcomes: NDArray[np.int8],
    observed: Any,
) -> bool:
    """Step, and observe unless a module came to a new stand; return whether one did.

    The tuples come as plain ones: those take a third of the time to be handed over.
    """
    fresh = step_all(
        Places(*places),
        Stands(*stands),
        Kinds(*kinds),
        codes,
        State(*state),
        actions,
        prefixes,
        lengths,
        live,
        Scratch(*scratch),
        outcomes,
    )
    if not fresh:
        observe_all(
            Places(*places),
            Goals(*goals),
            knower,
            Stands(*stands),
            Kinds(*kinds),
            codes,
            State(*state),
            Observed(*observed),
        )
    return fresh
