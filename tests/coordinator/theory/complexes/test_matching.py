"""Which actions a state shows by masks, against the definition on sets."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.theory.complexes.state_masks import (
    Bits,
    admissible_at,
    hash_of,
    modules_of,
    placing,
    proposals_of,
    row_of,
    turn,
)
from cubepath.protocol.core.actions import apply, end_at
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.plain_steps import COMPILED, plain_steps
from samples.listed_scenes import listed_scenes

SPECS = ["hex:n=5,base=1", "sliding:p=2,q=2,n=3", "agv-labelled:graph=K4,n=2", "arms", "assembly"]


def met(scene: Scene) -> Bits:
    """Return the bits of a scene, with the moves of all sites that its start's moves mention."""
    bits = Bits(scene)
    for _ in range(2):
        for bit in range(len(bits.sites)):
            if bit not in bits.met:
                bits.meet(bit)
    return bits


def check(bits: Bits, mask: int) -> None:
    """Compare everything that is said of one state with what sets say."""
    known = placing(bits)
    row = row_of(mask, bits.words)
    on, others = np.zeros((2, 64 * bits.words), dtype=np.int32)
    with plain_steps(COMPILED):
        modules = on[: modules_of(row, on)]
        assert modules.tolist() == [bit for bit in range(mask.bit_length()) if mask >> bit & 1]
        room = np.zeros((proposals_of(known, modules), 2), dtype=np.int32)
        found = room[: admissible_at(known, row, modules, room)]
        state = bits.decode(row)
        expected = {
            (action, end)
            for bit in modules.tolist()
            for action, end in bits.movers[bit]
            if end_at(bits.actions[action], state) == end
        }
        assert found.tolist() == [list(pair) for pair in sorted(expected)]
        after = np.zeros_like(row)
        for action, _ in found.tolist():
            turn(known, row, action, after)
            assert bits.decode(after) == apply(bits.actions[action], state)
            here = hash_of(known, modules) ^ known.turn_keys[action]
            further = others[: modules_of(after, others)]
            assert hash_of(known, further) == here


known = lru_cache(maxsize=None)(lambda spec: met(scene_from_spec(spec)))


@pytest.mark.slow
@given(st.sampled_from(SPECS), st.data())
def test_a_state_shows_by_masks_what_it_shows_by_sets(spec: str, data: st.DataObject) -> None:
    """What may be done, what it leads to and its hash: round an action, some sites on besides."""
    bits = known(spec)
    action = data.draw(st.integers(0, len(bits.actions) - 1))
    end = int.from_bytes(bits.masks()[action, 3 + data.draw(st.integers(0, 1))].tobytes(), "little")
    more = data.draw(st.lists(st.integers(0, len(bits.sites) - 1), max_size=6))
    check(bits, end | sum(1 << bit for bit in set(more) if not end >> bit & 1))


@pytest.mark.slow
@given(listed_scenes(), st.data())
def test_so_it_does_for_any_listed_system(scene: Scene, data: st.DataObject) -> None:
    """With free sites, guards, obstacles and doubled actions, at any state of their sites."""
    bits = met(scene)
    check(bits, data.draw(st.integers(0, 2 ** len(bits.sites) - 1)))
