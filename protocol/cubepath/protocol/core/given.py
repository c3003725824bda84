"""What callers give, checked for its type: numbers where numbers are expected, and functions."""

from __future__ import annotations

from typing import SupportsFloat, SupportsIndex

from cubepath.protocol.core.errors import InputError


def whole_number(name: str, found: object, least: int | None = None) -> int:
    """Return a whole number; InputError if it is none, or less than `least`."""
    expected = "a whole number" if least is None else f"{least} or more"
    if isinstance(found, bool) or not isinstance(found, SupportsIndex):
        raise InputError(f"{name}={found!r}: expected {expected}")
    number = found.__index__()
    if least is not None and number < least:
        raise InputError(f"{name}={number}: expected {expected}")
    return number


def real_number(name: str, found: object) -> float:
    """Return a number, which may be infinite or none; InputError if it is of another type."""
    if isinstance(found, bool) or not isinstance(found, SupportsFloat):
        raise InputError(f"{name}={found!r}: expected a number")
    return float(found)


def seconds(name: str, found: object) -> float:
    """Return a time in seconds; InputError if it is none, or less than 0."""
    value = real_number(name, found)
    if not value >= 0:
        raise InputError(f"{name}={value:g}: expected 0 or more seconds")
    return value


def function(name: str, found: object) -> None:
    """Check that something can be called; InputError if not."""
    if not callable(found):
        raise InputError(f"{name}={found!r}: expected a function")
