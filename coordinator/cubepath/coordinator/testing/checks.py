"""Checks of a test's requests: one that can never be met is refused in one line.

Otherwise a fault with a misspelt name never happens, and the test passes.
"""

from collections.abc import Iterable
from typing import Any

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean


def check_name(what: str, name: object, known: Iterable[str]) -> str:
    """Return a name that is known; InputError with the nearest one if it is not.

    `what` stands before it in the error, as ``phase=``.
    """
    names = list(known)
    if isinstance(name, str) and name in names:
        return name
    near = did_you_mean(name, names) if isinstance(name, str) else ""
    if not names:
        raise InputError(f"{what}{name}: there is none, the run has not begun or has ended")
    told = ", ".join(names)
    raise InputError(f"{what}{name}: expected one of {told}{near}")


def check_whole(what: str, number: object, least: int = 0, most: int | None = None) -> int:
    """Return a whole number within bounds; InputError if it is none, or out of them."""
    due = f"{least} or more" if most is None else f"{least} to {most}"
    if not isinstance(number, int) or isinstance(number, bool):
        raise InputError(f"{what}={number!r}: expected a whole number, {due}")
    if number < least or (most is not None and number > most):
        raise InputError(f"{what}={number}: expected {due}")
    return number


def is_number(number: object) -> bool:
    """Return whether something is a number that can be compared."""
    return isinstance(number, int | float) and not isinstance(number, bool)


def check_seconds(what: str, seconds: object) -> float:
    """Return seconds; InputError if they are no number from 0 to an hour."""
    found: Any = seconds
    if not is_number(found) or not 0.0 <= found <= 3600.0:
        raise InputError(f"{what}={seconds}: expected 0 to 3600")
    return float(found)
