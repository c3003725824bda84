"""Closed surfaces: known ones, random ones from squares glued side to side, and what is none."""

from random import Random

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, complex_from_faces
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.coordinator.theory.complexes.surfaces import ClosedSurface, surface
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.spaces import (
    EMPTY,
    LOOP,
    ONE_SQUARE_KLEIN_BOTTLE,
    ONE_SQUARE_SPHERE,
    ONE_SQUARE_TORUS,
    POINT,
    disjoint,
    glued,
    grid,
    moebius,
    projective,
    quotients,
    sphere,
    state_complex,
    torus,
)


@pytest.mark.parametrize(
    ("space", "name"),
    [
        (sphere(2), "closed orientable surface of genus 0"),
        (ONE_SQUARE_SPHERE, "closed orientable surface of genus 0"),
        (torus(3, 5), "closed orientable surface of genus 1"),
        (ONE_SQUARE_TORUS, "closed orientable surface of genus 1"),
        (ONE_SQUARE_KLEIN_BOTTLE, "closed non-orientable surface, Euler characteristic 0"),
        (projective(2), "closed non-orientable surface, Euler characteristic 1"),
        (
            disjoint(projective(2), sphere(2)),
            (
                "2 surfaces: closed non-orientable surface, Euler characteristic 1; "
                "closed orientable surface of genus 0"
            ),
        ),
        (EMPTY, "not a closed surface: it is empty"),
        (POINT, "not a closed surface: its dimension is 0, not 2"),
        (torus(2, 2, 2), "not a closed surface: its dimension is 3, not 2"),
        (moebius(), "not a closed surface: edge 2 lies in 1 square"),
        (disjoint(sphere(2), LOOP), "not a closed surface: edge 12 lies in 0 squares"),
        (
            glued(disjoint(sphere(2), sphere(2)), [(0, 3, 11)]),
            "not a closed surface: the link of vertex 3 consists of 2 circles, not 1",
        ),
        (
            disjoint(sphere(2), POINT),
            "not a closed surface: the link of vertex 8 consists of 0 circles, not 1",
        ),
        (
            glued(disjoint(sphere(2), sphere(2)), [(1, 3, 15)]),
            "not a closed surface: edge 3 lies in 4 squares",
        ),
    ],
)
def test_known_spaces_are_told_apart(space: CubicalComplex, name: str) -> None:
    """Closed surfaces are named by genus or Euler characteristic, others by their first flaw."""
    assert surface(space).name == name
    assert surface(space).closed == ("not a" not in name)


def test_genus_counts_handles_or_crosscaps() -> None:
    """The genus is that of the connected sum of tori, or of projective planes."""
    assert ClosedSurface(euler=-10, orientable=True).genus == 6
    assert ClosedSurface(euler=-5, orientable=False).genus == 7


@pytest.mark.parametrize(
    ("spec", "name"),
    [
        ("agv:graph=K5,n=2", "closed non-orientable surface, Euler characteristic -5"),
        ("agv-labelled:graph=K5,n=2", "closed orientable surface of genus 6"),
    ],
)
def test_vehicles_on_the_complete_graph_make_the_surfaces_of_the_paper(
    spec: str, name: str
) -> None:
    """Two vehicles on K5: unlabelled not orientable, labelled of genus 6."""
    assert surface(state_complex(scene_from_spec(spec))).name == name


@st.composite
def glued_squares(draw: st.DrawFn) -> CubicalComplex:
    """Draw squares of which every side is glued to one other: a closed surface, always."""
    count = draw(st.integers(1, 12))
    random = Random(draw(st.integers(0, 2**32)))  # noqa: S311 - nothing secret
    sides = list(range(4 * count))
    random.shuffle(sides)
    apart = disjoint(*[grid(1, 1)] * count)
    pairs = zip(sides[::2], sides[1::2], strict=True)
    return glued(apart, [(1, one, other) for one, other in pairs])


@given(glued_squares())
def test_squares_glued_side_to_side_are_a_closed_surface(space: CubicalComplex) -> None:
    """Its pieces, orientability and genus are those that its homology shows."""
    found = surface(space)
    groups = homology(space)
    assert found.closed
    assert len(found.pieces) == groups.betti[0] == groups.betti_z2[2]
    assert sum(piece.orientable for piece in found.pieces) == groups.betti[2]
    assert sum(piece.euler for piece in found.pieces) == space.euler
    crosscaps = [piece.genus for piece in found.pieces if not piece.orientable]
    handles = [piece.genus for piece in found.pieces if piece.orientable]
    assert groups.torsion[1] == (2,) * len(crosscaps)
    assert groups.betti[1] == 2 * sum(handles) + sum(crosscaps) - len(crosscaps)


@given(glued_squares(), st.integers(0, 100), st.integers(0, 100))
def test_two_points_of_a_surface_made_one_are_a_flaw(
    space: CubicalComplex, one: int, other: int
) -> None:
    """Gluing two vertices leaves every edge in two squares but makes a link of two circles."""
    one, other = one % space.f_vector[0], other % space.f_vector[0]
    found = surface(glued(space, [(0, one, other)]))
    low = min(one, other)
    flaw = f"the link of vertex {low} consists of 2 circles, not 1"
    assert found.flaw == ("" if one == other else flaw)


@pytest.mark.slow
@given(quotients())
def test_a_flaw_is_one(space: CubicalComplex) -> None:
    """On random complexes a surface has the mod 2 homology of one, and a flaw can be checked."""
    found = surface(space)
    if found.closed:
        groups = homology(space)
        assert groups.betti_z2[0] == groups.betti_z2[2] == len(found.pieces)
    elif found.flaw.startswith("edge"):
        _, edge, _, _, count, _ = found.flaw.split()
        assert (space.faces[2] == int(edge)).sum() == int(count) != 2


def test_a_cone_point_is_a_point_of_a_surface() -> None:
    """Two sides of a square glued at their corner: the link there is one circle of one arc."""
    cone = complex_from_faces([3, [[0, 1], [1, 2]], [[[0, 1], [0, 1]]]])
    assert surface(cone).name == "closed orientable surface of genus 0"
