"""What is kept of runs: the columns are those of the page that says what they are."""

import re
from pathlib import Path

from cubepath.coordinator.experiments.rows import FAILURES, ROUND_COLUMNS, RUN_COLUMNS

PAGE = Path(__file__).parents[3] / "docs" / "experiments.md"


def test_every_column_of_runs_is_on_the_page_once() -> None:
    """And the page has no others; it has each way in which a run fails, too."""
    text = PAGE.read_text("utf-8")
    table = text.partition("| column of `runs` | is |\n")[2].partition("\n\n")[0]
    named = [
        name
        for line in table.splitlines()
        for name in re.findall(r"`(\w+)`", line[: line.index("|", 1)])
    ]
    assert len(named) == len(set(named))
    assert {*named} == {*RUN_COLUMNS}
    assert all(f"`{ended}`" in table for ended in FAILURES)


def test_every_column_of_rounds_is_on_the_page() -> None:
    """In the lines that begin with the name of the dataset."""
    told = PAGE.read_text("utf-8").partition("\n`rounds` has for each")[2].partition("\n\n")[0]
    assert all(f"`{name}`" in told for name in ROUND_COLUMNS)
