"""A round of all environments of a batch, in compiled code: claims, moves, observations.

The same as a round of the plain world, which is the reference: tests hold the two together step by
step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.kinds import ANY, OWN
from cubepath.agents.arrays.observing import guards_hold, hear_all, observe_all
from cubepath.agents.arrays.settling import settle
from cubepath.agents.arrays.state import (
    GRANTED,
    ILLEGAL,
    LOST,
    STAYED,
    Observed,
    Scratch,
    State,
)
from cubepath.agents.arrays.tables import Goals, Ints, Kinds, Places, Stands
from cubepath.protocol.compiled import compiled, inner


@inner
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
            count += 1
    return count


@inner
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
    prefixes: NDArray[np.uint8],
    lengths: NDArray[np.int64],
    live: NDArray[np.uint8],
    scratch_arrays: Any,
    outcomes: NDArray[np.int8],
    observed_arrays: Any,
    only_observe: bool,  # noqa: FBT001 - compiled functions are called with positions
) -> bool:
    """Play one round in every live environment; return whether a module came to a new stand.

    If none did, what all modules observe is written too; with `only_observe` nothing else. The
    probes must be those of the present state. `prefixes` are the seeds as text, with a slash, of
    which `lengths` bytes count. The tuples come as plain ones: those take a third of the time to be
    handed over.
    """
    places, stands, kinds = Places(*place_arrays), Stands(*stand_arrays), Kinds(*kind_arrays)
    state, scratch = State(*state_arrays), Scratch(*scratch_arrays)
    fresh = False
    for environment in range(0 if only_observe else len(actions)):
        if not live[environment]:
            for module in range(actions.shape[1]):
                outcomes[environment, module] = STAYED
            continue
        state.round[environment] += 1
        count = claim_all(stands, kinds, codes, state, environment, actions, scratch, outcomes)
        length = lengths[environment]
        for at in range(length):
            scratch.text[at] = prefixes[environment, at]
        settle(places, kinds, state, environment, count, length, scratch)
        if execute_all(places, stands, kinds, codes, state, environment, count, scratch, outcomes):
            fresh = True
    if not fresh:
        observed = Observed(*observed_arrays)
        goals = Goals(*goal_arrays)
        observe_all(places, goals, knower, stands, kinds, codes, state, observed)
        if state.said.shape[2] > 0:
            hear_all(places, state, observed.notes)
    return fresh
