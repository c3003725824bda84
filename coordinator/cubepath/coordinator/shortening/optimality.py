"""How far a shortened path is from the best there is: improvement, lower bound, optimum.

Three gaps are told apart. *Shortening*: from the moves to the normal cube path, the shortest of its
homotopy class; closed by `cubepath.coordinator.normal_form.heap`. *Class*: from there to the best
that was found in any class. *Proof*: from there to the greatest lower bound that was shown.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.search.anytime import CubePath, Improved, improve
from cubepath.coordinator.search.exact import MAX_STATES, Optimum, optimum
from cubepath.coordinator.search.lower_bounds import lower_bound
from cubepath.coordinator.search.simply_connected import only_class
from cubepath.coordinator.search.transitions import Transitions, maskable
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.path_files.moves import CubeName, id_of

State = frozenset[Site]


@dataclass(frozen=True)
class Task:
    """What a path has to do: from which state, by the moves of what, and how its moves are named.

    Without a system its moves are those of `path`. With `labelled_goals` the vehicles of a graph
    have no labels but each is to end where it does.
    """

    path: tuple[Action, ...]
    start: State
    system: System | None
    labelled_goals: bool = False

    @cached_property
    def goal(self) -> State:
        """The state at the end."""
        return end_state(self.path, self.start)


@dataclass(frozen=True, slots=True)
class Beyond:
    """What is known beyond the class of a path; the keys that ``shorten --json`` adds.

    `improved` is the number of cubes after the search, None if none was asked for. `lower_bound`
    holds for every path of these moves between the same ends, by the argument `why`. `optimal`
    tells whether what is reported (improved, or else the normal cube path) is as short as any: None
    if that is not known. `only_class` is true where there is but one class, null if not known.
    """

    improved: int | None
    lower_bound: int
    optimal: bool | None
    only_class: bool | None
    why: str
    cube_path: CubePath
    named: tuple[tuple[CubeName, ...], ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = ("improved", "lower_bound", "optimal", "only_class")
        return {key: getattr(self, key) for key in keys}


def task_of(found: Shortened) -> Task:
    """Return the task of a path that was shortened.

    A plan's vehicles have goals of their own, so each is to end where it does. InputError for
    moves of which only support and trace are known, and for moves that the system does not have:
    nobody knows then what else there is to do.
    """
    given = found.given
    scene = given.scene
    if scene is None:
        return _of_moves_alone(given)
    actions = tuple(action for cube in found.cube_path for action in cube)
    if given.form in {"moves", "binary moves"}:
        for action in dict.fromkeys(actions):
            if _placed(scene.system, action) is None:
                raise InputError(
                    f"{given.source}: {action!r} is no move of {scene.spec}: expected moves of the"
                    " system, or no --system, to look beyond the class"
                )
    return Task(actions, scene.start_state, scene.system, labelled_goals=given.labelled_goals)


def _of_moves_alone(given: PathInput) -> Task:
    """Return the task of moves that stand for themselves: what occurs is all that there is."""
    if given.start is None:
        name = next(move.name for move in given.moves if move.before is None)
        raise InputError(
            f'{given.source}: move {name!r} has no "before" and "after": expected both, or'
            " --system SYSTEM, to look beyond the class"
        )
    return Task(given.actions, given.start, None)


def beyond(
    task: Task,
    found: Shortened | None = None,
    *,
    seconds: float | None = None,
    iterations: int | None = None,
    seed: int = 0,
    max_states: int = MAX_STATES,
    watch: Callable[[Improved], object] | None = None,
    tick: Callable[[int], object] | None = None,
) -> Beyond:
    """Look beyond the class of a path: improve it if time is given, and bound what is possible.

    The exhaustive search looks at no more than about `max_states` states; where it ends, it decides
    `optimal`. The improved path is checked by code of its own, from the start state on, before it
    is returned: CheckError if it is not a legal normal cube path to the same end. `found` is what
    shortening made of the path, where that is known, and gives the moves their names; without it
    there are none. An interrupt (KeyboardInterrupt) while it improves ends that search, as the time
    does, with the best path so far. InputError as `improve`.
    """
    asked = seconds is not None or iterations is not None
    normal = normal_cube_path(task.path) if found is None else found.cube_path
    system, start, goal = _as_labelled(task)
    small = maskable(system)
    only = only_class(system, start) if system is not None and normal and small else None
    bound = lower_bound(system, start, goal, within=len(normal))
    if bound.cubes > len(normal):
        raise CheckError(
            f"the system claims that no path has fewer than {bound.cubes} cubes ({bound.why}),"
            f" but one of {len(normal)} is known"
        )
    least, why = (len(normal), "the only class") if only else (bound.cubes, bound.why)
    best, shorter = normal, False
    if least < len(normal) and small:
        steps = Transitions(system, task.path if system is None else ())
        ends = steps.encode(start), steps.encode(goal)
        exact = optimum(steps, *ends, max_states=max_states, most=len(normal) - 1)
        if exact.at_least > least:
            least, why = exact.at_least, "exhaustive search"
        if exact.cubes is not None:
            least, why = len(exact.cubes), "exhaustive search"
            shorter = not asked
            best = _of_optimum(task, steps, exact) if asked else best
    if asked and least < len(best):
        kept = [best]

        def keep(better: Improved) -> None:
            kept.append(better.cube_path)
            if watch is not None:
                watch(better)

        # An interrupt says that the time is up: what was found is not lost.
        with contextlib.suppress(KeyboardInterrupt):
            improve(
                task.path,
                task.start,
                task.system,
                seconds=seconds,
                iterations=iterations,
                seed=seed,
                labelled_goals=task.labelled_goals,
                enough=least,
                watch=keep,
                tick=tick,
                normal=normal,
            )
        best = min(kept, key=lambda path: (len(path), sum(map(len, path))))
    if asked:
        _check(task, best)
    return Beyond(
        improved=len(best) if asked else None,
        lower_bound=least,
        optimal=True if len(best) == least else False if shorter else None,
        only_class=only,
        why=why,
        cube_path=best,
        named=() if found is None else _named(task, found, best),
    )


def _as_labelled(task: Task) -> tuple[System | None, State, State]:
    """Return system, start and goal, with labels where each vehicle is to keep its own end."""
    if not task.labelled_goals or task.system is None:
        return task.system, task.start, task.goal
    ends = ends_of(task.path, task.start)
    system = task.system.with_labels(len(ends))
    start = frozenset((site, label) for label, site in enumerate(ends))
    return system, start, frozenset((site, label) for label, site in enumerate(ends.values()))


def ends_of(path: Iterable[Action], start: State) -> dict[Site, Site]:
    """Return for each vehicle's start, in canonical order, where the path takes it.

    Each move is along an edge and taken as admissible.
    """
    origin = {site: site for site in start}
    for action in path:
        one, other = action.trace
        here, there = (one, other) if one in origin else (other, one)
        origin[there] = origin.pop(here)
    found = {begin: end for end, begin in origin.items()}
    return {begin: found[begin] for begin in in_order(found)}


def _of_optimum(task: Task, steps: Transitions, exact: Optimum) -> CubePath:
    """Return the normal cube path of what the exhaustive search found."""
    actions = [steps.actions[number] for cube in exact.cubes or () for number in cube]
    labelled = steps.system
    if task.labelled_goals and task.system is not None and labelled is not None:
        edge, place_of = task.system.action, labelled.place_of
        actions = [
            edge("edge", tuple(place_of(site) for site in in_order(action.trace)))
            for action in actions
        ]
    return normal_cube_path(actions)


def _check(task: Task, cubes: CubePath) -> None:
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


def _named(task: Task, found: Shortened, cubes: CubePath) -> tuple[tuple[CubeName, ...], ...]:
    if cubes == found.cube_path:
        return found.named
    known: dict[Action, CubeName] = {
        action: name
        for path, names in zip(found.cube_path, found.named, strict=True)
        for action, name in zip(path, names, strict=True)
    }

    def name(action: Action) -> CubeName:
        if action not in known:
            placed = None if task.system is None else _placed(task.system, action)
            known[action] = id_of(action) if placed is None else placed
        return known[action]

    return tuple(tuple(map(name, cube)) for cube in cubes)


def _placed(system: System, action: Action) -> GeneratorPlacement | None:
    """Return how the system names an action, None where it is not one of its own."""
    moves = system.moves_of(action)
    return GeneratorPlacement(moves[0].generator, moves[0].at) if moves else None
