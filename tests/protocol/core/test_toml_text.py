"""TOML text: read as the standard library reads it, and refused in one line."""

import tomllib

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import PARTS_MAX, parsed_toml

DOTS = ".".join("a" * 50_000)
LONG = "b" * 1_000_000 + " = 1"
QUOTED = " . ".join(['"a.b"', "'c'"] * PARTS_MAX)


@pytest.mark.parametrize(
    "text",
    [
        f"{LONG}\n{DOTS} = 1",
        f"{DOTS} = 1",
        f"[{DOTS}]",
        f"[[{DOTS}]]",
        f"x = {{ {DOTS} = 1 }}",
        f"{QUOTED} = 1",
    ],
)
def test_a_key_of_too_many_parts_is_refused_at_once(text: str) -> None:
    """Bare or in quotes, of a value or a table, after long words; the parser would take minutes."""
    with pytest.raises(
        InputError, match=r"^line \d: a key of more than 100 parts, expected fewer$"
    ):
        parsed_toml(f"a = '''\n'''\n{text}\n")


def test_the_line_of_the_key_is_told() -> None:
    """Also after strings of several lines."""
    with pytest.raises(InputError, match="line 4: a key of"):
        parsed_toml(f"a = '''\n''' # it's\nb = 1\n[{DOTS}]")


@pytest.mark.parametrize(
    "text",
    [
        f'a = "{DOTS}"',
        f"a = '{DOTS}'",
        f'a = """\n{DOTS} = 1\n"""',
        f"a = '''\n{DOTS} = 1\n'''",
        f'a = "\\"{DOTS}"',
        f"a = 1 # {DOTS}",
        f"a = [{'1.5, ' * 1000}]",
        f"{'.'.join('a' * PARTS_MAX)} = 1",
        f'a = """"{DOTS}""""',
    ],
)
def test_dots_elsewhere_are_not_counted(text: str) -> None:
    """In strings of every kind, comments and numbers; and as many parts as there may be."""
    assert parsed_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = ", r"^not TOML: Invalid value \(at end of document\)$"),
        (f"a = {'1' * 5000}", "^not TOML: Exceeds the limit"),
        (f"a = {'[' * 50_000}", "^lists in lists, nested too deeply$"),
        (f"a = {'{a=' * 50_000}", "^lists in lists, nested too deeply$"),
    ],
)
def test_what_cannot_be_parsed_is_told_in_one_line(text: str, message: str) -> None:
    """With the reason of the parser, or in words."""
    with pytest.raises(InputError, match=message):
        parsed_toml(text)
