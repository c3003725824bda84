"""What comparing two runs finds: as data, in one line, and in words for people."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from cubepath.coordinator.tools.comparison.results import Differences
from cubepath.coordinator.tools.comparison.told import answer, told


@dataclass(frozen=True, slots=True)
class Compared(Differences):
    """Where two runs part, and why.

    >>> found = diff("logs/golden/hex-5.mcap", "logs/golden/hex-5.mcap")
    >>> found.same, found.choice, found.paths.cubes
    (True, None, (19, 19))
    """

    @property
    def answer(self) -> str:
        """Where they part, in one line."""
        return answer(self)

    def __str__(self) -> str:
        """Return what is found, for people."""
        return told(self)

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath diff --json``."""
        return asdict(self)
