"""When a module tells others its rule's notes.

Pure, like `arbitration`: `ModuleCore` and `World` both use it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from cubepath.agents.local.observation import Note


@dataclass(frozen=True, slots=True)
class LastNote:
    """The last note of a module's rule, a fixed number of integers; none for a silent rule.

    The module sends it from its current site at the beginning of each round after the rule's first
    choice. It is zeros until the rule has chosen with a note.
    """

    numbers: Note
    first_choice: int
    """The round in which the rule chooses for the first time; until then it has said nothing."""

    def said_in(self, round_number: int) -> Note | None:
        """Return what the module says at the beginning of a round; None if it says nothing."""
        return self.numbers if self.numbers and round_number > self.first_choice else None

    def replaced_by(self, note: Note | None) -> LastNote:
        """Return the last note after a choice with this note; None or empty leaves it unchanged."""
        return replace(self, numbers=note) if note else self


def nothing_said(note_length: int, *, first_choice: int) -> LastNote:
    """Return the note of a rule that will choose for the first time in round `first_choice`."""
    return LastNote((0,) * note_length, first_choice)
