"""Macros: a shortest path between two shapes, found once and lifted to many places.

Source: Abrams and Ghrist, appendix on shape complexes. A path in the shape complex is a path in
the state complex wherever the aggregate stands, as long as no obstacle and no wall is in the way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cubepath.coordinator.theory.complexes.exploration import MAX_STATES
from cubepath.coordinator.theory.complexes.shape_complexes import (
    Shape,
    Steps,
    commuting_steps,
    normal_place,
    shifted,
    steps_at,
)
from cubepath.protocol.core.actions import Action, apply, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System


@dataclass(frozen=True, slots=True)
class Macro:
    """A cube path from one shape to another, relative to the first shape's normal place."""

    start: Shape
    end: Shape
    """The last shape, in its own normal place."""
    cubes: tuple[Steps, ...]


@dataclass(frozen=True, slots=True)
class Lift:
    """A macro at one place of a workspace: its actions cube by cube, or why it does not lift."""

    at: Cell
    cubes: tuple[tuple[Action, ...], ...] | None
    refusal: str | None = None


def macro(
    system: System, start: Iterable[Site], end: Iterable[Site], *, most: int = MAX_STATES
) -> Macro:
    """Return a macro with the fewest cubes from the shape of `start` to the shape of `end`.

    Both are sets of cells anywhere on the lattice. Obstacles and workspace of the system are
    ignored here. CheckError if the second shape cannot be reached, or not within `most` shapes.
    InputError if the system is not local or has no lattice, or if the shapes are empty or differ in
    size.

    >>> system = scene_from_spec("hex:n=3").system
    >>> plan = macro(system, [(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 1), (0, 2)])
    >>> len(plan.cubes), sorted(plan.end)
    (1, [(0, 0), (0, 1), (0, 2)])
    """
    if not system.local:
        raise InputError("a macro of a system that is not local: its shapes have no complex")
    sizes = len(start := frozenset(start)), len(end := frozenset(end))
    if not 0 < sizes[0] == sizes[1]:
        raise InputError(f"a macro from {sizes[0]} modules to {sizes[1]}: expected as many, not 0")
    lattice = _lattice(system)
    free = system.with_moves(())
    first, _ = normal_place(lattice, start)
    goal, _ = normal_place(lattice, end)
    back: dict[Shape, tuple[Shape, Steps] | None] = {first: None}
    queue = deque([first])
    while queue and goal not in back:
        shape = queue.popleft()
        for after, steps in _cubes_from(free, shape):
            if after not in back:
                back[after] = shape, steps
                queue.append(after)
        if len(back) > most:
            raise CheckError(f"the second shape is not within {most} shapes of the first")
    if goal not in back:
        raise CheckError("no path leads from the first shape to the second")
    return Macro(first, goal, _unrolled(free, first, _way_back(back, goal)))


def _lattice(system: System) -> Lattice:
    if system.catalogue is None:
        raise InputError("a macro of a system without a lattice: it has no shapes")
    return system.catalogue.lattice


def _cubes_from(system: System, shape: Shape) -> Iterator[tuple[Shape, Steps]]:
    actions = steps_at(system, shape)
    for steps in commuting_steps(actions):
        after: frozenset[Site] = shape
        for step in steps:
            after = apply(actions[step], after)
        yield normal_place(_lattice(system), after)[0], steps


def _way_back(back: dict[Shape, tuple[Shape, Steps] | None], goal: Shape) -> list[Steps]:
    found = []
    before = back[goal]
    while before is not None:
        shape, steps = before
        found.append(steps)
        before = back[shape]
    return found[::-1]


def _unrolled(system: System, start: Shape, cubes: list[Steps]) -> tuple[Steps, ...]:
    """Return the steps relative to one place, instead of each shape's own normal place."""
    lattice = _lattice(system)
    shape, origin = start, (0,) * lattice.dimension
    found = []
    for steps in cubes:
        found.append(tuple(shifted(lattice, step, origin) for step in steps))
        after: frozenset[Site] = shape
        for step in steps:
            after = apply(system.action(step.generator, step.at), after)
        shape, by = normal_place(lattice, after)
        origin = tuple(here - there for here, there in zip(origin, by, strict=True))
    return tuple(found)


def lift(system: System, plan: Macro, at: Cell) -> Lift:
    """Return the macro with its first shape's normal place at `at`, checked against obstacles.

    Every module must start on a free place, and each action must exist in the system and be
    admissible when its turn comes; otherwise the refusal says which one fails, and why.

    >>> system = scene_from_spec("hex:n=3").system
    >>> plan = macro(system, [(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 1), (0, 2)])
    >>> done = lift(system, plan, (5, 5))
    >>> done.refusal, len(done.cubes)
    (None, 1)
    """
    lattice = _lattice(system)
    if len(at) != lattice.dimension or any(type(number) is not int for number in at):
        raise InputError(f"a place is {lattice.dimension} integers, found {at!r}")
    if not system.local:
        raise InputError("a macro of a system that is not local: its shapes have no complex")
    cells = [lattice.shift(lattice.check(cell), at) for cell in sorted(plan.start, key=str)]
    for cell in cells:
        if not system.has_place(cell):
            return Lift(at, None, f"a module would start at {cell}, an obstacle or no place")
    state = {*cells, *system.filled}
    cubes = []
    for number, steps in enumerate(plan.cubes, 1):
        actions = []
        for step in steps:
            try:
                action = system.action(step.generator, lattice.shift(step.at, at))
            except InputError as error:
                return Lift(at, None, f"cube {number}: {error}")
            if end_at(action, state) is None:
                return Lift(at, None, f"cube {number}: {why_inadmissible(action, state)}")
            actions.append(action)
        for action in actions:
            apply_in_place(action, state)
        cubes.append(tuple(actions))
    return Lift(at, tuple(cubes))
