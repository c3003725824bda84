"""Rules that repeat given moves: those of a schedule, or those that a recording holds.

A module that executes a schedule knows from the start which moves it makes in which round, and no
others. In the round of such a move, it finds the move among its admissible ones and claims it; the
moves of a cube commute, so every claim is granted. If the move is not admissible, the module stays
and gives the reason as far as it senses it, so that no further round of the schedule begins.

A module that repeats a recording knows its own choices, round by round, and no others. It claims
the recorded move if that is admissible; otherwise, or if it stands somewhere else, it stays and
gives the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.actions import why_inadmissible
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.path_files.durations import OwnMoves

SCHEDULE = "schedule"


def scheduled(own: Mapping[int, OwnMoves]) -> RuleType:
    """Return the rule by which each module makes the moves of its own list in `own`."""

    def make(knowledge: InitialKnowledge) -> Rule:
        return _follow(own.get(knowledge.module, {}))

    return RuleType(
        name=SCHEDULE,
        summary="each module makes its own moves of a schedule, each in its round",
        source="own, see cubepath.agents.rules.schedule",
        fits=lambda _: True,
        make=make,
    )


def _follow(moves: OwnMoves) -> Rule:
    rounds = 0

    def choose(view: View) -> int | Choice:
        nonlocal rounds
        rounds += 1
        return move_due(view, moves[rounds]) if rounds in moves else STAY

    return choose


def move_due(view: View, placed: GeneratorPlacement) -> Choice:
    """Return the choice of a move by its name; of none, with the reason, if it cannot be made."""
    move = view.system.move_named(view.site, placed.generator, placed.at)
    if move is None:
        return Choice(failed=_none_such(placed, view))
    action = 1 + view.moves.index(move)
    return Choice(action) if view.mask[action] else Choice(failed=why_not(move, view))


def _none_such(placed: GeneratorPlacement, view: View) -> str:
    """Return why there is no such move: an obstacle in its way, or the module stands elsewhere."""
    try:
        view.system.read_action(placed)
    except InputError as error:
        return str(error)
    return f"{named(placed.generator, placed.at)} is no move from {site_text(view.site)}"


def why_not(move: Move, view: View) -> str:
    """Return one line on the first wrong site in the support of a move, as the module senses it."""
    on: set[Site] = {view.site}
    for near, code in view.occupied.items():
        shown = view.system.site_at(near, code)
        if shown is not None:
            on.add(shown)
    action = move.action
    one, other = action.ends
    before = one if move.source in one else other
    wrong = in_order((before ^ (action.support & on)) - action.free)
    if not wrong:
        return why_inadmissible(action, on)
    site, text = wrong[0], site_text(wrong[0])
    if site not in on:
        how = f"site {text} is off, expected on"
    else:
        obstacle = " (an obstacle)" if site in view.system.filled else ""
        how = f"site {text} is on{obstacle}, expected off"
    return f"{named(move.generator, move.at)} is not admissible: {how}"


def named(generator: str, at: Site) -> str:
    """Return a move as text for people."""
    return f"{generator} at {site_text(at)}"


RECORDED = "recorded"


class RecordedChoice(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    """What a module chose in a round: the move that it claimed, what it noted, if it gave up."""

    move: GeneratorPlacement | None = None
    note: list[int] | None = None
    """Its note at the beginning of the next round; None if that is not recorded."""
    failed: str | None = None


class RecordedChoices(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What some modules chose in the recording, and what they do when that is over."""

    choices: dict[int, list[RecordedChoice]]
    """By module its choices in the rounds from 1 on; a module that is not here follows its rule."""
    note_length: int = 0
    seeds: list[tuple[int, int]] = []
    """From which round on ranks follow another seed than that of the run, by increasing rounds.

    The last one is also the seed of what rules draw when the record is over.
    """
    rules: dict[int, str] = {}
    """By module the rule that it follows then, if that is not the rule of the run."""
    heard: bool = False
    """Whether what was noted last in the recording is heard in the first round of the rules."""

    def of(self, modules: Sequence[int]) -> RecordedChoices:
        """Return what concerns some modules."""
        return msgspec.structs.replace(
            self,
            choices={n: self.choices[n] for n in modules if n in self.choices},
            rules={n: self.rules[n] for n in modules if n in self.rules},
        )


def as_recorded(recorded: RecordedChoices) -> RuleType:
    """Return the rule by which each module chooses what it chose in the recording."""

    def make(knowledge: InitialKnowledge) -> Rule:
        return _repeat(recorded.choices[knowledge.module])

    return RuleType(
        name=RECORDED,
        summary="each module chooses what it chose in a run on record",
        source="own, see cubepath.agents.rules.schedule",
        fits=lambda _: True,
        make=make,
        note_length=lambda _: recorded.note_length,
    )


def _repeat(choices: Sequence[RecordedChoice]) -> Rule:
    left = iter(choices)

    def choose(view: View) -> Choice:
        chosen = next(left)
        found = Choice(STAY) if chosen.move is None else move_due(view, chosen.move)
        note = None if chosen.note is None else tuple(chosen.note)
        return Choice(found.action, note, found.failed or chosen.failed)

    return choose
