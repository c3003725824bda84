"""Usage errors: one line that says what was meant, with exit code 2 and nothing done."""

from __future__ import annotations

import pytest

from cubepath.coordinator.commands.main import main
from usage_errors import again, lines

Capture = pytest.CaptureFixture[str]


def test_no_command_asks_for_help(capsys: Capture) -> None:
    """The commands with a line on each, as --help says them."""
    assert main([]) == 0
    told = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--help"])
    assert told == capsys.readouterr().out
    assert "shorten a path to its normal cube path" in told


def test_a_group_of_commands_asks_for_help(capsys: Capture) -> None:
    """Its commands with a line on each, as --help says them; their options are not built."""
    assert main(["log"]) == 0
    told = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["log", "--help"])
    assert told == capsys.readouterr().out
    assert "show what a recording contains" in told


@pytest.mark.slow
def test_what_commands_refuse_is_as_in_the_snapshot() -> None:
    """Each in one line, with nothing printed and nothing left; `usage_errors.py` makes it anew."""
    assert list(again()) == lines()
