"""What a choice asks of the keepers: what it was decided on, what it writes, and what it cannot."""

from collections.abc import Mapping

import pytest

from cubepath.agents.keepers.attempts import planned
from cubepath.agents.local.observation import Note
from cubepath.agents.rules.actor import attempt_of
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles
from samples.local_families import LOCAL_FAMILIES

PATH = GraphSystem(range(4), [(0, 1), (1, 2), (2, 3)])


def asked(
    choice: Choice,
    *,
    system: System = PATH,
    site: Site = 1,
    occupants: Mapping[Site, Site] | None = None,
    notes: Mapping[Site, Note] | None = None,
    register: Note = (),
) -> Attempt | None:
    """Return the attempt of module 3, which stands on a path from 0 to 3."""
    return attempt_of(
        system,
        Tiles(system, 2),
        module=3,
        epoch=1,
        number=7,
        turn=9,
        site=site,
        occupants=occupants or {},
        notes=notes or {},
        register=register,
        choice=choice,
    )


def to(target: Site) -> int:
    """Return the action that goes from 1 to `target`."""
    (found,) = [
        slot
        for slot, move in enumerate(PATH.moves(1), 1)
        if move is not None and move.target == target
    ]
    return found


def test_a_move_says_what_was_sensed_of_its_support() -> None:
    """Its own place among it, though `occupants` need not have that."""
    assert asked(Choice(to(2))) == Attempt(
        3, 1, 7, 9, 1, generator="edge", at=(1, 2), sensed=[(1, 1), (2, None)]
    )


def test_guards_are_sensed_beside_the_support() -> None:
    """Free or not, each in canonical order."""
    found = asked(Choice(to(2), guards=(0,)), occupants={0: 0})
    assert found is not None
    assert found.sensed == [(0, 0), (1, 1), (2, None)]


def test_what_changes_nothing_is_no_attempt() -> None:
    """To stay, to say the same again, to go where somebody was seen, to do what cannot be."""
    assert asked(Choice()) is None
    assert asked(Choice(note=(4,)), register=(4,)) is None
    assert asked(Choice(heeds=(2,)), notes={2: (5,)}) is None
    assert asked(Choice(to(2)), occupants={2: 2}) is None
    assert asked(Choice(99)) is None
    assert asked(Choice(-1)) is None


def test_an_illegal_action_counts_as_stay_and_the_note_is_said() -> None:
    """As in rounds."""
    found = asked(Choice(99, (5,)), register=(4,))
    assert found is not None
    assert (found.generator, found.sensed, found.notes) == (None, [], [(1, [4], [5])])


def test_registers_are_compared_with_what_was_heard() -> None:
    """Those that are heeded hold, those that are exchanged are written, and so is the own one."""
    found = asked(
        Choice(note=(8,), heeds=(0, 3), exchanges={2: (9,)}),
        notes={2: (5,), 3: (6,)},
        register=(4,),
    )
    assert found is not None
    assert found.notes == [(0, [], None), (1, [4], [8]), (2, [5], [9]), (3, [6], None)]


def test_an_exchange_alone_holds_the_own_register() -> None:
    """The fence is at the module's own place, so the attempt goes there in any case."""
    for note in (None, (4,)):
        found = asked(Choice(note=note, exchanges={2: (9,)}), notes={2: (5,)}, register=(4,))
        assert found is not None
        assert found.notes == [(1, [4], None), (2, [5], [9])]


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (Choice(guards=(0,)), "guards without a move"),
        (Choice(to(2), guards=(3,)), "guards 3, which is not sensed from 1"),
        (Choice(to(2), heeds=(7,)), "heeds the register at 7, which is out of reach"),
        (Choice(exchanges={1: (2,)}), "exchanges with 1, expected another place within reach"),
        (Choice(exchanges={7: (2,)}), "exchanges with 7, expected another place within reach"),
        (Choice(exchanges={2: (2,)}), "exchanges with 2, from where nothing was heard"),
    ],
)
def test_what_cannot_be_asked_is_one_line(choice: Choice, message: str) -> None:
    """A content must not be written where there may be nobody to have it."""
    with pytest.raises(InputError, match=message):
        asked(choice)


@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_every_legal_move_is_an_attempt_that_keepers_take(spec: str) -> None:
    """In every system: from the start, with all that can be guarded as a guard."""
    scene = scene_from_spec(spec)
    system = scene.system
    tiles = Tiles(system, 3)
    on = {system.place_of(site): site for site in scene.start}
    attempts = 0
    for site in scene.start:
        sensed = tuple(near for near in system.sensed(system.place_of(site)) if near is not None)
        for action in range(1, system.move_slots + 1):
            found = asked(Choice(action, guards=sensed), system=system, site=site, occupants=on)
            if found is not None:
                attempts += 1
                plan = planned(system, tiles, found)
                guarded = [unit for share in plan.shares.values() for unit in share.guards]
                read = [unit for share in plan.shares.values() for unit in share.reads]
                assert not {*guarded} & {*read}
                assert plan.move is not None
    assert attempts
