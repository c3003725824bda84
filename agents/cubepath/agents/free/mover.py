"""One module of a run without rounds, as a pure machine: what it senses in, requests out.

The module joins, senses, lets its rule choose, and attempts the chosen move; it continues when it
knows the result. It acts only through the PettingZoo observation, mask and action. The node calls
it when something that it senses may have changed, or when a timer is due.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Literal, TypeAlias

from msgspec.structs import replace

from cubepath.agents.free.config import OwnMove
from cubepath.agents.free.sensing import Sensing
from cubepath.agents.keepers.attempts import chain_of
from cubepath.agents.local.observation import observe
from cubepath.agents.local.random_streams import PACE, stream
from cubepath.agents.rules.actor import Actor, actors_for, attempt_of
from cubepath.agents.rules.rule import Choice, RuleType
from cubepath.protocol.core.errors import RuleError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    Decision,
    Entered,
    EnterRequest,
    Turn,
)
from cubepath.protocol.wire.keys import Tiles

AGAIN_S, AGAIN_S_MAX = 0.25, 4.0
"""After how long a module asks again what it was not answered, and how rarely at the least."""
REST_S, REST_S_MAX = 0.005, 1.0
"""How long a module rests after it chose to stay, and at most if it does so again and again."""
RETRY_S, RETRY_S_MAX = 0.002, 0.25
"""The same after it was refused, times a number below one that it draws."""
THINK_S = 0.01
"""What a module of speed 1 that is told to think takes to choose; others as many times longer."""

_SITES_MAX = 256
"""Sites whose surroundings a module keeps: most go to and fro."""

State: TypeAlias = Literal["entering", "resting", "thinking", "pending", "superseded"]
Ask: TypeAlias = tuple[int, Attempt | EnterRequest]
"""What is asked of which keeper."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a module thinks: this many times `THINK_S`, and longer by a share up to `jitter`.

    With a factor of 0 it does not think at all.
    """

    factor: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """What there is around a site, whatever is on."""

    site: Site
    place: Site
    near: frozenset[Site]
    needs: frozenset[str]
    shown: frozenset[str]
    """The tiles of which a module there must have been shown everything before it chooses."""


class Mover:
    """A module."""

    def __init__(
        self,
        scene: Scene,
        tiles: Tiles,
        rule: RuleType,
        module: int,
        *,
        incarnation: int,
        seed: int,
        hesitate: float = 0.0,
        pace: Pace = Pace(),
        own: Sequence[OwnMove] | None = None,
    ) -> None:
        """Begin outside: it does not know where it stands. `own` are its moves of a schedule."""
        self.module = module
        self.site: Site = scene.start[module]
        self.state: State = "entering"
        self.due_s = 0.0
        self.dirty = False
        """Whether anything that it senses may have changed since it chose last."""
        self.turns: list[Turn] = []
        """What its rule was asked since this was last taken."""
        self._scene = scene
        self._system = scene.system
        self._tiles = tiles
        self._rule = rule
        self._incarnation = incarnation
        self._seed = seed
        self._hesitate = hesitate
        self._pace = pace
        self._own = own
        self._done = 0
        self._again_s = AGAIN_S
        self._rest_s, self._retry_s = REST_S, RETRY_S
        self._epoch = self._number = self._turn = self._version = 0
        self.halted = False
        """Whether it begins nothing new."""
        self._actor: Actor | None = None
        self._attempt: Attempt | None = None
        self._random = stream(seed, module, PACE)
        self._goals = frozenset(scene.goals[module] if scene.goals else ())
        self._note_length = 0 if own is not None else rule.length(len(scene.start), "free")
        self._surroundings = lru_cache(maxsize=_SITES_MAX)(self._found_around)
        self._around = self._surroundings(self.site)

    @property
    def rests(self) -> bool:
        """Return whether it was told to halt, and no attempt of it is pending any more."""
        return self.halted and self.state == "resting"

    @property
    def around(self) -> Neighbourhood:
        """Return what there is around its site."""
        if self._around.site != self.site:
            self._around = self._surroundings(self.site)
        return self._around

    def _found_around(self, site: Site) -> Neighbourhood:
        system, tile_of = self._system, self._tiles.tile_of
        place = system.place_of(site)
        sensed = {near: None for near in system.sensed(place) if near is not None}
        near = dict.fromkeys([place, *sensed, *system.reach(place)])
        found = [each for each in near if system.has_place(each)]
        shown = found if self._note_length else [each for each in found if each in sensed]
        return Neighbourhood(
            site,
            place,
            frozenset(found),
            frozenset(map(tile_of, found)),
            frozenset(map(tile_of, shown)),
        )

    @property
    def near(self) -> frozenset[Site]:
        """Return its place, those that it senses, and those within its reach."""
        return self.around.near

    @property
    def needs(self) -> frozenset[str]:
        """Return the tiles of what it may sense, and of what it would sense one move away."""
        return self.around.needs

    # What keepers answer.

    def entered(self, answer: Entered, now_s: float) -> None:
        """Take its place again, in a new epoch."""
        occupant = answer.occupant
        if answer.incarnation != self._incarnation:
            return
        # Where it was shown before this answer came may be later than the answer.
        self.taken_to(answer.site, occupant.version)
        if self.state != "entering":
            return  # said again: an incarnation has one epoch
        self._epoch, self._number = occupant.epoch, occupant.number
        self._rests(now_s)
        if self._own is None:
            (self._actor,) = actors_for(
                self._scene,
                self._rule,
                seed=self._seed,
                hesitate=self._hesitate,
                modules=[self.module],
                sites={self.module: answer.site},
                clock="free",
            ).values()

    def taken_to(self, site: Site, version: int) -> None:
        """Note where keepers show it, unless something later is known."""
        if version > self._version:
            self.site, self._version = site, version

    def decided(self, decision: Decision, now_s: float) -> None:
        """Note the result of its attempt."""
        attempt = self._attempt if self.state == "pending" else None
        if attempt is None or (decision.epoch, decision.number) != (attempt.epoch, attempt.number):
            return
        if decision.reason.startswith("fenced"):
            # A later incarnation has taken its place. To enter again would fence that one off in
            # turn, under a number of incarnation that may be given to yet another.
            self.state, self.due_s = "superseded", inf  # so it is never due to ask again
            return
        self._attempt = None
        self._number = decision.number
        if decision.commit is None:
            self._retry_s = min(2 * self._retry_s, RETRY_S_MAX)
            self._rests(now_s + self._retry_s * self._random.fraction())
            return
        self._retry_s = RETRY_S
        self._executed(decision.commit)
        self._rests(now_s)

    def _executed(self, moved: Commit) -> None:
        for module, _, target, version in moved.motion:
            if module == self.module:
                self.taken_to(target, version)
        for _, module, version, _ in moved.notes:
            if module == self.module:
                self.taken_to(self.site, version)
        self._done += 1

    def _rests(self, due_s: float) -> None:
        self.state, self.due_s = "resting", due_s

    # What it does.

    def step(self, now_s: float, sensing: Sensing) -> list[Ask]:
        """Do what is to be done now; return what is asked of which keeper."""
        if self.state == "entering":
            return self._enter(now_s)
        if self._attempt is None:
            return self._choose(now_s, sensing)
        if self.state == "thinking":
            return self._thought(self._attempt, now_s, sensing)
        return [] if now_s < self.due_s else self._ask(self._attempt, now_s)

    def _enter(self, now_s: float) -> list[Ask]:
        if now_s < self.due_s:
            return []
        self._wait_for_answer(now_s)
        enter = EnterRequest(self.module, self._incarnation)
        return [(keeper, enter) for keeper in range(self._tiles.keepers)]

    def _wait_for_answer(self, now_s: float) -> None:
        self.due_s = now_s + self._again_s
        self._again_s = min(2 * self._again_s, AGAIN_S_MAX)

    def _thought(self, attempt: Attempt, now_s: float, sensing: Sensing) -> list[Ask]:
        if now_s < self.due_s and not self.halted:
            return []
        if self.halted or not self._still(attempt, sensing):
            self._attempt = None
            self._rests(now_s)
            return self._choose(now_s, sensing)
        return self._send(attempt, now_s)

    def _still(self, attempt: Attempt, sensing: Sensing) -> bool:
        """Return whether, as far as it can tell, what it sensed when it began to think holds."""
        return (
            attempt.site == self.site
            and all(self._shows(unit, sensing) == shown for unit, shown in attempt.sensed)
            and all(list(sensing.place(place).note) == note for place, note, _ in attempt.notes)
        )

    def _unit_place(self, unit: Site) -> Site:
        return unit if self._system.labels is not None else self._system.place_of(unit)

    def _shows(self, unit: Site, sensing: Sensing) -> Site | None:
        """Return the site that is on at a unit, as keepers have shown it."""
        on = sensing.place(self._unit_place(unit)).site
        return on if self._system.labels is not None or on == unit else None

    def _send(self, attempt: Attempt, now_s: float) -> list[Ask]:
        self.state = "pending"
        self._again_s = AGAIN_S
        return self._ask(attempt, now_s)

    def _ask(self, attempt: Attempt, now_s: float) -> list[Ask]:
        """Ask the first of its keepers, for the first time or again."""
        self._wait_for_answer(now_s)
        return [(chain_of(self._system, self._tiles, attempt)[0], attempt)]

    def _choose(self, now_s: float, sensing: Sensing) -> list[Ask]:
        """Let the rule choose, if it is due and everything that it senses is known."""
        if self.halted:
            self.dirty = True
            self.due_s = now_s + REST_S_MAX
            return []
        if now_s < self.due_s and not (self.dirty and self._retry_s <= RETRY_S):
            return []
        around = self.around
        here = sensing.place(around.place)
        known = here.module == self.module and here.module_version == self._version
        if not known or not sensing.has_whole(around.shown):
            self.due_s = now_s + AGAIN_S  # what it has just done, or what is near, is not shown yet
            return []
        self.dirty = False
        self._turn += 1
        attempt = self._own_attempt(sensing) if self._own is not None else self._asked(sensing)
        if attempt is None:
            self.due_s = now_s + self._rest_s
            self._rest_s = min(2 * self._rest_s, REST_S_MAX)
            return []
        self._rest_s = REST_S
        self._attempt = attempt
        return self._think(attempt, now_s)

    def _think(self, attempt: Attempt, now_s: float) -> list[Ask]:
        if not self._pace.factor:
            return self._send(attempt, now_s)
        longer = 1.0 + self._pace.jitter * self._random.fraction()
        self.state, self.due_s = "thinking", now_s + self._pace.factor * THINK_S * longer
        return []

    def _asked(self, sensing: Sensing) -> Attempt | None:
        """Ask the rule; return the attempt that follows from its choice."""
        system = self._system
        place = system.place_of(self.site)
        occupants: dict[Site, Site] = {}
        sensed = []
        slots = system.sensed(place)
        for near, known in zip(slots, sensing.places(slots), strict=True):
            sensed.append(-1 if near is None else known.version)
            if near is not None and known.site is not None:
                occupants[near] = known.site
        own = sensing.place(place)
        notes: dict[Site, tuple[int, ...]] = {}
        heard: list[tuple[int, int]] = []
        if self._note_length:
            reach = system.reach(place)
            for near, known in zip(reach, sensing.places(reach), strict=True):
                heard.append((known.version, known.module_version))
                if known.note:
                    notes[near] = known.note
        observation = observe(
            system,
            self.site,
            occupants,
            goals=self._goals,
            notes={near: note for near, note in notes.items() if self._is_note(note)},
            note_length=self._note_length,
            register=(own.note if self._is_note(own.note) else ()) if self._note_length else None,
        )
        actor = self._actor
        if actor is None:
            raise AssertionError(f"module_{self.module} acts before it has entered")
        try:
            choice = actor.act(observation)
        except RuleError as error:
            choice = Choice(failed=str(error))
        attempt = self._attempt_of(choice, occupants, notes, own.note)
        self._on_record(choice, sensed, heard, attempt)
        return attempt

    def _attempt_of(
        self,
        choice: Choice,
        occupants: Mapping[Site, Site],
        notes: Mapping[Site, tuple[int, ...]],
        register: tuple[int, ...],
    ) -> Attempt | None:
        return attempt_of(
            self._system,
            self._tiles,
            module=self.module,
            epoch=self._epoch,
            number=self._number + 1,
            turn=self._turn,
            site=self.site,
            occupants=occupants,
            notes=notes,
            register=register,
            choice=choice,
        )

    def _is_note(self, note: Sequence[int]) -> bool:
        """Return whether its rule can take a note; keepers hold whatever a process has written."""
        return len(note) == self._note_length

    def _on_record(
        self,
        choice: Choice,
        sensed: list[int],
        heard: list[tuple[int, int]],
        attempt: Attempt | None,
    ) -> None:
        self.turns.append(
            Turn(
                module=self.module,
                epoch=self._epoch,
                turn=self._turn,
                site=self.site,
                version=self._version,
                sensed=sensed,
                action=choice.action,
                received=heard,
                note=None if choice.note is None else list(choice.note),
                guards=list(choice.guards),
                heeds=list(choice.heeds),
                exchanges=[(at, list(note)) for at, note in choice.exchanges.items()],
                number=None if attempt is None else attempt.number,
                failed=choice.failed,
            )
        )

    def _own_attempt(self, sensing: Sensing) -> Attempt | None:
        """Return the next move of its schedule, if those that it depends on are done."""
        if self._own is None or self._done >= len(self._own):
            return None
        due = self._own[self._done]
        move = self._system.move_named(self.site, due.placed.generator, due.placed.at)
        if move is None or not self._ready(due, sensing):
            return None
        shown = {
            near: on
            for near in self._system.sensed(self._system.place_of(self.site))
            if near is not None and (on := sensing.place(near).site) is not None
        }
        choice = Choice(self._system.moves(self.site).index(move) + 1)
        attempt = self._attempt_of(choice, shown, {}, ())
        return None if attempt is None else replace(attempt, after=due.after)

    def _ready(self, due: OwnMove, sensing: Sensing) -> bool:
        return all(
            found == version and reads in (None, times)
            for unit, version, reads in due.after
            for found, times in [self._counts(unit, sensing)]
        )

    def _counts(self, unit: Site, sensing: Sensing) -> tuple[int, int]:
        """Return how often a unit was written, and how often that was read."""
        shown = sensing.place(self._unit_place(unit)).reads
        return {each: (version, reads) for each, version, reads in shown}.get(unit, (0, 0))
