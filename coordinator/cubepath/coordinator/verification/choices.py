"""What a rule had to choose from: the observation of a module, derived from a recording.

Part of `cubepath verify`. States, sites and notes are those that verification derives or reads;
with a run it shares the catalogue and the neighbourhoods of the system (`sensed`, `reach`, `moves`,
and how sites are encoded). It asks no rule: code that has rules implements `RoundPlayer`.
"""

from collections.abc import Callable, Mapping, Set as AbstractSet
from functools import lru_cache, partial
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.verification.rounds import NOTE_MIN, is_admissible, is_note
from cubepath.coordinator.verification.transcript import RecordedRound, Transcript
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, FILLED, Scene, System
from cubepath.protocol.wire.messages import Note

Arrays: TypeAlias = dict[str, NDArray[np.int32] | NDArray[np.int8]]
"""A PettingZoo observation by its keys: "observation", "action_mask", and "notes" if any."""
_NOTHING_HEARD = NOTE_MIN - 1
_KEPT = 2048


class Moment(NamedTuple):
    """A round at the time of its claims, as derived, with the messages sent in it."""

    round: int
    sites: tuple[Site, ...]
    """Where each module stands."""
    state: frozenset[Site]
    """What is on, occupied obstacles included."""
    recorded: RecordedRound


class RoundPlayer(Protocol):
    """Asks the rules of a run again, round by round from the first on."""

    def round(self, moment: Moment, transcript: Transcript, fail: Callable[[str], None]) -> None:
        """Ask the rules in a round, and call `fail` with one line for each other choice."""

    def end(self, moment: Moment, transcript: Transcript, fail: Callable[[str], None]) -> None:
        """Note that this round, if it was begun at all, was not completed."""

    def unchecked(self) -> str | None:
        """Return in one line what was not asked again, and why; None if all was."""


class Observing:
    """The observations of the modules of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._system = scene.system
        sets: dict[tuple[Site, ...], frozenset[Site]] = {}
        self._goals = [sets.setdefault(goals, frozenset(goals)) for goals in scene.goals]
        self._shown = lru_cache(maxsize=_KEPT)(partial(_shown_at, self._system))

    def observations(self, moment: Moment, note_length: int) -> list[Arrays]:
        """Return what each module observes, by number.

        A note counts only if it has `note_length` numbers, each an int32 other than the least.
        """
        there = self._there(moment, note_length)
        return [
            self._observation(module, site, *there, note_length)
            for module, site in enumerate(moment.sites)
        ]

    def observation(self, moment: Moment, module: int, note_length: int) -> Arrays:
        """Return what one module observes; notes as for `observations`."""
        there = self._there(moment, note_length)
        return self._observation(module, moment.sites[module], *there, note_length)

    def _there(
        self, moment: Moment, note_length: int
    ) -> tuple[tuple[Mapping[Site, Site], AbstractSet[Site]], Mapping[Site, list[int]]]:
        """Return what stands at places, what is on, and the notes sent, by place."""
        place_of = self._system.place_of
        standing = {place_of(site): site for site in moment.sites}
        notes: dict[Site, list[int]] = {}
        for message in moment.recorded.messages.values():
            if isinstance(message, Note) and is_note(message.note, note_length):
                notes[place_of(moment.sites[message.module])] = message.note
        return (standing, moment.state), notes

    def seen(
        self,
        module: int,
        site: Site,
        standing: Mapping[Site, Site],
        notes: Mapping[Site, list[int]],
        *,
        note_length: int,
        register: list[int],
    ) -> Arrays:
        """Return what a module observes without rounds, from what it was shown.

        `standing` has what is on at the places sensed and at its own, `notes` the registers within
        reach that are not empty; `register` is its own. What is no note of the rule is not heard.
        """
        goals = self._goals[module] if self._goals else frozenset[Site]()
        # Modules are shown much the same time and again.
        shown = self._shown(site, goals, tuple(standing.items()))
        found: Arrays = {key: each.copy() for key, each in shown.items()}
        if note_length:
            fitting = {at: note for at, note in notes.items() if is_note(note, note_length)}
            found["notes"] = self._heard(site, fitting, note_length)
            own = register if is_note(register, note_length) else [_NOTHING_HEARD] * note_length
            found["register"] = np.array(own, dtype=np.int32)
        return found

    def may_choose(
        self, module: int, site: Site, standing: Mapping[Site, Site], action: int
    ) -> bool:
        """Return whether a module may choose an action without rounds, as for `seen`."""
        goals = self._goals[module] if self._goals else frozenset[Site]()
        shown = self._shown(site, goals, tuple(standing.items()))
        return bool(shown["action_mask"][action])

    def _observation(
        self,
        module: int,
        site: Site,
        found_there: tuple[Mapping[Site, Site], AbstractSet[Site]],
        notes: Mapping[Site, list[int]],
        note_length: int,
    ) -> Arrays:
        goals = self._goals[module] if self._goals else frozenset[Site]()
        found = _without_notes(self._system, site, goals, *found_there)
        if note_length:
            found["notes"] = self._heard(site, notes, note_length)
        return found

    def _heard(
        self, site: Site, notes: Mapping[Site, list[int]], note_length: int
    ) -> NDArray[np.int32]:
        system = self._system
        silence = [_NOTHING_HEARD] * note_length
        heard = [notes.get(near, silence) for near in system.reach(system.place_of(site))]
        heard += [silence] * (system.reach_slots - len(heard))
        return np.array(heard, dtype=np.int32)


def _shown_at(
    system: System, site: Site, goals: frozenset[Site], items: tuple[tuple[Site, Site], ...]
) -> Arrays:
    standing = dict(items)
    state = frozenset(standing.values()) | system.filled
    return _without_notes(system, site, goals, standing, state)


def _without_notes(
    system: System,
    site: Site,
    goals: frozenset[Site],
    standing: Mapping[Site, Site],
    state: AbstractSet[Site],
) -> Arrays:
    place = system.place_of(site)
    shown = [*system.encode_site(site), int(not goals.isdisjoint((site, place)))]
    for near in system.sensed(place):
        if near is None:
            shown += [CLOSED, 0]
            continue
        there = standing.get(near)
        code = system.background(near) if there is None else system.code_of(there)
        if there is None and code == FILLED:
            there = near
        wanted = near in goals or (there is not None and there in goals)
        shown += [code, int(wanted)]
    mask = [1, *(int(_is_possible(move, state)) for move in system.moves(site))]
    return {
        "observation": np.array(shown, dtype=np.int32),
        "action_mask": np.array(mask, dtype=np.int8),
    }


def _is_possible(move: Move | None, state: AbstractSet[Site]) -> bool:
    return (
        move is not None
        and is_admissible(move.action, state)
        and all(source in state for source, _ in move.motion)
    )
