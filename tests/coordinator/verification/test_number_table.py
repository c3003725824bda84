"""Numbers by keys: what is kept is found again, in memory that keys alone cannot run up."""

import tracemalloc

from hypothesis import given, strategies as st

from cubepath.coordinator.verification.number_table import NumberTable


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(-9, 9))))
def test_it_keeps_what_a_dictionary_keeps(pairs: list[tuple[int, int]]) -> None:
    """The first number of a key stays, and keys come in order."""
    table, known = NumberTable(), dict[int, int]()
    for key, value in pairs:
        assert table.setdefault(key, value) == known.setdefault(key, value)
    assert (list(table), len(table)) == (sorted(known), len(known))
    assert all(table.get(key) == known.get(key) for key in range(401))
    assert table.last == max(known, default=0)


def test_gaps_of_keys_take_no_memory() -> None:
    """Each as far beyond the last as is allowed, which would add up to the square of the count."""
    tracemalloc.start()
    try:
        table, key = NumberTable(), 0
        for count in range(3000):
            key += 64 + count
            table.setdefault(key, count)
        assert tracemalloc.get_traced_memory()[0] < 1_000_000
    finally:
        tracemalloc.stop()
    assert len(table) == 3000
