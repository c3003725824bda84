"""Places and speeds as users write them: "12", "3.5s"; "10", "2x", "max"."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from cubepath.protocol.core.errors import InputError

_SECONDS = re.compile(r"(\d+(?:\.\d*)?|\.\d+)s", re.ASCII)
_WHOLE = re.compile(r"\d{1,15}", re.ASCII)
_RATE = re.compile(r"(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)(x?)", re.ASCII)
RATE_MIN = 1e-5
"""About a round a day."""
_EXPECTED_SPOT = "expected a round or level such as 12, or a time such as 3.5s"
_EXPECTED_RATE = (
    f"expected rounds or levels a second such as 10, times as fast as it was such as 2x, both at"
    f" least {RATE_MIN:f}".rstrip("0")
    + ", or max"
)


@dataclass(frozen=True, slots=True)
class Spot:
    """A place in a recording: a round or level, or seconds since its first message.

    >>> read_spot("12"), read_spot("3.5s").seconds
    (Spot(step=12, seconds=None), 3.5)
    """

    step: int | None = None
    seconds: float | None = None

    def __str__(self) -> str:
        """Return the text that it is read from."""
        return str(self.step) if self.seconds is None else f"{self.seconds:g}s"

    def comes_after(self, other: Spot) -> bool:
        """Return whether it is later than another of its sort; one of another sort is not."""
        if self.seconds is None:
            return other.step is not None and (self.step or 0) > other.step
        return other.seconds is not None and self.seconds > other.seconds


def read_spot(text: str | int | Spot, name: str = "to") -> Spot:
    """Return the place that is written as "12" or "3.5s"; InputError if it is none."""
    if isinstance(text, Spot):
        return text
    written = str(text)
    if _WHOLE.fullmatch(written) and not isinstance(text, bool):
        return Spot(step=int(written))
    found = _SECONDS.fullmatch(written)
    if found is None:
        raise InputError(f"{name}={written}: {_EXPECTED_SPOT}")
    return Spot(seconds=float(found[1]))


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast messages follow one another; without a rate as fast as possible.

    By "step" the rate is in rounds or levels a second, by "clock" it is how many times as fast as
    it was, by the publish times.
    """

    rate: float | None = None
    by: Literal["step", "clock"] = "step"

    def __str__(self) -> str:
        """Return the text that it is read from."""
        return "max" if self.rate is None else f"{self.rate:g}{'x' if self.by == 'clock' else ''}"

    def times(self, factor: float) -> Pace:
        """Return a pace so many times as fast; nothing is faster than as fast as possible."""
        if self.rate is None:
            return self
        return Pace(max(self.rate * factor, RATE_MIN), self.by)


def read_pace(text: str | float | Pace, *, by_wall: bool = False) -> Pace:
    """Return the pace that is written as "10", "2x" or "max"; InputError if it is none.

    Where log time is the wall clock (`by_wall`), there are no rounds to count, and "2" is "2x".
    """
    if isinstance(text, Pace):
        return text
    written = str(text)
    if written == "max":
        return Pace()
    found = _RATE.fullmatch(written)
    rate = float(found[1]) if found else math.nan
    if found is None or not RATE_MIN <= rate < math.inf:
        raise InputError(f"rate={written}: {_EXPECTED_RATE}")
    return Pace(rate, "clock" if found[2] or by_wall else "step")
