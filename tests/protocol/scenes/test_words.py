"""Words under their relations: the complexes are those of rewriting strings."""

from itertools import combinations

import numpy as np
import pytest

from cubepath.agents.environments.world import World
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.families.words import PRESENTATIONS, relations_from_text, word_moves
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.listed import TabledSystem
from oracles.complexes import actions_at, f_vector, states_of

SPECS = [
    "words",
    "words:presentation=raag",
    "words:presentation=free2,word=aAbB",
    "words:relations=ab~ba+abc~adc,word=abcabc",
    "words:presentation=braid4,relations=ab~ca,word=abacb",
]


def word_of(state: State) -> str:
    """Return the word that a state spells, checking that it has one letter at each position."""
    letters: dict[int, str] = dict(state)  # type: ignore[arg-type]
    assert len(letters) == len(state)
    return "".join(letters[place] for place in range(len(letters)))


def relations_of(spec: str) -> list[tuple[str, str]]:
    system = scene_from_spec(spec).system
    assert isinstance(system, TabledSystem)
    names = dict.fromkeys(move.generator for move in system.listed)
    return [(left, right) for name in names for left, right in [name.split("~")]]


def steps(word: str, relations: list[tuple[str, str]]) -> list[tuple[int, str, str]]:
    """Return where which side of a relation stands in the word, and the other side."""
    return [
        (begin, one, other)
        for left, right in relations
        for one, other in ((left, right), (right, left))
        for begin in range(len(word))
        if word.startswith(one, begin)
    ]


def rewritten(word: str, step: tuple[int, str, str]) -> str:
    begin, one, other = step
    return word[:begin] + other + word[begin + len(one) :]


def class_of(word: str, relations: list[tuple[str, str]]) -> set[str]:
    found, queue = {word}, [word]
    for known in queue:
        for step in steps(known, relations):
            after = rewritten(known, step)
            if after not in found:
                found.add(after)
                queue.append(after)
    return found


def apart(one: tuple[int, str, str], other: tuple[int, str, str]) -> bool:
    """Tell whether neither rewriting changes a position that the other reads."""

    def read(step: tuple[int, str, str]) -> set[int]:
        return set(range(step[0], step[0] + len(step[1])))

    def changed(step: tuple[int, str, str]) -> set[int]:
        return {
            step[0] + k for k, pair in enumerate(zip(*step[1:], strict=True)) if len({*pair}) > 1
        }

    return not (changed(one) & read(other) or changed(other) & read(one))


@pytest.mark.parametrize("spec", SPECS)
def test_states_edges_and_squares_are_those_of_strings(spec: str) -> None:
    """States are the words that rewriting reaches; rewritings that are apart span squares."""
    scene = scene_from_spec(spec)
    relations = relations_of(spec)
    words = class_of(word_of(scene.start_state), relations)
    assert {word_of(state) for state in states_of(scene)} == words
    edges = sum(len(steps(word, relations)) for word in words)
    pairs = sum(
        apart(one, other)
        for word in words
        for one, other in combinations(steps(word, relations), 2)
    )
    counts = f_vector(scene)
    assert counts[:3] == [len(words), edges // 2, pairs // 4]


def test_the_half_twist_on_four_strands() -> None:
    """Sixteen words, as the longest element of the symmetric group on four letters has."""
    assert f_vector(scene_from_spec("words")) == [16, 18, 2]


def test_words_that_only_commute_make_a_contractible_complex_in_numbers() -> None:
    """The words of one trace are the linear extensions of an order: Euler characteristic 1."""
    counts = f_vector(scene_from_spec("words:presentation=raag"))
    assert sum((-1) ** k * count for k, count in enumerate(counts)) == 1


def test_the_free_group_keeps_the_element() -> None:
    """All words that are reached are equal in the free group, and the empty one is among them."""

    def reduced(word: str) -> str:
        found = ""
        for letter in word.replace("_", ""):
            found = found[:-1] if found[-1:] == letter.swapcase() else found + letter
        return found

    for word, element, room in (("aAbB", "", True), ("abA_", "abA", False), ("_ab_", "ab", False)):
        scene = scene_from_spec(f"words:presentation=free2,word={word}")
        words = {word_of(state) for state in states_of(scene)}
        assert {reduced(each) for each in words} == {element}
        assert ("____" in words) == room


def test_a_letter_that_is_read_and_kept_is_in_the_support_alone() -> None:
    """Support are both sides' letters, trace those at positions that change."""
    (move,) = word_moves(3, [("abc", "adc")])
    assert move.action.support == {(0, "a"), (1, "b"), (1, "d"), (2, "c")}
    assert move.action.trace == {(1, "b"), (1, "d")}
    assert move.motion == (((1, "b"), (1, "d")),)


def test_the_leftmost_position_that_changes_proposes() -> None:
    """The mover is the first, and the others are taken along from letter to letter."""
    (move,) = word_moves(3, [("abc", "acb")])
    assert move.motion == (((1, "b"), (1, "c")), ((2, "c"), (2, "b")))
    assert (move.generator, move.at) == ("abc~acb", 0)


@pytest.mark.slow
@pytest.mark.parametrize("title", PRESENTATIONS)
def test_random_positions_keep_a_word_of_the_class(title: str) -> None:
    """After every round there is a word that rewriting reaches, and the goal is one."""
    spec = f"words:presentation={title}"
    scene = scene_from_spec(spec)
    known = {frozenset(state) for state in states_of(scene)}
    assert scene.goal in known
    world, random = World(scene, seed=2), np.random.default_rng(2)
    for _ in range(20):
        masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
        world.step({m: int(random.choice(k.nonzero()[0])) for m, k in enumerate(masks)})
        assert frozenset(world.sites) in known


def test_a_position_sees_whether_it_has_its_letter() -> None:
    """The flag of the own site is 1 where the letter is that of the goal."""
    scene = scene_from_spec("words:word=abacba,goal=cbcabc")
    world = World(scene, seed=0)
    flags = [int(world.observe(place)["observation"][2]) for place in range(6)]
    assert flags == [0, 1, 0, 0, 1, 0]


def test_no_move_is_possible_that_no_string_shows() -> None:
    """At every state there are as many admissible moves as places where a side stands."""
    for spec in SPECS:
        scene = scene_from_spec(spec)
        for state in states_of(scene, 50):
            assert len(actions_at(scene, state)) == len(steps(word_of(state), relations_of(spec)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ab~b", "relation ab~b: sides of 2 and 1 letters, expected equal lengths"),
        ("ab", "relation 'ab': expected two words, as in ab~ba"),
        ("~ab", "relation '~ab': expected two words"),
        ("ab~ba~ab", "expected two words"),
        ("ab~ab", "relation ab~ab: both sides are the same"),
        ("ab~ba+ba~ab", "relation ba~ab: stands twice"),
        ("ab~ba+", "relation '': expected two words"),
    ],
)
def test_relations_that_are_refused(text: str, message: str) -> None:
    """Each is named with what was expected."""
    with pytest.raises(InputError, match=message):
        relations_from_text(text)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("words:word=abz", "word=abz: letter 'z' is in no relation, expected a, b, c"),
        ("words:word=aba,goal=abz", "goal=abz: letter 'z' is in no relation"),
        ("words:word=aba,goal=ab", "goal=ab: 2 letters, the word has 3"),
        ("words:presentation=klein", "presentation=klein: expected one of braid4, raag, free2"),
        ("words:relations=aba~bab,word=ab", "word=ab: shorter than every relation"),
        ("words:word=" + "ab" * 501, "word of 1002 letters, expected at most 1000"),
    ],
)
def test_specs_that_are_refused(spec: str, message: str) -> None:
    """Each mistake in a key is named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)
