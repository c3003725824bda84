"""The proof that no schedule is shorter, as a file: what was refuted, and the schedule.

It touches only the file that it is told to write, and reads the log of a solver.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import IO

import numpy as np

from cubepath.coordinator.theory.satisfiability.clauses import OFF, ON
from cubepath.coordinator.theory.satisfiability.proving import Refutation
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.optimality_proofs import (
    Group,
    Ladder,
    LadderKind,
    OptimalityProof,
)
from cubepath.protocol.scenes.toml import scene_to_toml

CubePath = Sequence[Sequence[Action]]
_CHUNK = 1 << 20


def proof_of(
    refuted: Refutation,
    schedule: CubePath,
    scene: Scene | None,
    system: System | None,
    ends: tuple[State, State],
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
            names.append(name if name or system is None else _name_of(system, action))
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
        standing="proved",
        moves=actions if text is None else named,
        sites=() if problem.impossible else met.sites,
        variables=variables,
        ladders=_ladders(refuted),
        groups=[
            Group("exactly one" if group.exactly else "at most one", group.sites)
            for group in problem.groups
        ],
        log=_log(refuted.log),
        schedule=[[number[action] for action in cube] for cube in schedule],
    )


def _name_of(system: System, action: Action) -> GeneratorPlacement:
    move = system.moves_of(action)[0]
    return GeneratorPlacement(move.generator, move.at)


def _ladders(refuted: Refutation) -> list[Ladder]:
    members = refuted.problem.members.tolist()
    found: list[Ladder] = []
    begin = 0
    for site, turn, kind, count, _ in refuted.problem.ladders.tolist():
        name: LadderKind = "on" if kind == ON else "off" if kind == OFF else "stay"
        found.append(Ladder(site, turn, name, members[begin : begin + count]))
        begin += count
    return found


def _log(file: IO[bytes] | None) -> Iterator[bytes]:
    if file is not None:
        file.seek(0)
        while chunk := file.read(_CHUNK):
            yield chunk
