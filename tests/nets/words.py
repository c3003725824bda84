"""Named results as canonical text in one file, and two such files compared in the words of one.

A file has one line for each result, ``[NAME, VALUE]`` in JSON with sorted keys, compressed. A name
that changed on purpose is translated back before anything is hashed: a table
``{"keys": {NEW: OLD}, "values": {NEW: OLD}, "text": {NEW: OLD}}`` holds the keys of JSON objects,
whole strings (of a string with slashes, as a topic has, each part), and what is replaced inside
strings with spaces, as messages for people are. Keys that `keys` does not have are looked up in
`values`, since objects also count things by name.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Set as AbstractSet
from dataclasses import dataclass, field, fields, is_dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cubepath.protocol import Action

_EXACT = 1 << 53
_SHOWN = 20
"""So many names that differ are shown with the place where they do."""


def plain(value: Any) -> Any:  # noqa: C901, PLR0911, PLR0912 - one line for each kind
    """Return a value of the library as JSON; sets and numbers in their canonical order."""
    match value:
        case None | bool() | float() | np.bool_():
            return value if value is None or isinstance(value, float) else bool(value)
        case int() | np.integer():
            return int(value) if abs(int(value)) < _EXACT else str(int(value))
        case np.floating():
            return float(value)
        case str() | Fraction():
            return _text(str(value))
        case bytes():
            return _text(value.decode("utf-8", "backslashreplace"))
        case Path():
            return value.name
        case np.ndarray():
            whole = np.ascontiguousarray(value)
            return {
                "array": str(whole.dtype),
                "shape": whole.shape,
                "values": whole.ravel().tolist(),
            }
        case Action():
            parts = (value.support, value.trace, value.reads, value.ends, value.free, value.guards)
            return [value.label, *map(plain, parts)]
        case AbstractSet():
            return sorted(map(plain, value), key=text_of)
        case Mapping():
            if all(isinstance(key, str) for key in value):
                return {key: plain(found) for key, found in value.items()}
            return sorted(([plain(key), plain(found)] for key, found in value.items()), key=text_of)
        case msgspec.Struct():
            return plain(msgspec.to_builtins(value))
        case _ if is_dataclass(value):
            shown = (each.name for each in fields(value) if each.compare and each.name[0] != "_")
            return {name: plain(getattr(value, name)) for name in shown}
        case _ if hasattr(value, "_asdict"):
            return plain(value._asdict())
        case _ if isinstance(value, Iterable):
            return [plain(each) for each in value]
        case _:
            raise TypeError(f"{type(value).__name__} is not a result: {value!r}")


def _text(text: str) -> Any:
    """Return a string, or what it holds if that is a JSON object or list."""
    if text[:1] in ("{", "["):
        try:
            return msgspec.json.decode(text)
        except msgspec.DecodeError:
            pass
    return text


def text_of(value: Any) -> bytes:
    """Return the canonical text of JSON."""
    return msgspec.json.encode(value, order="sorted")


@dataclass(frozen=True)
class Words:
    """A table that translates new words back."""

    keys: Mapping[str, str] = field(default_factory=dict[str, str])
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    text: Mapping[str, str] = field(default_factory=dict[str, str])

    def back(self, value: Any) -> Any:
        """Return JSON with old words; two keys that become one are an error."""
        match value:
            case str():
                return self._string(value)
            case list():
                return [self.back(each) for each in value]
            case dict():
                found = {self._key(key): self.back(each) for key, each in value.items()}
                if len(found) != len(value):
                    raise SystemExit(f"two keys become one: {sorted(value)} to {sorted(found)}")
                return found
            case _:
                return value

    def _key(self, key: str) -> str:
        return self.keys.get(key) or self._string(key)

    def _string(self, text: str) -> str:
        if text in self.values:
            return self.values[text]
        if " " in text:
            for new, old in self.text.items():
                text = text.replace(new, old)
        elif "/" in text:
            return "/".join(self.values.get(part, part) for part in text.split("/"))
        return text


def write(out: Path, results: Iterable[tuple[str, bytes]]) -> int:
    """Write named canonical texts, the same bytes for the same results; return their number."""
    out.parent.mkdir(parents=True, exist_ok=True)
    count = 0
    with out.open("wb") as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed:
        for name, text in results:
            packed.write(b"[%b,%b]\n" % (text_of(name), text))
            count += 1
    return count


def _read(path: Path, words: Words | None = None) -> Iterator[tuple[str, Any]]:
    with gzip.open(path) as lines:
        for line in lines:
            name, value = msgspec.json.decode(line)
            if words is not None:
                name, value = " ".join(map(words.back, name.split(" "))), words.back(value)
            yield name, value


def digests(path: Path, words: Words | None = None) -> dict[str, tuple[str, int]]:
    """Return the sha256 and the size of each result, by its name."""
    found: dict[str, tuple[str, int]] = {}
    for name, value in _read(path, words):
        text = text_of(value)
        found[name] = hashlib.sha256(text).hexdigest(), len(text)
    return found


def _first_difference(one: Any, other: Any, place: str = "") -> str:
    """Return where two values differ first, and how."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        pairs = [(f"{place}.{key}", one[key], other[key]) for key in one]
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = [
            (f"{place}[{number}]", *pair)
            for number, pair in enumerate(zip(one, other, strict=True))
        ]
    else:
        texts = [text_of(each).decode() for each in (one, other)]
        if max(map(len, texts)) > 200:  # what is the same in both is not shown
            same = next((n for n, (a, b) in enumerate(zip(*texts, strict=False)) if a != b), 0)
            texts = [f"...{text[max(0, same - 40) : same + 80]}..." for text in texts]
        return f"{place or '.'}: {texts[0]} became {texts[1]}"
    return next(_first_difference(a, b, where) for where, a, b in pairs if a != b)


def compare(one: Path, other: Path, words: Words) -> int:
    """Print the names of results that differ, the first ones with the place; return how many."""
    before, after = digests(one), digests(other, words)
    names = [name for name in before | after if before.get(name) != after.get(name)]
    shown = set(names[:_SHOWN])
    old = {name: value for name, value in _read(one) if name in shown}
    new = {name: value for name, value in _read(other, words) if name in shown}
    for name in names:
        where = "is new" if name not in before else "is gone" if name not in after else "differs"
        if name in old and name in new:
            where = f"differs at {_first_difference(old[name], new[name])}"
        print(f"{name}: {where}")
    print(f"{len(before)} results before, {len(after)} after, {len(names)} differ")
    return len(names)


def parser(description: str | None) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return a parser with ``take FILE`` and ``compare A B [--words FILE]``, and that of `take`."""
    found = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    commands = found.add_subparsers(dest="command", required=True)
    take = commands.add_parser("take", help="write the results of the present code")
    take.add_argument("file", type=Path)
    comparing = commands.add_parser("compare", help="print what differs between two files")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--words", type=Path, help="the table that translates the second back")
    return found, take


def compared(options: argparse.Namespace) -> int:
    """Carry out `compare`; return the exit code."""
    table = options.words.read_bytes() if options.words else b"{}"
    words = msgspec.json.decode(table, type=Words)
    return 1 if compare(options.before, options.after, words) else 0
