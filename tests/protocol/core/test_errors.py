"""Error messages: one line that a person can read, whatever the input holds."""

import pickle
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from processes.command_line import refused

LONG = "x" * 1_000_000


@pytest.mark.parametrize("kind", [CheckError, CubepathError, InputError])
def test_a_long_message_keeps_its_beginning_and_its_end(kind: type[CubepathError]) -> None:
    """Where it was found stands at the beginning, what was expected at the end."""
    error = kind(f"a.json: found {LONG!r}, expected a number")
    assert len(str(error)) < 2100
    assert str(error).startswith("a.json: found 'xxx")
    assert str(error).endswith("xxx', expected a number")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # noqa: S301 - our own bytes


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.jsonl", f'{{"generator":"{LONG}","at":[0,0]}}'),
        ("a.jsonl", f'{{"{LONG}":1}}'),
        ("a.jsonl", LONG),
        ("a.json", f'{{"starts":[],"goals":[],"moves":[],"{LONG}":1,"{LONG}":2}}'),
        ("a.json", f'{{"starts":"{LONG}"}}'),
        ("a.txt", f"(0,0) -> ({LONG}"),
    ],
)
def test_no_input_is_echoed_whole(name: str, content: str, tmp_path: Path) -> None:
    """A command quotes a part of it, in one line, with exit code 2."""
    (tmp_path / name).write_text(content)
    line = refused("shorten", str(tmp_path / name), "--system", "hex:n=3")
    assert str(tmp_path) in line
    assert len(line) < 2100


@pytest.mark.parametrize(
    "arguments", [["shorten", "a.jsonl", "--system", LONG[:100_000]], [LONG[:100_000]]]
)
def test_no_argument_is_echoed_whole(arguments: list[str]) -> None:
    """Neither a value nor a command."""
    assert len(refused(*arguments)) < 2100
