"""Duplicate keys in a JSON object: parsers silently take the last one.

The check is cheap: the decoded value tells how many keys the text must have, and if it has no more
colons than that, no key is a duplicate.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from cubepath.protocol.core.errors import InputError

_COLON = re.compile(rb'"\s*:')
_KEY_OR_BRACE = re.compile(rb'("(?:[^"\\]|\\.)*")(\s*:)?|[{}]', re.DOTALL)


class _TwiceError(Exception):
    pass


def check_keys(text: bytes, least: int = 1, *, where: str | None = None) -> None:
    """Raise InputError if a key stands twice in one object of a valid JSON text.

    `least` is the number of keys that the text has at least, without duplicates. `where` precedes
    the line number in the error, as ``FILE:``; without it only the key is named.
    """
    if text.count(b":") <= least or len(_COLON.findall(text)) <= least:
        return
    try:
        # Numbers are not parsed, however long they are.
        json.loads(
            text.decode("utf-8-sig"),
            object_pairs_hook=_distinct,
            parse_int=len,
            parse_float=len,
            parse_constant=len,
        )
    except _TwiceError:
        line, key = _first_twice(text)
        place = "" if where is None else f"{where}{line}: "
        raise InputError(f"{place}key {key} stands twice in one object, expected once") from None


def _distinct(pairs: Sequence[tuple[str, object]]) -> None:
    if len({key for key, _ in pairs}) < len(pairs):
        raise _TwiceError


def _first_twice(text: bytes) -> tuple[int, str]:
    """Return the first key that stands twice, as JSON, and the line where it stands again."""
    open_objects: list[set[str]] = []
    for found in _KEY_OR_BRACE.finditer(text):
        match found[0][:1]:
            case b"{":
                open_objects.append(set())
            case b"}":
                open_objects.pop()
            case _ if found[2] is not None:
                key = json.loads(found[1])
                if key in open_objects[-1]:
                    return text.count(b"\n", 0, found.start()) + 1, json.dumps(key)
                open_objects[-1].add(key)
            case _:
                pass
    raise AssertionError("no key stands twice")
