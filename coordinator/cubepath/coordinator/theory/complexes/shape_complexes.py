"""The shape complex: the state complex of a lattice system up to translation; and macros.

Source: Abrams and Ghrist, appendix on shape complexes. No translation fixes a finite state, so
every cube of the quotient has exactly one name: the shape at which all of its actions are at end 0,
in its normal place, and these actions. A macro is a shortest path between two shapes, found once
and lifted to wherever no obstacle and no wall is in the way.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import MAX_STATES
from cubepath.coordinator.theory.complexes.links import spans_cube
from cubepath.protocol.core.actions import (
    Action,
    admissible,
    apply,
    apply_in_place,
    commute,
    end_at,
    why_inadmissible,
)
from cubepath.protocol.core.catalogue import Cell, GeneratorPlacement, Lattice
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.displays import Displayed

Shape: TypeAlias = frozenset[Site]
"""The cells of an aggregate, translated so that the first in canonical order is at the origin."""
Steps: TypeAlias = tuple[GeneratorPlacement, ...]
"""Commuting actions in ascending order: by place, in the order of cells, then by generator."""
Cube: TypeAlias = tuple[int, Steps]
"""The number of the base shape, and the cube's directions."""


class TooManyShapes(CheckError):  # noqa: N818 - named after the condition
    """There are more shapes than allowed; `known` were found before the search stopped."""

    def __init__(self, spec: str, most: int, known: int) -> None:
        """Make the message, which is one line."""
        super().__init__(f"{spec}: more than {most} shapes")
        self.known = known


@dataclass(frozen=True, slots=True)
class ShapeComplex(Displayed):
    """A shape complex with its shapes, and the names of its cubes by dimension."""

    scene: Scene
    complex: CubicalComplex
    shapes: tuple[Shape, ...]
    cubes: tuple[tuple[Cube, ...], ...]


def lattice_of(scene: Scene) -> Lattice:
    """Return the lattice of a scene on a whole lattice; InputError if translations do not act."""
    system = scene.system
    if system.catalogue is None:
        raise InputError(f"{scene.spec}: no lattice, so there are no shapes up to translation")
    if not system.open:
        raise InputError(
            f"{scene.spec}: a workspace or obstacles, expected a whole lattice for shapes up to"
            " translation"
        )
    return system.catalogue.lattice


def normal_place(lattice: Lattice, cells: frozenset[Site]) -> tuple[Shape, Cell]:
    """Return the aggregate in its normal place, and the translation that takes it there."""
    first = lattice.check(in_order(cells)[0])
    by = tuple(-number for number in first[: lattice.dimension])
    return frozenset(lattice.shift(lattice.check(cell), by) for cell in cells), by


def order_of(step: GeneratorPlacement) -> tuple[Cell, str]:
    """Return the sort key of a step: its place as a cell, then its generator."""
    return cast("Cell", step.at), step.generator


def shifted(lattice: Lattice, step: GeneratorPlacement, by: Cell) -> GeneratorPlacement:
    """Return the step translated by `by`."""
    return GeneratorPlacement(step.generator, lattice.shift(cast("Cell", step.at), by))


def steps_at(system: System, shape: Shape) -> dict[GeneratorPlacement, Action]:
    """Return the actions that may be executed at an aggregate, by their steps in ascending order.

    An action that has two names in the catalogue is listed under the first of its steps.
    """
    found: dict[GeneratorPlacement, Action] = {}
    for cell in shape:
        for move in system.moves(cell):
            if (
                move is not None
                and isinstance(move.at, tuple)  # a translation, on a lattice
                and admissible(move.action, shape)
                and (system.local or system.legal(apply(move.action, shape)))
            ):
                found[GeneratorPlacement(move.generator, move.at)] = move.action
    first = {found[step]: step for step in sorted(found, key=order_of, reverse=True)}
    return {step: found[step] for step in sorted(first.values(), key=order_of)}


def shape_complex(
    scene: Scene,
    *,
    max_states: int = MAX_STATES,
    progress: Callable[[int, int], None] | None = None,
) -> ShapeComplex:
    """Return the shape complex; CheckError if it has more than `max_states` shapes.

    >>> found = shape_complex(scene_from_spec("hex:n=2"))
    >>> found.complex.f_vector
    (3, 6)
    """
    system, lattice = scene.system, lattice_of(scene)
    first, _ = normal_place(lattice, frozenset(scene.start))
    number: dict[Shape, int] = {first: 0}
    shapes = [first]
    across: list[dict[GeneratorPlacement, tuple[int, Cell]]] = []
    """For each shape and step at end 0: the shape after it, and its shift to the normal place."""
    up: list[dict[GeneratorPlacement, Action]] = []
    for shape in shapes:
        here: dict[GeneratorPlacement, tuple[int, Cell]] = {}
        steps = steps_at(system, shape)
        rising: dict[GeneratorPlacement, Action] = {}
        for step, action in steps.items():
            after, by = normal_place(lattice, apply(action, shape))
            if after not in number:
                number[after] = len(shapes)
                shapes.append(after)
            if end_at(action, shape) == 0:
                here[step] = (number[after], by)
                rising[step] = action
        across.append(here)
        up.append(rising)
        if progress is not None:
            progress(len(up), len(shapes))
        if len(shapes) > max_states:
            raise TooManyShapes(scene.spec, max_states, len(shapes))
    cubes = _cubes(scene, shapes, up)
    return ShapeComplex(
        scene, _complex(lattice, cubes, across), tuple(shapes), tuple(map(tuple, cubes))
    )


def _cubes(
    scene: Scene, shapes: list[Shape], up: list[dict[GeneratorPlacement, Action]]
) -> list[list[Cube]]:
    """Return the cubes by dimension, from the actions at end 0 of each shape."""
    cubes: list[list[Cube]] = [[(place, ()) for place in range(len(shapes))]]
    for base, rising in enumerate(up):
        for chosen in commuting_steps(rising):
            actions = [rising[step] for step in chosen]
            if not (scene.system.local or spans_cube(scene, shapes[base], actions)):
                continue
            if len(chosen) == len(cubes):
                cubes.append([])
            cubes[len(chosen)].append((base, chosen))
    return cubes


def commuting_steps(actions: dict[GeneratorPlacement, Action]) -> Iterator[Steps]:
    """Yield the non-empty sets of pairwise commuting actions, as steps in ascending order."""
    steps = list(actions)

    def larger(chosen: Steps, first: int) -> Iterator[Steps]:
        for place in range(first, len(steps)):
            if all(commute(actions[steps[place]], actions[step]) for step in chosen):
                found = (*chosen, steps[place])
                yield found
                yield from larger(found, place + 1)

    yield from larger((), 0)


def _complex(
    lattice: Lattice,
    cubes: list[list[Cube]],
    across: list[dict[GeneratorPlacement, tuple[int, Cell]]],
) -> CubicalComplex:
    faces = [np.empty((len(cubes[0]), 0, 2), dtype=np.int32)]
    for k in range(1, len(cubes)):
        number = {cube: place for place, cube in enumerate(cubes[k - 1])}
        found = np.empty((len(cubes[k]), k, 2), dtype=np.int32)
        for place, (base, steps) in enumerate(cubes[k]):
            for direction, step in enumerate(steps):
                rest = steps[:direction] + steps[direction + 1 :]
                target, by = across[base][step]
                moved = tuple(shifted(lattice, each, by) for each in rest)
                found[place, direction] = number[base, rest], number[target, moved]
        faces.append(found)
    return CubicalComplex(tuple(faces))


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


def macro(system: System, start: Iterable[Site], end: Iterable[Site]) -> Macro:
    """Return a macro with the fewest cubes from the shape of `start` to the shape of `end`.

    Both are sets of cells anywhere on the lattice. Obstacles and workspace of the system are
    ignored here. CheckError if the second shape cannot be reached, or not within `MAX_STATES`
    shapes. InputError if the system is not local or has no lattice, or if the shapes are empty or
    differ in size.

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
        if len(back) > MAX_STATES:
            raise CheckError(f"the second shape is not within {MAX_STATES} shapes of the first")
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
                action = system.action(step.generator, lattice.shift(cast("Cell", step.at), at))
            except InputError as error:
                return Lift(at, None, f"cube {number}: {error}")
            if end_at(action, state) is None:
                return Lift(at, None, f"cube {number}: {why_inadmissible(action, state)}")
            actions.append(action)
        for action in actions:
            apply_in_place(action, state)
        cubes.append(tuple(actions))
    return Lift(at, tuple(cubes))
