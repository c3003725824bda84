"""The meaning of marks in a picture, for its legend: outlines, traces, rings, bands, obstacles.

Pure functions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.agents.rendering.themes import GHOST, INK
from cubepath.protocol.core.sites import Site

Shot: TypeAlias = tuple[Sequence[Site], Mapping[int, Site]]
"""A state in a picture: the site of each module, and the previous site of each that just moved."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark and its meaning: a box, or a disc where `is_round`, of these colours."""

    meaning: str
    face: str = "none"
    edge: str = "none"
    is_round: bool = False


def moves_marks(shots: Iterable[Shot], *, is_round: bool = False) -> Iterator[Mark]:
    """Yield the marks of modules that have just moved: a dark outline, and a pale trace."""
    if any(moved for _, moved in shots):
        yield Mark("has just moved", edge=INK, is_round=is_round)
        yield Mark("where it was before", face=GHOST, is_round=is_round)
