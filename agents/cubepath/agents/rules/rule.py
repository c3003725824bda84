"""Rules: plain functions from a view to a choice, each made for one module at its birth.

Room: agents. Third parties add rules under the entry point group ``cubepath.rules``: each entry
names a `RuleType`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from cubepath.agents.local.observation import STAY, Note, View
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System


@dataclass(frozen=True, slots=True)
class InitialKnowledge:
    """What a module knows from birth: the static map, its own number, place and goals.

    `modules` is the number of modules; where the others are is unknown. `random` is the module's
    own stream, derived from the seed of the run and its number; it tells nothing of that seed.
    """

    system: System
    module: int
    modules: int
    start: Site
    goals: tuple[Site, ...]
    random: np.random.Generator

    @property
    def label(self) -> int | None:
        """Return the module's label in a labelled system."""
        if self.system.labels is None or not isinstance(self.start, tuple):
            return None
        return int(self.start[1])


@dataclass(frozen=True, slots=True)
class Choice:
    """An action, a note for the modules within reach, and whether the rule has given up.

    They hear the note when they sense the next round, whether or not the move was granted. A rule
    that finds that it cannot reach its goal says so in `failed`, in one line.
    """

    action: int = STAY
    note: Note | None = None
    failed: str | None = None


def _silent(_modules: int) -> int:
    return 0


Rule: TypeAlias = Callable[[View], "int | Choice"]
"""A module calls it once per round: from what it sees to an action, or to a full `Choice`."""


@dataclass(frozen=True, slots=True)
class RuleType:
    """A rule by name: its source, the systems that it fits, and how to make one for a module."""

    name: str
    summary: str
    source: str
    fits: Callable[[System], bool]
    make: Callable[[InitialKnowledge], Rule]
    note_length: Callable[[int], int] = _silent
    """Length of the notes, from the number of modules; 0 for a rule that is silent."""


def as_choice(found: int | Choice) -> Choice:
    """Return a rule's result as a choice, with its reason for giving up as one line."""
    if not isinstance(found, Choice):
        return Choice(int(found))
    if found.failed is None:
        return found
    return replace(found, failed=" ".join(found.failed.split()))
