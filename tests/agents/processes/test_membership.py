"""Who joins from elsewhere: who is let in, with which number, and who is forgotten."""

import pytest
from hypothesis import given, strategies as st

from cubepath.agents.processes.membership import FORGET_S, Membership, spans


def test_joiners_are_numbered_by_their_first_modules() -> None:
    """Whoever asks first; one that names itself has that number."""
    for order in (("a", "b", "c"), ("c", "a", "b")):
        roster = Membership(8, 3)
        asked = {"a": ([5, 4], None), "b": ([0], "process_1"), "c": ([3, 1], None)}
        for joiner in order:
            assert not roster.complete
            assert roster.ask(joiner, *asked[joiner], 0.0) is None
        assert (roster.complete, roster.missing, roster.free) == (True, 0, [2, 6, 7])
        assert roster.name_of("a") is None
        assert roster.number() == [[1, 3], [0], [4, 5]]
        names = ["process_2", "process_1", "process_0", None]
        assert [roster.name_of(joiner) for joiner in "abcd"] == names


@pytest.mark.parametrize(
    ("modules", "name", "reason"),
    [
        ([3, 6, 8], None, "modules 6, 8: the run has modules 0-5"),
        ([-1, 3], None, "modules -1: the run has modules 0-5"),
        ([], None, "modules none: the run has modules 0-5"),
        ([3, 3], None, "modules: one is named twice"),
        ([5, 1, 0], None, "modules 0-1: taken by another process"),
        ([3], "process_2", "process_2: those that join are process_0 to process_1"),
        ([3], "process_0", "process_0: there already"),
        ([], "keeper_0", "keeper_0: the run has no keepers"),
    ],
)
def test_who_is_refused_is_told_why_and_changes_nothing(
    modules: list[int], name: str | None, reason: str
) -> None:
    """The place stays free for another."""
    roster = Membership(6, 2)
    assert roster.ask("first", [0, 1, 2], "process_0", 0.0) is None
    assert roster.ask("other", modules, name, 0.0) == reason
    assert (roster.missing, roster.free) == (1, [3, 4, 5])
    assert roster.ask("another", [3], "process_1", 0.0) is None
    assert roster.ask("late", [4], None, 0.0) == "the run waits for 2 processes, and they are there"
    roster.number()
    line = "the run has begun, and no place in it is free"
    assert roster.ask("late", [4], None, 0.0) == line
    assert roster.ask("first", [0, 1, 2], "process_0", 0.0) is None


def test_keepers_join_beside_processes_which_leave_no_gap_in_their_numbers() -> None:
    """A process has no number that a keeper makes impossible, and the other way round."""
    roster = Membership(6, 3, keepers=2)
    assert roster.ask("k", [], "keeper_1", 0.0) is None
    assert roster.ask("l", [], "keeper_1", 0.0) == "keeper_1: there already"
    assert roster.ask("l", [], "keeper_2", 0.0) == "keeper_2: the run has keeper_0 to keeper_1"
    last = "process_2: those that join are process_0 to process_1"
    assert roster.ask("p", [0], "process_2", 0.0) == last
    assert roster.ask("p", [0], "process_1", 0.0) is None
    last = "process_1: those that join are process_0 to process_0"
    assert roster.ask("l", [], "keeper_0", 0.0) == last
    assert roster.ask("q", [3, 2], None, 0.0) is None
    assert roster.number() == [[2, 3], [0]]
    assert roster.names == ["keeper_1", "process_0", "process_1"]
    assert [roster.name_of(joiner) for joiner in "kpq"] == ["keeper_1", "process_1", "process_0"]


def test_the_place_of_one_that_has_left_is_for_one_that_asks_alike() -> None:
    """By its name or by its modules; the one before is unknown from then on."""
    roster = Membership(4, 2, keepers=1)
    assert roster.ask("p", [0, 1], None, 0.0) is None
    assert roster.ask("k", [], "keeper_0", 0.0) is None
    roster.number()
    line = "the run has begun, and no place in it is free"
    assert roster.ask("new", [0, 1], None, 0.0) == line
    roster.vacant = {"process_0": [0, 1], "keeper_1": []}
    line = "the run has begun, expected the place of process_0 (0-1), keeper_1"
    assert roster.ask("new", [0], None, 0.0) == line
    assert roster.ask("new", [], "keeper_0", 0.0) == line
    assert roster.ask("new", [1, 0], None, 0.0) is None
    assert [roster.name_of(joiner) for joiner in ("p", "new")] == [None, "process_0"]
    line = "the run has begun, expected the place of keeper_1"
    assert roster.ask("p", [], "process_0", 0.0) == line
    roster.vacant = {"process_0": [0, 1]}
    assert roster.ask("p", [], "process_0", 0.0) is None
    roster.leave("process_0")
    assert roster.name_of("p") is None


def test_who_asks_no_more_is_forgotten_until_the_run_begins() -> None:
    """Its modules are free again; asking again counts, whatever else it would say."""
    roster = Membership(4, 2)
    assert roster.ask("gone", [0], None, 0.0) is None
    assert roster.ask("stays", [1], None, 0.0) is None
    assert roster.ask("stays", [1], None, FORGET_S) is None
    roster.forget(FORGET_S)
    assert (roster.missing, roster.free) == (1, [0, 2, 3])
    assert roster.ask("gone", [0, 2], None, FORGET_S) is None
    assert roster.number() == [[0, 2], [1]]
    roster.forget(10 * FORGET_S)
    assert roster.complete


@given(st.sets(st.integers(0, 40)))
def test_spans_name_the_modules_and_no_others(modules: set[int]) -> None:
    """As one would write them on the command line, with a space after each comma."""
    text = spans(sorted(modules))
    found: list[int] = []
    for part in text.split(", ") if text else []:
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    assert found == sorted(modules)
    assert ", ".join(text.split(", ")) == text
