"""What callers give, checked for its type: numbers where numbers are expected, and functions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import SupportsFloat, SupportsIndex

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean


def whole_number(
    name: str, found: object, least: int | None = None, most: int | None = None
) -> int:
    """Return a whole number; InputError if it is none, less than `least` or more than `most`."""
    expected = "a whole number" if least is None else f"{least} or more"
    expected = expected if most is None else f"{least} to {most}"
    if isinstance(found, bool) or not isinstance(found, SupportsIndex):
        raise InputError(f"{name}={found!r}: expected {expected}")
    number = found.__index__()
    if (least is not None and number < least) or (most is not None and number > most):
        raise InputError(f"{name}={number}: expected {expected}")
    return number


def real_number(name: str, found: object) -> float:
    """Return a number, which may be infinite or none; InputError if it is of another type."""
    if isinstance(found, bool) or not isinstance(found, SupportsFloat):
        raise InputError(f"{name}={found!r}: expected a number")
    return float(found)


def seconds(name: str, found: object, most: float = math.inf) -> float:
    """Return a time in seconds; InputError if it is none, less than 0, or more than `most`."""
    value = real_number(name, found)
    if not 0 <= value <= most:
        expected = "0 or more seconds" if most == math.inf else f"0 to {most:g} seconds"
        raise InputError(f"{name}={value:g}: expected {expected}")
    return value


def known_name(what: str, name: object, known: Iterable[str]) -> str:
    """Return a name that is known; InputError with the nearest one if it is not.

    The error begins with `what`, such as ``phase=``.
    """
    names = list(known)
    if isinstance(name, str) and name in names:
        return name
    near = did_you_mean(name, names) if isinstance(name, str) else ""
    raise InputError(f"{what}{name}: expected one of {', '.join(names) or 'none'}{near}")


def function(name: str, found: object) -> None:
    """Check that something can be called; InputError if not."""
    if not callable(found):
        raise InputError(f"{name}={found!r}: expected a function")
