"""Actions: the definition of a generator, equality, admissibility, applying, commuting."""

import pickle
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cubepath.protocol.core.actions import (
    Action,
    admissible,
    apply,
    apply_in_place,
    commute,
    end_at,
    why_inadmissible,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site

STEP = Action({"a", "b"}, {"a", "b"}, {"a"}, {"b"}, label="step")


def test_local_states_are_an_unordered_pair() -> None:
    """An action equals its reverse, whatever it is called, and has the same hash."""
    back = Action({"a", "b"}, {"a", "b"}, {"b"}, {"a"}, label="back")
    assert back == STEP
    assert hash(back) == hash(STEP)


@pytest.mark.parametrize(
    "other",
    [
        Action({"a", "b", "c"}, {"a", "b"}, {"a"}, {"b"}),
        Action({"a", "b", "c"}, {"a", "b"}, {"a", "c"}, {"b", "c"}),
        Action({"a", "b", "c"}, {"a", "b", "c"}, {"a"}, {"b"}),
        Action({"a", "b", "c"}, {"a", "b"}, {"a"}, {"b"}, free={"c"}),
        Action({"a", "b"}, {"a", "b"}, {"a", "b"}, set()),
    ],
)
def test_contents_decide_equality(other: Action) -> None:
    """Another support, trace, local state or condition makes another action."""
    assert other != STEP


def test_guards_are_part_of_what_an_action_is() -> None:
    """With other guards, or with none, it is another action, with another hash."""
    plain, guarded, other = (
        Action([1, 2, 3, 4], [1, 2], [1], [2], free=[3, 4], guards=guards)
        for guards in ([], [(3, 4)], [(4, 3)])
    )
    assert len({plain, guarded, other}) == 3
    assert len({hash(plain), hash(guarded), hash(other)}) == 3
    assert plain != guarded != other != plain


def test_another_label_is_the_same_action() -> None:
    """With all that it knows, and the first keeps its own."""
    action = Action({"a", "b", "c"}, {"a"}, {"a"}, set(), free={"b"}, guards={("b", "c")})
    other = action.labelled("other")
    assert other == action
    assert (action.label, other.label) == ("", "other")
    assert {name: getattr(other, name) for name in Action.__slots__ if name != "label"} == {
        name: getattr(action, name) for name in Action.__slots__ if name != "label"
    }


def test_an_action_is_its_own_inverse() -> None:
    """Applying an action twice gives the state back."""
    assert apply(STEP, {"a", "z"}) == {"b", "z"}
    assert apply(STEP, apply(STEP, {"a", "z"})) == {"a", "z"}


def test_only_the_support_is_looked_at() -> None:
    """Admissibility and application cost the support, not the state."""
    looked: list[object] = []

    class Watched(set[Site]):
        def __contains__(self, site: object) -> bool:
            looked.append(site)
            return super().__contains__(site)

        def __iter__(self) -> Iterator[Site]:
            raise AssertionError("the whole state was read")

    state = Watched({"a", *range(1000)})
    assert admissible(STEP, state)
    apply_in_place(STEP, state)
    assert set(looked) == {"a", "b"}
    assert len(looked) <= 4


def test_a_guard_lets_a_free_site_be_on_only_beside_its_neighbour() -> None:
    """Free, but if on then so is the one that the arrow points to."""
    guarded = Action(
        {"a", "b", "over", "next"},
        {"a", "b"},
        {"a"},
        {"b"},
        free={"over", "next"},
        guards={("over", "next")},
    )
    assert admissible(guarded, {"a"})
    assert admissible(guarded, {"a", "next"})
    assert admissible(guarded, {"a", "over", "next"})
    assert not admissible(guarded, {"a", "over"})
    assert "so 'next' must be on" in why_inadmissible(guarded, {"a", "over"})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({"a"}, {"a", "b"}, {"a"}, set()), "the trace holds 'b'"),
        (({"a", "b"}, set(), {"a"}, {"b"}), "the trace is empty"),
        (({"a", "b"}, {"a"}, {"a"}, {"b"}), "differ at 'b'"),
        (({"a", "b"}, {"a"}, {"b"}, {"b"}), "two local states are equal"),
        (({"a", "b"}, {"a", "b"}, {"a"}, {"c"}), "a local state holds 'c'"),
    ],
)
def test_what_contradicts_the_definition_is_refused(
    arguments: tuple[set[str], set[str], set[str], set[str]], message: str
) -> None:
    """A generator that is none is refused with the site that shows it."""
    with pytest.raises(InputError, match=message):
        Action(*arguments)


def test_a_guard_may_not_lie_in_the_trace() -> None:
    """A guard in the trace could hold before and fail after, so the move could not be undone."""
    with pytest.raises(InputError, match="guard site 'a'"):
        Action({"a", "b"}, {"a", "b"}, {"a"}, {"b"}, guards={("a", "b")})


def test_a_misfit_is_named() -> None:
    """Applying where not admissible says which site is not as it must be."""
    with pytest.raises(InputError, match="site 'a' is off, expected on"):
        apply(STEP, set())


sites = st.sets(st.integers(0, 6), min_size=1)


@given(sites, sites, sites, sites)
def test_commuting_is_trace_against_support(
    support_1: set[int], support_2: set[int], trace_1: set[int], trace_2: set[int]
) -> None:
    """Two actions commute iff no trace meets the other's support; symmetric, never with itself."""
    one = Action(support_1 | trace_1, trace_1, trace_1, set())
    two = Action(support_2 | trace_2, trace_2, trace_2, set())
    meets = trace_1 & (support_2 | trace_2) or trace_2 & (support_1 | trace_1)
    assert commute(one, two) == (not meets)
    assert commute(one, two) == commute(two, one)
    assert not commute(one, one)


@given(sites, sites, st.sets(st.integers(0, 6)))
def test_commuting_actions_apply_in_either_order(
    trace_1: set[int], trace_2: set[int], state: set[int]
) -> None:
    """What commutes and is admissible can be applied in any order, with the same result."""
    one = Action(trace_1 | {7}, trace_1, trace_1, set())
    two = Action(trace_2 | {7}, trace_2, trace_2, set())
    if commute(one, two) and admissible(one, state) and admissible(two, state):
        assert apply(two, apply(one, state)) == apply(one, apply(two, state))


def test_pickling_keeps_equality() -> None:
    """An action that went to another process is still equal."""
    again = pickle.loads(pickle.dumps(STEP))  # noqa: S301 - our own bytes
    assert again == STEP
    assert end_at(again, {"a"}) == end_at(STEP, {"a"})
