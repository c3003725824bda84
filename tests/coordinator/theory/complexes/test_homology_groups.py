"""Homology: known spaces, the obvious way beside the fast one, products, big coefficients."""

from math import gcd

import pytest
from flint import fmpz_mat, nmod_mat
from hypothesis import given, settings, strategies

from cubepath.coordinator.theory.complexes import homology_groups as homology_module
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.homology_groups import Homology, homology
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.obvious_homology import obvious_homology
from oracles.spaces import (
    DUNCE_HAT,
    EMPTY,
    LOOP,
    ONE_SQUARE_KLEIN_BOTTLE,
    ONE_SQUARE_SPHERE,
    ONE_SQUARE_TORUS,
    POINT,
    circle,
    disjoint,
    glued,
    grid,
    moebius,
    product,
    projective,
    quotients,
    sphere,
    state_complex,
    subcomplexes,
    telescope,
    torus,
)

KNOWN = {
    "nothing": (EMPTY, (), {}),
    "a point": (POINT, (1,), {}),
    "three points": (disjoint(POINT, POINT, POINT), (3,), {}),
    "a loop": (LOOP, (1, 1), {}),
    "a circle": (circle(7), (1, 1), {}),
    "a ball": (grid(3, 2, 2), (1, 0, 0, 0), {}),
    "the 2-sphere": (sphere(2), (1, 0, 1), {}),
    "the 4-sphere": (sphere(4), (1, 0, 0, 0, 1), {}),
    "a sphere of one square": (ONE_SQUARE_SPHERE, (1, 0, 1), {}),
    "a torus": (torus(4, 3), (1, 2, 1), {}),
    "a torus of one square": (ONE_SQUARE_TORUS, (1, 2, 1), {}),
    "a 4-torus of one cube": (torus(1, 1, 1, 1), (1, 4, 6, 4, 1), {}),
    "the Klein bottle": (ONE_SQUARE_KLEIN_BOTTLE, (1, 1, 0), {1: (2,)}),
    "the projective plane": (projective(2), (1, 0, 0), {1: (2,)}),
    "projective 3-space": (projective(3), (1, 0, 0, 1), {1: (2,)}),
    "projective 4-space": (projective(4), (1, 0, 0, 0, 0), {1: (2,), 3: (2,)}),
    "the Moebius strip": (moebius(), (1, 1, 0), {}),
    "the dunce hat": (DUNCE_HAT, (1, 0, 0), {}),
    "two spheres at a point": (glued(disjoint(sphere(2), sphere(2)), [(0, 0, 8)]), (1, 0, 2), {}),
    "a torus, a sphere, a loop": (disjoint(torus(2, 2), sphere(2), LOOP), (3, 3, 2), {}),
}


def in_full(found: Homology) -> tuple[object, ...]:
    return found.betti, found.torsion, found.betti_z2


@pytest.mark.parametrize("name", KNOWN)
def test_known_spaces_have_the_homology_that_is_known(name: str) -> None:
    """Betti numbers and torsion are those of the textbook, and the obvious way finds the same."""
    space, betti, torsion = KNOWN[name]
    space.check()
    found = homology(space)
    assert found.betti == betti
    assert found.torsion == tuple(torsion.get(k, ()) for k in range(len(betti)))
    assert in_full(found) == obvious_homology(space)
    assert found.acyclic == (name in {"a point", "a ball", "the dunce hat"})


@pytest.mark.slow
@settings(max_examples=75)
@given(subcomplexes())
def test_on_pieces_of_grids_it_is_what_dense_matrices_say(space: CubicalComplex) -> None:
    """Random subcomplexes of grids in dimension up to 4 have the homology found the obvious way."""
    assert in_full(homology(space)) == obvious_homology(space)


@pytest.mark.slow
@settings(max_examples=75)
@given(quotients())
def test_on_random_quotients_it_is_what_dense_matrices_say(space: CubicalComplex) -> None:
    """So do quotients, where cubes are glued to themselves and incidences are 0, 2 and more."""
    space.check()
    assert in_full(homology(space)) == obvious_homology(space)


@pytest.mark.slow
@settings(max_examples=75)
@given(quotients())
def test_the_results_fit_each_other(space: CubicalComplex) -> None:
    """Euler characteristic, universal coefficients, lengths, Morse inequalities, determinism."""
    found = homology(space)
    assert len(found.betti) == len(found.torsion) == len(found.betti_z2) == space.dimension + 1
    assert sum((-1) ** k * betti for k, betti in enumerate(found.betti)) == space.euler
    even = [sum(factor % 2 == 0 for factor in factors) for factors in found.torsion]
    for k, betti in enumerate(found.betti):
        assert found.betti_z2[k] == betti + even[k] + (even[k - 1] if k else 0)
        assert found.betti_z2[k] <= found.critical[k] <= space.f_vector[k]
    assert homology(space) == found


@pytest.mark.slow
@settings(max_examples=40)
@given(quotients(most=2), quotients(most=2))
def test_products_follow_kuenneth(one: CubicalComplex, other: CubicalComplex) -> None:
    """The homology of a product is that of tensor products and torsion products."""
    if not one.faces or not other.faces:
        return
    found = homology(product(one, other))
    assert cyclic_parts(found) == kuenneth(homology(one), homology(other))


def test_products_of_spaces_with_torsion_follow_kuenneth() -> None:
    """The same for Klein bottles, projective spaces and a torsion of 16: torsion meets torsion."""
    spaces = [ONE_SQUARE_KLEIN_BOTTLE, projective(2), projective(3), telescope(3, ascending=True)]
    for place, one in enumerate(spaces):
        for other in spaces[place:]:
            found = homology(product(one, other))
            assert cyclic_parts(found) == kuenneth(homology(one), homology(other))


def cyclic_parts(found: Homology) -> list[tuple[int, list[int]]]:
    """Return rank and torsion of each group, the latter as sorted prime powers."""
    return [
        (betti, sorted(power for factor in factors for power in prime_powers(factor)))
        for betti, factors in zip(found.betti, found.torsion, strict=True)
    ]


def kuenneth(one: Homology, other: Homology) -> list[tuple[int, list[int]]]:
    """Return the homology of the product, in the form of `cyclic_parts`; 0 stands for Z."""
    groups: list[list[int]] = [[] for _ in range(len(one.betti) + len(other.betti))]
    for i, first in enumerate(cyclic_parts(one)):
        for j, second in enumerate(cyclic_parts(other)):
            for a in [0] * first[0] + first[1]:
                for b in [0] * second[0] + second[1]:
                    groups[i + j].append(gcd(a, b))
                    if a and b:
                        groups[i + j + 1].append(gcd(a, b))
    top = groups.pop()
    assert top == []
    return [(group.count(0), sorted(a for a in group if a > 1)) for group in groups]


def prime_powers(number: int) -> list[int]:
    found, prime = [], 2
    while number > 1:
        power = 1
        while number % prime == 0:
            number, power = number // prime, power * prime
        if power > 1:
            found.append(power)
        prime += 1
    return found


@pytest.mark.parametrize("ascending", [True, False])
def test_coefficients_beyond_64_bits_are_exact(ascending: bool) -> None:
    """A torsion of 2^91 comes out whole, whether it arises in the matching or in the pivots."""
    found = homology(telescope(90, ascending=ascending))
    assert found.betti == (1, 1, 0)
    assert found.torsion == ((), (2**91,), ())
    assert found.betti_z2 == (1, 2, 1)


@given(quotients())
@settings(max_examples=40)
def test_where_64_bits_end_changes_nothing(space: CubicalComplex) -> None:
    """With a limit of 1 linear algebra takes more of the complex: the same groups."""
    expected = in_full(homology(space))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(homology_module, "LIMIT", 1)
        assert in_full(homology(space)) == expected


_ENTRIES = strategies.lists(strategies.integers(-12, 12), min_size=4, max_size=4)


@given(strategies.lists(_ENTRIES, min_size=1, max_size=5))
def test_smith_forms_are_those_of_flint(columns: list[list[int]]) -> None:
    """Invariant factors, each a divisor of the next, and the rank modulo 2."""
    sparse = [{row: value for row, value in enumerate(column) if value} for column in columns]
    matrix = fmpz_mat(columns)
    form = matrix.snf()
    diagonal = [abs(int(form[i, i])) for i in range(min(form.nrows(), form.ncols()))]
    expected = [factor for factor in diagonal if factor], nmod_mat(matrix, 2).rank()
    assert homology_module._smith(sparse, list(range(len(sparse)))) == expected


def test_progress_adds_up_to_the_number_of_cells() -> None:
    """Progress is told of every cell once."""
    for space in (EMPTY, torus(5, 5, 5), telescope(40, ascending=False)):
        told: list[int] = []
        homology(space, told.append)
        assert sum(told) == sum(space.f_vector)


@pytest.mark.parametrize(
    ("spec", "betti", "torsion"),
    [
        ("agv:graph=K5,n=2", (1, 6, 0), {1: (2,)}),
        ("agv-labelled:graph=K5,n=2", (1, 12, 1), {}),
        ("arm:n=5", (1, 0, 0, 0), {}),
        ("agv:graph=grid3x3,n=2", (1, 5, 0), {}),
        ("agv:graph=grid2x3,n=3", None, {}),
        ("agv-labelled:graph=grid2x3,n=2", None, {}),
        ("arm:n=6", (1, 0, 0, 0), {}),
    ],
)
def test_state_complexes(
    spec: str, betti: tuple[int, ...] | None, torsion: dict[int, tuple[int, ...]]
) -> None:
    """State complexes have the homology that the paper says, and that the obvious way finds."""
    space = state_complex(scene_from_spec(spec))
    space.check()
    found = homology(space)
    assert in_full(found) == obvious_homology(space)
    if betti is not None:
        assert found.betti == betti
        assert found.torsion == tuple(torsion.get(k, ()) for k in range(len(betti)))


def test_a_large_torus_is_quick() -> None:
    """A 3-torus of 216,000 cells leaves one critical cell for each class."""
    found = homology(torus(30, 30, 30))
    assert found.betti == found.critical == (1, 3, 3, 1)
