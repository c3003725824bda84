"""The commits of one keeper: which of them have come."""

from __future__ import annotations

from array import array
from hashlib import blake2b

import msgspec

from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.names import Json
from cubepath.protocol.wire.free_messages import Moved

_encode = msgspec.json.Encoder().encode


def named(moved: Moved) -> str:
    """Return the name of a commit in error messages."""
    return f"commit {moved.serial} of keeper_{moved.keeper} (module_{moved.module})"


class Commits:
    """Which commits of a keeper have come, each with a digest; those in order take 8 bytes each."""

    def __init__(self) -> None:
        """Begin with none."""
        self.in_order = array("Q")
        self._ahead: dict[int, int] = {}
        self.told = 0
        """How many there are at least."""

    def is_new(self, moved: Moved) -> bool:
        """Take note of a commit; CheckError if another came under its number."""
        if moved.serial < 1:
            raise CheckError(f"{named(moved)}: commits count from 1")
        digest = int.from_bytes(blake2b(_encode(moved), digest_size=8).digest(), "big")
        self.told = max(self.told, moved.serial)
        known: int | None = None
        if moved.serial <= len(self.in_order):
            known = self.in_order[moved.serial - 1]
        else:
            known = self._ahead.get(moved.serial)
        if known is not None:
            if known != digest:
                raise CheckError(f"{named(moved)} comes twice, and differs")
            return False
        self._ahead[moved.serial] = digest
        while len(self.in_order) + 1 in self._ahead:
            self.in_order.append(self._ahead.pop(len(self.in_order) + 1))
        return True

    @property
    def gap(self) -> bool:
        """Return whether one is missing that is known to be there."""
        return self.told > len(self.in_order)


class Released(msgspec.Struct, frozen=True, array_like=True):
    """A move of a run without rounds, with its level."""

    level: int
    generator: str
    at: Json
