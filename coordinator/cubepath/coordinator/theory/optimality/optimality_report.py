"""How far a shortened path is from the best possible: improvement, lower bound, optimum.

There are three gaps. *Shortening*: from the moves to the normal cube path, the shortest of its
homotopy class; closed by `cubepath.coordinator.normal_form.heap`. *Class*: from there to the best
path found in any class. *Proof*: from there to the greatest lower bound that was proved.

It uses the clock only to know when to stop.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.progress import StageProgress, each_of, progress_bar
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.coordinator.theory.optimality.stages import Between, OptimalityStages, Tick
from cubepath.coordinator.theory.optimality.tasks import PathTask, placement_of
from cubepath.coordinator.theory.satisfiability.solver_process import check_installed
from cubepath.coordinator.theory.search.anytime import CubePath, Improvement
from cubepath.coordinator.theory.search.budget import SearchStage
from cubepath.coordinator.theory.search.exact import MAX_STATES
from cubepath.coordinator.theory.search.own_ends import ends_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.path_files.moves import CubeName

NamedPath = tuple[tuple[CubeName, ...], ...]
_BEFORE_PROOF = 0.15
"""Share of the time for a proof that all other stages may take together."""


@dataclass(frozen=True)
class OptimalityReport:
    """What is known beyond the class of a path; the keys that ``shorten --json`` adds.

    `improved` is the number of cubes after the search, None if no search was asked for.
    `lower_bound` holds for every path of these moves between the same ends, by the argument `why`.
    `optimal` says whether the reported path (the improved one, or else the normal cube path) has as
    few cubes as any; None if that is not known. `only_class` says whether there is only one class,
    None if that is not known. `agreed` is greater than `lower_bound` where two solvers found no
    path with fewer cubes, but their logs are too long to be checked; otherwise None. `proof` is the
    file with the proof, None if none was written. `spent` says what each stage took. `cube_path` is
    the reported path, and `named` the names of its moves.
    """

    improved: int | None
    lower_bound: int
    optimal: bool | None
    only_class: bool | None
    why: str
    spent: tuple[SearchStage, ...]
    agreed: int | None
    proof: str | None
    _cube_path: Callable[[], CubePath] = field(repr=False, compare=False)
    _named: Callable[[], NamedPath] = field(repr=False, compare=False)

    @cached_property
    def cube_path(self) -> CubePath:
        """The cubes of the reported path, as actions."""
        return self._cube_path()

    @cached_property
    def named(self) -> NamedPath:
        """The names of these actions, none if the path was not given with names."""
        return self._named()

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = ("improved", "lower_bound", "optimal", "only_class")
        found = {key: getattr(self, key) for key in keys}
        found |= {"proved_by": self.why, "agreed": self.agreed, "proof": self.proof}
        return found | {"spent": [stage.document() for stage in self.spent]}


def beyond(
    task: PathTask,
    found: Shortened | None = None,
    *,
    seconds: float | None = None,
    iterations: int | None = None,
    seed: int = 0,
    max_states: int = MAX_STATES,
    prove: float | None = None,
    proof: Path | str | None = None,
    watch: Callable[[Improvement], object] | None = None,
    tick: Tick | None = None,
    between: Between | None = None,
    progress: bool = False,
) -> OptimalityReport:
    """Look beyond the class of a path: improve it if time is given, and bound what is possible.

    `seconds` is the time for all stages together. Without it each stage is bounded by the number of
    its steps, and the result depends only on the input and `seed`; `iterations` is the number of
    steps of the search for a better path. `prove` is the time for a search by SAT solvers, from the
    best path down and from the bound up, which comes last; without `seconds` and `iterations` it is
    the time for all stages. `proof` says where to write what it has proved; then the clauses prove
    the bound also where it is known otherwise. The exhaustive search keeps at most about
    `max_states` states; if it completes, it decides `optimal`. An improved path is checked by
    independent code, from the start state on, before it is returned: CheckError if it is not a
    legal normal cube path to the same end. `found` is the shortened path, if it is known already,
    and gives the moves their names; without it they have none. An interrupt (KeyboardInterrupt)
    ends the search with what is known so far, as running out of time does. `tick` is called now and
    then with the current stage and the steps that it took, `watch` with every better path, and
    `between`, while a proof is searched for, with the lower bound and the best number of cubes;
    `progress` shows all three on a bar of `tqdm`.
    InputError as for `improve`, and if a proof is asked for without the library that it takes.

    >>> found = shorten(play("agv:graph=grid3x3,n=3", "random", seed=2, max_rounds=30))
    >>> better = beyond(task_of(found), found, iterations=200)
    >>> found.cubes, better.improved, better.lower_bound, better.optimal
    (8, 3, 3, True)
    """
    asked = seconds is not None or iterations is not None or prove is not None
    if prove is not None:
        check_installed("a proof")
    bar = StageProgress(progress_bar("bounds", " steps", shown=progress))
    watch, tick = each_of(watch, bar.watch), each_of(tick, bar.tick)
    between = each_of(between, bar.between)
    look = OptimalityStages(task, found, seconds=seconds, max_states=max_states, tick=tick)
    if prove is not None and seconds is None and iterations is None:
        look.share(prove, _BEFORE_PROOF)
    look.ask_for_classes()
    look.bound_from_below()
    look.bound_by_windows()
    look.search_all(take=asked)
    if asked:
        look.improve(iterations=iterations, seed=seed, watch=watch)
    if prove is not None:
        look.prove(prove, seed=seed, proof=proof, watch=watch, between=between)
    bar.bar.close()
    if look.better is not None:
        _check(task, look.better)
    return OptimalityReport(
        improved=look.cubes if asked else None,
        lower_bound=look.bound.cubes,
        optimal=True if look.cubes == look.bound.cubes else False if look.shorter else None,
        only_class=look.only,
        why=look.bound.why,
        spent=tuple(look.stages),
        agreed=look.agreed if look.agreed > look.bound.cubes else None,
        proof=look.written,
        _cube_path=lambda: look.best,
        _named=lambda: () if found is None else _named(task, found, look.better),
    )


def _check(task: PathTask, cubes: CubePath) -> None:
    try:
        end = end_state(cubes, task.start)
    except InputError as error:
        raise CheckError(f"the improved path is not legal: {error}") from None
    if end != task.goal or not is_normal(cubes):
        raise CheckError("the improved path is no normal cube path to the same end")
    if task.labelled_goals:
        moves = (action for cube in cubes for action in cube)
        if ends_of(moves, task.start) != ends_of(task.path, task.start):
            raise CheckError("the improved path takes a vehicle to another's end")


def _named(task: PathTask, found: Shortened, cubes: CubePath | None) -> NamedPath:
    """Return the names of the moves of a better path, or without one of the normal cube path."""
    if cubes is None:
        return found.named
    known: dict[Action, CubeName] = {
        action: name
        for path, names in zip(found.cube_path, found.named, strict=True)
        for action, name in zip(path, names, strict=True)
    }

    def name(action: Action) -> CubeName:
        if action not in known:
            placed = None if task.system is None else placement_of(task.system, action)
            known[action] = _in_input(found.given, action) if placed is None else placed
        return known[action]

    return tuple(tuple(map(name, cube)) for cube in cubes)


def _in_input(given: PathInput, action: Action) -> CubeName:
    """Return the name of the first move of the input that does this, all of which may cancel."""
    numbered = given.numbered
    first = np.flatnonzero(numbered.numbers == numbered.actions.index(action))[:1]
    return numbered.cube_names(first)[0]
