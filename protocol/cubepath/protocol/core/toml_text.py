"""TOML text, parsed with every failure as one line.

The parser of the standard library takes quadratic time for a key of many dotted parts, so such keys
are refused before it sees them.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from typing import Any

from cubepath.protocol.core.errors import InputError

PARTS_MAX = 100
"""The most parts of a dotted key."""
_STRING_OR_COMMENT = re.compile(
    r"""
    "{3} (?: [^\\] | \\. )*? "{3,5}
    | '{3} .*? '{3,5}
    | " (?: [^"\\\n] | \\. )*+ "
    | ' [^'\n]*+ '
    | \# [^\n]*+
    """,
    re.DOTALL | re.VERBOSE,
)
# Possessive, and from the start of a part on: linear, however long the parts are.
_LONG_KEY = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{PARTS_MAX}}}")


def parsed_toml(text: str, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """Return the table that a TOML text holds; InputError if it is no TOML or nested too deeply."""
    _check_keys(text)
    try:
        return tomllib.loads(text, parse_float=parse_float)
    except RecursionError:
        raise InputError("lists in lists, nested too deeply") from None
    except ValueError as error:
        raise InputError(f"not TOML: {error}") from None


def _check_keys(text: str) -> None:
    if all(line.count(".") < PARTS_MAX for line in text.split("\n")):
        return
    bare = _STRING_OR_COMMENT.sub(_without_dots, text)
    found = _LONG_KEY.search(bare)
    if found is not None:
        line = bare.count("\n", 0, found.start()) + 1
        raise InputError(f"line {line}: a key of more than {PARTS_MAX} parts, expected fewer")


def _without_dots(found: re.Match[str]) -> str:
    """Return a part of a key, as a string can be one, on as many lines; nothing for a comment."""
    return "" if found[0][0] == "#" else "s" + "\n" * found[0].count("\n")
