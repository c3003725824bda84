"""Junk for fuzzing: arbitrary bytes and JSON, and real messages changed in every way there is.

All of it follows from a `Random`, so a failing input is made again by its seed.
"""

import json
import math
import tomllib
from collections.abc import Sequence
from copy import deepcopy
from random import Random
from typing import Any

import tomli_w

from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.messages import KINDS, NoMessageError, decode

Put = tuple[str, bytes]
"""A key and what is put on it."""
NUMBERS: tuple[Any, ...] = (
    *(0, 1, -1, 2, 7, 255, 1 << 31, -(1 << 31), (1 << 53) - 1, 1 << 53, 1 << 64, -(1 << 80)),
    *(0.5, 1.0, -0.0, 1e308, math.nan, math.inf, -math.inf),
)
OTHERS: tuple[Any, ...] = (
    *(None, True, False, "", "0", "0,0", "edge", "é\ud7ff", "\x00", "x" * 300, "**", "/"),
    *([], [[]], [0], [0, 0], [0, 1, 0], [[0, 0], 1], {}, {"0": 1}, {"": []}),
)
WORDS = ("sense", "claim", "settle", "join", "over", "stop", "observe", "granted", "lost", *KINDS)
_DEEP = (40, 70, 2000)


def any_value(random: Random, deep: int = 2) -> Any:  # noqa: PLR0911 - one for each kind
    """Return some JSON value; now and then one that is huge, or nested very deeply."""
    kind = random.randrange(12)
    if kind < 4:
        return random.choice(NUMBERS)
    if kind < 6:
        return deepcopy(random.choice(OTHERS))
    if kind < 8:
        return random.choice(WORDS)
    if kind == 8 and not random.randrange(8):
        return "x" * random.choice((257, 5000))
    if kind == 9 and deep and not random.randrange(8):
        levels = random.choice(_DEEP)
        return _Raw("[" * levels + "]" * levels)
    if deep and kind == 10:
        return [any_value(random, deep - 1) for _ in range(random.randrange(4))]
    if deep and kind == 11:
        return {random.choice(WORDS): any_value(random, deep - 1) for _ in range(3)}
    return random.randrange(-3, 9)


class _Raw(str):
    """Text that is JSON already: lists that json cannot write, nested too deeply."""

    __slots__ = ()


def spelled(value: Any) -> bytes:
    """Return a value as JSON, NaN and what is nested deeply included."""
    if isinstance(value, _Raw):
        return value.encode()
    if isinstance(value, dict):
        inner = (json.dumps(str(key)).encode() + b":" + spelled(one) for key, one in value.items())
        return b"{" + b",".join(inner) + b"}"
    if isinstance(value, list):
        return b"[" + b",".join(map(spelled, value)) + b"]"
    return json.dumps(value).encode()


def places_in(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all values in a JSON value."""
    found = [path]
    if isinstance(value, dict):
        for key, one in value.items():
            found += places_in(one, (*path, key))
    elif isinstance(value, list):
        for place, one in enumerate(value):
            found += places_in(one, (*path, place))
    return found


def _holder(value: Any, path: tuple[Any, ...]) -> Any:
    for step in path[:-1]:
        value = value[step]
    return value


def _changed(random: Random, value: Any, others: Sequence[Any]) -> Any:
    """Change a value somewhere inside: a field to another, gone, doubled, moved, from elsewhere."""
    path = random.choice(places_in(value)[1:] or [()])
    if not path:
        return any_value(random)
    holder, last = _holder(value, path), path[-1]
    match random.randrange(7):
        case 0:
            del holder[last]
        case 1 if isinstance(holder, list):
            holder.insert(last, holder[last])
        case 2 if isinstance(holder, list):
            random.shuffle(holder)
        case 3:  # what another message has in its place
            other = random.choice(others)
            theirs = random.choice(places_in(other)[1:] or [()])
            holder[last] = deepcopy(_holder(other, theirs)[theirs[-1]] if theirs else other)
        case 4 if isinstance(holder[last], int):
            holder[last] += random.choice((-1, 1, 2, -5))
        case 5 if isinstance(holder, dict):
            holder[random.choice(WORDS)] = any_value(random)
        case _:
            holder[last] = any_value(random)
    return value


def _with_doubled_keys(random: Random, data: bytes) -> bytes:
    """Say one more thing under a key that is there already."""
    key = random.choice(("kind", "round", "process", "parts", "phase", "module"))
    return b"{" + spelled({key: any_value(random)})[1:-1] + b"," + data[1:]


def _flipped(random: Random, data: bytes) -> bytes:
    damaged = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 9))):
        place = random.randrange(len(damaged) + 1)
        match random.randrange(4):
            case 0:
                damaged[place : place + random.randrange(20)] = b""
            case 1:
                damaged[place:place] = random.randbytes(random.randrange(5))
            case _ if place < len(damaged):
                damaged[place] ^= 1 << random.randrange(8)
            case _:
                del damaged[place:]
    return bytes(damaged)


class Junk:
    """Makes junk from the messages that were heard so far; it keeps the last of them."""

    def __init__(self, random: Random, keep: int = 64) -> None:
        self._random = random
        self._keep = keep
        self._heard: list[Put] = []

    def heard(self, key: str, data: bytes) -> None:
        """Take note of a real message."""
        if len(self._heard) >= self._keep:
            self._heard[self._random.randrange(self._keep)] = key, data
        else:
            self._heard.append((key, data))

    def one(self) -> Put:  # noqa: PLR0911 - one for each kind
        """Return some junk: any bytes, any JSON, or a real message again or changed."""
        random = self._random
        kind = random.randrange(10)
        if kind == 0 or not self._heard:
            return self._key(), random.randbytes(random.choice((0, 1, 7, 60)))
        if kind == 1:
            return self._key(), spelled(any_value(random, 4))
        key, data = random.choice(self._heard)
        if kind == 2:
            return key, data
        if kind == 3:
            return self._key(), data
        if kind == 4:
            return key, _flipped(random, data)
        if kind == 5:
            return key, _with_doubled_keys(random, data)
        others = [json.loads(theirs) for _, theirs in random.sample(self._heard, 1)]
        value = json.loads(data)
        for _ in range(random.choice((1, 1, 1, 2, 4))):
            value = _changed(random, value, others) if isinstance(value, dict | list) else value
        changed = spelled(value)
        return self._fitting(key, changed), changed

    def _fitting(self, key: str, data: bytes) -> str:
        """Return the key that the message itself names, mostly; so it gets past the first look."""
        if not self._random.randrange(8):
            return self._key()
        try:
            return key_of(key.split("/")[1], decode(data))
        except NoMessageError:
            return key

    def _key(self) -> str:
        random = self._random
        if self._heard and random.randrange(3):
            key = random.choice(self._heard)[0]
            steps = key.split("/")
            steps[random.randrange(len(steps))] = random.choice((*WORDS, "process_1", "**", ""))
            return "/".join(steps)
        return random.choice(("", "/", "cubepath", "x" * 999, "cubepath/run/go/coordinator"))


def _is_nested(value: Any) -> bool:
    return isinstance(value, dict | list)


def changed_json(random: Random, text: bytes) -> bytes:
    """Return JSON with some values changed; its bytes damaged now and then."""
    if not random.randrange(4):
        return _flipped(random, text)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):  # it was changed before
        return _flipped(random, text)
    for _ in range(random.choice((1, 1, 2, 5))):
        value = _changed(random, value, [deepcopy(value)]) if _is_nested(value) else value
    return spelled(value)


def changed_lines(random: Random, text: bytes) -> bytes:
    """Return lines of JSON with one of them changed, doubled, gone or moved."""
    lines = text.splitlines()
    place = random.randrange(len(lines))
    match random.randrange(6):
        case 0:
            lines[place : place + 1] = [lines[place]] * 2
        case 1:
            del lines[place]
        case 2:
            lines[place] = spelled(any_value(random))
        case 3:
            other = random.randrange(len(lines))
            lines[place], lines[other] = lines[other], lines[place]
        case _:
            lines[place] = changed_json(random, lines[place])
    return b"\n".join(lines) + b"\n"


def changed_toml(random: Random, text: str) -> str:
    """Return TOML with some values changed; its letters damaged now and then."""
    if not random.randrange(3):
        return _flipped(random, text.encode()).decode(errors="replace")
    value = tomllib.loads(text)
    for _ in range(random.choice((1, 1, 2, 5))):
        value = _changed(random, value, [value])
        if not isinstance(value, dict):
            return str(value)
    try:
        return tomli_w.dumps(value)
    except (TypeError, ValueError, RecursionError):  # what has no form in TOML
        return text.replace(random.choice('0123456789[]={}"'), random.choice(WORDS))
