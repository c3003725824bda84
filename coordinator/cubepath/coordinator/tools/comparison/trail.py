"""What one module sensed, was told and did in each round, derived from the record of a run.

The rules that are asked again on the way are given the observations that `verification` derives, as
in an audit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cubepath.coordinator.tools.comparison.lockstep import chosen, note_of
from cubepath.coordinator.tools.comparison.playing import Played, Player, Way
from cubepath.coordinator.tools.comparison.reading import Contradiction, Reading, moments
from cubepath.coordinator.verification.choices import Arrays, Moment, Observing
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import CLOSED, FILLED, System


class Recorded(NamedTuple):
    """What a module chose, as it is on record; of the note it is not always known."""

    action: tuple[str, Site | None] | None
    failed: str | None
    note: tuple[int, ...] | None

    def is_by(self, played: Played) -> bool:
        """Return whether a rule that was asked again chose this, as far as it is known."""
        note = self.note is None or self.note == played.note
        return (self.action, self.failed) == (played.action, played.failed) and note


@dataclass(frozen=True)
class Trail:
    """A module in one of the runs, up to a round."""

    inputs: dict[int, tuple[object, ...]]
    """By round what its rule was given, in a form in which two runs can be compared."""
    moment: Moment
    site: Site
    recorded: Recorded
    sensed: dict[str, str]
    told: dict[str, list[int]]
    played: list[Played | None]
    """What the rules chose in the last round, in the order of the ways that were asked for."""
    refused: list[str | None]
    """Why a rule could not be asked."""


def follow(reading: Reading, module: int, last: int, ways: Sequence[Way]) -> Trail:
    """Follow a module up to a round, and ask its rule in each of some ways from its birth on.

    Contradiction as for `moments`.
    """
    scene = reading.recording.scene
    observing, system = Observing(scene), scene.system
    players: list[Player | None] = []
    inputs: dict[int, tuple[object, ...]] = {}
    steps = moments(reading)
    since = 0
    for moment in steps:
        site = moment.sites[module]
        if moment.round - 1 not in inputs:
            # What the rule was given in a gap is not known, so that it has to be born anew.
            since = moment.round
            players[:] = [None] * len(ways)
            inputs = {}
        for place, way in enumerate(ways):
            if moment.round == way.begins:
                said = note_of(moment.said, module) if way.heard else None
                players[place] = Player(scene, module, way, site, clock="lockstep", said=said)
        plain = observing.observation(moment, module, 0)
        told = notes_told(system, moment, module)
        inputs[moment.round] = (site, *_bytes(plain), sorted(told.items()))
        seen: dict[int, Arrays] = {0: plain}
        played: list[Played | None] = []
        for player in players:
            if player is None:
                played.append(None)
                continue
            length = player.length
            if length not in seen:
                seen[length] = observing.observation(moment, module, length)
            played.append(player.play(site, seen[length]))
        if moment.round == last:
            sensed = sensed_at(system, site, moment.sites)
            refused = [
                _unborn(since, way) if player is None else player.why
                for player, way in zip(players, ways, strict=True)
            ]
            recorded = Recorded(*chosen(moment.said, module), _note_after(steps, module, last))
            return Trail(inputs, moment, site, recorded, sensed, told, played, refused)
    raise Contradiction(f"round {last} cannot be derived")


def _unborn(since: int, way: Way) -> str:
    return f"its rule began in round {way.begins}, and rounds before {since} are not on record"


def _note_after(steps: Iterator[Moment], module: int, last: int) -> tuple[int, ...] | None:
    """Return the note that the module says in the round after `last`, as chosen in that."""
    try:
        after = next(steps, None)
    except Contradiction:  # what comes later does not matter here
        return None
    return None if after is None or after.round != last + 1 else note_of(after.said, module)


def sensed_at(system: System, site: Site, sites: Sequence[Site]) -> dict[str, str]:
    """Return what is at each place that a module at `site` senses, in words."""
    at_place = {system.place_of(each): (each, module) for module, each in enumerate(sites)}
    found: dict[str, str] = {}
    for near in system.sensed(system.place_of(site)):
        if near is None:
            continue
        there = at_place.get(near)
        if there is not None:
            on, module = there
            which = "" if on == near else f" as {site_text(on)}"
            found[site_text(near)] = f"module_{module}{which}"
        else:
            code = system.background(near)
            found[site_text(near)] = {CLOSED: "closed", FILLED: "filled"}.get(code, "empty")
    return found


def notes_told(system: System, moment: Moment, module: int) -> dict[str, list[int]]:
    """Return the notes of the modules within reach, by who says it where."""
    at_place = {system.place_of(each): other for other, each in enumerate(moment.sites)}
    found: dict[str, list[int]] = {}
    for near in system.reach(system.place_of(moment.sites[module])):
        other = at_place.get(near)
        note = None if other is None else note_of(moment.said, other)
        if note is not None:
            found[f"module_{other} at {site_text(near)}"] = list(note)
    return found


def _bytes(seen: Arrays) -> tuple[bytes, bytes]:
    return seen["observation"].tobytes(), seen["action_mask"].tobytes()
