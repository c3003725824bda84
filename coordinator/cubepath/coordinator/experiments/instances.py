"""The standard instances, and what holds for all runs in a scene, as far as experiments use it.

The folder `standard` beside this file holds them. `standard.toml` lists the instances with their
values; a scene is a TOML file where no spec names it; each instance has a cubes file with the
schedule that attains the best known value. tests/standards.py computes all of it. `theory` works
out what holds for other scenes.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Protocol, TypeAlias

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import parsed_toml
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

Change: TypeAlias = tuple[State, State]
"""The sites that a move turns off, and those that it turns on."""


class SceneFacts(Protocol):
    """What is known of a scene; see the class of this name in `theory` for each value."""

    scene: Scene
    optimum: int | None
    best_found: int | None
    missing: int | None
    distance: int | None
    hashed: str

    def bound(self, cubes: int | None) -> int | None:
        """Return a lower bound on cubes from start to goal; None if there is none."""
        ...

    def measures(self, changes: Iterable[Change]) -> NDArray[np.int64]:
        """Return how much each change of sites changes `missing` and `distance`, shape (2, n)."""
        ...

    def blocked(self, sites: Sequence[Site]) -> bool:
        """Return whether no move at all is admissible with the modules at these sites."""
        ...


def facts_of(system: str, max_states: int = 0, iterations: int = 0) -> SceneFacts:
    """Return what is known of a scene by name, found once in a process.

    `max_states` bounds a search for the optimum, `iterations` one for a path with few cubes; there
    is none if it is 0.
    """
    found: SceneFacts = plugin("facts_of")(system, max_states, iterations)
    return found


def forget_facts() -> None:
    """Forget what is known of all scenes, since files of scenes may have changed."""
    plugin("facts_of").cache_clear()


FOLDER = Path(__file__).parent / "standard"


class StandardInstance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A scene to try rules on, and how good a schedule can be.

    `system` is what `scene_from_spec` takes: a spec, or the path of a TOML file. `best` is the
    least number of cubes that is known, `moves` the number of moves of `schedule`, a cubes file
    that attains it. No schedule has fewer than `bound` cubes, whatever its homotopy class; `how`
    says in words how the two are known.

    >>> one = next(each for each in standard() if each.name == "hex-6")
    >>> one.system, one.best, one.bound, one.proved
    ('hex:n=6', 18, 18, True)
    """

    name: str
    system: str
    best: int
    moves: int
    bound: int
    how: str

    @property
    def schedule(self) -> Path:
        """Return the file of the schedule."""
        return FOLDER / f"{self.name}.jsonl"

    @property
    def proved(self) -> bool:
        """Return whether the best known value is proved to be the least there is."""
        return self.best == self.bound


@cache
def standard() -> tuple[StandardInstance, ...]:
    """Return the standard instances, by family and size.

    >>> [each.system for each in standard() if each.name == "hex-6"]
    ['hex:n=6']
    >>> [(each.best, each.bound, each.proved) for each in standard() if each.name == "hex-6"]
    [(18, 18, True)]
    """
    table = parsed_toml(read_text(FOLDER / "standard.toml"))
    found = msgspec.convert(table["instance"], tuple[StandardInstance, ...])
    return tuple(
        replace(each, system=str(FOLDER / each.system)) if each.system.endswith(".toml") else each
        for each in found
    )
