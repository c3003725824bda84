"""Words in a group presentation, rewritten in place by its relations.

Source: Abrams and Ghrist, examples ("examples arising from word representations in group theory").

A word has a fixed length. A site is ``(position, letter)``; at every position exactly one letter is
on, so the agent is the position and a move changes its letter. A relation u ~ v with sides of equal
length is a generator for every place in the word: it reads the letters of both sides at all its
positions, and writes them where they differ. One letter being on implies that all others are off,
so no further letters are read. The mover is the leftmost position that changes.

Sides of unequal length are padded with a letter ``_`` that stands for nothing and moves freely:
``aA~__`` cancels inverses, and the words of one group element are connected if the length leaves
enough room.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import Family, Values, scene_of
from cubepath.protocol.systems.listed import TabledSystem

BLANK = "_"
_LENGTH_MAX = 1000


@dataclass(frozen=True, slots=True)
class Presentation:
    """Relations, with a word and a goal to show them."""

    relations: str
    word: str
    goal: str


def _with_blanks(relations: str, letters: str) -> str:
    """Return the relations, and those that move the blank past every letter."""
    return "+".join((relations, *(f"{BLANK}{each}~{each}{BLANK}" for each in letters)))


PRESENTATIONS: Mapping[str, Presentation] = {
    # The positive half twist on four strands, with two of its sixteen words.
    "braid4": Presentation("aba~bab+bcb~cbc+ac~ca", "abacba", "cbcabc"),
    # Right-angled: a, b, c, d in a row; neighbours commute.
    "raag": Presentation("ab~ba+bc~cb+cd~dc", "abcdabcd", "badcbadc"),
    # Inverses are capitals; the word is trivial in the free group.
    "free2": Presentation(
        _with_blanks(f"aA~{BLANK * 2}+Aa~{BLANK * 2}+bB~{BLANK * 2}+Bb~{BLANK * 2}", "aAbB"),
        "abBbBAaA",
        BLANK * 8,
    ),
}
"""Relations known by name."""


def relations_from_text(text: str) -> tuple[tuple[str, str], ...]:
    """Read `ab~ba+bc~cb`; InputError names the first invalid relation."""
    found: dict[frozenset[str], tuple[str, str]] = {}
    for part in text.split("+"):
        left, tilde, right = part.partition("~")
        if not tilde or not left or not right or "~" in right:
            raise InputError(f"relation {part!r}: expected two words, as in ab~ba")
        if len(left) != len(right):
            raise InputError(
                f"relation {part}: sides of {len(left)} and {len(right)} letters, expected equal"
                f" lengths (pad with {BLANK})"
            )
        if left == right:
            raise InputError(f"relation {part}: both sides are the same")
        if frozenset((left, right)) in found:
            raise InputError(f"relation {part}: stands twice")
        found[frozenset((left, right))] = left, right
    return tuple(found.values())


def word_moves(length: int, relations: Iterable[tuple[str, str]]) -> tuple[Move, ...]:
    """Return the moves of words of this length, by relation and position."""
    found = []
    for left, right in relations:
        for begin in range(length - len(left) + 1):
            before = [(begin + k, letter) for k, letter in enumerate(left)]
            after = [(begin + k, letter) for k, letter in enumerate(right)]
            motion = tuple((a, b) for a, b in zip(before, after, strict=True) if a != b)
            name = f"{left}~{right}"
            action = Action(
                [*before, *after],
                [site for pair in motion for site in pair],
                before,
                after,
                label=f"{name} at {begin}",
            )
            found.append(Move(action, name, begin, motion))
    return tuple(found)


def _words(name: str, values: Values) -> Scene:
    """Build a word whose goal, if any, is another of the same length."""
    title = values["presentation"] or ("" if values["relations"] else "braid4")
    preset = PRESENTATIONS.get(title)
    if title and preset is None:
        known = ", ".join(PRESENTATIONS)
        raise InputError(f"presentation={title}: expected one of {known}, or give relations")
    parts = [preset.relations if preset else "", values["relations"]]
    relations = relations_from_text("+".join(part for part in parts if part))
    own = preset is not None and not values["relations"]
    word = values["word"] or (preset.word if preset and own else relations[0][0] * 2)
    goal = values["goal"] or (preset.goal if preset and own and not values["word"] else "")
    letters = tuple(dict.fromkeys(letter for pair in relations for side in pair for letter in side))
    if len(word) > _LENGTH_MAX:
        raise InputError(f"word of {len(word)} letters, expected at most {_LENGTH_MAX}")
    for key, spelt in (("word", word), ("goal", goal)):
        stray = [letter for letter in spelt if letter not in letters]
        if stray:
            raise InputError(
                f"{key}={spelt}: letter {stray[0]!r} is in no relation, expected"
                f" {', '.join(letters)}"
            )
    if goal and len(goal) != len(word):
        raise InputError(f"goal={goal}: {len(goal)} letters, the word has {len(word)}")
    moves = word_moves(len(word), relations)
    if not moves:
        raise InputError(f"word={word}: shorter than every relation, so nothing can move")
    system = TabledSystem(moves, letters=letters, drawing="letters")
    return scene_of(name, system, enumerate(word), enumerate(goal), own=True)


FAMILIES = (
    Family(
        "words",
        "words of a fixed length in a group presentation, rewritten by its relations",
        {
            "word": ("", "the word to begin with, a letter a position"),
            "relations": ("", "such as ab~ba+bcb~cbc; further ones where a presentation is named"),
            "presentation": ("", f"{', '.join(PRESENTATIONS)}; braid4 without relations"),
            "goal": ("", "a word of the same length"),
        },
        _words,
        TabledSystem,
    ),
)
