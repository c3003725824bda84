"""The table of forgeries: each row is built, and fails what the row says."""

import re
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from samples.free_runs import asked
from tampering.forgeries import FORGERIES, Forgery

TABLE = Path(__file__).parents[2] / "tampering" / "forgeries.md"


class Row(NamedTuple):
    """A row of the table: the forgery, and what `verify` says of it with and without rounds."""

    name: str
    lockstep: str
    free: str


def rows() -> list[Row]:
    """Return the rows of the table."""
    lines = TABLE.read_text().partition("| what was changed |")[2].splitlines()[2:]
    table = takewhile(lambda line: line.startswith("|"), lines)
    return [Row(*(cell.strip() for cell in line.strip("|").split("|"))) for line in table]


def cases() -> list[Any]:
    """Return each forgery with what the table says of it."""
    found = []
    for row in rows():
        for clock, said, make in zip(
            ("lockstep", "free"), row[1:], FORGERIES.get(row.name, (None, None)), strict=True
        ):
            if said or make:
                found.append(pytest.param(make, said, id=f"{clock}: {row.name}"))
    return found


def test_the_table_has_a_row_for_each_forgery() -> None:
    """And a forgery for each row, in the same order."""
    assert [row.name for row in rows()] == list(FORGERIES)


@pytest.mark.few(12)
@pytest.mark.parametrize(("make", "said"), cases())
def test_a_forgery_fails_what_the_table_says(make: Forgery, said: str) -> None:
    """Or passes, and the check is not made, or nothing proves that it is one."""
    found = asked(make())
    failing = {check.name for check in found.checks if not check.ok}
    named = set(re.findall("`([^`]+)`", said))
    if said.startswith("not proved: "):
        assert found.ok
        assert all(check.checked for check in found.checks)
    elif said == "counted in `missing`":
        assert found.ok
        assert found.missing.messages > 0
    elif said.startswith("not checked: "):
        assert found.ok
        assert named <= {check.name for check in found.checks if not check.checked}
    else:
        assert named
        assert named <= failing
