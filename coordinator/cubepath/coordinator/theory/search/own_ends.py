"""Vehicles that must keep their own ends, on a graph whose system gives them no labels.

Such a path is translated into a system with a label for each vehicle; moves are translated there
and back.
"""

from collections.abc import Iterable, Sequence
from typing import Self

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System


def ends_of(path: Iterable[Action], start: State) -> dict[Site, Site]:
    """Return where the path takes each vehicle, by its start, in canonical order.

    Each move must be along an edge and admissible, which is not checked.
    """
    origin = {site: site for site in start}
    for action in path:
        one, other = action.trace
        here, there = (one, other) if one in origin else (other, one)
        origin[there] = origin.pop(here)
    found = {begin: end for end, begin in origin.items()}
    return {begin: found[begin] for begin in in_order(found)}


class OwnEnds:
    """The labelled form of a task of vehicles: its `system`, `start` and `goal`."""

    def __init__(self, system: System, ends: dict[Site, Site]) -> None:
        """Take a system without labels, and the end of each vehicle by its start."""
        self._plain = system
        self._label = {site: label for label, site in enumerate(ends)}
        self.system = system.with_labels(len(ends))
        self.start: frozenset[Site] = frozenset((site, label) for label, site in enumerate(ends))
        self.goal: frozenset[Site] = frozenset(
            (site, label) for label, site in enumerate(ends.values())
        )

    @classmethod
    def of(cls, system: System, path: Iterable[Action], start: State) -> Self:
        """Return the form in which each vehicle ends where `path` takes it."""
        return cls(system, ends_of(path, start))

    def labelled(self, cubes: Iterable[Iterable[Action]]) -> tuple[tuple[Action, ...], ...]:
        """Return cubes from the start on with the labels of the vehicles that move."""
        at = dict(self._label)
        found: list[tuple[Action, ...]] = []
        for cube in cubes:
            moves: list[Action] = []
            for action in cube:
                one, other = in_order(action.trace)
                here, there = (one, other) if one in at else (other, one)
                label = at[there] = at.pop(here)
                moves.append(self.system.action("edge", (one, other, label)))
            found.append(tuple(moves))
        return tuple(found)

    def plain(self, path: Sequence[Action]) -> list[Action]:
        """Return moves without their labels."""
        edge, place_of = self._plain.action, self.system.place_of
        return [
            edge("edge", tuple(place_of(site) for site in in_order(action.trace)))
            for action in path
        ]
