"""Where modules are after each step of a run or of a schedule, from the scene and the moves alone.

Pictures and films are drawn from the snapshots.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.protocol.core.actions import Action, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System

Steps: TypeAlias = Sequence[Iterable[Action]]
"""A run or a cube path: the actions of each round or cube, which commute."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Where modules are after a step; which moved in it, from which site and by which action."""

    sites: tuple[Site, ...]
    moved: Mapping[int, Site]
    by: Mapping[int, Action]


def snapshots(scene: Scene, steps: Iterable[Iterable[Action]]) -> Iterator[Snapshot]:
    """Follow the modules through the steps: first the start, then a snapshot after each step.

    InputError if an action is not admissible when its turn comes.
    """
    sites = list(scene.start)
    module_at = {site: number for number, site in enumerate(sites)}
    state = set(scene.start_state)
    yield Snapshot(tuple(sites), {}, {})
    for number, actions in enumerate(steps, 1):
        moved: dict[int, Site] = {}
        by: dict[int, Action] = {}
        for action in actions:
            index = end_at(action, state)
            if index is None:
                raise InputError(f"step {number}: {why_inadmissible(action, state)}")
            motion = _goes(scene.system, action, index)
            apply_in_place(action, state)
            movers = [module_at.pop(source) for source, _ in motion]
            for module, (source, target) in zip(movers, motion, strict=True):
                moved[module], by[module] = source, action
                sites[module] = target
                module_at[target] = module
        yield Snapshot(tuple(sites), moved, by)


def visited(found: Iterable[Snapshot]) -> Iterator[Site]:
    """Yield the sites that modules come to, each once."""
    return iter(dict.fromkeys(snap.sites[module] for snap in found for module in snap.moved))


def _goes(system: System, action: Action, index: int) -> Sequence[tuple[Site, Site]]:
    """Return where the action takes each module of its trace from its end `index`."""
    before = in_order(action.ends[index] & action.trace)
    for move in system.moves_of(action):
        if set(before) == {source for source, _ in move.motion}:
            return move.motion
    after = in_order(action.ends[1 - index] & action.trace)
    if len(before) != len(after):
        raise InputError(f"{action!r} makes {len(after)} modules of {len(before)}")
    return list(zip(before, after, strict=True))
