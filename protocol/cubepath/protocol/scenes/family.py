"""Families of scenes: what `name:key=value,...` may say, and how its values are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.keyed_values import Keys
from cubepath.protocol.core.system import Scene, System

Values = Mapping[str, str]
MODULES_MAX = 100_000
"""The largest number of modules, or of anything else, that a spec may ask for."""


def _not_known(_system: System, _start: State) -> bool:
    return False


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenes: its keys with their defaults and one line on each.

    Families are found by the entry points of the group ``cubepath.systems``, those that come with
    the project and those of other distributions alike: an entry names a `Family`, or several in a
    tuple.
    """

    name: str
    summary: str
    keys: Keys
    build: Callable[[str, Values], Scene]
    """Make the scene of a name and the values of all keys."""
    system: type[System]
    """The class of its systems, which says what their TOML table is called and how it is read."""
    rule: str = "random"
    """The rule that reaches the default goal; random where there is none, empty without runs."""
    one_class: Callable[[System, State], bool] = _not_known
    """Tell whether it is known that all paths between two states which the given one reaches are
    homotopic, by an argument that stands beside it. It is asked of every system of the class, so it
    looks at what the system is, not at how it is called."""


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
