"""Unit propagation: solvers' refutations are accepted, and nothing is refuted that has a model."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.theory.proof_checking.unit_propagation import Refuter
from oracles.obvious_refutations import log_of

Clauses = list[list[int]]


@st.composite
def clause_lists(draw: st.DrawFn) -> Clauses:
    """Draw clauses over a few variables, about as many as make half of the lists refutable."""
    count = draw(st.integers(2, 6))
    literal = st.integers(1, count).flatmap(lambda each: st.sampled_from([each, -each]))
    clause = st.lists(literal, min_size=1, max_size=4, unique_by=abs)
    return draw(st.lists(clause, min_size=2, max_size=6 * count))


def coded(literal: int) -> int:
    return 2 * abs(literal) + (literal < 0)


def refuter(clauses: Clauses) -> Refuter:
    literals = np.array([coded(each) for clause in clauses for each in clause], dtype=np.int32)
    ends = np.cumsum([len(clause) for clause in clauses], dtype=np.int64)
    return Refuter(most(clauses), literals, ends)


def most(clauses: Clauses) -> int:
    return max(abs(each) for clause in clauses for each in clause)


def models(clauses: Clauses) -> list[tuple[bool, ...]]:
    return [
        values
        for values in product((False, True), repeat=most(clauses))
        if all(any(values[abs(each) - 1] == (each > 0) for each in clause) for clause in clauses)
    ]


def lemma(kind: str, literals: list[int]) -> bytes:
    return bytes([ord(kind), *map(coded, literals), 0])


@given(clauses=clause_lists(), piece=st.integers(1, 9))
def test_logs_of_a_solver_are_accepted(clauses: Clauses, piece: int) -> None:
    """Clauses without a model are refuted by the log of a solver, in pieces of any length."""
    log = log_of(most(clauses), clauses)
    assert (log is None) == bool(models(clauses))
    if log is None:
        assert not refuter(clauses).refuted
        return
    checker = refuter(clauses)
    for begin in range(0, len(log), piece):
        assert checker.check(log[begin : begin + piece]) is None
    assert checker.refuted
    assert not checker.cut_off() or checker.refuted


@given(
    clauses=clause_lists(),
    log=st.lists(st.tuples(st.sampled_from("aad"), st.integers(0, 2**30)), max_size=12),
)
def test_no_log_refutes_what_has_a_model(clauses: Clauses, log: list[tuple[str, int]]) -> None:
    """Lemmas that are accepted hold in every model; deletions, of units too, change nothing."""
    checker, all_models = refuter(clauses), models(clauses)
    for kind, seed in log:
        numbers = [1 + seed // 7**place % most(clauses) for place in range(1 + seed % 3)]
        literals = [each if seed >> each & 1 else -each for each in numbers]
        if kind == "d":
            literals = clauses[seed % len(clauses)]
        if checker.check(lemma(kind, literals)) is not None:
            break
        if kind == "a" and not checker.refuted:
            assert all(
                any(values[abs(each) - 1] == (each > 0) for each in literals)
                for values in all_models
            )
    assert not (checker.refuted and all_models)


def test_what_is_deleted_is_not_used() -> None:
    """Without a clause that it needs a lemma does not follow; a unit is kept, as in drat-trim."""
    clauses = [[1, 2], [1, -2], [-1, 3], [-1, -3]]
    assert refuter(clauses).check(lemma("a", [1])) is None
    deleting = refuter(clauses)
    assert deleting.check(lemma("d", [-2, 1])) is None
    said = deleting.check(lemma("a", [1]))
    assert said == "lemma 1 of the log does not follow by unit propagation"
    units = refuter([[1], [-1, 2], [-2, 3, 4]])
    assert units.check(lemma("d", [1])) is None
    assert units.check(lemma("a", [2])) is None


def test_a_clause_that_stands_twice_is_deleted_once() -> None:
    """Of equal clauses one is left after a deletion, and none after two."""
    clauses = [[1, 2], [2, 1], [1, -2], [3, 4]]
    once = refuter(clauses)
    assert once.check(lemma("d", [1, 2]) + lemma("a", [1])) is None
    twice = refuter(clauses)
    assert twice.check(2 * lemma("d", [1, 2]) + lemma("a", [1])) is not None


@pytest.mark.parametrize(
    ("log", "why"),
    [
        (b"x\x02\x00", "byte 0 of the log is neither"),
        (b"d\x02\x04\x00x", "byte 4 of the log is neither"),
        (b"a\x01\x00", "lemma 1 of the log has a literal of no variable"),
        (b"a\x0a\x00", "lemma 1 of the log has a literal of no variable"),
        (b"a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01\x00", "literal of no variable"),
        (b"a\x00", "lemma 1 of the log does not follow"),
    ],
)
def test_malformed_logs_are_refused(log: bytes, why: str) -> None:
    """What is no record, or names no variable, is refused with its place."""
    assert why in str(refuter([[1, 2], [-1, 3], [4, 1]]).check(log))


def test_an_empty_clause_refutes_at_once() -> None:
    """Clauses with an empty one, or with a unit and its opposite, need no log."""
    assert Refuter(0, np.zeros(0, dtype=np.int32), np.zeros(1, dtype=np.int64)).refuted
    assert refuter([[1], [-1]]).refuted
    assert refuter([[1], [-1, 2], [-2, 3], [-3, -1]]).refuted
    assert not Refuter(0, np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int64)).refuted


def test_lemmas_with_a_literal_twice() -> None:
    """A literal that stands twice counts once, and a tautology holds but adds nothing."""
    clauses = [[1, 2], [1, -2], [-1, 3], [-1, -3, 4], [-4, 1]]
    checker = refuter(clauses)
    assert checker.check(lemma("a", [5 - 1, -4])) is None
    assert checker.check(lemma("a", [1, 1])) is None
    assert checker.lemmas == 2
    assert checker.check(lemma("a", [4, 4, 2])) is None
    assert not checker.refuted
