"""Numbers for things in the order in which they are met: how sites become integers and bits."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TypeVar

Thing = TypeVar("Thing", bound=Hashable)


class Ordinals(dict[Thing, int]):
    """The numbers of things, from 0 in the order in which they are first asked for.

    Equal things have one number. To ask by `get` or `in` gives no number to what has none.

    >>> numbers = Ordinals[str]()
    >>> numbers["b"], numbers["a"], numbers["b"], list(numbers), "c" in numbers
    (0, 1, 0, ['b', 'a'], False)
    """

    def __missing__(self, thing: Thing) -> int:
        """Give the next number to a thing."""
        number = self[thing] = len(self)
        return number
