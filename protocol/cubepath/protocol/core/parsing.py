"""Parsing text from users, with every failure as one line: TOML, `name:key=value`, repeated keys.

Names with keys, `name:key=value,...`, are how scenes and plan formats are written on one line.

A JSON object may hold a key twice, and parsers silently take the last one. The check is cheap: the
decoded value tells how many keys the text must have, and if the text has no more colons than that,
no key is repeated.

The standard library's TOML parser takes quadratic time for a key of many dotted parts, so such keys
are refused before it sees them.
"""

import json
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import BYTE_ORDER_MARK, Source, opened

_T = TypeVar("_T")
_KINDS = {
    "int": "a whole number",
    "float": "a decimal number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}
_COLON = re.compile(rb'"\s*:')
_STRING = re.compile(rb'("(?:[^"\\]|\\.)*")(\s*:)?', re.DOTALL)
_KEY_OR_BRACE = re.compile(_STRING.pattern + rb"|[{}]", re.DOTALL)


class _TwiceError(Exception):
    pass


def check_keys(text: bytes, least: int = 1, *, where: str | None = None) -> None:
    """Raise InputError if a key stands twice in one object of a valid JSON text.

    `least` is the number of keys that the text has at least, without duplicates. `where` precedes
    the line number in the error, as ``FILE:``; without it only the key is named.
    """
    if text.count(b":") <= least or len(_COLON.findall(text)) <= least:
        return
    if _no_key_twice(text):
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


def read_json(source: Source, type_: type[_T]) -> _T:
    """Return the JSON document in a file; InputError names the file and the place in it.

    A byte order mark is passed over.
    """
    with opened(source) as file:
        path, text = file.path, file.whole().removeprefix(BYTE_ORDER_MARK)
    try:
        found = msgspec.json.decode(text, type=type_)
        check_keys(text, where=f"{path}:")
    except RecursionError:
        raise InputError(f"{path}: lists in lists, nested too deeply") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from None
    return found


def _no_key_twice(text: bytes) -> bool:
    """Return whether no key stands twice in all of a text, which is quickly seen in long lists."""
    met: set[bytes] = set()
    for found in _STRING.finditer(text):  # its first byte is sought much faster than one of several
        if found[2] is not None:
            if found[1] in met or b"\\" in found[1]:
                return False
            met.add(found[1])
    return True


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


Keys = Mapping[str, tuple[str, str]]
"""The keys that a name may have, each with its default and one line on it."""


def given_values(text: str, keys: Keys, where: str) -> dict[str, str]:
    """Return the values after the colon of a name, by key, in the order given.

    Raises InputError, beginning with `where`, for a part that is not KEY=VALUE with one of the
    keys, and for a key that stands twice.
    """
    given: dict[str, str] = {}
    for part in text.split(",") if text else []:
        key, equals, value = part.partition("=")
        if not equals or key not in keys:
            known = f"KEY=VALUE with a key of {', '.join(keys)}" if keys else "no keys"
            near = did_you_mean(key, keys) if equals else ""
            raise InputError(f"{where}: cannot read {part!r}{near}, expected {known}")
        if key in given:
            raise InputError(f"{where}: key {key!r} stands twice")
        given[key] = value
    return given


def all_values(given: Mapping[str, str], keys: Keys) -> dict[str, str]:
    """Return the values of all keys, in the order of `keys`: the given ones, or the defaults."""
    return {key: given.get(key, default) for key, (default, _) in keys.items()}


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


def converted(table: object, kind: type[_T], where: str) -> _T:
    """Return a value of a TOML file as of a kind; InputError begins with `where` and the key."""
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        keys = getattr(kind, "__struct_encode_fields__", ())
        raise InputError(f"{where}{': ' * bool(where)}{mistake_of(error, keys)}") from None


def mistake_of(error: msgspec.ValidationError, keys: Sequence[str] = ()) -> str:
    """Return what is wrong in a table, after the key where it is; `keys` are those it may have.

    >>> try:
    ...     msgspec.convert({"n": [1, "x"]}, dict[str, list[int]])
    ... except msgspec.ValidationError as error:
    ...     print(mistake_of(error))
    [...][1]: expected a whole number, found a text
    """
    what, _, place = str(error).partition(" - at `")
    place = place.strip("$.`")
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", what):
        expected = f", expected one of {', '.join(keys)}" if keys and not place else ""
        what = f"unknown key {unknown[1]!r}{did_you_mean(unknown[1], keys)}{expected}"
    what = re.sub(r"Object missing required field `(.*)`", r"key '\1' is missing", what)
    what = re.sub(r"^Expected `([^`]*)`(.*), got `?(\w+)`?$", _expected, what)
    return f"{place}: {what}" if place else what


def _expected(found: re.Match[str]) -> str:
    kinds = [_KINDS.get(each, each) for each in found[1].split(" | ") if each != "null"]
    return f"expected {' or '.join(kinds)}{found[2]}, found {_KINDS.get(found[3], found[3])}"
