"""Collapses: replayed on plain sets, and nothing claimed that was not shown."""

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes import collapses as collapse_module
from cubepath.coordinator.theory.complexes.collapses import (
    CollapseResult,
    collapse,
    contractibility,
)
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, complex_from_faces
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.spaces import (
    DUNCE_HAT,
    EMPTY,
    LOOP,
    ONE_SQUARE_SPHERE,
    ONE_SQUARE_TORUS,
    POINT,
    circle,
    disjoint,
    generated,
    grid,
    moebius,
    path,
    product,
    projective,
    quotients,
    sphere,
    state_complex,
    subcomplexes,
)


def check(space: CubicalComplex, found: CollapseResult) -> None:
    """Replay the collapses on sets: each face is free in its turn, and in the end none is."""
    present = {(k, i) for k, count in enumerate(space.f_vector) for i in range(count)}

    def cofaces(cell: tuple[int, int]) -> list[tuple[int, int]]:
        k, i = cell
        return [
            (k + 1, cube)
            for cube, _ in np.argwhere(_flat(space, k + 1) == i).tolist()
            if (k + 1, cube) in present
        ]

    for k, cube, face in found.steps.tolist():
        assert cofaces((k - 1, face)) == [(k, cube)]
        assert cofaces((k, cube)) == []
        present -= {(k, cube), (k - 1, face)}
    for cell in present:
        above = cofaces(cell)
        assert len(above) != 1 or cofaces(above[0])
    assert found.left == tuple(
        sum(k == dimension for k, _ in present) for dimension in range(space.dimension + 1)
    )


def _flat(space: CubicalComplex, k: int) -> NDArray[np.int32]:
    if k > space.dimension:
        return np.empty((0, 2 * k), np.int32)
    return space.faces[k].reshape(len(space.faces[k]), -1)


@pytest.mark.slow
@given(subcomplexes())
def test_every_step_takes_a_free_face_and_none_is_left(space: CubicalComplex) -> None:
    """On random subcomplexes of grids the steps, replayed on plain sets, are collapses."""
    check(space, collapse(space))


@settings(max_examples=15)
@given(quotients())
def test_the_same_where_cubes_are_glued_to_themselves(space: CubicalComplex) -> None:
    """On random quotients too; what is left has the same Euler characteristic and homology."""
    found = collapse(space)
    check(space, found)
    gone = {(k, cube) for k, cube, _ in found.steps.tolist()}
    gone |= {(k - 1, face) for k, _, face in found.steps.tolist()}
    kept = [(k, i) for k, n in enumerate(space.f_vector) for i in range(n) if (k, i) not in gone]
    left = generated(space, kept)
    assert sum(left.f_vector) == sum(found.left) == len(kept)
    before, after = homology(space), homology(left)
    shorter = len(after.betti)
    assert before.betti[:shorter] == after.betti
    assert not any(before.betti[shorter:])
    assert before.torsion[:shorter] == after.torsion
    assert not any(before.torsion[shorter:])
    if found.contractible:
        assert before.acyclic


@pytest.mark.parametrize(
    ("space", "left"),
    [
        (EMPTY, ()),
        (POINT, (1,)),
        (LOOP, (1, 1)),
        (circle(9), (9, 9)),
        (path(9), (1, 0)),
        (grid(3, 3, 2), (1, 0, 0, 0)),
        (grid(1, 1, 1, 1, 1), (1, 0, 0, 0, 0, 0)),
        (disjoint(path(3), path(2)), (2, 0)),
        (sphere(2), (8, 12, 6)),
        (ONE_SQUARE_TORUS, (1, 2, 1)),
        (DUNCE_HAT, (3, 5, 3)),
        (moebius(), (3, 3, 0)),
    ],
)
def test_known_spaces_collapse_as_they_must(space: CubicalComplex, left: tuple[int, ...]) -> None:
    """Trees and boxes come down to a point, the Moebius strip to a circle, closed ones stay."""
    found = collapse(space)
    check(space, found)
    assert found.left == left
    assert found.contractible == (left[:1] == (1,) and not any(left[1:]))


def test_a_face_that_a_cube_has_twice_is_not_free() -> None:
    """A square with one edge as two of its sides goes with another edge, or not at all."""
    assert collapse(ONE_SQUARE_SPHERE).left == ONE_SQUARE_SPHERE.f_vector
    disc = complex_from_faces([3, [[0, 1], [1, 2], [1, 2]], [[[0, 1], [0, 2]]]])
    found = collapse(disc)
    check(disc, found)
    assert found.steps[0].tolist() == [2, 0, 1]
    assert found.contractible


def test_a_face_is_looked_at_again_when_its_cube_is_free_to_go() -> None:
    """The tip of a cone lies on one edge only, but this can go only after the cone's square.

    A loop at the edge's other end sees to it that nothing else takes the edge.
    """
    cone = complex_from_faces([3, [[0, 1], [1, 2], [1, 2], [1, 1]], [[[0, 1], [0, 2]]]])
    found = collapse(cone)
    check(cone, found)
    assert found.left == (1, 1, 0)


def test_other_orders_are_tried_where_the_first_gets_stuck() -> None:
    """The dunce hat times an interval collapses (Zeeman), though not in the first order tried."""
    space = product(DUNCE_HAT, path(2))
    found = collapse(space)
    check(space, found)
    assert found.contractible
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(collapse_module, "ORDERS", 1)
        assert not collapse(space).contractible


@pytest.mark.parametrize(
    ("space", "verdict"),
    [
        (grid(2, 2, 2), "collapses to a point"),
        (POINT, "collapses to a point"),
        (DUNCE_HAT, "acyclic, not shown contractible"),
        (EMPTY, "not contractible"),
        (disjoint(POINT, POINT), "not contractible"),
        (circle(3), "not contractible"),
        (projective(2), "not contractible"),
        (projective(4), "not contractible"),
    ],
)
def test_contractibility_claims_what_was_shown(space: CubicalComplex, verdict: str) -> None:
    """The dunce hat is contractible without a free face: it is not called either."""
    assert contractibility(space, homology(space)) == verdict


def test_a_collapse_is_the_same_every_time() -> None:
    """The same complex gives the same steps."""
    space = grid(4, 3, 3)
    assert np.array_equal(collapse(space).steps, collapse(space).steps)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6, 7])
def test_the_arm_collapses(n: int) -> None:
    """The state complex of the positive arm collapses to a point, for every length tried."""
    space = state_complex(scene_from_spec(f"arm:n={n}"))
    found = collapse(space)
    check(space, found)
    assert found.contractible
