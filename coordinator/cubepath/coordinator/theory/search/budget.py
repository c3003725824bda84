"""What a search may spend, in seconds or in steps, and what it has spent.

It uses the clock only to know when to stop.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal


class SpentError(Exception):
    """A budget is spent, and the current work is given up; whatever set the budget catches this."""


class Budget:
    """Seconds from now on, or steps, whichever is spent first; without either, no bound.

    A step is any work that takes a bounded time: looking at a move, comparing a set.
    """

    def __init__(
        self,
        seconds: float | None = None,
        *,
        steps: int | None = None,
        tick: Callable[[int], object] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count; `tick` is called now and then with the number of steps taken.

        It may be set later.
        """
        self._clock = clock
        self.steps = 0
        self._most = steps
        self._end = None if seconds is None else clock() + seconds
        self.tick = tick
        self._reported = 0

    def spend(self, steps: int = 1) -> None:
        """Count steps; SpentError if they exceed the budget, or the time is up."""
        self.steps += steps
        if self.tick is not None and self.steps - self._reported >= _TICK:
            self._reported = self.steps
            self.tick(self.steps)
        if self.spent:
            raise SpentError

    def extend(self, seconds: float) -> None:
        """Add time that something else took."""
        if self._end is not None:
            self._end += seconds

    @property
    def spent(self) -> bool:
        """Return whether nothing is left."""
        if self._most is not None and self.steps > self._most:
            return True
        return self._end is not None and self._clock() >= self._end

    @property
    def seconds_left(self) -> float | None:
        """Return the seconds that are left, None if the time is not bounded."""
        return None if self._end is None else max(0.0, self._end - self._clock())


_TICK = 256
"""The number of steps between two calls of `tick`."""


@dataclass(slots=True)
class SearchStage:
    """A part of a search: its name, what it took, and how it ended.

    `ended` is "done", or what stopped it: "time", "interrupt", or "limit" for a bound on states or
    steps. `why` says more about that where there is more to say. The meaning of `steps` differs
    from stage to stage.
    """

    name: str
    seconds: float = 0.0
    steps: int = 0
    ended: Literal["done", "time", "limit", "interrupt"] = "done"
    why: str | None = None

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``; ``why`` is among them only where it is known."""
        found = {
            "stage": self.name,
            "seconds": round(self.seconds, 3),
            "steps": self.steps,
            "ended": self.ended,
        }
        return found if self.why is None else found | {"why": self.why}
