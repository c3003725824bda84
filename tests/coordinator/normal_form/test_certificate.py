"""Certificates: what is built is accepted, what is wrong is refused and named, by two checkers."""

import ast
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest
from hypothesis import assume, given, settings, strategies as st
from msgspec.structs import replace

from counted_lines import lines_of
from cubepath.coordinator.normal_form.certificate import certificate_of, link
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.verification import proof as checker
from cubepath.coordinator.verification.proof import check_proof
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.certificates import (
    Certificate,
    certificate_from_json,
    companion,
    read_certificate,
    write_certificate,
)
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.numbered import number_moves
from cubepath.protocol.wire.messages import Certified, encode
from oracles.obvious import obvious_normal_form
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.strategies import (
    SCENES,
    Word,
    crowded_words,
    edge,
    random_walk,
    scene,
    toggle,
    walks,
    walks_with_detours,
    words,
)
from tampering.altered_certificates import GOOD, PATH, TAMPERINGS, WRONG, Tampering

all_words = st.one_of(words(max_size=40), crowded_words())


def judged(path: Sequence[Action], found: Certificate) -> dict[str, str | None]:
    return check_proof(path, found.cancelled, found.cubes, found.chain)


def refused(path: Sequence[Action], found: Certificate) -> dict[str, str]:
    """Return the checks that fail, with their reasons."""
    return {check: why for check, why in judged(path, found).items() if why is not None}


def obviously(path: Sequence[Action], found: Certificate) -> set[str]:
    """Return the checks that fail, by the definitions, each pair of moves looked at."""
    members = [move for part in (*found.cancelled, *found.cubes) for move in part]
    everything = list(range(1, len(path) + 1))
    if sorted(members) != everything or [] in found.cubes:
        return {"form"}
    laters = [later for _, later in found.cancelled]
    fails: set[str] = set() if laters == sorted(laters) else {"cancelled"}

    def apart(one: int, other: int) -> bool:
        return commute(path[one - 1], path[other - 1])

    cube = {move: number for number, each in enumerate(found.cubes) for move in each}
    left = sorted(cube)
    alive = set(everything)
    for first, later in sorted(found.cancelled, key=lambda pair: pair[1]):
        between = [move for move in alive if first < move < later]
        if (
            first > later
            or path[first - 1] != path[later - 1]
            or not all(apart(move, first) for move in between)
        ):
            fails.add("cancelled")
            break
        alive -= {first, later}
    for place, move in enumerate(left):
        for other in left[place + 1 :]:
            if not apart(move, other) and cube[move] >= cube[other]:
                fails.add("schedule")
            if path[move - 1] == path[other - 1] and all(
                apart(move, between) for between in left[place + 1 : left.index(other)]
            ):
                fails.add("reduced")
    links = list(pairwise(found.chain))
    if (
        len(found.chain) != len(found.cubes)
        or not set(found.chain) <= set(left)
        or any(one >= other or apart(one, other) for one, other in links)
    ):
        fails.add("chain")
    return fails


def test_the_checker_knows_actions_and_nothing_else() -> None:
    """Of the project it imports `Action`, `commute` and the name of a site."""
    tree = ast.parse(Path(checker.__file__).read_text())
    ours = [
        (node.module, {name.name for name in node.names})
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and "cubepath" in node.module
    ]
    assert ours == [
        ("cubepath.protocol.core.actions", {"Action", "commute"}),
        ("cubepath.protocol.core.sites", {"Site"}),
    ]


# What is built


@pytest.mark.slow
@given(path=all_words)
def test_what_is_built_is_accepted(path: Word) -> None:
    """The certificate of any word is accepted by both checkers, and has the known cubes."""
    found = certificate_of(path)
    assert not refused(path, found)
    assert not obviously(path, found)
    cubes = tuple(frozenset(path[move - 1] for move in cube) for cube in found.cubes)
    assert cubes == obvious_normal_form(path)
    assert [later for _, later in found.cancelled] == sorted(later for _, later in found.cancelled)


@pytest.mark.slow
@given(data=st.data())
def test_the_certificate_of_a_walk_with_detours(data: st.DataObject) -> None:
    """Of every system, with detours in it: accepted, and the cubes end where the walk does."""
    spec = data.draw(st.sampled_from(SCENES))
    word = data.draw(walks(spec, max_size=16))
    path = data.draw(walks_with_detours(spec, word))
    start = scene(spec).start_state
    found = certificate_of(path, start=start)
    assert not refused(path, found)
    assert found.cancelled
    assert found.end is not None
    assert frozenset(found.end) == end_state(path, start)
    cubes = [[path[move - 1] for move in cube] for cube in found.cubes]
    assert end_state(cubes, start) == end_state(path, start)


def test_a_schedule_that_is_not_normal_is_accepted_too() -> None:
    """A move may come later than it could: in the class, and no shorter schedule, all the same."""
    path = [edge(1, 2), edge(2, 3), edge(7, 8)]
    assert not refused(path, Certificate(3, [], [[1], [2, 3]], [1, 2]))
    assert not refused(path, Certificate(3, [], [[1, 3], [2]], [1, 2]))


def test_other_pairs_than_those_of_the_heap_are_accepted() -> None:
    """Of three equal moves the first may remain as well as the last."""
    path = [toggle(1)] * 3
    for pair, left in (((1, 2), 3), ((2, 3), 1)):
        assert not refused(path, Certificate(3, [pair], [[left]], [left]))


# What is tampered with


def test_the_one_that_is_tampered_with_is_good() -> None:
    """What the tamperings start from is a certificate, and the one that is built."""
    assert not refused(PATH, GOOD)
    assert certificate_of(PATH) == GOOD


@pytest.mark.slow
@pytest.mark.parametrize("steps", [PLAIN, COMPILED])
@settings(max_examples=40)
@given(data=st.data())
def test_a_path_in_numbers_has_the_certificate_of_its_actions(
    steps: int, data: st.DataObject
) -> None:
    """Of every system, with the end or without."""
    spec = data.draw(st.sampled_from(SCENES))
    path = data.draw(walks_with_detours(spec, data.draw(walks(spec, max_size=12))))
    start = data.draw(st.sampled_from([scene(spec).start_state, None]))
    known = number_moves(PathMove(action, move) for move, action in enumerate(path))
    with plain_steps(steps):
        found = certificate_of(known, found=cancellations(path), start=start)
    assert found == certificate_of(path, start=start)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_tampered_with_is_refused_and_named(name: str) -> None:
    """The check fails, and its reason names the moves; the obvious checker finds the same."""
    path, wrong, check, reason = WRONG[name]
    found = refused(path, wrong)
    assert found[check].startswith(reason)
    assert set(found) == obviously(path, wrong)


@pytest.mark.slow
@given(
    path=all_words,
    steps=st.lists(st.sampled_from(TAMPERINGS), max_size=3),
    random=st.randoms(use_true_random=False),
)
def test_the_obvious_checker_agrees(path: Word, steps: list[Tampering], random: Random) -> None:
    """On certificates with up to three things changed, right or wrong, the same checks fail."""
    assume(path)
    found = certificate_of(path)
    for tamper in steps:
        found = tamper(found, random)
    assert set(refused(path, found)) == obviously(path, found)


@pytest.mark.slow
@given(path=all_words, random=st.randoms(use_true_random=False))
def test_a_chain_with_a_link_missing_is_refused(path: Word, random: Random) -> None:
    """Whichever move of the chain is left out."""
    found = certificate_of(path)
    assume(found.chain)
    chain = list(found.chain)
    del chain[random.randrange(len(chain))]
    assert "chain" in refused(path, replace(found, chain=chain))


@pytest.mark.slow
@settings(max_examples=50)
@given(path=words(max_letters=4, max_size=9), cut=st.integers(1, 9))
def test_nothing_shorter_is_ever_accepted(path: Word, cut: int) -> None:
    """Whatever is merged into fewer cubes, with whatever chain: refused."""
    found = certificate_of(path)
    assume(len(found.cubes) >= 2)
    place = cut % (len(found.cubes) - 1)
    cubes = list(found.cubes)
    cubes[place : place + 2] = [[*cubes[place], *cubes[place + 1]]]
    shorter = replace(found, cubes=cubes, chain=[cube[0] for cube in cubes])
    assert "schedule" in refused(path, shorter)


# Why one waits for the other


@given(letters=words(max_letters=2, max_size=8))
def test_a_link_says_what_holds_a_move_up(letters: Word) -> None:
    """Of any two moves that do not commute it gives a site that both have and one writes."""
    for one, other in pairwise(letters):
        if commute(one, other):
            with pytest.raises(ValueError, match="commute"):
                link(one, other)
            continue
        found = link(one, other)
        assert found.site in one.support & other.support
        assert (found.before_writes, found.writes) == (
            found.site in one.trace,
            found.site in other.trace,
        )
        assert found.before_writes or found.writes


# As a file


def test_a_certificate_is_read_back(tmp_path: Path) -> None:
    """Written and read it is the same."""
    path = companion(tmp_path / "cubes.jsonl")
    end = replace(GOOD, end=[5, "dock", (0, 1)])
    write_certificate(path, end)
    read = read_certificate(path)
    assert read == end
    assert path.read_text().startswith('{"format":"cubepath-certificate-1","moves":10,')


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "truncated"),
        ("[]", "Expected `object`"),
        ('{"format":"cubepath-certificate-2"}', "format"),
        ('{"moves":0,"cancelled":[],"cubes":[],"chain":[]}', "missing required field `format`"),
        ('{"format":""}', "its format is empty"),
        ('{"format":"cubepath-certificate-1","moves":1}', "missing required field `cancelled`"),
        (
            '{"format":"cubepath-certificate-1","moves":2,"cancelled":[[1,"2"]],"cubes":[],"chain":[]}',
            r"Expected `int`, got `str` - at `\$.cancelled\[0\]\[1\]`",
        ),
        (
            '{"format":"cubepath-certificate-1","moves":2,"cancelled":[],"cubes":[[1],[2.5]],"chain":[]}',
            r"Expected `int`, got `float` - at `\$.cubes\[1\]\[0\]`",
        ),
        (
            '{"format":"cubepath-certificate-1","moves":2,"cancelled":[],"cubes":[],"chain":[true]}',
            r"Expected `int`, got `bool` - at `\$.chain\[0\]`",
        ),
        (
            '{"format":"cubepath-certificate-1","moves":3,"cancelled":[[1,2,3]],"cubes":[],"chain":[]}',
            r"`\$.cancelled\[0\]`",
        ),
    ],
)
def test_what_is_no_certificate_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    """With the file, what was found, and where in it."""
    path = tmp_path / "certificate.json"
    path.write_text(text)
    with pytest.raises(InputError, match=reason) as refusal:
        read_certificate(path)
    assert str(refusal.value).startswith(f"{path}: no cubepath-certificate-1")
    with pytest.raises(InputError, match="no cubepath-certificate-1"):
        certificate_from_json(text.encode())


# Cost


def _steps(path: Word) -> int:
    """Return how many lines checking the certificate of a path runs."""
    found = certificate_of(path)
    assert not refused(path, found)
    return lines_of(lambda: refused(path, found))


@pytest.mark.slow
def test_checking_grows_with_the_path_alone() -> None:
    """Eight times as many moves, some far from their partners: far from 64 times as long."""
    short = random_walk("agv:graph=grid3x3,n=3", 500, seed=1)
    long = random_walk("agv:graph=grid3x3,n=3", 4000, seed=1)
    assert 0 < _steps(long + long[::-1]) < 12 * _steps(short + short[::-1])


@given(words())
def test_a_certificate_for_encoding_has_the_same_text(word: Word) -> None:
    """Byte for byte, with and without the state at the end."""
    start = frozenset(site for action in word for site in action.ends[0])
    for state in (None, start):
        one, other = (
            certificate_of(word, start=state),
            certificate_of(word, start=state, as_text=True),
        )
        assert encode(one) == encode(other)
        assert encode(Certified(3, one)) == encode(Certified(3, other))
