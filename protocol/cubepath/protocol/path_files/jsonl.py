"""JSON Lines: decoding a line, and files of lines.

It touches only the files it is given, and knows nothing of their content.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.parsing import check_keys

_Line = TypeVar("_Line")
_encode = msgspec.json.Encoder().encode


def decode_line(
    decode: Callable[[bytes], _Line],
    line: bytes,
    keys: str,
    least: Callable[[_Line], int] = lambda _: 1,
) -> _Line:
    """Return a decoded line; InputError says what was found and the expected `keys`.

    `least` returns how many keys a line with this content has at least, see `check_keys`.
    """
    try:
        found = decode(line)
        check_keys(line, least(found))
    except msgspec.ValidationError as error:
        raise InputError(f"{error}; a line has {keys}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"found no whole JSON object, expected one a line: {error}") from None
    return found


def write_lines(path: Path | str, lines: Iterable[object]) -> None:
    """Write one JSON document per line; afterwards the file is complete, or unchanged.

    Raises InputError if it cannot be written; other errors of `lines` propagate, see
    `written_whole`.
    """
    with written_whole(path) as stream:
        for line in lines:
            stream.write(_encode(line) + b"\n")
