"""What one module sees: the PettingZoo observation, and a view read back from it.

`observe` looks only at the sensed places of one module. A `View` is made from that observation
alone, so a rule cannot see beyond its neighbourhood.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, FIRST_LABEL, KEPT, Scene, System

Note: TypeAlias = tuple[int, ...]
"""What a rule tells the modules within reach: a fixed number of integers."""
Array: TypeAlias = NDArray[np.int32] | NDArray[np.int8] | NDArray[np.float32]
"""An array of an observation. Floats are in relative ones alone, see `RelativeObserver`."""
Observation: TypeAlias = dict[str, Array]
"""The arrays that PettingZoo gives an agent; `observe` documents them and their shapes."""
Mask: TypeAlias = Sequence[int] | NDArray[np.int8]
"""Which actions are legal, 1 or 0 each: an `action_mask`, or its values as a list."""

STAY = 0
"""The action that is always legal; action ``i`` is the move in slot ``i - 1``."""
SILENT, _MOST = -(1 << 31), (1 << 31) - 1
"""Fills the note of a place within reach from which nothing was heard."""


def is_legal(mask: Mask, action: int) -> bool:
    """Return whether an action is in the action mask; any integer is allowed."""
    return 0 <= action < len(mask) and bool(mask[action])


def chosen_move(system: System, site: Site, mask: Mask, action: int) -> Move | None:
    """Return the move that a module at `site` claims by an action.

    None if it claims nothing: the action is to stay, or is not in the mask.
    """
    if action == STAY or not is_legal(mask, action):
        return None
    return system.moves(site)[action - 1]


def checked_note(note: Iterable[int], note_length: int) -> Note:
    """Return a note as integers; InputError if it does not have `note_length` valid numbers.

    A number of a note is an int32 greater than the least int32, which is `SILENT`.
    """
    numbers = tuple(map(int, note))
    if len(numbers) != note_length:
        raise InputError(f"a note of {len(numbers)} numbers, expected {note_length}")
    if numbers and not SILENT < min(numbers) <= max(numbers) <= _MOST:
        wrong = next(number for number in numbers if not SILENT < number <= _MOST)
        raise InputError(f"a note with {wrong}, expected more than {SILENT} and an int32")
    return numbers


def goal_sets(scene: Scene) -> tuple[frozenset[Site], ...]:
    """Return each module's goals, by number; modules with the same goals share one set.

    In a chain every module knows the whole goal: one set for each would take quadratic time.
    """
    distinct = {id(goals): goals for goals in scene.goals}
    shared = {key: frozenset(goals) for key, goals in distinct.items()}
    nothing: frozenset[Site] = frozenset()
    return tuple(shared[id(goals)] for goals in scene.goals) or (nothing,) * len(scene.start)


def observation_length(system: System) -> int:
    """Return the length of `observation`: the own site, its goal flag, and two entries per slot."""
    return system.site_size + 1 + 2 * system.sense_slots


def observe(
    system: System,
    site: Site,
    occupants: Mapping[Site, Site],
    *,
    goals: frozenset[Site],
    notes: Mapping[Site, Note] | None = None,
    note_length: int = 0,
    register: Note | None = None,
) -> Observation:
    """Return the PettingZoo observation of a module at `site`.

    `occupants` maps places to the site that is on there; only sensed places are looked up. The
    result holds

    - ``observation``, int32, shape ``(site_size + 1 + 2 * sense_slots,)``: the own site, 1 if it
      or its place is one of the module's `goals`, then for each sensed slot what it shows (0 free,
      1 module, 2 occupied obstacle, 3 no place, 4 + label or letter) and 1 if that place, or what
      is on there, is one of its goals;
    - ``action_mask``, int8, shape ``(move_slots + 1,)``: which actions are legal, stay first;
    - ``notes`` when `note_length` is positive, int32, shape ``(reach_slots, note_length)``:
      the note heard from each place within reach; `SILENT` if none was, and for unused slots;
    - ``register`` under the free clock, if it is given: int32, shape ``(note_length,)``, the
      module's own note, which others may exchange; `SILENT` if it is empty.

    >>> scene = scene_from_spec("hex:n=3")
    >>> standing = {site: site for site in scene.start}
    >>> seen = observe(scene.system, (0, 0), standing, goals=frozenset(scene.goals[0]))
    >>> seen["observation"].shape, seen["action_mask"].nonzero()[0].tolist()
    ((39,), [0, 7, 12])
    """
    place = system.place_of(site)
    memory = _memory_of(system)
    numbers, mask = memory.seen(site, tuple(map(occupants.get, memory.sensed(place))), goals)
    # Copies: the receiver may write into them.
    found: Observation = {"observation": numbers.copy(), "action_mask": mask.copy()}
    if note_length:
        heard = np.empty((system.reach_slots, note_length), dtype=np.int32)
        heard.fill(SILENT)  # in half the time of `np.full`
        if notes:
            for slot, near in enumerate(system.reach(place)):
                note = notes.get(near)
                if note is not None:
                    heard[slot] = note
        found["notes"] = heard
        if register is not None:
            found["register"] = np.array(register or (SILENT,) * note_length, np.int32)
    return found


class _Memory:
    """What modules of a system saw lately: most see the same for several rounds, as others do."""

    def __init__(self, system: System) -> None:
        self._system = system
        self.sensed = lru_cache(maxsize=KEPT)(self._sensed)
        self.seen = lru_cache(maxsize=_SEEN_MAX)(self._seen)
        self.read = lru_cache(maxsize=_SEEN_MAX)(self._read)

    def _sensed(self, place: Site) -> tuple[Site, ...]:
        """Return the sensed places, without empty slots."""
        return tuple(near for near in self._system.sensed(place) if near is not None)

    def _seen(
        self, site: Site, shown: tuple[Site | None, ...], goals: frozenset[Site]
    ) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
        """Return ``observation`` and ``action_mask``, given what is on at each sensed place."""
        system = self._system
        place = system.place_of(site)
        numbers = [*system.encode_site(site), int(place in goals or site in goals)]
        on: set[Site] = {site}
        occupants = iter(shown)
        for near in system.sensed(place):
            if near is None:
                numbers += (CLOSED, 0)
                continue
            occupant = next(occupants)
            code = system.background(near) if occupant is None else system.code_of(occupant)
            there = system.site_at(near, code)
            numbers += (code, int(near in goals or there in goals))
            if there is not None:
                on.add(there)
        mask = np.zeros(system.move_slots + 1, dtype=np.int8)
        mask[STAY] = 1
        for slot, move in enumerate(system.moves(site), 1):
            if move is not None and move.possible(on):
                mask[slot] = 1
        return np.array(numbers, dtype=np.int32), mask

    def _read(self, data: bytes, label: int | None) -> tuple[Site, Site, dict[Site, int]]:
        """Return site, place and what is sensed, given the bytes of ``observation``."""
        system = self._system
        numbers: Sequence[int] = np.frombuffer(data, dtype=np.int32).tolist()
        size = system.site_size
        site = system.decode_site(numbers[:size], label)
        place = system.place_of(site)
        occupied = {}
        for slot, near in enumerate(system.sensed(place)):
            code = numbers[size + 1 + 2 * slot]
            if near is not None and code not in (0, CLOSED):
                occupied[near] = code
        return site, place, occupied


_SEEN_MAX = 1 << 9
"""More than modules of one process see at a time: ten times as many gain nothing."""
_memory_of = lru_cache(maxsize=16)(_Memory)


@dataclass(frozen=True, slots=True)
class View:
    """An observation as a rule reads it: by places and moves instead of slots and codes.

    `system` is the static world, without modules; `site` and `place` are where the module is.
    """

    system: System
    site: Site
    place: Site
    occupied: Mapping[Site, int]
    """Sensed places with a module or an occupied obstacle, and the codes they show."""
    mask: NDArray[np.int8]
    """1 for each legal action, of shape (move_slots + 1,); action 0, to stay, always is."""
    moves: tuple[Move | None, ...]
    """The moves by slot, admissible or not; action ``i`` is ``moves[i - 1]``."""
    notes: Mapping[Site, Note]
    """The notes heard from places within reach."""
    numbers: NDArray[np.int32]
    """The array ``observation`` that all of this but mask and notes was read from."""
    register: Note | None = None
    """Under the free clock the module's own note, None if it is empty."""

    def legal(self) -> list[tuple[int, Move]]:
        """Return the admissible moves with their actions, in slot order."""
        return [
            (action, move)
            for action, move in enumerate(self.moves, 1)
            if move is not None and self.mask[action]
        ]

    def label_at(self, place: Site) -> int | None:
        """Return the label of the module sensed at `place`; None if there is none."""
        code = self.occupied.get(place, 0)
        return code - FIRST_LABEL if code >= FIRST_LABEL else None


def view_of(system: System, observation: Mapping[str, Array], label: int | None = None) -> View:
    """Read an observation back; `label` is the module's own in a labelled system."""
    numbers = observation["observation"].astype(np.int32, copy=False)
    site, place, occupied = _memory_of(system).read(numbers.tobytes(), label)
    notes: dict[Site, Note] = {}
    heard = observation.get("notes")
    if heard is not None:
        slots = (heard[:, 0] != SILENT).nonzero()[0]
        reach, lines = system.reach(place), heard[slots].tolist()
        notes = {reach[slot]: tuple(line) for slot, line in zip(slots.tolist(), lines, strict=True)}
    own = observation.get("register")
    mask = observation["action_mask"].astype(np.int8, copy=False)
    return View(
        system=system,
        site=site,
        place=place,
        occupied=occupied.copy(),  # a rule of someone else may write into it
        mask=mask,
        moves=system.moves(site),
        notes=notes,
        numbers=numbers,
        register=None if own is None or own[0] == SILENT else tuple(own.tolist()),
    )
