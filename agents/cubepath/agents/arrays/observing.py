"""What all modules observe, in compiled code.

The same as `observe` in `local`, by number instead of by name, for every module of every
environment of a batch. The plain world is the reference: tests hold the two together step by step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import ANY, Bits, Goals, Ints, MoveKinds, Places, Stands
from cubepath.protocol.compiled import inner

STAYED, GRANTED, LOST, ILLEGAL = 0, 1, 2, 3
"""What came of a module's action."""
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
