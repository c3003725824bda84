"""The lockstep world in one process: where modules are, what each observes, one round.

It holds the state that is distributed over the modules on the wire; each module sees only what
`observe` looks up for it. The functions that `ModuleCore` uses decide what a module claims, which
claims outrank it, whether it is granted, and where the module then stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from cubepath.agents.local.arbitration import contest, site_after, verdict
from cubepath.agents.local.module import LastNote
from cubepath.agents.local.observation import (
    STAY,
    Mask,
    Note,
    Observation,
    chosen_move,
    goal_sets,
    observe,
)
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


@dataclass(frozen=True, slots=True)
class Round:
    """What a round did: the executed moves by module in increasing order, and the lost claims."""

    number: int
    moves: Mapping[int, Move]
    lost: tuple[int, ...]


class World:
    """All modules of a scene, stepped in lockstep; round numbers count from 1."""

    def __init__(self, scene: Scene, *, seed: int, note_length: int = 0) -> None:
        """Put every module at its start."""
        self.scene = scene
        self.note_length = note_length
        self._goals = goal_sets(scene)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        self.seed = seed
        self.put(self.scene.start, 0, [(0,) * self.note_length] * len(self.scene.start))

    def put(self, sites: Sequence[Site], round_number: int, notes: Sequence[Note]) -> None:
        """Put every module at its site after a round, with its last note."""
        self.round = round_number
        self.sites: list[Site] = list(sites)
        self._occupants: dict[Site, Site] = {self.scene.system.place_of(s): s for s in sites}
        self._module_at = {site: number for number, site in enumerate(sites)}
        self._masks: dict[int, Mask] = {}
        self._last_notes = [LastNote(tuple(numbers), first_choice=1) for numbers in notes]
        self._notes: dict[Site, Note] = {}
        self._speak({})

    def close(self) -> None:
        """Do nothing: there is no connection to close."""

    def observe(self, module: int) -> Observation:
        """Return the observation of one module."""
        seen = observe(
            self.scene.system,
            self.sites[module],
            self._occupants,
            goals=self._goals[module],
            notes=self._notes,
            note_length=self.note_length,
        )
        # A copy: the receiver of the mask may write into it.
        self._masks[module] = seen["action_mask"].tobytes()
        return seen

    def step(self, actions: Mapping[int, int], notes: Mapping[int, Note] | None = None) -> Round:
        """Settle the claims that the actions make, and execute the granted ones.

        An action that is not in the module's mask makes no claim. The last note of a module is
        heard in the next round, from the place where it then stands.
        """
        self.round += 1
        claims = self._claims(actions)
        verdicts = _verdicts(claims, seed=self.seed, round_number=self.round)
        executed = {module: move for module, move in claims.items() if verdicts[module]}
        for move in executed.values():
            self._execute(move)
        self._masks.clear()
        self._speak(notes or {})
        lost = tuple(module for module in claims if not verdicts[module])
        return Round(self.round, executed, lost)

    def _claims(self, actions: Mapping[int, int]) -> dict[int, Move]:
        """Return the moves that the actions claim, by module in increasing order."""
        found: dict[int, Move] = {}
        for module in sorted(actions):
            action = actions[module]
            if action == STAY:
                continue
            if module not in self._masks:
                self.observe(module)
            move = chosen_move(self.scene.system, self.sites[module], self._masks[module], action)
            if move is not None:
                found[module] = move
        return found

    def _execute(self, move: Move) -> None:
        place_of = self.scene.system.place_of
        movers = [self._module_at.pop(source) for source, _ in move.motion]
        for module in movers:
            del self._occupants[place_of(self.sites[module])]
        for module in movers:
            site = self.sites[module] = site_after(self.sites[module], (move,))
            self._module_at[site] = module
            self._occupants[place_of(site)] = site

    def spoken(self) -> list[Note]:
        """Return the last note of each module, by number; zeros where a rule has sent none."""
        return [last.numbers for last in self._last_notes]

    def _speak(self, notes: Mapping[int, Note]) -> None:
        """Set the notes that are heard in the next round, from where modules stand now."""
        if not self.note_length:
            return
        for module, note in notes.items():
            self._last_notes[module] = self._last_notes[module].replaced_by(note)
        place_of = self.scene.system.place_of
        heard = (
            (place_of(site), last.sent_in(self.round + 1))
            for site, last in zip(self.sites, self._last_notes, strict=True)
        )
        self._notes = {place: numbers for place, numbers in heard if numbers is not None}


def _verdicts(claims: Mapping[int, Move], *, seed: int, round_number: int) -> dict[int, bool]:
    """Return the verdict on every claim, by module.

    Claims that conflict share a site, so each module hears only the claims that share a site with
    its own: the cost is that of the neighbourhoods. Each module is asked for its verdict at first,
    and again when a module before it has given its own, as on the wire.
    """
    over: dict[Site, list[int]] = {}
    for module, move in claims.items():
        for site in move.action.support:
            over.setdefault(site, []).append(module)
    contests = {}
    for module, move in claims.items():
        near = set(chain.from_iterable([over[site] for site in move.action.support]))
        heard = {other: claims[other] for other in near if other != module}
        contests[module] = contest(module, move, heard, seed=seed, round_number=round_number)
    verdicts: dict[int, bool] = {}
    asked = list(contests)
    while asked:
        module = asked.pop()
        granted = None if module in verdicts else verdict(contests[module].before, verdicts)
        if granted is not None:
            verdicts[module] = granted
            asked += contests[module].after
    if len(verdicts) < len(claims):
        raise AssertionError(f"no verdict on the claims of {sorted(claims.keys() - verdicts)}")
    return verdicts
