"""The world without rounds in one process: one keeper, and what each module sees of it.

The keeper decides every attempt immediately, with the code that keepers run on the wire. What a
module sees may be out of date, as on the wire; the keeper compares it with the present state.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.local.observation import Note, Observation, chosen_move, goal_sets, observe
from cubepath.agents.rules.actor import attempt_of
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire import free_messages
from cubepath.protocol.wire.keys import Tiles

_LAG = 2
"""What a stream of random numbers is for, beside those of `actor`."""


@dataclass(frozen=True, slots=True)
class ActionResult:
    """What a module's turn came to: nothing asked (`asked` is False), refused, or committed."""

    module: int
    choice: Choice
    asked: bool = False
    illegal: bool = False
    moved: free_messages.Commit | None = None
    move: Move | None = None
    """The move that was committed, if it was one."""
    why: str = ""
    """Why the attempt was refused."""


@dataclass(slots=True)
class _Seen:
    """What a module was shown at its last turn."""

    site: Site
    occupants: Mapping[Site, Site]
    notes: Mapping[Site, Note]
    register: Note
    observation: Observation


@dataclass(slots=True)
class _Past:
    """What something was, after which commit, as far back as anybody may still see it."""

    commits: list[int]
    values: list[tuple[Site | None, Note]]

    def at(self, commit: int) -> tuple[Site | None, Note]:
        """Return what it was after that many commits."""
        for number in range(len(self.commits) - 1, 0, -1):
            if self.commits[number] <= commit:
                return self.values[number]
        return self.values[0]

    def add(self, commit: int, value: tuple[Site | None, Note], *, since: int) -> None:
        """Add what it is from now on, and forget what was over before the commit `since`."""
        self.commits.append(commit)
        self.values.append(value)
        while len(self.commits) > 1 and self.commits[1] <= since:
            del self.commits[0], self.values[0]


@dataclass(slots=True)
class _Module:
    """What a process on the wire knows of its module."""

    epoch: int = 0
    incarnation: int = 0
    number: int = 0
    turn: int = 0
    seen: _Seen | None = None
    register: _Past = field(default_factory=lambda: _Past([0], [(None, ())]))
    known: int = 0
    """As of which commit it knows its own register."""


class FreeWorld:
    """All modules of a scene around one keeper; each acts by itself.

    With a `lag` a module is shown each place as it was up to this many commits ago, drawn anew for
    each place and turn, but never as it was before what it was shown there earlier. Its own site is
    up to date, and its own register may be out of date too.
    """

    def __init__(self, scene: Scene, *, seed: int, note_length: int = 0, lag: int = 0) -> None:
        """Put every module at its start."""
        self.scene = scene
        self.note_length = note_length
        self.lag = lag
        self._goals = goal_sets(scene)
        self._tiles = Tiles(scene.system, 1)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Put every module back at its start; the seed decides what is shown late."""
        self.seed = seed
        self.commits = 0
        self.turns = 0
        self._random = np.random.default_rng([seed, _LAG])
        self.keeper = Keeper(0, self.scene, self._tiles, MemoryJournal())
        self.sites: list[Site] = list(self.scene.start)
        self.registers: list[Note] = [()] * len(self.sites)
        place_of = self.scene.system.place_of
        self._occupants: dict[Site, Site] = {place_of(site): site for site in self.sites}
        self._notes: dict[Site, Note] = {}
        self._past: dict[Site, _Past] = {}
        self._shown: dict[tuple[int, Site], int] = {}
        """As of which commit a module was shown a place."""
        self._modules = [_Module() for _ in self.sites]

    def restart(self, module: int) -> None:
        """Let the process of a module die and come back: what it knew is lost, its place holds."""
        known = self._modules[module]
        self.keeper.ask(0, free_messages.EnterRequest(module, known.incarnation + 1))
        for message in self.keeper.outgoing():
            for part in message.parts if isinstance(message, free_messages.Replies) else ():
                if isinstance(part, free_messages.Entered):
                    known.incarnation, known.epoch = part.incarnation, part.occupant.epoch
        known.number = known.turn = 0
        known.seen = None
        known.known = self.commits

    def look(self, module: int) -> Observation:
        """Begin a turn of a module: return what it is shown now."""
        self._look(module)
        return self.observation(module)

    def _look(self, module: int) -> _Seen:
        known = self._modules[module]
        if self.lag:
            occupants, notes = self._shown_to(module)
            known.known = max(known.known, self.commits - int(self._random.integers(self.lag + 1)))
            register = known.register.at(known.known)[1]
        else:
            occupants, notes = self._occupants, self._notes
            register = self.registers[module]
        site = self.sites[module]
        observation = observe(
            self.scene.system,
            site,
            occupants,
            goals=self._goals[module],
            notes=notes,
            note_length=self.note_length,
            register=register,
        )
        if not self.lag:
            near = self._near(module)
            occupants = {place: occupants[place] for place in near if place in occupants}
            notes = {place: notes[place] for place in near if place in notes}
        known.seen = _Seen(site, occupants, notes, register, observation)
        return known.seen

    def observation(self, module: int) -> Observation:
        """Return what a module was shown at its last turn; before the first one, the start."""
        seen = self._modules[module].seen or self._look(module)
        return {key: array.copy() for key, array in seen.observation.items()}

    def _near(self, module: int) -> list[Site]:
        system = self.scene.system
        place = system.place_of(self.sites[module])
        sensed = (near for near in system.sensed(place) if near is not None)
        return list(dict.fromkeys((*sensed, *system.reach(place))))

    def _shown_to(self, module: int) -> tuple[dict[Site, Site], dict[Site, Note]]:
        near = self._near(module)
        ages: list[int] = self._random.integers(self.lag + 1, size=len(near)).tolist()
        occupants: dict[Site, Site] = {}
        notes: dict[Site, Note] = {}
        for place, age in zip(near, ages, strict=True):
            as_of = max(self._shown.get((module, place), 0), self.commits - age)
            self._shown[module, place] = as_of
            past = self._past.get(place)
            if past is None:
                site, note = self._occupants.get(place), self._notes.get(place, ())
            else:
                site, note = past.at(as_of)
            if site is not None:
                occupants[place] = site
            if note:
                notes[place] = note
        return occupants, notes

    def act(self, module: int, choice: Choice) -> ActionResult:
        """Make the attempt of a choice, on what the module was shown when its turn began."""
        self.turns += 1
        known = self._modules[module]
        seen = known.seen or self._look(module)
        known.turn += 1
        system = self.scene.system
        mask = seen.observation["action_mask"].tolist()
        move = chosen_move(system, seen.site, mask, choice.action)
        illegal = bool(choice.action) and move is None
        attempt = attempt_of(
            system,
            self._tiles,
            module=module,
            epoch=known.epoch,
            number=known.number + 1,
            turn=known.turn,
            site=seen.site,
            occupants=seen.occupants,
            notes=seen.notes,
            register=seen.register,
            choice=choice,
        )
        if attempt is None:
            return ActionResult(module, choice, illegal=illegal)
        known.number += 1
        decision = self._ask(attempt)
        moved = decision.commit
        if moved is None:
            return ActionResult(module, choice, asked=True, illegal=illegal, why=decision.reason)
        self._committed(module, moved)
        return ActionResult(module, choice, asked=True, illegal=illegal, moved=moved, move=move)

    def _ask(self, attempt: free_messages.Attempt) -> free_messages.Decision:
        self.keeper.ask(0, attempt)
        decision: free_messages.Decision | None = None
        for message in self.keeper.outgoing():
            if isinstance(message, free_messages.Replies):
                decision = next(
                    part for part in message.parts if isinstance(part, free_messages.Decision)
                )
            elif isinstance(message, free_messages.TileUpdate):
                for part in message.parts:
                    site = part.site
                    self._change(part.place, site, tuple(part.note))
        if decision is None:  # one keeper alone waits for nobody
            raise AssertionError(f"no answer to {attempt}")
        return decision

    def _change(self, place: Site, site: Site | None, note: Note) -> None:
        """Note what is shown of a place from now on."""
        if self.lag:
            old = self._occupants.get(place), self._notes.get(place, ())
            past = self._past.setdefault(place, _Past([0], [old]))
            past.add(self.commits + 1, (site, note), since=self.commits - self.lag)
        self._occupants.pop(place, None)
        self._notes.pop(place, None)
        if site is not None:
            self._occupants[place] = site
        if note:
            self._notes[place] = note

    def _committed(self, module: int, moved: free_messages.Commit) -> None:
        self.commits += 1
        for who, _, to, _ in moved.motion:
            self.sites[who] = to
        for _, who, _, note in moved.notes:
            if note is not None:
                self.registers[who] = tuple(note)
                past = self._modules[who].register
                past.add(self.commits, (None, tuple(note)), since=self.commits - self.lag - 1)
        self._modules[module].known = self.commits
