"""What a whole session of tests must meet: counted here, by workers of xdist, and by `simulate`."""

import subprocess
import sys
from pathlib import Path

import pytest

from cubepath.coordinator.testing import properties
from cubepath.coordinator.testing.properties import always, reached, sometimes
from cubepath.protocol.core.errors import InputError


def test_what_is_called_and_never_true_is_named() -> None:
    """With the line of its first call; what was true once, or is only reached, is not."""
    with properties.apart():
        for number in range(3):
            sometimes(number > 5, "large")
            sometimes(number > 1, "more than one")
        reached("the end")
        properties.add({"a door": ("test_doors.py:7", 0, False), "the end": ("x.py:1", 0, False)})
        door, large = properties.unmet()
    assert large.endswith("test_properties.py:18: 'large' was false in 3 of 3 calls")
    assert door == "test_doors.py:7: 'a door' was never reached"


def test_workers_are_added_up_in_any_order() -> None:
    """One that has met it is enough, and the line that is named is the same."""
    one = {"large": ("b.py:2", 3, False), "met": ("a.py:1", 1, False)}
    other = {"large": ("a.py:9", 2, False), "met": ("a.py:1", 1, True)}
    for counts in ((one, other), (other, one)):
        with properties.apart():
            for each in counts:
                properties.add(each)
            assert properties.unmet() == ["a.py:9: 'large' was false in 5 of 5 calls"]


def test_what_is_always_so_fails_at_once() -> None:
    """With its text; a condition in the place of the text is an error, not a text that is true."""
    always([1], "there is one")
    with pytest.raises(AssertionError, match=r"^there is one$"):
        always([], "there is one")
    for call in (always, sometimes):
        with pytest.raises(InputError, match="what=False: expected a text, after the condition"):
            call("there is one", False)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]


PROJECT = """
import pytest
from cubepath.coordinator.testing import reached, sometimes

@pytest.mark.parametrize("size", range(6))
def test_queue(size):
    sometimes(size == 0, "the queue is empty")
    sometimes(size > 9, "the queue is full")
    if size > 4:
        reached("five wait")

@pytest.mark.cubepath(reaches=["five wait", "nine wait"])
def test_long(): pass

@pytest.mark.cubepath(reaches=["skipped"])
def test_skipped(): pytest.skip("not here")

def test_quick(): pass
"""
FULL = "FAILED test_mine.py:8: 'the queue is full' was false in 6 of 6 calls"
NINE = "FAILED test_mine.py:12: 'nine wait' was never reached"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("options", "lines"),
    [
        ((), [NINE, FULL]),
        (("-n2",), [NINE, FULL]),
        (("-k", "queue"), [FULL]),
        (("-k", "quick or skipped"), []),
    ],
)
def test_a_session_that_has_not_met_it_fails(
    tmp_path: Path, options: tuple[str, ...], lines: list[str]
) -> None:
    """In one process and in workers, though each test passes; of the tests that were run."""
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_mine.py").write_text(PROJECT)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert [line for line in done.stdout.splitlines() if line.startswith("FAILED")] == lines
    assert done.returncode == bool(lines)
    assert "passed" in done.stdout
