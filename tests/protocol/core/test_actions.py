"""Actions: the definition of a generator, equality, admissibility, applying, commuting."""

import pickle
import re
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, strategies as st

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


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Action({-1, 3}, {3}, {3}, ()), Action({-2, 3}, {3}, {3}, ())),
        (Action({-1, -2, 3}, {-1, 3}, {3}, ()), Action({-1, -2, 3}, {-2, 3}, {3}, ())),
        (Action({-1, -2, 3}, {3}, {-1, 3}, {-1}), Action({-1, -2, 3}, {3}, {-2, 3}, {-2})),
        (
            Action({-1, -2, 3}, {3}, {3}, (), free={-1}),
            Action({-1, -2, 3}, {3}, {3}, (), free={-2}),
        ),
        (
            Action({-1, -2, 3, 4}, {3}, {3}, (), guards={(-1, 4)}),
            Action({-1, -2, 3, 4}, {3}, {3}, (), guards={(-2, 4)}),
        ),
    ],
)
def test_equal_hashes_do_not_make_equal_actions(one: Action, other: Action) -> None:
    """Python hashes -1 and -2 alike, so that here only contents tell two actions apart."""
    assert hash(one) == hash(other)
    assert one != other


def test_an_action_equals_itself_and_nothing_that_is_none() -> None:
    """The same object is equal, and what is no action is not."""
    same = STEP
    assert (same == STEP) is True
    assert STEP != "step"
    assert STEP not in (None, "step", 1)


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


@pytest.mark.parametrize("kind", [frozenset, set, "keys"])
def test_a_state_may_be_any_set(kind: Any) -> None:
    """Frozen or not, or the keys of a table: the same end is shown, with what is beside it."""
    for on, end in (({"a"}, 0), ({"b", 7}, 1), ({"a", "b"}, None), ({7}, None)):
        state = dict.fromkeys(on).keys() if kind == "keys" else kind(on)
        assert end_at(STEP, state) == end


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({"a"}, {"a", "b"}, {"a"}, set()), "the trace holds 'b'"),
        (({"a", "b"}, set(), {"a"}, {"b"}), "the trace is empty"),
        (({"a", "b"}, {"a"}, {"a"}, {"b"}), "differ at 'b'"),
        (({"a", "b"}, {"a"}, {"b"}, {"b"}), "two local states are equal"),
        (({"a", "b"}, {"a", "b"}, {"a"}, {"c"}), "a local state holds 'c'"),
        (({"a", "b"}, {"a", "b"}, {"c"}, {"a"}), "a local state holds 'c'"),
        (({"a"}, {"a", "d", "c"}, {"a"}, set()), "the trace holds 'c', which is not in the"),
        (({*"abcd"}, {"a"}, {*"acd"}, {"b"}), "an action: the local states differ at 'b', which"),
    ],
)
def test_what_contradicts_the_definition_is_refused(
    arguments: tuple[set[str], set[str], set[str], set[str]], message: str
) -> None:
    """A generator that is none is refused with the site that shows it."""
    with pytest.raises(InputError, match=message):
        Action(*arguments)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"free": {"y", "x"}}, "step: the free sites holds 'x', which is not in the support"),
        ({"guards": {("c", "x")}}, "step: a guard holds 'x', which is not in the support"),
        ({"guards": {("x", "c")}}, "step: a guard holds 'x', which is not in the support"),
        ({"free": {"b", "a"}}, "step: site 'a' is free and in the trace or a local state"),
        ({"free": {"A", "b"}}, "step: site 'b' is free and in the trace or a local state"),
        ({"guards": {("A", "b")}}, "step: guard site 'b' is in the trace, so undoing could fail"),
        ({"free": {"on"}}, "step: site 'on' is free and in the trace or a local state"),
        ({"guards": {("b", "a")}}, "step: guard site 'a' is in the trace, so undoing could fail"),
    ],
)
def test_conditions_that_contradict_the_definition_are_refused(
    conditions: dict[str, Any], message: str
) -> None:
    """What is free lies in the support, off the trace and the local states; guards off the trace.

    Of several sites the first in canonical order is named.
    """
    with pytest.raises(InputError, match=f"^{message}$"):
        Action({*"Aabc", "on"}, {"a", "b"}, {"a", "on"}, {"b", "on"}, label="step", **conditions)


WIDE = Action(
    {*"abcfgh"}, {*"abc"}, {"a"}, {"b", "c"}, free={*"fgh"}, guards={("g", "h"), ("f", "h")}
)


@pytest.mark.parametrize(
    ("action", "state", "said"),
    [
        (STEP, set[Site](), "step is not admissible: site 'a' is off, expected on"),
        (STEP, {"a", "b"}, "step is not admissible: site 'b' is on, expected off"),
        (STEP, {"a", "z"}, "step is admissible"),
        # The local state that is nearest, and what is free is none of the misfits.
        (WIDE, {"c"}, "Action(('a', 'b', 'c')) is not admissible: site 'b' is off, expected on"),
        (
            WIDE,
            {*"acfh"},
            "Action(('a', 'b', 'c')) is not admissible: site 'c' is on, expected off",
        ),
        (
            WIDE,
            {*"afg"},
            "Action(('a', 'b', 'c')) is not admissible: site 'f' is on, so 'h' must be on",
        ),
        (
            WIDE,
            {*"bcg"},
            "Action(('a', 'b', 'c')) is not admissible: site 'g' is on, so 'h' must be on",
        ),
        (WIDE, {*"bcgh"}, "Action(('a', 'b', 'c')) is admissible"),
    ],
)
def test_what_is_in_the_way_is_said(action: Action, state: set[Site], said: str) -> None:
    """The first site of the nearest local state, else the first guard, in canonical order."""
    assert why_inadmissible(action, state) == said
    assert admissible(action, state) == said.endswith("is admissible")
    if not admissible(action, state):
        with pytest.raises(InputError, match=re.escape(said)):
            apply(action, state)


def test_guards_are_looked_at_in_the_order_of_their_texts() -> None:
    """Also where sites are of kinds that cannot be compared."""
    guards: list[tuple[Site, Site]] = [(7, "h"), ("f", "h"), ((1, 2), "h")]
    action = Action(
        {"a", "b", "h", *(site for site, _ in guards)},
        {"a", "b"},
        {"a"},
        {"b"},
        free={"h", *(site for site, _ in guards)},
        guards=guards,
    )
    state: set[Site] = {"a", 7, "f", (1, 2)}
    for named in ("'f'", "7", "(1, 2)"):
        assert f"site {named} is on, so 'h' must be on" in why_inadmissible(action, state)
        state.remove({"'f'": "f", "7": 7, "(1, 2)": (1, 2)}[named])


def test_which_of_the_two_local_states_is_shown() -> None:
    """Their place in `ends`, which has nothing to do with which was given first."""
    assert STEP.ends == (frozenset("a"), frozenset("b"))
    assert [end_at(STEP, state) for state in ({"a"}, {"b"}, {"a", "b"}, set[Site]())] == [
        0,
        1,
        None,
        None,
    ]


sites = st.sets(st.integers(0, 6), min_size=1)


@given(st.sets(st.integers(0, 6)), st.sets(st.integers(0, 6)))
def test_an_action_is_its_own_reverse(before: set[int], after: set[int]) -> None:
    """Which local state is given first makes no difference, whatever else is on in both."""
    if before != after:
        there = Action(before | after, before ^ after, before, after)
        back = Action(before | after, before ^ after, after, before)
        assert (there, there.ends, hash(there)) == (back, back.ends, hash(back))


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
    for action in (STEP, WIDE, WIDE.labelled("wide")):
        again = pickle.loads(pickle.dumps(action))  # noqa: S301 - our own bytes
        assert again == action
        assert (again.label, again.reads) == (action.label, action.reads)
        assert end_at(again, {"a"}) == end_at(action, {"a"}) is not None
