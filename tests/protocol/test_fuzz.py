"""Files that users give, changed in every way: each is read, or refused in one line."""

from collections.abc import Callable
from random import Random
from unittest import mock

import pytest
from hypothesis import given, strategies as st

from tampering import fuzzed_files
from tampering.fuzzed_files import FILES, refusal


@pytest.mark.slow
@given(read=st.sampled_from(FILES), seed=st.integers(0, 1 << 32))
def test_a_changed_file_is_read_or_refused_in_one_line(
    read: Callable[[Random], object], seed: int
) -> None:
    """Moves, cubes, schedules, timetables, durations, certificates and scenes."""
    refusal(read, Random(seed))  # noqa: S311 - not for secrets


@pytest.mark.parametrize("read", FILES)
def test_an_unchanged_file_is_read(read: Callable[[Random], object]) -> None:
    """So what is refused is refused for its change."""
    with (
        mock.patch.object(fuzzed_files, "changed_lines", unchanged),
        mock.patch.object(fuzzed_files, "changed_json", unchanged),
        mock.patch.object(fuzzed_files, "changed_toml", unchanged),
    ):
        assert [refusal(read, Random(seed)) for seed in range(6)] == [None] * 6  # noqa: S311


def unchanged(random: Random, text: bytes | str) -> bytes | str:
    """Return what it is given."""
    return text


@pytest.mark.nightly
def test_many_changed_files_are_read_or_refused_in_one_line() -> None:
    """Hundreds of each."""
    for read in FILES:
        for seed in range(400):
            refusal(read, Random(seed))  # noqa: S311 - not for secrets
