"""The pace of a run that is watched: paused, step by step, or so many rounds a second.

Orders come in other threads than that of the run, which asks between two rounds how long it is to
wait yet.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.given import real_number, whole_number

Order: TypeAlias = Literal["pause", "resume", "step", "rate"]
ORDERS: tuple[Order, ...] = get_args(Order)
RATE_MAX = 1000.0
"""Rounds a second; without a rate a run takes what it needs."""
STEPS_MAX = 1000
"""So many rounds can be asked for at most while a run is paused."""
_LATE_S = 0.05


class Pace:
    """When the next round may begin.

    >>> pace = Pace(paused=True)
    >>> pace.order("step")
    >>> pace.left(), pace.left()
    (0.0, inf)
    """

    def __init__(self, *, rate: float | None = None, paused: bool = False) -> None:
        """Begin paused or not, with so many rounds a second at most, or as many as there can be.

        InputError for a rate of 0 or less, or above `RATE_MAX`.
        """
        self.changed: Callable[[], None] = lambda: None
        """Called after an order was carried out, or a round begun while the run is paused."""
        self._rate = _checked(rate)
        self._paused = paused
        self._steps = 0
        self._due = -math.inf
        self._lock = threading.Lock()

    def left(self) -> float:
        """Return how many seconds the next round is to wait yet; at 0.0 it is taken to begin."""
        with self._lock:
            stepped = self._paused and self._steps > 0
            if self._paused and not stepped:
                return math.inf
            now = time.monotonic()
            if not stepped and now < self._due:
                return self._due - now
            self._steps -= stepped
            if self._rate is not None:
                # Rounds that were a little late do not make all that follow later.
                self._due = max(self._due, now - _LATE_S) + 1 / self._rate
        if stepped:
            self.changed()
        return 0.0

    def order(self, order: str, value: object = None) -> None:
        """Carry out an order: "pause", "resume", "step" by so many rounds, or a "rate" or None.

        A step pauses a run that goes on. InputError for others, and for values that none can be.
        """
        rate = _checked(value) if order == "rate" else None
        steps = 0
        if order == "step":
            steps = whole_number("step", 1 if value is None else value, 1)
        elif order not in ORDERS:
            raise InputError(f"order {order!r:.40}: expected one of {', '.join(ORDERS)}")
        with self._lock:
            match order:
                case "rate":
                    self._rate, self._due = rate, -math.inf
                case "resume":
                    self._paused, self._steps = False, 0
                case _:
                    if self._steps + steps > STEPS_MAX:
                        raise InputError(f"step: expected at most {STEPS_MAX} rounds to come")
                    self._paused, self._steps = True, self._steps + steps
        self.changed()

    @property
    def state(self) -> dict[str, Any]:
        """Return ``paused``, the ``steps`` that are to come though it is, and the ``rate``."""
        with self._lock:
            return {"paused": self._paused, "steps": self._steps, "rate": self._rate}


def _checked(rate: object) -> float | None:
    if rate is None:
        return None
    found = real_number("rate", rate)
    if not 0.0 < found <= RATE_MAX:
        raise InputError(
            f"rate={found:g}: expected more than 0 and at most {RATE_MAX:g} rounds a second"
        )
    return found
