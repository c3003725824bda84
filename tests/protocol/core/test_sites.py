"""Sites from JSON: what is one, and how deep lists may be nested."""

from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import (
    DEPTH_MAX,
    Site,
    in_order,
    site_from_json,
    site_hook,
    site_text,
)


def nested(depth: int) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


def test_lists_are_nested_so_deep_at_most() -> None:
    """The deepest that are taken can be ordered, hashed and written; one more is refused."""
    deepest = site_from_json(nested(DEPTH_MAX))
    assert in_order({deepest, 1}) == (1, deepest)
    assert site_text(deepest).count("[") == DEPTH_MAX
    for depth in (DEPTH_MAX + 1, 500, 100_000):
        with pytest.raises(InputError, match="lists in lists 64 deep at most, found more"):
            site_from_json(nested(depth))


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (None, "null"),
        ({}, "{}"),
        ([1, [None]], "null"),
        ([{"a": 1}], "{'a': 1}"),
        (True, "true"),
        ([1, [False]], "false"),
    ],
)
def test_what_names_no_place(value: Any, found: str) -> None:
    """Null, objects, and booleans, which Python takes for 0 and 1, at any depth."""
    with pytest.raises(InputError, match=f"JSON number, string or list, found {found}$"):
        site_from_json(value)


def test_a_decoder_with_the_hook_reads_sites_or_names_the_field() -> None:
    """Sites in lists too, in their one spelling; null, which the type allows, stays null."""
    decoder = msgspec.json.Decoder(dict[str, list[Site | None]], dec_hook=site_hook)
    assert decoder.decode(b'{"to": [[[0, 1.0], "x"], 2.0, null]}') == {
        "to": [((0, 1), "x"), 2, None]
    }
    expected = r"a site is a JSON number, string or list, found true - at `\$\[...\]\[1\]`$"
    with pytest.raises(msgspec.ValidationError, match=expected):
        decoder.decode(b'{"to": [1, true]}')


ALIKE = (
    st.integers(-20, 20),
    st.text(max_size=2),
    st.tuples(st.integers(-20, 20), st.integers(-20, 20)),
    st.lists(st.integers(-9, 9), max_size=3).map(tuple),
    st.lists(st.tuples(st.integers(-9, 9), st.text(max_size=1)), max_size=2).map(tuple),
)


def rank(site: Site) -> tuple[object, ...]:
    """Numbers before texts before tuples, and tuples item by item."""
    if isinstance(site, tuple):
        return (2, [rank(item) for item in site])
    return (isinstance(site, str), site)


@given(st.one_of(*map(st.lists, ALIKE), st.lists(st.one_of(*ALIKE, st.floats(-2, 2)), max_size=6)))
def test_the_order_is_that_of_content_whatever_sites_are_mixed(sites: list[Site]) -> None:
    """Sites of one kind, of several, and tuples of several lengths and depths."""
    assert list(in_order(sites)) == sorted(sites, key=rank)
