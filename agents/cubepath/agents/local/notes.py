"""What a module tells others of its rule's notes, and when.

Room: agents. Pure, like `arbitration`: `ModuleCore` and `World` both go by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from cubepath.agents.local.observation import Note


@dataclass(frozen=True, slots=True)
class LastNote:
    """What a module's rule said last, of a fixed number of integers; no integers: it is silent.

    It is said at the beginning of each round after that of the rule's first choice, by the module
    from where it then stands, and is zeros as long as the rule has chosen without a note.
    """

    numbers: Note
    first_choice: int
    """The round in which the rule chooses for the first time: until then it has said nothing."""

    def said_in(self, round_number: int) -> Note | None:
        """Return what the module says at the beginning of a round; None where that is nothing."""
        return self.numbers if self.numbers and round_number > self.first_choice else None

    def replaced_by(self, note: Note | None) -> LastNote:
        """Return what was said last after a choice with this note; None or empty leaves it."""
        return replace(self, numbers=note) if note else self


def nothing_said(note_length: int, *, first_choice: int) -> LastNote:
    """Return the note of a rule that is to choose for the first time in round `first_choice`."""
    return LastNote((0,) * note_length, first_choice)
