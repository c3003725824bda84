"""Text for a terminal: control characters are shown, and nothing else changes."""

import unicodedata

from hypothesis import given, strategies as st

from cubepath.protocol.core.formatting import visible


@given(st.text())
def test_no_control_character_is_left(text: str) -> None:
    """By the categories of Unicode, whatever the text; other characters stay in their order."""
    kept = "".join(each for each in text if unicodedata.category(each) != "Cc")
    shown = visible(text)
    assert all(unicodedata.category(each) != "Cc" for each in shown)
    assert (shown == text) == (kept == text)
    assert len(shown) == len(text) + 3 * (len(text) - len(kept))
