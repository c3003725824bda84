"""Documents as text in a page: they come back, and no name in them can break out."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.tools.viewing.pages import pack, unpack

numbers = st.lists(st.integers(-(2**31), 2**32 - 1).filter(lambda n: -(2**31) <= n < 2**31))


@given(st.dictionaries(st.text(), st.text() | st.integers(-9, 9) | st.none()), numbers)
def test_what_is_packed_comes_back(document: dict[str, Any], listed: list[int]) -> None:
    """Whatever the texts hold, and whichever type has room for the numbers."""
    whole = document | {"numbers": np.array(listed, np.int64)}
    text = pack(whole)
    assert re.fullmatch(r"[A-Za-z0-9+/=]+", text)
    assert unpack(text) == document | {"numbers": listed}


@pytest.mark.parametrize(
    ("listed", "kind"),
    [([0, 255], "u1"), ([256], "u2"), ([2**16], "u4"), ([-1], "i4"), ([0.5], "f4"), ([], "u1")],
)
def test_numbers_take_the_least_room(listed: list[float], kind: str) -> None:
    """A page of many moves is small."""
    from base64 import b64decode
    from zlib import decompress

    text = pack({"numbers": np.array(listed, float if kind == "f4" else np.int64)})
    assert f'"array":"{kind}"'.encode() in decompress(b64decode(text))


def test_what_no_page_can_hold_is_refused() -> None:
    """Numbers that need more than 32 bits, and things that are no data."""
    with pytest.raises(ValueError, match="expected 32 bits"):
        pack({"numbers": np.array([2**40])})
    with pytest.raises(TypeError, match="object in a document"):
        pack({"thing": object()})
