"""Families of scenes: what `name:key=value,...` may say, and how its values are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene

Values = Mapping[str, str]
MODULES_MAX = 100_000
"""The largest number of modules, or of anything else, that a spec may ask for."""


@dataclass(frozen=True, slots=True)
class Family:
    """A built-in family of scenes: its keys with their defaults and one line on each."""

    name: str
    summary: str
    keys: Mapping[str, tuple[str, str]]
    build: Callable[[str, Values], Scene]
    rule: str = "random"
    """The rule that reaches the default goal; random where there is none, empty without runs."""


def whole(values: Values, key: str, *, least: int, most: int = MODULES_MAX) -> int:
    """Return the value of a key as a whole number within bounds; InputError names the key."""
    text = values[key]
    try:
        number = int(text)
    except ValueError:
        number = None
    if number is None or not least <= number <= most:
        raise InputError(
            f"{key}={text}: expected a whole number of at least {least}, at most {most}"
        )
    return number
