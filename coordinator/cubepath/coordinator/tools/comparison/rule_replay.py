"""One module's rule asked again in each round of a recording, with every number that it drew.

`auditing` does this for all modules: an actor with the random streams of the seed receives the
observation that `verification` derives. Here one module is played, with the rule, the seed and the
hesitation of either run, to find what made it choose otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cubepath.agents.local.random_streams import HESITATE, RandomStream, stream
from cubepath.agents.rules.actor import Actor, knowledge_of
from cubepath.agents.rules.registry import is_in_file, rule_named
from cubepath.agents.rules.rule import Choice, RuleType
from cubepath.agents.rules.schedule import SCHEDULE
from cubepath.coordinator.tools.comparison.lockstep import chosen, note_of
from cubepath.coordinator.tools.comparison.moves import Contradiction, Reading, moments
from cubepath.coordinator.verification.choices import Arrays, Moment, Observing
from cubepath.coordinator.verification.parameters import (
    RECORDED,
    RuleStage,
    hesitation_in,
    seed_in,
    stages_in,
)
from cubepath.protocol.core.errors import CubepathError, InputError, RuleError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import CLOSED, FILLED, Scene, System
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Go, decode

DRAWS_MAX = 1024
"""If a rule draws more numbers than this in one choice, none are reported."""


@dataclass(frozen=True)
class RuleSource:
    """How modules of a run choose: their rule, and what its randomness follows from."""

    rule: str | None
    seed: int | None
    hesitate: float | None
    schedule: bytes | None = None
    own: str | None = None
    """The process's own rule for the module, which cannot be asked again."""
    begins: int = 1
    """The round in which the rule began, with no memory."""
    heard: bool = False
    """Whether the module's earlier note is still sent in that round."""

    def exchanged(self, name: str, other: RuleSource) -> RuleSource:
        """Return this way with one thing of another: "rule", "seed" or "hesitate".

        When the rule began belongs to it: what it remembers and has drawn follows from that.
        """
        if name == "rule":
            return replace(
                self,
                rule=other.rule,
                schedule=other.schedule,
                own=other.own,
                begins=other.begins,
                heard=other.heard,
            )
        return replace(self, **{name: getattr(other, name)})

    def differs(self, other: RuleSource) -> list[str]:
        """Return what can be exchanged."""
        return [
            name for name in ("rule", "seed", "hesitate") if self.exchanged(name, other) != self
        ]


def way_of(recording: Recording, module: int, number: int, own: str | None = None) -> RuleSource:
    """Return how a module chose in a round, by the parameters and by when rules took over.

    `own` is the rule that its process names for it. Without rounds `number` is 1.
    """
    parameters, stage = recording.parameters, stage_at(recording, number)
    if stage is not None:
        rule = next((name for name in stage.rules if module in stage.modules(name)), None)
        return RuleSource(rule, stage.seed, stage.hesitate, None, own, stage.begins, stage.heard)
    over = _over(recording)
    if over is not None and number > over:
        rule = parameters.get("repair")
        return RuleSource(rule, seed_in(parameters), hesitation_in(parameters), None, own, over + 1)
    name = parameters.get("rule")
    return RuleSource(
        None if name == RECORDED else name,  # its stages are malformed
        seed_in(parameters),
        hesitation_in(parameters),
        recording.schedule,
        own,
    )


def stage_at(recording: Recording, number: int) -> RuleStage | None:
    """Return the stage to which a round belongs; None if the run has no stages."""
    begun = [each for each in stages_in(recording) if each.begins <= max(number, 1)]
    return begun[-1] if begun else None


def seed_at(recording: Recording, number: int) -> int | None:
    """Return the seed from which ranks follow in a round; None if it is not known."""
    stage = stage_at(recording, number)
    return seed_in(recording.parameters) if stage is None else stage.seed


def _over(recording: Recording) -> int | None:
    """Return the last round of a schedule after which a rule took over."""
    if recording.schedule is None:
        return None
    for record in recording.of_kind("go"):
        try:
            message = decode(record.data)
        except InputError:
            continue
        if isinstance(message, Go) and message.phase == "over":
            return message.round
    return None


@dataclass(frozen=True)
class ReplayedChoice:
    """What a rule chose, and the numbers that were drawn for it."""

    action: tuple[str, Site] | None
    note: tuple[int, ...] | None
    """The last note that it sent, in this choice or before."""
    failed: str | None
    drew: tuple[float, ...] | None
    doubt: float | None
    choice: Choice


class RuleReplayer:
    """The rule of one module, from its birth on; `why` says why it cannot be asked."""

    def __init__(
        self,
        scene: Scene,
        module: int,
        way: RuleSource,
        start: Site,
        *,
        clock: str,
        note: tuple[int, ...] | None = None,
    ) -> None:
        """Make the rule; `said` is the module's last note before the rule began."""
        self.why: str | None = None
        self.length = 0
        self._scene = scene
        self._note: tuple[int, ...] | None = None
        self._actor: Actor | None = None
        self._doubt: RandomStream | None = None
        rule = self._found(way, clock)
        if rule is None or way.seed is None or way.hesitate is None:
            return
        knowledge = knowledge_of(scene, module, start, way.seed)
        self._stream = knowledge.stream
        self._doubt = stream(way.seed, module, HESITATE) if way.hesitate else None
        try:
            self.length = rule.length(len(scene.start), clock)
            if self.length:
                fits = note is not None and len(note) == self.length
                self._note = note if fits else (0,) * self.length
            self._actor = Actor(
                rule, knowledge, hesitate=way.hesitate, doubt=self._doubt, clock=clock
            )
        except CubepathError as error:
            self.why = str(error)

    def _found(self, way: RuleSource, clock: str) -> RuleType | None:
        missing = [key for key in ("rule", "seed", "hesitate") if getattr(way, key) is None]
        if way.own is not None:
            self.why = f"its process names its own rule: {way.own!r}"
        elif missing:
            self.why = f"the recording names no {missing[0]} for it"
        elif way.schedule is not None or way.rule == SCHEDULE:
            self.why = "it follows a schedule"
        elif is_in_file(way.rule or ""):  # a recording can name any file
            self.why = f"rule {way.rule!r} is in a file, which a recording cannot make run"
        else:
            try:
                return rule_named(way.rule or "", self._scene.system, clock)
            except CubepathError as error:
                self.why = str(error)
        return None

    def play(self, site: Site, seen: Arrays) -> ReplayedChoice | None:
        """Return what the rule chooses; None if it cannot be asked, or has failed before."""
        actor = self._actor
        if actor is None:
            return None
        before, doubted = deepcopy((self._stream, self._doubt))
        try:
            choice = actor.act(seen)
        except RuleError as error:
            self._actor, self.why = None, str(error)
            choice = Choice(failed=str(error))
        if choice.note:
            self._note = tuple(choice.note)
        drew = _drawn(before, self._stream)
        drew_doubt = self._doubt is not None and self._doubt.drawn
        doubt = doubted.fraction() if doubted is not None and drew_doubt else None
        return ReplayedChoice(
            self._move(site, choice), self._note, choice.failed, drew, doubt, choice
        )

    def _move(self, site: Site, choice: Choice) -> tuple[str, Site] | None:
        if not choice.action:
            return None
        move = self._scene.system.moves(site)[choice.action - 1]
        return None if move is None else (move.generator, move.at)


def _drawn(before: RandomStream, after: RandomStream) -> tuple[float, ...] | None:
    """Return the numbers that were drawn since a stream was copied, as fractions.

    First those of the stream itself, then those of its numpy generator, which are reported only if
    they are at most `DRAWS_MAX`.
    """
    count = after.drawn - before.drawn
    if count > DRAWS_MAX:
        return None
    found = [before.fraction() for _ in range(count)]
    drawn = _drawn_by_numpy(before.generator, after.generator)
    return None if drawn is None else (*found, *drawn)


def _drawn_by_numpy(
    before: np.random.Generator, after: np.random.Generator
) -> tuple[float, ...] | None:
    """Return the numbers drawn between two states of a generator, as fractions.

    PCG64 gives 64 bits a step; as numpy does for a random float, the upper 53 make the fraction.
    Of a rule that draws 32 bits numpy keeps the upper half of a number for the next time.
    """
    copy, known = before.bit_generator, after.bit_generator.state
    state: Any = copy.state
    if state["state"] == known["state"] and state["has_uint32"] > known["has_uint32"]:
        return (state["uinteger"] * 2.0**-32,)
    found: list[float] = []
    while copy.state["state"] != known["state"]:
        if len(found) >= DRAWS_MAX:
            return None
        found.append((int(copy.random_raw()) >> 11) * 2.0**-53)
    return tuple(found)


class ChoiceOnRecord(NamedTuple):
    """What a module chose, as it is recorded; of the note it is not always known."""

    action: tuple[str, Site | None] | None
    failed: str | None
    note: tuple[int, ...] | None

    def is_by(self, played: ReplayedChoice) -> bool:
        """Return whether a rule that was asked again chose this, as far as it is known."""
        note = self.note is None or self.note == played.note
        return (self.action, self.failed) == (played.action, played.failed) and note


@dataclass(frozen=True)
class ModuleHistory:
    """A module in one of the runs, up to a round."""

    inputs: dict[int, tuple[object, ...]]
    """By round what its rule was given, in a form in which two runs can be compared."""
    moment: Moment
    site: Site
    recorded: ChoiceOnRecord
    sensed: dict[str, str]
    received: dict[str, list[int]]
    played: list[ReplayedChoice | None]
    """What the rules chose in the last round, in the order of the ways that were asked for."""
    refused: list[str | None]
    """Why a rule could not be asked."""


def follow(reading: Reading, module: int, last: int, ways: Sequence[RuleSource]) -> ModuleHistory:
    """Follow a module up to a round, and ask its rule in each of some ways from its birth on.

    Contradiction as for `moments`.
    """
    scene = reading.recording.scene
    observing, system = Observing(scene), scene.system
    players: list[RuleReplayer | None] = []
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
                note = note_of(moment.recorded, module) if way.heard else None
                players[place] = RuleReplayer(scene, module, way, site, clock="lockstep", note=note)
        plain = observing.observation(moment, module, 0)
        notes = notes_told(system, moment, module)
        inputs[moment.round] = (site, *_bytes(plain), sorted(notes.items()))
        seen: dict[int, Arrays] = {0: plain}
        played: list[ReplayedChoice | None] = []
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
            recorded = ChoiceOnRecord(
                *chosen(moment.recorded, module), _note_after(steps, module, last)
            )
            return ModuleHistory(inputs, moment, site, recorded, sensed, notes, played, refused)
    raise Contradiction(f"round {last} cannot be derived")


def _unborn(since: int, way: RuleSource) -> str:
    return f"its rule began in round {way.begins}, and rounds before {since} are not on record"


def _note_after(steps: Iterator[Moment], module: int, last: int) -> tuple[int, ...] | None:
    """Return the note that the module says in the round after `last`, as chosen in that."""
    try:
        after = next(steps, None)
    except Contradiction:  # what comes later does not matter here
        return None
    return None if after is None or after.round != last + 1 else note_of(after.recorded, module)


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
        note = None if other is None else note_of(moment.recorded, other)
        if note is not None:
            found[f"module_{other} at {site_text(near)}"] = list(note)
    return found


def _bytes(seen: Arrays) -> tuple[bytes, bytes]:
    return seen["observation"].tobytes(), seen["action_mask"].tobytes()
