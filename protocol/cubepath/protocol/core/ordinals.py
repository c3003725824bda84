"""Numbers for things in order of first use: how sites become integers and bits."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TypeVar

Thing = TypeVar("Thing", bound=Hashable)


class Ordinals(dict[Thing, int]):
    """The numbers of things, from 0 in the order in which they are first looked up.

    Equal things share a number. `get` and `in` assign no numbers.

    >>> numbers = Ordinals[str]()
    >>> numbers["b"], numbers["a"], numbers["b"], list(numbers), "c" in numbers
    (0, 1, 0, ['b', 'a'], False)
    """

    def __missing__(self, thing: Thing) -> int:
        """Assign the next number to a thing."""
        number = self[thing] = len(self)
        return number
