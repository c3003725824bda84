"""Cells in one row: the faces and cofaces are those of the complex."""

from collections import Counter

import pytest
from hypothesis import given

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, cofaces, incidence
from oracles.spaces import quotients


@pytest.mark.slow
@given(quotients())
def test_rows_hold_what_the_complex_holds(space: CubicalComplex) -> None:
    """Every face is there as often as it is one, and cofaces are the transpose."""
    found = incidence(space)
    above = cofaces(found.faces)
    start, cell = found.faces
    assert len(start) - 1 == found.offset[-1] == sum(space.f_vector)
    pairs: Counter[tuple[int, int]] = Counter()
    for k, faces in enumerate(space.faces):
        for i in range(len(faces)):
            here = slice(start[found.offset[k] + i], start[found.offset[k] + i + 1])
            below = found.offset[k - 1] if k else 0
            assert (cell[here] - below).tolist() == faces[i].reshape(-1).tolist()
            pairs.update((int(face), int(found.offset[k]) + i) for face in cell[here])
    for face in range(len(above.start) - 1):
        row = above.cell[above.start[face] : above.start[face + 1]].tolist()
        assert row == sorted(row)
        pairs.subtract((face, cube) for cube in row)
    assert not any(pairs.values())
