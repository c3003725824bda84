"""The task that a path solves, and the proof that no schedule for it is shorter, as a file."""

from collections.abc import Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.coordinator.theory.satisfiability.encoding import OFF, ON
from cubepath.coordinator.theory.satisfiability.proving import Refutation
from cubepath.coordinator.theory.satisfiability.solver_process import pieces_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.optimality_proofs import (
    Group,
    Ladder,
    LadderKind,
    OptimalityProof,
)
from cubepath.protocol.scenes.toml import scene_to_toml

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

    Where a plan's vehicles have their own goals, each must end where the path takes it. InputError
    for moves of which only support and trace are known, and for moves that the system does not
    have: the possible moves are then unknown.

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


CubePath = Sequence[Sequence[Action]]


def proof_of(
    refuted: Refutation,
    schedule: CubePath,
    scene: Scene | None,
    system: System | None,
    ends: tuple[AbstractSet[Site], AbstractSet[Site]],
) -> OptimalityProof:
    """Return the proof that no schedule between two states has so few rounds as were refuted.

    `schedule` is the best that is known. `scene` is where its moves come from, None for moves that
    are listed alone, and `system` that of the clauses, which may give each vehicle a label. The log
    of the refutation is read when the proof is written.
    """
    problem, met = refuted.problem, refuted.problem.met
    variables = problem.variables.copy()
    moves = variables[problem.made, 1]
    alone = scene is None or system is None
    # With a system only those moves are named that have a variable or stand in the schedule.
    used = np.arange(len(met.actions)) if alone else np.unique(moves // 2)
    variables[problem.made, 1] = 2 * np.searchsorted(used, moves // 2) + moves % 2
    actions = [met.actions[place] for place in used.tolist()]
    names = [met.names[place] for place in used.tolist()]
    number = {action: place for place, action in enumerate(actions)}
    for action in (action for cube in schedule for action in cube):
        if action not in number:
            number[action] = len(actions)
            actions.append(action)
            name = met.name_of(action)
            names.append(name if name or system is None else placement_of(system, action))
    named = [name for name in names if name is not None]
    text = None
    if scene is not None and system is not None:
        modules = in_order(ends[0] - system.filled)
        text = scene_to_toml(replace(scene, system=system, start=modules, goal=None, goals=()))
    return OptimalityProof(
        system=text,
        start=in_order(ends[0]),
        goal=in_order(ends[1]),
        refuted=refuted.rounds,
        cubes=len(schedule),
        solver=refuted.why,
        moves=actions if text is None else named,
        sites=() if problem.impossible else met.sites,
        variables=variables,
        ladders=_ladders(refuted),
        groups=[
            Group("exactly one" if group.exactly else "at most one", group.sites)
            for group in problem.groups
        ],
        log=pieces_of(refuted.log),
        schedule=[[number[action] for action in cube] for cube in schedule],
    )


def _ladders(refuted: Refutation) -> list[Ladder]:
    members = refuted.problem.members.tolist()
    found: list[Ladder] = []
    begin = 0
    for site, turn, kind, count, _ in refuted.problem.ladders.tolist():
        name: LadderKind = "on" if kind == ON else "off" if kind == OFF else "stay"
        found.append(Ladder(site, turn, name, members[begin : begin + count]))
        begin += count
    return found
