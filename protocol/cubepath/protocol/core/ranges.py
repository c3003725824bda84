"""Ranges and lists in texts: `hex:n=4..12..4,bend=60,120` stands for six systems."""

import re
from collections import Counter
from itertools import product

from cubepath.protocol.core.errors import InputError, OptionError

_RANGE = re.compile(
    r"((?:.*?[^\d.])??)((?:^-)?\d{1,18})\.\.(-?\d{1,18})(?:\.\.(-?\d{1,18}))?((?!\.\.)(?:\D.*)?)",
    re.ASCII,
)
"""What is before a range, its first and last number and its step, and what comes after it."""
_WHOLE = re.compile(r"-?\d{1,18}", re.ASCII)
MOST = 1_000_000
"""A range or a product of ranges has at most this many values: more is taken for a slip."""
LARGEST = 10**18 - 1
"""The largest whole number that a sweep takes; one more digit may not fit into a column."""


def values(text: str, where: str) -> list[str]:
    """Return the values that a part of a name stands for: those of a range, or itself alone.

    ``A..B`` has the whole numbers from A to B, both included, and ``A..B..STEP`` each STEP-th of
    them, also within a text. InputError, beginning with `where`, for a range that has none or too
    many.

    >>> values("4..12..4", "n"), values("K5", "graph"), values("map-1..2.scen", "scene")
    (['4', '8', '12'], ['K5'], ['map-1.scen', 'map-2.scen'])
    """
    found = _RANGE.fullmatch(text)
    if found is None:
        return [text]
    first, last, step = int(found[2]), int(found[3]), int(found[4] or 1)
    if step < 1 or last < first:
        raise InputError(
            f"{where}: {text!r} is an empty range, expected A..B or A..B..STEP with A at most B"
            " and a STEP of 1 or more"
        )
    if (last - first) // step >= MOST:
        raise InputError(f"{where}: {text!r} has more than {MOST} values")
    return [f"{found[1]}{number}{found[5]}" for number in range(first, last + 1, step)]


def expanded(text: str) -> list[str]:
    """Return the names that a name with ranges and lists of values stands for, in their order.

    A part between commas that is no KEY=VALUE continues with the values of the key before it. The
    last key changes fastest. InputError for an empty range.

    >>> expanded("agv:graph=K5,C8,n=2..3")
    ['agv:graph=K5,n=2', 'agv:graph=K5,n=3', 'agv:graph=C8,n=2', 'agv:graph=C8,n=3']
    >>> expanded("hex")
    ['hex']
    """
    name, colon, rest = text.partition(":")
    if not rest:
        return [text]
    keys: list[tuple[str, list[str]]] = []
    for part in rest.split(","):
        key, equals, value = part.partition("=")
        if equals or not keys:
            keys.append((key + equals, []))
        else:
            value = part
        keys[-1][1].extend(values(value, text))
    total = 1
    for _, several in keys:
        total *= len(several)
    if total > MOST:
        raise InputError(f"{text}: stands for {total} names, expected at most {MOST}")
    return [
        name + colon + ",".join(key + value for (key, _), value in zip(keys, row, strict=True))
        for row in product(*(several for _, several in keys))
    ]


def seeds_of(text: str, key: str = "seeds") -> tuple[int, ...]:
    """Return the seeds of a text: ``100`` is 0 to 99, ``5..9`` and ``3,7,20..29`` are those.

    OptionError, by the name `key`, if it is none of these or a seed stands twice.

    >>> seeds_of("3"), seeds_of("7,2..4"), seeds_of("5,")
    ((0, 1, 2), (7, 2, 3, 4), (5,))
    """
    parts = text.split(",")
    wrong = f"{key}: expected a number of seeds, a range A..B or a list of both, found {text!r}"
    if len(parts) == 1 and _WHOLE.fullmatch(text):
        if not 1 <= int(text) <= MOST:
            raise OptionError(f"{key}: expected 1 to {MOST} seeds, found {text}")
        return tuple(range(int(text)))
    found: list[int] = []
    for part in parts if parts[-1] else parts[:-1]:
        for value in _values(part, key):
            if not _WHOLE.fullmatch(value):
                raise OptionError(wrong)
            found.append(int(value))
    return checked_seeds(found, key)


def _values(text: str, key: str) -> list[str]:
    try:
        return values(text, key)
    except InputError as error:
        raise OptionError(str(error)) from None


def checked_seeds(found: list[int], key: str = "seeds") -> tuple[int, ...]:
    """Return seeds as they are; OptionError for none, too large or negative ones, and for twice."""
    if not found:
        raise OptionError(f"{key}: expected one seed or more, found none")
    if min(found) < 0:
        raise OptionError(f"{key}: expected 0 or more, found {min(found)}")
    if max(found) > LARGEST:
        raise OptionError(f"{key}: expected at most {LARGEST}, found {max(found)}")
    if len(set(found)) < len(found):
        ((twice, _),) = Counter(found).most_common(1)
        raise OptionError(f"{key}: {twice} stands twice")
    return tuple(found)
