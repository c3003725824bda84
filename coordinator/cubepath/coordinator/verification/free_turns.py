"""What a rule was shown in each turn, and whether its attempt is what it chose.

Room: coordinator. Part of `cubepath verify`: a turn names the versions of what it was shown, and
the history says what was there. It asks no rule: whoever has rules is a `FreePlayer`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

from cubepath.coordinator.verification.choices import Arrays, Observing
from cubepath.coordinator.verification.free_history import (
    History,
)
from cubepath.coordinator.verification.free_shown import Shownness
from cubepath.coordinator.verification.free_transcript import (
    FreeTranscript,
    attempt_text,
    turn_text,
)
from cubepath.coordinator.verification.free_units import NO_SITE, on_unit, units_of
from cubepath.coordinator.verification.transcript import Fail, site_in
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.wire.free_messages import Attempt, Register, Turn
from cubepath.protocol.wire.tiles import Tiles


class Seen(NamedTuple):
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

    def turn(self, seen: Seen, fail: Callable[[str], None]) -> None:
        """Ask the rule in a turn, and call `fail` with one line for each other choice."""

    def end(self, fail: Callable[[str], None]) -> None:
        """Say what is wrong with the rule itself."""

    def unchecked(self) -> str | None:
        """Return in one line what was not asked again, and why; None if all was."""


class TurnsOfModules:
    """The turns of a run."""

    def __init__(
        self,
        history: History,
        shown: Shownness,
        transcript: FreeTranscript,
        tiles: Tiles,
        fail: Fail,
    ) -> None:
        """Know what was shown."""
        self._tiles = tiles
        self._history, self._shown, self._said, self._fail = history, shown, transcript, fail
        self._system = history.system
        self._observing = Observing(history.scene)
        self._entered = _entered(transcript)
        self._losses = transcript.losses
        self._broken = False
        """Whether it is not known what the module's rule was shown since it entered."""
        self._last: dict[Site, tuple[int, int]] = {}
        """What the process of a module was shown last of each place."""

    def check(self, player: FreePlayer | None) -> None:
        """Check all turns, and let the player play them."""

        def another_choice(why: str) -> None:
            self._fail("choices", why)

        answered: set[tuple[int, int, int]] = set()
        for module in sorted(self._said.turns):
            turns = self._said.turns[module]
            before: Turn | None = None
            for name in sorted(turns):
                turn = turns[name]
                seen = self._seen(turn, before)
                if seen is not None:
                    self._check_attempt(seen, answered)
                    self._play(player, seen, another_choice)
                before = turn
        if player is not None:
            player.end(another_choice)
        if self._said.turns:
            for each in sorted(self._said.attempts.keys() - answered):
                self._lack(each[0], each[1], f"{attempt_text(each)} has no turn")

    def _play(
        self, player: FreePlayer | None, seen: Seen, another_choice: Callable[[str], None]
    ) -> None:
        if player is None:
            return
        if self._broken:
            why = f"{turn_text(seen.turn)} comes after a gap"
            self._losses.lack(self._fail, "choices", why, excused=True)
        else:
            player.turn(seen, another_choice)

    def _lack(self, module: int, epoch: int, why: str) -> None:
        """Take note of what the process of a module said and is not on record."""
        excused = self._losses.of_module(module) or self._losses.before(module, epoch)
        self._losses.lack(self._fail, "turns", why, excused=excused)

    def _not_shown(self, turn: Turn, why: str, keepers: Iterable[int]) -> None:
        """Take note of what keepers said to a module and is not on record."""
        before = self._losses.before(turn.module, turn.epoch)
        excused = before or self._losses.of_keepers(keepers)
        self._losses.lack(self._fail, "turns", why, excused=excused)

    def _seen(self, turn: Turn, before: Turn | None) -> Seen | None:
        """Return what was shown in a turn, None if it cannot have been."""
        name, history, system = turn_text(turn), self._history, self._system
        fresh = self._follows(turn, before)
        standing = history.module(turn.module, turn.version)
        site = site_in(turn.site)
        if standing is None or standing.site != site:
            where = f"at {turn.site!r} at version {turn.version}"
            self._fail("turns", f"{name}: it does not stand {where}")
            return None
        place = system.place_of(site)
        near = system.sensed(place)
        reach = system.reach(place) if turn.heard else ()
        if len(turn.sensed) != len(near) or len(turn.heard) != len(reach):
            self._fail("turns", f"{name}: it was shown other places than it senses")
            return None
        on: dict[Site, Site] = {place: site}
        if not all(self._sees(turn, *each, on) for each in zip(near, turn.sensed, strict=True)):
            return None
        notes: dict[Site, Register] = {}
        if not all(self._hears(turn, *each, notes) for each in zip(reach, turn.heard, strict=True)):
            return None

        def arrays(length: int) -> Arrays:
            return self._observing.seen(
                turn.module, site, on, notes, note_length=length, register=standing.note
            )

        entered = self._entered.get((turn.module, turn.epoch), site)
        return Seen(turn, site, on, notes, standing.note, fresh, entered, arrays)

    def _follows(self, turn: Turn, before: Turn | None) -> bool:
        """Check a turn against the one before it; return whether its process has begun anew."""
        name, fresh = turn_text(turn), before is None or before.epoch != turn.epoch
        last = 0 if before is None or fresh else before.turn
        if fresh:
            self._last, self._broken = {}, False
        if turn.turn != last + 1:
            self._broken = True
            self._lack(turn.module, turn.epoch, f"{name} comes after turn {last}")
        if before is not None and turn.version < before.version:
            self._fail("turns", f"{name}: version {turn.version} after {before.version}")
        if (turn.module, turn.epoch) not in self._entered:
            self._broken = True
            self._not_shown(turn, f"{name}: it never entered so", range(self._tiles.keepers))
        return fresh

    def _goes_on(self, name: str, at: Site, shown: tuple[int, int]) -> None:
        known = self._last.get(at, shown)
        if shown[0] < known[0] or (shown[0] == known[0] and -1 < shown[1] < known[1]):
            self._fail("turns", f"{name}: {site_text(at)} was shown to it later than so before")
        self._last[at] = max(known, shown)

    def _sees(self, turn: Turn, at: Site | None, version: int, on: dict[Site, Site]) -> bool:
        name = turn_text(turn)
        if (at is None) != (version == -1):
            self._fail("turns", f"{name}: it was shown a place that is none, or not one that is")
            return False
        if at is None:
            return True
        self._goes_on(name, at, (version, -1))
        there = self._history.at_place(at, version)
        why = f"{name}: {site_text(at)} was never shown at version {version}"
        if there is None:
            self._fail("turns", why)
            return False
        if not self._was_shown(at, version, None):
            self._not_shown(turn, why, [self._tiles.keeper_of(at)])
        if there.site is not None:
            on.setdefault(at, there.site)
        return True

    def _hears(
        self, turn: Turn, at: Site, shown: tuple[int, int], notes: dict[Site, Register]
    ) -> bool:
        name, (version, module_version) = turn_text(turn), shown
        self._goes_on(name, at, shown)
        there = self._history.at_place(at, version)
        why = (
            f"{name}: {site_text(at)} was never shown at version {version}, with its module at"
            f" version {module_version}"
        )
        if there is None:
            self._fail("turns", why)
            return False
        if not self._was_shown(at, version, module_version):
            self._not_shown(turn, why, [self._tiles.keeper_of(at)])
        if there.module is None:
            if module_version:
                self._fail("turns", f"{name}: nobody was at {site_text(at)} at version {version}")
        else:
            standing = self._history.module(there.module, module_version)
            if standing is None or standing.since != there.since:
                self._fail("turns", f"{name}: no register was at {site_text(at)} so")
                return False
            if standing.note:
                notes[at] = standing.note
        return True

    def _was_shown(self, at: Site, version: int, module_version: int | None) -> bool:
        known = self._shown.versions.get(at, ())
        if version == 0 and not module_version and (0, 0) not in known:
            there = self._history.at_place(at, 0)
            return there is not None and there.site is None  # what was never touched is not shown
        if module_version is None:
            return version in self._shown.place_versions.get(at, ())
        return (version, module_version) in known

    # Attempts.

    def _check_attempt(self, seen: Seen, answered: set[tuple[int, int, int]]) -> None:
        turn, name = seen.turn, turn_text(seen.turn)
        try:
            due = self._due(seen)
        except NO_SITE as error:
            self._fail("turns", f"{name}: {type(error).__name__}: {error}")
            return
        if turn.number is None:
            if due is not None:
                self._fail("turns", f"{name} makes no attempt of what was chosen")
            return
        key = turn.module, turn.epoch, turn.number
        answered.add(key)
        attempt = self._said.attempts.get(key)
        if attempt is None:
            # What came to nothing while the module was thinking was not asked of anyone.
            after = self._said.turns[turn.module].get((turn.epoch, turn.turn + 1))
            if after is not None and after.number not in (None, turn.number):
                why = f"{name}: its attempt {turn.number} is not on record"
                self._lack(turn.module, turn.epoch, why)
            return
        if attempt.turn != turn.turn:
            others = self._said.turns[turn.module]
            later = others.get((turn.epoch, attempt.turn))
            if later is None or later.number != turn.number or attempt.turn < turn.turn:
                why = f"{name}: attempt {turn.number} says it is of turn {attempt.turn}"
                if later is None and attempt.turn > turn.turn:
                    self._lack(turn.module, turn.epoch, why)
                else:
                    self._fail("turns", why)
            return
        found = _content(attempt)
        if due is None or found != due:
            self._fail("turns", f"{name}: attempt {turn.number} is not what was chosen")

    def _due(self, seen: Seen) -> object:
        """Return the content of the attempt that a choice makes, None if it makes none."""
        turn, system = seen.turn, self._system
        place = system.place_of(seen.site)
        move = self._chosen(seen)
        notes: dict[Site | None, tuple[Register, Register | None]] = {}
        for value in turn.heeds:
            at = site_in(value)
            notes[at] = _register(seen, place, at), None
        for value, new in turn.exchanges:
            at = site_in(value)
            notes[at] = _register(seen, place, at), new
        if turn.note is not None:
            notes[place] = seen.register, None if turn.note == seen.register else turn.note
        if move is None and all(new is None for _, new in notes.values()):
            return None
        if move is None:
            notes.setdefault(place, (seen.register, None))
        units: set[Site] = set()
        if move is not None:
            reads, writes = units_of(system, move)
            units = {*reads, *writes, *self._guards(seen)}
        on = dict(seen.standing)
        sensed = {unit: on_unit(system, unit, on) for unit in units}
        named = None if move is None else (move.generator, move.at)
        return seen.site, named, sensed, notes

    def _chosen(self, seen: Seen) -> Move | None:
        moves = self._system.moves(seen.site)
        action = seen.turn.action
        move = moves[action - 1] if 0 < action <= len(moves) else None
        return move if move is not None and seen.arrays(0)["action_mask"][action] else None

    def _guards(self, seen: Seen) -> set[Site]:
        system = self._system
        found: set[Site] = set()
        for value in seen.turn.guards:
            at = site_in(value)
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


def _register(seen: Seen, place: Site, at: Site | None) -> Register:
    if at == place:
        return seen.register
    return [] if at is None else seen.notes.get(at, [])


def _content(attempt: Attempt) -> object:
    named = None if attempt.generator is None else (attempt.generator, site_in(attempt.at))
    sensed = {
        site_in(unit): None if shown is None else site_in(shown) for unit, shown in attempt.sensed
    }
    notes = {site_in(place): (shown, new) for place, shown, new in attempt.notes}
    return site_in(attempt.site), named, sensed, notes


def _entered(transcript: FreeTranscript) -> dict[tuple[int, int], Site]:
    """Return where modules were told that they stand, by module and epoch."""
    found: dict[tuple[int, int], Site] = {}
    for said in transcript.said:
        occupant = getattr(said.part, "occupant", None)
        site = site_in(getattr(said.part, "site", None))
        if occupant is not None and site is not None:
            found.setdefault((occupant.module, occupant.epoch), site)
    return found
