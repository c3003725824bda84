"""From a choice to an attempt: what a module asks of the keepers under the free clock.

The wire and the environment in one process both use it, so a rule that holds in the one holds in
the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cubepath.agents.keepers.attempts import support_units
from cubepath.agents.local.observation import STAY, Note
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, to_json
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles


def attempt_of(
    system: System,
    tiles: Tiles,
    *,
    module: int,
    epoch: int,
    number: int,
    turn: int,
    site: Site,
    occupants: Mapping[Site, Site],
    notes: Mapping[Site, Note],
    register: Note,
    choice: Choice,
) -> Attempt | None:
    """Return the attempt that a choice makes, None if it changes nothing.

    `occupants` maps other places to the site that was seen on there, `notes` maps places to the
    registers that were seen there, `register` is the module's own, ``()`` while it is empty. An
    action that is not admissible where that was seen counts as stay. A note that repeats the
    register writes nothing, but holds the attempt to it. InputError if a guard is not sensed or has
    no move to guard, or if a register is out of reach, or is to be exchanged and nothing was heard
    from it.
    """
    place = system.place_of(site)
    move = _move(system, site, occupants, choice.action)
    if choice.guards and choice.action == STAY:
        raise InputError("guards without a move")
    registers = _registers(system, place, notes, register, choice)
    if move is None and all(new is None for _, new in registers.values()):
        return None
    if move is None:  # the fence is at the module's own place
        registers.setdefault(place, (register, None))
    units = {} if move is None else _units(system, tiles, occupants, move, choice.guards)
    return Attempt(
        module=module,
        epoch=epoch,
        number=number,
        turn=turn,
        site=to_json(site),
        generator=None if move is None else move.generator,
        at=None if move is None else to_json(move.at),
        sensed=[(to_json(unit), to_json(units[unit])) for unit in in_order(units)],
        notes=[
            (to_json(near), list(shown), None if new is None else list(new))
            for near in in_order(registers)
            for shown, new in (registers[near],)
        ],
    )


def _move(system: System, site: Site, occupants: Mapping[Site, Site], action: int) -> Move | None:
    moves = system.moves(site)
    move = moves[action - 1] if STAY < action <= len(moves) else None
    if move is None:
        return None
    near = (occupants.get(each) for each in system.sensed(system.place_of(site)))
    on = {site, *(each for each in near if each is not None)}
    return move if move.possible(on | (system.filled & move.action.support)) else None


def _registers(
    system: System, place: Site, notes: Mapping[Site, Note], register: Note, choice: Choice
) -> dict[Site, tuple[Note, Note | None]]:
    """Return what must be in registers, and what is to be there, None if it must only hold."""
    near = {place, *system.reach(place)}
    found: dict[Site, tuple[Note, Note | None]] = {}
    for each in choice.heeds:
        if each not in near:
            raise InputError(f"heeds the register at {each!r}, which is out of reach")
        found[each] = register if each == place else notes.get(each, ()), None
    for each, new in choice.exchanges.items():
        if each == place or each not in near:
            raise InputError(f"exchanges with {each!r}, expected another place within reach")
        if not notes.get(each):
            raise InputError(f"exchanges with {each!r}, from where nothing was heard")
        found[each] = notes[each], tuple(new)
    if choice.note is not None:
        found[place] = register, None if tuple(choice.note) == register else tuple(choice.note)
    return found


def _units(
    system: System, tiles: Tiles, occupants: Mapping[Site, Site], move: Move, guards: Iterable[Site]
) -> dict[Site, Site | None]:
    """Return what was sensed on the units of a move and of its guards."""
    place = system.place_of(move.source)
    reads, writes = support_units(system, tiles, move)
    units = {*reads, *writes}
    sensed = {place, *system.sensed(place)}
    for guard in guards:
        if guard not in sensed:
            raise InputError(f"guards {guard!r}, which is not sensed from {place!r}")
        if not system.has_place(guard):
            continue  # it never changes, so no keeper has it
        if system.letters:
            shown = occupants.get(guard)
            units |= {(guard, letter) for letter in system.letters} if shown is None else {shown}
        else:
            units.add(guard)
    found: dict[Site, Site | None] = {}
    for unit in units:
        at = unit if system.labels is not None else system.place_of(unit)
        on = move.source if at == place else occupants.get(at)
        found[unit] = on if system.labels is not None or on == unit else None
    return found
