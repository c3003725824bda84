"""The rule of a module that chooses again what it chose in a run on record.

From birth a module knows what it chose itself, round by round, and nothing of what others chose. In
each round it finds its move among its admissible ones and claims it; where it was not admissible,
or the module stood elsewhere, it stays and says why.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.schedule import move_due
from cubepath.protocol.core.names import GeneratorPlacement

RECORDED = "recorded"


class RecordedChoice(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    """What a module chose in a round: the move that it claimed, what it noted, if it gave up."""

    move: GeneratorPlacement | None = None
    note: list[int] | None = None
    """What it said at the beginning of the next round; None if that is not on record."""
    failed: str | None = None


class Recorded(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What some modules chose on record, and what they do when that is over."""

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
    """Whether what was noted last on record is heard in the first round of the rules."""

    def of(self, modules: Sequence[int]) -> Recorded:
        """Return what concerns some modules."""
        return msgspec.structs.replace(
            self,
            choices={n: self.choices[n] for n in modules if n in self.choices},
            rules={n: self.rules[n] for n in modules if n in self.rules},
        )


def as_recorded(told: Recorded) -> RuleType:
    """Return the rule by which each module chooses what it chose on record."""

    def make(knowledge: InitialKnowledge) -> Rule:
        return _repeat(told.choices[knowledge.module])

    return RuleType(
        name=RECORDED,
        summary="each module chooses what it chose in a run on record",
        source="own, see cubepath.agents.rules.recorded",
        fits=lambda _: True,
        make=make,
        note_length=lambda _: told.note_length,
    )


def _repeat(choices: Sequence[RecordedChoice]) -> Rule:
    left = iter(choices)

    def choose(view: View) -> Choice:
        chosen = next(left)
        found = Choice(STAY) if chosen.move is None else move_due(view, chosen.move)
        note = None if chosen.note is None else tuple(chosen.note)
        return Choice(found.action, note, found.failed or chosen.failed)

    return choose
