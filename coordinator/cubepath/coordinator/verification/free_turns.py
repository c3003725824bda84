"""What a rule was shown in each turn, and whether its attempt is what it chose.

Part of `cubepath verify`: a turn names the versions of what it was shown, and the history says what
was there. It asks no rule: code that has rules implements `FreePlayer`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from cubepath.coordinator.verification.choices import Arrays, Observing
from cubepath.coordinator.verification.findings import StageFailures
from cubepath.coordinator.verification.free_asked import AskedContent, ShownVersions
from cubepath.coordinator.verification.free_history import History
from cubepath.coordinator.verification.free_transcript import (
    FreeTranscript,
    attempt_text,
    turn_text,
)
from cubepath.coordinator.verification.free_units import NO_SITE, on_unit
from cubepath.coordinator.verification.number_table import Name
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.wire.free_messages import Register, Turn, Turns
from cubepath.protocol.wire.keys import Tiles

_NEVER = ShownVersions()


class TurnView(NamedTuple):
    """What a module was shown in a turn, as derived."""

    turn: Turn
    site: Site
    standing: Mapping[Site, Site]
    """What is on at the places sensed, and at its own."""
    notes: Mapping[Site, Register]
    """The registers at places within reach, if they are not empty."""
    register: Register
    fresh: bool
    """Whether its process has begun anew since its turn before."""
    entered: Site
    """Where it stood when that process took it up."""
    arrays: Callable[[int], Arrays]
    """The observation, for notes of a length."""


class FreePlayer(Protocol):
    """Asks the rules of a run without rounds again, for each module turn by turn."""

    def turn(self, seen: TurnView, fail: Callable[[str], None]) -> None:
        """Ask the rule in a turn, and call `fail` with one line for each other choice."""

    def end(self, fail: Callable[[str], None]) -> None:
        """Say what is wrong with the rule itself."""

    def unchecked(self) -> str | None:
        """Return in one line what was not asked again, and why; None if all was."""


@dataclass(slots=True)
class _Progress:
    """How far the turns of a module were checked."""

    due: Iterator[Name]
    next: Name | None
    """The next turn in the recording; those after it wait."""
    waiting: dict[Name, Turn] = field(default_factory=dict)
    before: Turn | None = None
    last: dict[Site, tuple[int, int]] = field(default_factory=dict)
    """What the process of the module was shown last of each place."""
    known: dict[Site, tuple[int, Site | None]] = field(default_factory=dict)
    """The last version of each place that was rightly shown to it, and what was on."""
    broken: bool = False
    """Whether it is not known what the module's rule was shown since it entered."""


class TurnsOfModules:
    """The turns of a run.

    Those of a module are checked in their order, as they stand in the recording unless one had to
    be repeated: then those behind it wait for it.
    """

    def __init__(
        self,
        history: History,
        transcript: FreeTranscript,
        tiles: Tiles,
        player: FreePlayer | None,
        fail: StageFailures,
    ) -> None:
        self._tiles = tiles
        self._history, self._transcript, self._fail = history, transcript, fail
        self._player = player
        self._system = history.system
        self._observing = Observing(history.scene)
        self._losses = transcript.losses
        self._answered = bytearray(len(transcript.attempts))
        self._progress: dict[int, _Progress] = {}

    def turns(self, message: Turns) -> None:
        """Take turns, and check those that are due."""
        for turn in message.parts:
            self._take(turn)

    def _take(self, turn: Turn) -> None:
        at = self._progress.get(turn.module)
        if at is None:
            due = self._transcript.turns.of(turn.module)
            at = self._progress[turn.module] = _Progress(due, next(due))
        name = turn.module, turn.epoch, turn.turn
        if at.next is None or name < at.next:
            return  # it comes again
        if name != at.next:
            at.waiting.setdefault(name, turn)
            return
        following: Turn | None = turn
        while following is not None:
            self._check(following, at)
            at.before, at.next = following, next(at.due, None)
            following = None if at.next is None else at.waiting.pop(at.next, None)

    def _check(self, turn: Turn, at: _Progress) -> None:
        self._fail.position = 0, turn.module, turn.epoch, turn.turn
        seen = self._seen(turn, at)
        if seen is not None:
            self._check_attempt(seen)
            self._play(seen, at)

    def _another_choice(self, why: str) -> None:
        self._fail("choices", why)

    def end(self) -> None:
        """Check that each attempt was chosen in a turn."""
        self._fail.position = (1,)
        if self._player is not None:
            self._player.end(self._another_choice)
        for name in self._transcript.attempts if self._transcript.turns else ():
            if not self._answered[self._transcript.attempts.place(name)]:
                self._lack(name[0], name[1], f"{attempt_text(name)} has no turn")

    def _play(self, seen: TurnView, at: _Progress) -> None:
        if self._player is None:
            return
        if at.broken:
            why = f"{turn_text(seen.turn)} comes after a gap"
            self._losses.lack(self._fail, "choices", why, excused=True)
        else:
            self._player.turn(seen, self._another_choice)

    def _lack(self, module: int, epoch: int, why: str) -> None:
        """Note messages of a module's process that are not recorded."""
        excused = self._losses.of_module(module) or self._losses.before(module, epoch)
        self._losses.lack(self._fail, "turns", why, excused=excused)

    def _not_shown(self, turn: Turn, why: str, keepers: Iterable[int]) -> None:
        """Note messages of keepers to a module that are not recorded."""
        before = self._losses.before(turn.module, turn.epoch)
        excused = before or self._losses.of_keepers(keepers)
        self._losses.lack(self._fail, "turns", why, excused=excused)

    def _seen(self, turn: Turn, at: _Progress) -> TurnView | None:
        """Return what was shown in a turn, None if it cannot have been."""
        system = self._system
        fresh = self._follows(turn, at)
        standing = self._history.module(turn.module, turn.version)
        site = turn.site
        if standing is None or standing.site != site:
            where = f"at {turn.site!r} at version {turn.version}"
            self._fail("turns", f"{turn_text(turn)}: it does not stand {where}")
            return None
        place = system.place_of(site)
        near = system.sensed(place)
        reach = system.reach(place) if turn.received else ()
        if len(turn.sensed) != len(near) or len(turn.received) != len(reach):
            why = "it was shown other places than it senses"
            self._fail("turns", f"{turn_text(turn)}: {why}")
            return None
        on: dict[Site, Site] = {place: site}
        for slot, version in zip(near, turn.sensed, strict=True):
            if not self._sees(turn, at, slot, version, on):
                return None
        notes: dict[Site, Register] = {}
        for heard, shown in zip(reach, turn.received, strict=True):
            if not self._hears(turn, at, heard, shown, notes):
                return None

        def arrays(length: int) -> Arrays:
            return self._observing.seen(
                turn.module, site, on, notes, note_length=length, register=standing.note
            )

        _, entered = self._transcript.stands.get((turn.module, turn.epoch), (0, site))
        return TurnView(turn, site, on, notes, standing.note, fresh, entered, arrays)

    def _follows(self, turn: Turn, at: _Progress) -> bool:
        """Check a turn against the one before it; return whether its process has begun anew."""
        before = at.before
        fresh = before is None or before.epoch != turn.epoch
        last = 0 if before is None or fresh else before.turn
        if fresh:
            at.last, at.known, at.broken = {}, {}, False
        if turn.turn != last + 1:
            at.broken = True
            self._lack(turn.module, turn.epoch, f"{turn_text(turn)} comes after turn {last}")
        if before is not None and not fresh and turn.version < before.version:
            why = f"{turn_text(turn)}: version {turn.version} after {before.version}"
            self._fail("turns", why)
        # A process that was replaced may wake and see more than its successor did at first: so the
        # first turn of an epoch comes after what was told at its entry, and not after others.
        entered = self._transcript.stands.get((turn.module, turn.epoch))
        if entered is None or turn.version < entered[0]:
            at.broken = True
            why = f"{turn_text(turn)}: it never entered so"
            self._not_shown(turn, why, range(self._tiles.keepers))
        return fresh

    def _goes_on(self, turn: Turn, at: _Progress, place: Site, shown: tuple[int, int]) -> None:
        known = at.last.get(place, shown)
        if shown[0] < known[0] or (shown[0] == known[0] and -1 < shown[1] < known[1]):
            why = f"{site_text(place)} was shown to it later than so before"
            self._fail("turns", f"{turn_text(turn)}: {why}")
        at.last[place] = max(known, shown)

    def _sees(
        self, turn: Turn, at: _Progress, near: Site | None, version: int, on: dict[Site, Site]
    ) -> bool:
        if (near is None) != (version == -1):
            why = "it was shown a place that is none, or not one that is"
            self._fail("turns", f"{turn_text(turn)}: {why}")
            return False
        if near is None:
            return True
        known = at.known.get(near)
        if known is not None and known[0] == version == at.last[near][0]:
            if known[1] is not None:
                on.setdefault(near, known[1])
            return True
        self._goes_on(turn, at, near, (version, -1))
        there = self._history.at_place(near, version)
        if there is None or not self._was_shown(near, version, None):
            why = f"{turn_text(turn)}: {site_text(near)} was never shown at version {version}"
            if there is None:
                self._fail("turns", why)
                return False
            self._not_shown(turn, why, [self._tiles.keeper_of(near)])
        else:
            at.known[near] = version, there.site
        if there.site is not None:
            on.setdefault(near, there.site)
        return True

    def _hears(
        self,
        turn: Turn,
        at: _Progress,
        near: Site,
        shown: tuple[int, int],
        notes: dict[Site, Register],
    ) -> bool:
        version, module_version = shown
        self._goes_on(turn, at, near, shown)
        there = self._history.at_place(near, version)
        if there is None or not self._was_shown(near, version, module_version):
            why = (
                f"{turn_text(turn)}: {site_text(near)} was never shown at version {version}, with"
                f" its module at version {module_version}"
            )
            if there is None:
                self._fail("turns", why)
                return False
            self._not_shown(turn, why, [self._tiles.keeper_of(near)])
        if there.module is None:
            if module_version:
                why = f"no module was at {site_text(near)} at version {version}"
                self._fail("turns", f"{turn_text(turn)}: {why}")
        else:
            standing = self._history.module(there.module, module_version)
            if standing is None or standing.since != there.since:
                why = f"no register was at {site_text(near)} so"
                self._fail("turns", f"{turn_text(turn)}: {why}")
                return False
            if standing.note:
                notes[near] = standing.note
        return True

    def _was_shown(self, at: Site, version: int, module_version: int | None) -> bool:
        known = self._transcript.shown.get(at, _NEVER)
        if version == 0 and not module_version and (0, 0) not in known:
            there = self._history.at_place(at, 0)
            return there is not None and there.site is None  # what was never touched is not shown
        if module_version is None:
            return known.has(version)
        return (version, module_version) in known

    # Attempts.

    def _check_attempt(self, seen: TurnView) -> None:
        turn = seen.turn
        try:
            due = self._due(seen)
        except NO_SITE as error:
            self._fail("turns", f"{turn_text(turn)}: {type(error).__name__}: {error}")
            return
        if turn.number is None:
            if due is not None:
                self._fail("turns", f"{turn_text(turn)} makes no attempt of what was chosen")
            return
        known, numbers = self._transcript.attempts, self._transcript.turns
        place = known.get((turn.module, turn.epoch, turn.number))
        if place is None:
            # What came to nothing while the module was thinking was not asked of anyone.
            after = numbers.value((turn.module, turn.epoch, turn.turn + 1))
            if after not in (None, -1, turn.number):
                why = f"{turn_text(turn)}: its attempt {turn.number} is not on record"
                self._lack(turn.module, turn.epoch, why)
            return
        self._answered[place] = True
        known_turn = known.turn(place)
        if known_turn != turn.turn:
            later = numbers.value((turn.module, turn.epoch, known_turn))
            if later != turn.number or known_turn < turn.turn:
                why = f"{turn_text(turn)}: attempt {turn.number} says it is of turn {known_turn}"
                if later is None and known_turn > turn.turn:
                    self._lack(turn.module, turn.epoch, why)
                else:
                    self._fail("turns", why)
            return
        if due is None or not known.asks_for(place, due):
            why = f"attempt {turn.number} is not what was chosen"
            self._fail("turns", f"{turn_text(turn)}: {why}")

    def _due(self, seen: TurnView) -> AskedContent | None:
        """Return the content of the attempt that a choice makes, None if it makes none."""
        turn, system = seen.turn, self._system
        place = system.place_of(seen.site)
        move = self._chosen(seen)
        notes: dict[Site | None, tuple[Register, Register | None]] = {}
        for at in turn.heeds:
            notes[at] = _register(seen, place, at), None
        for at, new in turn.exchanges:
            notes[at] = _register(seen, place, at), new
        if turn.note is not None:
            notes[place] = seen.register, None if turn.note == seen.register else turn.note
        if move is None and all(new is None for _, new in notes.values()):
            return None
        if move is None:
            notes.setdefault(place, (seen.register, None))
        sensed: list[tuple[Site, Site | None]] = []
        if move is not None:
            reads, writes = self._history.units_of(move.action)
            units = {*reads, *writes, *self._guards(seen)} if turn.guards else reads | writes
            sensed = [(unit, on_unit(system, unit, seen.standing)) for unit in units]
        named = None if move is None else (move.generator, move.at)
        asked = {
            at: (tuple(shown), None if new is None else tuple(new))
            for at, (shown, new) in notes.items()
        }
        return AskedContent(seen.site, named, frozenset(sensed), frozenset(asked.items()))

    def _chosen(self, seen: TurnView) -> Move | None:
        moves = self._system.moves(seen.site)
        action = seen.turn.action
        if not 0 < action <= len(moves):
            return None
        may = self._observing.may_choose(seen.turn.module, seen.site, seen.standing, action)
        return moves[action - 1] if may else None

    def _guards(self, seen: TurnView) -> set[Site]:
        system = self._system
        found: set[Site] = set()
        for at in seen.turn.guards:
            if at is None or not system.has_place(at):
                continue
            there = seen.standing.get(at)
            if not system.letters:
                found.add(at)
            elif there is not None:
                found.add(there)
            else:
                found |= {(at, letter) for letter in system.letters}
        return found


def _register(seen: TurnView, place: Site, at: Site | None) -> Register:
    if at == place:
        return seen.register
    return [] if at is None else seen.notes.get(at, [])
