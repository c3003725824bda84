"""Observations derived for `cubepath verify`, compared with those that modules make."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.local.observation import goal_sets, observe
from cubepath.coordinator.verification.choices import Moment, Observing
from cubepath.coordinator.verification.rounds import NOTE_MAX, NOTE_MIN, is_note
from cubepath.coordinator.verification.transcript import RecordedRound
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Note
from marked import some
from samples.local_families import LOCAL_FAMILIES


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize("spec", some(LOCAL_FAMILIES, [*LOCAL_FAMILIES[:4], "assembly"]))
@settings(max_examples=15)
@given(data=st.data())
def test_what_is_derived_is_what_modules_observe(spec: str, data: st.DataObject) -> None:
    """In every local system, after random moves, with and without notes: array by array."""
    scene = scene_from_spec(spec)
    system = scene.system
    sites = list(scene.start)
    state = set(scene.start_state)
    for _ in range(data.draw(st.integers(0, 6))):
        possible = [
            move for site in sites for move in system.moves(site) if move and move.possible(state)
        ]
        if not possible:
            break
        move = data.draw(st.sampled_from(possible))
        motion = dict(move.motion)
        sites = [motion.get(site, site) for site in sites]
        state = set(sites) | system.filled
    length = data.draw(st.integers(0, 3))
    numbers = st.lists(st.integers(NOTE_MIN, NOTE_MAX), min_size=length, max_size=length)
    notes: dict[Site, tuple[int, ...]] = {}
    said = RecordedRound()
    for module, site in enumerate(sites):
        if length and data.draw(st.booleans()):
            note = data.draw(numbers)
            notes[system.place_of(site)] = tuple(note)
            said.messages["note", module] = Note(1, module, None, note)
    moment = Moment(1, tuple(sites), frozenset(state), said)
    found = Observing(scene).observations(moment, length)
    occupants = {system.place_of(site): site for site in sites}
    for module, goals in enumerate(goal_sets(scene)):
        expected = observe(
            system, sites[module], occupants, goals=goals, notes=notes, note_length=length
        )
        assert found[module].keys() == expected.keys()
        for key, array in expected.items():
            assert found[module][key].dtype == array.dtype
            assert np.array_equal(found[module][key], array), (key, module)


def test_a_note_has_its_length_and_its_numbers_are_of_32_bits() -> None:
    """The least number of 32 bits stands for silence, and is no number of a note."""
    assert is_note([NOTE_MIN, 0, NOTE_MAX], 3)
    assert is_note([], 0)
    assert not is_note([0], 2)
    assert not is_note([NOTE_MIN - 1], 1)
    assert not is_note([NOTE_MAX + 1], 1)
