"""The stream of random numbers that random scenes are drawn from.

A seed must name one scene for good: in any process, on any machine, with any version of Python and
numpy. So nothing of theirs is used but SHA-256 (FIPS 180-4). The stream for a purpose and a seed is
the bits of the digests of the texts ``cubepath:PURPOSE:SEED:0``, ``cubepath:PURPOSE:SEED:1`` and so
on, in ASCII, each digest from its most significant bit on. Purposes have streams of their own: the
same seed gives the same map, however many vehicles start there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from hashlib import sha256
from typing import TypeVar

T = TypeVar("T")
SEED_MAX = 10**18 - 1
"""The greatest seed that a spec may have."""


class Stream:
    """A stream of random numbers for one purpose, from a seed.

    >>> Stream("docs", 1).below(100), Stream("docs", 2).below(100)
    (83, 92)
    """

    def __init__(self, purpose: str, seed: int) -> None:
        """Begin the stream; nothing is drawn yet."""
        self._name = f"cubepath:{purpose}:{seed}"
        self._blocks = 0
        self._bits = 0
        self._left = 0

    def below(self, limit: int) -> int:
        """Return an integer of at least 0 and less than `limit`, each equally likely.

        As many bits as ``limit - 1`` has are read as a number, most significant first, again until
        it is less than `limit`. `limit` is at least 1; of 1 alone nothing is read.
        """
        size = (limit - 1).bit_length()
        while True:
            while self._left < size:
                text = f"{self._name}:{self._blocks}"
                block = int.from_bytes(sha256(text.encode("ascii")).digest(), "big")
                self._bits = self._bits << 256 | block
                self._left += 256
                self._blocks += 1
            self._left -= size
            found = self._bits >> self._left
            self._bits &= (1 << self._left) - 1
            if found < limit:
                return found

    def choice(self, among: Sequence[T]) -> T:
        """Return one of several, each equally likely."""
        return among[self.below(len(among))]

    def drawn(self, among: Sequence[T]) -> Iterator[T]:
        """Yield all of several in random order, each order equally likely.

        Whoever stops after some has a random choice of so many; with more, it begins the same.
        """
        rest = list(among)
        for place in range(len(rest)):
            other = place + self.below(len(rest) - place)
            rest[place], rest[other] = rest[other], rest[place]
            yield rest[place]
