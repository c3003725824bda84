"""Usage errors: one line that says what was meant, with exit code 2 and nothing done."""

import pytest

from cubepath.coordinator.commands.main import main
from usage_errors import again, lines

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("group", "line"),
    [([], "shorten a path to its normal cube path"), (["log"], "show what a recording contains")],
)
def test_no_command_asks_for_help(group: list[str], line: str, capsys: Capture) -> None:
    """Those of the group with a line on each, as --help says them; no options are built."""
    assert main(group) == 0
    told = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([*group, "--help"])
    assert told == capsys.readouterr().out
    assert line in told


@pytest.mark.slow
def test_what_commands_refuse_is_as_in_the_snapshot() -> None:
    """Each in one line, with nothing printed and nothing left; `usage_errors.py` makes it anew."""
    assert list(again()) == lines()
