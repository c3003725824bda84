"""Recordings of both clocks with one value changed are verified, or refused in one line."""

import pytest

from changed_values import Raised, answers


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("count", "seed"),
    [(150, 0), pytest.param(5000, 1, marks=[pytest.mark.nightly, pytest.mark.timeout(400)])],
)
def test_whatever_one_value_is_changed_to_nothing_else_is_raised(count: int, seed: int) -> None:
    """A message, a parameter or an attachment: `python tests/changed_values.py` tries a million."""
    try:
        fates = [each.fate for each in answers(count, seed)]
    except Raised as error:
        pytest.fail(str(error))
    assert {"refused", "failing"} <= set(fates)
