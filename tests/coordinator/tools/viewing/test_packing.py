"""Documents as text in a page: they come back, and no name in them can break out."""

import re
from typing import Any

import numpy as np
from hypothesis import given, strategies as st

from cubepath.coordinator.tools.viewing.pages import pack, unpack

numbers = st.lists(st.integers(-(2**31), 2**32 - 1))


@given(st.dictionaries(st.text(), st.text() | st.integers(-9, 9) | st.none()), numbers)
def test_what_is_packed_comes_back(document: dict[str, Any], listed: list[int]) -> None:
    """Whatever the texts hold."""
    whole = document | {"numbers": np.array(listed, np.int64)}
    text = pack(whole)
    assert re.fullmatch(r"[A-Za-z0-9+/=]+", text)
    assert unpack(text) == document | {"numbers": listed}
