"""Checking a certificate over arrays: the reference says the same of each, right or wrong."""

import ast
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.verification import array_proof
from cubepath.coordinator.verification.array_proof import carry_out, proves
from cubepath.coordinator.verification.certificate import check_certificate, check_numbered
from cubepath.coordinator.verification.proof import check_proof
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves
from cubepath.protocol.path_files.supports import Supports, supports_of
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.strategies import (
    SCENES,
    Word,
    crowded_words,
    edge,
    lists_of,
    scene,
    walks,
    walks_with_detours,
    words,
)
from tampering.altered_certificates import GOOD, PATH, TAMPERINGS, WRONG, Tampering

all_words = st.one_of(words(max_size=40), crowded_words())
both_ways = pytest.mark.parametrize("steps", [PLAIN, COMPILED])


def numbered(path: Sequence[Action]) -> NumberedPath:
    return number_moves(PathMove(action, move) for move, action in enumerate(path))


def accepted(path: Sequence[Action], found: Certificate) -> bool:
    """Return whether the reference accepts a certificate."""
    told = check_proof(path, found.cancelled, found.cubes, found.chain)
    return not any(told.values())


def test_the_checker_knows_what_actions_write_and_read_and_nothing_else() -> None:
    """Of the project it imports the forms of rows and certificates, and the compiler."""
    tree = ast.parse(Path(array_proof.__file__).read_text())
    ours = [
        (node.module, {name.name for name in node.names})
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and "cubepath" in node.module
    ]
    assert ours == [
        ("cubepath.protocol.compiled", {"compiled"}),
        ("cubepath.protocol.path_files.certificates", {"Certificate"}),
        ("cubepath.protocol.path_files.supports", {"FREE", "TRACE", "SupportRows", "Supports"}),
    ]


@pytest.mark.slow
@both_ways
@settings(max_examples=100)
@given(
    path=all_words,
    tampers=st.lists(st.sampled_from(TAMPERINGS), max_size=3),
    random=st.randoms(use_true_random=False),
)
def test_the_reference_agrees(
    steps: int, *, path: Word, tampers: list[Tampering], random: Random
) -> None:
    """On certificates with up to three things changed, right or wrong: accepted by both, or not."""
    found = certificate_of(path)
    for tamper in tampers if path else []:
        found = tamper(found, random)
    known = numbered(path)
    with plain_steps(steps):
        assert proves(found, known.numbers, known.supports) == accepted(path, found)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_tampered_with_is_refused(name: str) -> None:
    """Each tampering by hand, told as by the reference, and the one that it starts from is not."""
    path, wrong, check, reason = WRONG[name]
    known = numbered(path)
    assert not proves(wrong, known.numbers, known.supports)
    told = check_numbered(replace(wrong, moves=len(path)), known)
    assert str(told[check]).startswith(reason)
    assert check_numbered(GOOD, numbered(PATH)) == dict.fromkeys(
        ["form", "cancelled", "schedule", "reduced", "chain"]
    )


def chain_by_commuting(path: Word, cubes: list[list[int]]) -> list[int]:
    """Return the first move of the last cube, and down from there the first that blocks each."""
    found = cubes[-1][:1] if cubes else []
    for cube in reversed(cubes[:-1]):
        found.insert(0, next(n for n in cube if not commute(path[n - 1], path[found[0] - 1])))
    return found


@pytest.mark.slow
@both_ways
@settings(max_examples=40)
@given(data=st.data(), random=st.randoms(use_true_random=False))
def test_a_walk_is_certified_and_checked_as_by_its_actions(
    steps: int, data: st.DataObject, random: Random
) -> None:
    """Of every system, with the end, right or wrong in up to two things: the same is said."""
    spec = data.draw(st.sampled_from(SCENES))
    path = data.draw(walks_with_detours(spec, data.draw(walks(spec, max_size=12))))
    start = data.draw(st.sampled_from([scene(spec).start_state, None]))
    known, became = numbered(path), cancellations(path)
    with plain_steps(steps):
        found = certificate_of(known, found=became, start=start)
        assert found == certificate_of(path, start=start)
        assert found.chain == chain_by_commuting(path, found.cubes)
        for tamper in data.draw(lists_of(st.sampled_from(TAMPERINGS), max_size=2)):
            found = tamper(found, random)
        ends: list[list[Any] | None] = [found.end, None, [*(found.end or []), "away"]]
        found = replace(found, end=data.draw(st.sampled_from(ends)))
        begin = data.draw(st.sampled_from([start, None, frozenset({"away"})]))
        assert check_numbered(found, known, begin) == check_certificate(found, path, begin)


@both_ways
@settings(max_examples=60)
@given(data=st.data(), random=st.randoms(use_true_random=False))
def test_moves_are_carried_out_as_actions_are(
    steps: int, data: st.DataObject, random: Random
) -> None:
    """From the start of a walk with a few sites the other way: as far, and to the same state."""
    spec = data.draw(st.sampled_from(SCENES))
    path = data.draw(walks(spec, min_size=1, max_size=6))
    known = numbered(path)
    supports = known.supports
    state = set(scene(spec).start_state)
    for site in random.sample(supports.sites, data.draw(st.integers(0, 2))):
        state ^= {site}
    begin = np.array([site in state for site in supports.sites], dtype=np.int8)
    fits = True
    for action in path:
        fits = fits and why_not(action, state) is None
        if fits:
            make(action, state)
    with plain_steps(steps):
        assert carry_out(known.numbers, supports.rows, begin) is fits
    if fits:
        assert begin.tolist() == [site in state for site in supports.sites]


@both_ways
@pytest.mark.parametrize("on", range(8))
def test_free_sites_and_guards_are_heeded(steps: int, on: int) -> None:
    """Of every state of three sites: a free one may be on or off, with its neighbour if guarded."""
    step = Action([0, 1, 2], [0], [], [0], free=[1, 2], guards=[(1, 2)])
    known = numbered([step, step])
    sites = known.supports.sites
    state = {site for site in (0, 1, 2) if on >> site & 1}
    begin = np.array([site in state for site in sites], dtype=np.int8)
    before = begin.tolist()
    with plain_steps(steps):
        fits = carry_out(known.numbers, known.supports.rows, begin)
        assert fits is (why_not(step, state) is None)
    assert begin.tolist() == before


@pytest.mark.parametrize(
    "wrong",
    [
        Certificate(1, [], [[1]], [2**70]),
        Certificate(1, [], [[-(2**70)]], [1]),
        Certificate(1, [], [[1]], [2**40]),
        Certificate(1, [], [[1]], [0]),
        Certificate(1, [], [[1]], [-1]),
        Certificate(1, [(1, 2**32 + 1)], [], []),
        Certificate(2, [], [[1]], [1]),
    ],
)
def test_no_number_is_too_large_to_be_refused(wrong: Certificate) -> None:
    """Beyond 64 bits, beyond 32, or below 1: what is wrong is told as by the reference."""
    path = [edge(1, 2)]
    told = check_numbered(wrong, numbered(path))
    assert told == check_certificate(wrong, path)
    assert any(told.values())


def doubled(path: Sequence[Action]) -> tuple[NDArray[np.int32], Supports]:
    """Return a path of actions that are all taken to be different, and their rows."""
    return np.arange(len(path), dtype=np.int32), supports_of(path, [True] * len(path))


def test_one_action_under_two_numbers_is_no_proof() -> None:
    """Or else nothing would seem to cancel: in either direction, and in any order of its sites."""
    step, far = edge(1, 2), edge(3, 4)
    found = Certificate(2, [], [[1], [2]], [1, 2])
    numbers, supports = doubled([step, far])
    assert proves(Certificate(2, [], [[1, 2]], [1]), numbers, supports)
    numbers, supports = doubled([step, step])
    assert not proves(found, numbers, supports)
    says = supports.rows.says.copy()
    says[2:] = says[:2][::-1]
    assert not proves(found, numbers, Supports(supports.rows._replace(says=says), supports.sites))
    sites = supports.rows.sites.copy()
    sites[2:] = sites[:2][::-1]
    turned = supports.rows._replace(says=says, sites=sites)
    assert not proves(found, numbers, Supports(turned, supports.sites))


def test_one_site_under_two_numbers_is_no_proof() -> None:
    """Or else moves would seem to commute; nor is a site twice in one row."""
    found = Certificate(2, [], [[1, 2]], [1])
    numbers, supports = doubled([edge(1, 2), edge(3, 4)])
    assert proves(found, numbers, supports)
    assert not proves(found, numbers, Supports(supports.rows, [1, 2, 3, 1]))
    sites = supports.rows.sites.copy()
    sites[3] = sites[2]
    again = supports.rows._replace(sites=sites)
    assert not proves(found, numbers, Supports(again, supports.sites))
