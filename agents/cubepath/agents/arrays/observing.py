"""What all modules of a batch are shown, in compiled code: observations, masks and notes.

The plain world is the reference, and tests compare the two step by step.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import ANY, Bits, Goals, Ints, MoveKinds, Places, Stands
from cubepath.protocol.compiled import inner

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
    notes: Ints
    """Shape (environments, modules, note_length): the last notes."""


class ObservationArrays(NamedTuple):
    """What all modules observe, as `observe` documents it."""

    observation: Ints
    """Shape (environments, modules, observation_length)."""
    mask: NDArray[np.int8]
    """Shape (environments, modules, move_slots + 1)."""
    notes: Ints
    """Shape (environments, modules, reach_slots, note_length)."""


_FREE, _CLOSED = 0, 3

# Arrays are taken out of their tuples once, and small functions take arrays alone: a tuple that is
# passed on costs an atomic count of references for each array in it.


@inner
def place_at(shift: int, first: Ints, around: Ints, sensed: Ints, own: int, ref: int) -> Any:
    """Return the number of the place that a reference means for a module at place `own`."""
    if ref == 0:
        return own
    inside = (1 << shift) - 1
    block = own >> shift
    there = sensed[first[block] + (own & inside), ref - 1]
    return around[block, there >> shift] + (there & inside)


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
def is_goal(knower: Ints, code: Ints, following: Ints, entry: Any, module: int, found: int) -> bool:
    """Return whether a place that shows `found`, with this entry, is a goal of somebody."""
    flag = False
    while entry >= 0:
        if knower[entry] == module:
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
    out: Ints,
) -> None:
    """Write the observations of all modules of all environments, and their probes."""
    environments, modules = state.place.shape
    sensed, goal = places.sensed, places.goal
    goal_knower, goal_code, following = goals.knower, goals.code, goals.following
    shift, first_row, around = places.shift, places.first, places.around
    inside = (1 << shift) - 1
    kind_of, encoded, origin = stands.kind, stands.encoded, stands.origin
    alike = goals.alike
    shown, bits = state.shown, state.bits
    slots, size = sensed.shape[1], encoded.shape[1]
    words = bits.shape[2]
    one = np.uint64(1)
    for environment in range(environments):
        for module in range(modules):
            place, code = state.place[environment, module], state.code[environment, module]
            block = place >> shift
            row = first_row[block] + (place & inside)
            stand = row * codes + (code if codes > 1 else 0)
            kind, knows = kind_of[stand], knower[module]
            for at in range(size):
                out[environment, module, at] = origin[block, at] + encoded[stand, at]
            for word in range(words):
                bits[environment, module, word] = 0
            out[environment, module, size] = is_goal(
                goal_knower, goal_code, following, goal[place], knows, shown[environment, place]
            )
            for word in range((slots + 63) >> 6):
                probed = np.uint64(0)
                for slot in range(64 * word, min(slots, 64 * word + 64)):
                    there = sensed[row, slot]
                    near = around[block, there >> shift] + (there & inside)
                    found = shown[environment, near]
                    out[environment, module, size + 1 + 2 * slot] = found
                    entry = goal[near]
                    out[environment, module, size + 2 + 2 * slot] = (
                        entry >= 0
                        if alike
                        else is_goal(goal_knower, goal_code, following, entry, knows, found)
                    )
                    probed |= np.uint64((found != _FREE) & (found != _CLOSED)) << np.uint64(
                        slot & 63
                    )
                if codes == 1 and word < words:
                    bits[environment, module, word] = probed
            if codes > 1:
                first = kinds.probes_at[kind]
                for probe in range(first, kinds.probes_at[kind + 1]):
                    there = sensed[row, kinds.probes[probe, 0]]
                    near = around[block, there >> shift] + (there & inside)
                    if shown[environment, near] == kinds.probes[probe, 1]:
                        bit = probe - first
                        bits[environment, module, bit >> 6] |= one << np.uint64(bit & 63)


@inner
def mask_all(
    places: Places,
    stands: Stands,
    kinds: MoveKinds,
    codes: int,
    state: BatchState,
    mask: NDArray[np.int8],
) -> None:
    """Write which moves all modules can make by their probes."""
    environments, modules = state.place.shape
    shift, first_row, kind_of, usable = places.shift, places.first, stands.kind, stands.usable
    care, want, guards_at, guards = kinds.care, kinds.want, kinds.guards_at, kinds.guards
    bits = state.bits
    words, move_slots = bits.shape[2], usable.shape[1]
    # Most systems have neither guards nor more than 64 probes: a third of the time for masks.
    simple = words == 1 and guards_at[-1] == 0
    for environment in range(environments):
        for module in range(modules):
            place, code = state.place[environment, module], state.code[environment, module]
            row = first_row[place >> shift] + (place & ((1 << shift) - 1))
            first = kind_of[row * codes + (code if codes > 1 else 0)] * move_slots
            limits = place if len(usable) > 1 else 0
            own = bits[environment, module, 0]
            mask[environment, module, 0] = 1
            for slot in range(move_slots):
                move = first + slot
                legal = usable[limits, slot] != 0
                if simple:
                    legal &= own & care[move, 0] == want[move, 0]
                else:
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
    reach, module_at, last_notes = places.reach, state.module, state.notes
    shift, first, around = places.shift, places.first, places.around
    note_length = last_notes.shape[2]
    for environment in range(environments):
        heard = state.round[environment] > 0
        for module in range(modules):
            place = state.place[environment, module]
            for slot in range(reach.shape[1]):
                near = place_at(shift, first, around, reach, place, slot + 1)
                other = module_at[environment, near] if heard else -1
                for at in range(note_length):
                    notes[environment, module, slot, at] = (
                        last_notes[environment, other, at] if other >= 0 else SILENT
                    )
