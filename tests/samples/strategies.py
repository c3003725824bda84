"""What tests of paths are made of: words of abstract actions, walks of real systems, and detours.

A word is a list of actions read as an edge path. Abstract actions know no state; a walk is a
word that is admissible from the start of a scene.
"""

from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import TypeVar

from hypothesis import strategies as st

from cubepath.protocol.core.actions import Action, State, apply, commute
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import actions_at

T = TypeVar("T")
Word = list[Action]
ClassKey = frozenset[tuple[tuple[Action, int], ...]]

SCENES = (
    "hex:n=5",
    "hex-open:n=4",
    "agv:graph=grid3x3,n=3",
    "agv-labelled:graph=grid3x3,n=3",
    "agv:graph=K5,n=2",
    "arm:n=5",
    "sliding:p=2,q=1,n=4",
    "arms:n=1",
    "polygon:n=8",
    "words:presentation=raag",
    "assembly:n=3",
)

scene = lru_cache(maxsize=None)(scene_from_spec)


def toggle(*trace: Site, reads: Sequence[Site] = (), label: str = "") -> Action:
    """Return an abstract action that writes the sites of `trace` and reads those of `reads`."""
    return Action([*trace, *reads], trace, [], trace, label=label or f"{trace}{[*reads]}")


def edge(one: Site, other: Site) -> Action:
    """Return the action of a vehicle along an edge: it writes both ends."""
    return Action([one, other], [one, other], [one], [other], label=f"{one}-{other}")


@st.composite
def lists_of(
    draw: st.DrawFn, elements: st.SearchStrategy[T], *, min_size: int = 0, max_size: int
) -> list[T]:
    """Draw a list whose length is spread evenly: hypothesis alone rarely goes beyond ten."""
    size = draw(st.integers(min_size, max_size))
    return draw(st.lists(elements, min_size=size, max_size=size))


@st.composite
def alphabets(draw: st.DrawFn, *, max_letters: int = 6) -> Word:
    """Draw distinct abstract actions on six sites: writers, readers, and some that differ only
    in their local states."""
    letters = st.tuples(
        st.sets(st.integers(0, 5), min_size=1, max_size=2),
        st.sets(st.integers(0, 5), max_size=3),
        st.booleans(),
    )
    found: dict[Action, None] = {}
    for trace, reads, other_state in draw(st.lists(letters, min_size=2, max_size=max_letters)):
        on = sorted(reads - trace)[:1] if other_state else []
        found[Action(trace | reads, trace, on, [*on, min(trace)])] = None
    return list(found)


@st.composite
def words(draw: st.DrawFn, *, max_letters: int = 6, max_size: int = 24) -> Word:
    """Draw a word in a small alphabet, so that letters come again."""
    alphabet = draw(alphabets(max_letters=max_letters))
    return draw(lists_of(st.sampled_from(alphabet), max_size=max_size))


@st.composite
def crowded_words(draw: st.DrawFn) -> Word:
    """Draw a word in which many pieces of different levels read one site and leave it again.

    Each of five towers has two letters that make it higher and one that reads the common site.
    """
    towers = [(toggle(n), toggle(n, reads=[n + 10]), toggle(n, reads=["hub"])) for n in range(5)]
    known: Word = []
    for tower, letter in draw(
        st.lists(st.tuples(st.integers(0, 4), st.integers(0, 5)), max_size=60)
    ):
        # The reader comes more often than the rest, and so does its own undoing.
        known.append(towers[tower][min(letter, 2)])
    if draw(st.booleans()):
        known.insert(draw(st.integers(0, len(known))), toggle("hub"))
    return known


def walk(where: Scene, state: State, choices: Sequence[int]) -> tuple[Word, State]:
    """Return the walk that takes these choices among the admissible moves, and where it ends."""
    word: Word = []
    for choice in choices:
        possible = actions_at(where, state)
        word.append(possible[choice % len(possible)])
        state = apply(word[-1], state)
    return word, state


def random_walk(spec: str, moves: int, seed: int) -> Word:
    """Return a walk of the scene from its start, from a seed."""
    random = Random(seed)  # noqa: S311 - nothing secret
    return walk(scene(spec), scene(spec).start_state, [random.randrange(60) for _ in range(moves)])[
        0
    ]


_choices = st.integers(0, 59)


def walks(spec: str, *, min_size: int = 0, max_size: int = 20) -> st.SearchStrategy[Word]:
    """Draw a walk of the scene from its start."""
    where = scene(spec)
    return lists_of(_choices, min_size=min_size, max_size=max_size).map(
        lambda choices: walk(where, where.start_state, choices)[0]
    )


def linear_extensions(word: Word) -> st.SearchStrategy[Word]:
    """Draw an order of the moves in which those that do not commute keep theirs."""
    return st.randoms(use_true_random=False).map(lambda random: _reordered(word, random))


def _reordered(word: Word, random: Random) -> Word:
    left: Word = list(word)
    found: Word = []
    while left:
        free = [
            place
            for place, action in enumerate(left)
            if all(commute(action, before) for before in left[:place])
        ]
        found.append(left.pop(random.choice(free)))
    return found


@st.composite
def detours(draw: st.DrawFn, word: Word, alphabet: Word) -> Word:
    """Draw the word with a detour there and back, at any place, and then in any order."""
    place = draw(st.integers(0, len(word)))
    there = draw(st.lists(st.sampled_from(alphabet), min_size=1, max_size=8))
    return draw(linear_extensions(word[:place] + there + there[::-1] + word[place:]))


@st.composite
def walks_with_detours(draw: st.DrawFn, spec: str, word: Word) -> Word:
    """Draw the walk with a detour of admissible moves there and back, and then in any order."""
    place = draw(st.integers(0, len(word)))
    state: State = scene(spec).start_state
    for action in word[:place]:
        state = apply(action, state)
    choices = draw(st.lists(_choices, min_size=1, max_size=6))
    there, _ = walk(scene(spec), state, choices)
    return draw(linear_extensions(word[:place] + there + there[::-1] + word[place:]))


def reduced(word: Sequence[Action]) -> Word:
    """Return the word after all cancellation, by Tits' solution of the word problem.

    Two equal letters between which everything commutes with them are taken out, until there are
    none: then the word is a shortest one for its class.
    """
    found: Word = []
    for action in word:
        for place in range(len(found) - 1, -1, -1):
            if found[place] == action:
                del found[place]
                break
            if not commute(found[place], action):
                found.append(action)
                break
        else:
            found.append(action)
    return found


def class_key(word: Sequence[Action]) -> ClassKey:
    """Return a key that two words share iff they are the same path up to homotopy.

    The occurrences of letters in the reduced word, and which come before which where they do not
    commute: the word's dependence graph. It uses neither cubes nor levels.
    """
    counts: dict[Action, int] = {}
    occurrences: list[tuple[Action, int]] = []
    for action in reduced(word):
        counts[action] = counts.get(action, 0) + 1
        occurrences.append((action, counts[action]))
    return frozenset((each,) for each in occurrences) | frozenset(
        (first, second)
        for place, second in enumerate(occurrences)
        for first in occurrences[:place]
        if not commute(first[0], second[0])
    )
