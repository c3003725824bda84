"""A best-first search from both ends (Pohl, Bi-directional search, 1971), in portions."""

from collections.abc import Callable, Hashable, Iterable
from heapq import heappop, heappush
from typing import Generic, TypeVar

S = TypeVar("S", bound=Hashable)


class TwoSidedSearch(Generic[S]):
    """Looks for a path between two states in a graph whose edges can be walked both ways.

    Both sides take turns. Each expands the state for which the steps from its own end, and the
    estimated way to the other end, are least in sum. ``estimate(end)`` returns the estimate for
    all states, which need not be a bound. Some goals lie in pockets, hard to enter and easy to
    leave; there the side of the goal finds the way.

    Guarantee. Each side expands a state at most once, so if finitely many states can be reached
    from one of the ends, the search ends, with a path if there is one.

    >>> search = TwoSidedSearch(
    ...     0, 5, near=lambda x: (x - 1, x + 1), estimate=lambda end: lambda x: abs(x - end)
    ... )
    >>> search.expand(most=2), search.expand(most=100), search.path
    (False, True, [0, 1, 2, 3, 4, 5])
    """

    def __init__(
        self,
        start: S,
        goal: S,
        *,
        near: Callable[[S], Iterable[S]],
        estimate: Callable[[S], Callable[[S], int]],
    ) -> None:
        """Begin at both ends; `path` is None until there is one."""
        self.path: list[S] | None = [start] if start == goal else None
        self._near = near
        self._sides = (_Side(start, estimate(goal)), _Side(goal, estimate(start)))
        self._turn = 0

    def expand(self, most: int) -> bool:
        """Expand at most this many states; return whether the search is over."""
        for _ in range(most):
            side, other = self._sides[self._turn], self._sides[1 - self._turn]
            if self.path is not None or not side.queue:
                return True
            state = heappop(side.queue)[2]
            for there in self._near(state):
                if side.met(there, state) and there in other.before:
                    one, two = (each.way(there) for each in self._sides)
                    self.path = [*one[::-1], *two[1:]]
                    return True
            self._turn = 1 - self._turn
        return False


class _Side(Generic[S]):
    def __init__(self, root: S, estimate: Callable[[S], int]) -> None:
        self.before: dict[S, S | None] = {root: None}
        self.queue: list[tuple[int, int, S]] = [(0, 0, root)]
        self._steps = {root: 0}
        self._estimate = estimate

    def met(self, state: S, before: S) -> bool:
        """Note a state that is one step from another; return whether it is new."""
        if state in self.before:
            return False
        self.before[state] = before
        self._steps[state] = self._steps[before] + 1
        seems = self._steps[state] + self._estimate(state)
        heappush(self.queue, (seems, len(self.before), state))
        return True

    def way(self, state: S) -> list[S]:
        """Return the way from a state back to the root."""
        found: list[S] = []
        here: S | None = state
        while here is not None:
            found.append(here)
            here = self.before[here]
        return found
