"""Families of scenes: the keys of `name:key=value,...`, and how their values are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import Keys
from cubepath.protocol.core.system import Scene, System

Values = Mapping[str, str]
MODULES_MAX = 100_000
"""The largest number of modules, or of anything else, that a spec may ask for."""

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")


def _not_known(_system: System, _start: State) -> bool:
    return False


def no_file(_key: str, _value: str) -> bool:
    """Return that no key names a file."""
    return False


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenes: its keys with their defaults and one line on each.

    Families are found by the entry points of the group ``cubepath.systems``, both the project's own
    and those of other distributions. An entry names a `Family`, or a tuple of several.

    >>> from cubepath.protocol.scenes.registry import all_families
    >>> hexagons = all_families()["hex"]
    >>> hexagons.rule, hexagons.system.__name__, hexagons.keys["n"][0]
    ('chain', 'LatticeSystem', '12')
    """

    name: str
    summary: str
    keys: Keys
    build: Callable[[str, Values], Scene]
    """Make the scene for a name and the values of all keys."""
    system: type[System]
    """The class of its systems, which defines the name and the reading of their TOML table."""
    rule: str = "random"
    """The rule that reaches the default goal; random if there is none, empty without runs."""
    one_class: Callable[[System, State], bool] = _not_known
    """Return whether all paths between two states reachable from the given one are known to be
    homotopic; the proof stands beside the function. It is called for every system of the class, so
    it looks at what the system is, not at its name."""
    is_file: Callable[[str, str], bool] = no_file
    """Return whether the value of a key is the path of a file. In a sweep's file such a path is
    relative to its folder and stays in it, and a name in a recording opens no file."""


def whole(values: Values, key: str, *, least: int, most: int = MODULES_MAX) -> int:
    """Return the value of a key as a whole number within bounds; InputError names the key."""
    text = values[key]
    # Not all that int takes: it allows spaces around a number, 1_0 and the digits of any script.
    number = int(text) if _WHOLE.fullmatch(text) else None
    if number is None or not least <= number <= most:
        shown = text if text.isprintable() else repr(text)
        raise InputError(
            f"{key}={shown}: expected a whole number of at least {least}, at most {most}"
        )
    return number
