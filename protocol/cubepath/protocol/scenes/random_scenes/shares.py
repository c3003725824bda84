"""Shares and probabilities as values of keys: exact decimals."""

from __future__ import annotations

import re
from fractions import Fraction

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.random_scenes.stream import Stream

_DECIMAL = re.compile(r"[0-9]?(\.[0-9]{1,9})?")


def share_of(text: str, what: str, *, most: str = "1") -> Fraction:
    """Return a decimal number within bounds, exactly; InputError begins with `what`."""
    found = Fraction(text) if text and _DECIMAL.fullmatch(text) else None
    if found is None or not 0 <= found <= Fraction(most):
        raise InputError(
            f"{what}: expected a decimal number of at least 0, at most {most}, of at most 9 places"
        )
    return found


def happens(share: Fraction, stream: Stream) -> bool:
    """Return True with this probability, exactly."""
    return stream.below(share.denominator) < share.numerator
