"""The task that a path solves: from where to where, and by which moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

State = frozenset[Site]


@dataclass(frozen=True)
class PathTask:
    """The task that a path solves: its start and end, and the system whose moves it may use.

    Without a system the moves are those of `path`. With `labelled_goals` the vehicles of a graph
    have no labels, but each must end where the path takes it. `end` is the state at the end, if it
    is known already.
    """

    path: Sequence[Action]
    start: State
    system: System | None
    labelled_goals: bool = False
    end: State | None = None

    @cached_property
    def goal(self) -> State:
        """The state at the end."""
        return end_state(self.path, self.start) if self.end is None else self.end


def task_of(found: Shortened) -> PathTask:
    """Return the task of a path that was shortened.

    Where a plan's vehicles have goals of their own, each must end where the path takes it.
    InputError for moves of which only support and trace are known, and for moves that the system
    does not have: the possible moves are then unknown.

    >>> task = task_of(shorten(play("hex:n=4")))
    >>> from cubepath.protocol.core.sites import in_order
    >>> in_order(task.start), in_order(task.goal)
    (((0, 0), (1, 0), (2, 0), (3, 0)), ((3, 0), (3, 1), (3, 2), (3, 3)))
    """
    given = found.given
    scene = given.scene
    if scene is None:
        return _of_moves_alone(given)
    actions = tuple(action for cube in found.cube_path for action in cube)
    if given.form in {"moves", "binary moves"}:
        for action in dict.fromkeys(actions):
            if placement_of(scene.system, action) is None:
                raise InputError(
                    f"{given.source}: {action!r} is no move of {scene.spec}: expected moves of the"
                    " system, or no --system, to look beyond the class"
                )
    return PathTask(actions, scene.start_state, scene.system, labelled_goals=given.labelled_goals)


def _of_moves_alone(given: PathInput) -> PathTask:
    """Return the task of self-contained moves: no moves exist but those that occur."""
    if given.start is None:
        name = given.numbered.name(int(np.flatnonzero(given.numbered.ends < 0)[0]))
        raise InputError(
            f'{given.source}: move {name!r} has no "before" and "after": expected both, or'
            " --system SYSTEM, to look beyond the class"
        )
    return PathTask(given.actions, given.start, None, end=end_of(given.numbered, given.start))


def placement_of(system: System, action: Action) -> GeneratorPlacement | None:
    """Return the system's name of an action, None if the system does not have the action."""
    moves = system.moves_of(action)
    return GeneratorPlacement(moves[0].generator, moves[0].at) if moves else None
