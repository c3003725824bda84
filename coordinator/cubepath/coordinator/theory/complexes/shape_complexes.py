"""The shape complex: the state complex of a lattice system up to translation.

Source: Abrams and Ghrist, appendix on shape complexes. No translation fixes a finite state, so
every cube of the quotient has exactly one name: the shape at which all of its actions are at end 0,
in its normal place, and these actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import MAX_STATES
from cubepath.protocol.core.actions import Action, admissible, apply, commute, end_at
from cubepath.protocol.core.catalogue import Cell, GeneratorPlacement, Lattice
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System, local_only

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
class ShapeComplex:
    """A shape complex with its shapes, and the names of its cubes by dimension."""

    scene: Scene
    complex: CubicalComplex
    shapes: tuple[Shape, ...]
    cubes: tuple[tuple[Cube, ...], ...]


def lattice_of(scene: Scene) -> Lattice:
    """Return the lattice of a scene on a whole lattice; InputError if translations do not act."""
    system = local_only(scene, "shape complex").system
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
    return step.at, step.generator


def shifted(lattice: Lattice, step: GeneratorPlacement, by: Cell) -> GeneratorPlacement:
    """Return the step translated by `by`."""
    return GeneratorPlacement(step.generator, lattice.shift(step.at, by))


def steps_at(system: System, shape: Shape) -> dict[GeneratorPlacement, Action]:
    """Return the admissible actions of an aggregate, by their steps in ascending order.

    An action that has two names in the catalogue is listed under the first of its steps.
    """
    found: dict[GeneratorPlacement, Action] = {}
    for cell in shape:
        for move in system.moves(cell):
            if (
                move is not None
                and isinstance(move.at, tuple)  # a translation, on a lattice
                and admissible(move.action, shape)
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
    cubes: list[list[Cube]] = [[(place, ()) for place in range(len(shapes))]]
    for base, rising in enumerate(up):
        for chosen in commuting_steps(rising):
            if len(chosen) == len(cubes):
                cubes.append([])
            cubes[len(chosen)].append((base, chosen))
    return ShapeComplex(
        scene, _complex(lattice, cubes, across), tuple(shapes), tuple(map(tuple, cubes))
    )


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
