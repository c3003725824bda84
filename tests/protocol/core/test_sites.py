"""Sites from JSON: what is one, and how deep lists may be nested."""

from __future__ import annotations

from typing import Any

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import DEPTH_MAX, in_order, site_from_json, site_text


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


@pytest.mark.parametrize("value", [None, {}, [1, [None]], [{"a": 1}]])
def test_what_names_no_place(value: Any) -> None:
    """Null and objects, at any depth."""
    with pytest.raises(InputError, match="a site is a JSON number, string or list"):
        site_from_json(value)
