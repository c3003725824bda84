"""Chains, matchings and Morse boundaries, against their definitions."""

from collections import Counter
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given

from cubepath.coordinator.theory.complexes.cubical_complex import (
    Boundary,
    CellRows,
    CubicalComplex,
    boundary_of,
    cofaces,
)
from cubepath.coordinator.theory.complexes.homology_groups import (
    Matching,
    matched,
    morse_columns,
    paths_along,
)
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from oracles.spaces import quotients, telescope, torus

Chain = Counter[int]


def chains(boundary: Boundary) -> list[Chain]:
    """Return the boundary of every cell."""
    start, face, value = (array.tolist() for array in boundary)
    return [Counter(dict(zip(face[a:b], value[a:b], strict=True))) for a, b in pairwise(start)]


def by_definition(space: CubicalComplex) -> list[Chain]:
    """Return the sums over j of (-1)^j (end 1 minus end 0), without zeros."""
    found, below = [], 0
    for faces in space.faces:
        for cube in faces.tolist():
            chain: Chain = Counter()
            for j, ends in enumerate(cube):
                for e, face in enumerate(ends):
                    chain[below + face] += (-1) ** j * (2 * e - 1)
            found.append(Counter({face: value for face, value in chain.items() if value}))
        below = len(found) - len(faces)
    return found


def morse_by_definition(boundary: list[Chain], matching: Matching) -> list[dict[int, int]]:
    """Return the Morse boundary of every critical cell: the sum over all paths from it."""
    pairs = list(zip(*(array.tolist() for array in matching), strict=True))
    above = {face: (cell, unit) for face, cell, unit in pairs if face != cell}
    critical = sorted(face for face, cell, _ in pairs if face == cell)
    number = {cell: place for place, cell in enumerate(critical)}

    def flow(chain: Chain) -> Chain:
        total: Chain = Counter()
        for face, value in chain.items():
            for reached, times in of_face(face).items():
                total[reached] += value * times
        return total

    @cache
    def of_face(face: int) -> Chain:
        if face in number:
            return Counter({number[face]: 1})
        if face not in above:
            return Counter()
        cell, unit = above[face]
        rest = Counter({each: -unit * value for each, value in boundary[cell].items()})
        del rest[face]
        return flow(rest)

    return [{c: v for c, v in flow(boundary[cell]).items() if v} for cell in critical]


def check(space: CubicalComplex) -> None:
    """Compare chains, matching and columns of a complex with what they are."""
    boundary = boundary_of(space)
    known = chains(boundary)
    assert known == by_definition(space)
    matching = matched(boundary, cofaces(CellRows(boundary.start, boundary.face)))
    gone: set[int] = set()
    for face, cell, unit in zip(*(array.tolist() for array in matching), strict=True):
        assert not gone & {face, cell}
        if face == cell:
            assert gone >= set(known[cell])
        else:
            assert known[cell][face] == unit
            assert abs(unit) == 1
            assert gone >= set(known[cell]) - {face}
        gone |= {face, cell}
    assert gone == set(range(len(known)))
    paths = paths_along(boundary, matching)
    rows = np.repeat(np.arange(len(paths.start) - 1), np.diff(paths.start))
    assert (paths.node[paths.node >= 0] > rows[paths.node >= 0]).all()
    expected = morse_by_definition(known, matching)
    assert morse_columns(paths, 2**30) == expected
    if any(abs(value) > 1 for column in expected for value in column.values()):
        assert morse_columns(paths, 1) is None


@pytest.mark.slow
@given(quotients())
def test_morse_boundaries_are_sums_over_paths(space: CubicalComplex) -> None:
    """Of any complex: chains with incidences added, an acyclic matching, all paths along it."""
    check(space)


@pytest.mark.parametrize("left", [PLAIN, COMPILED])
def test_they_are_so_over_long_paths(left: int) -> None:
    """Over many rows, and with coefficients that grow."""
    with plain_steps(left):
        check(torus(9, 9, 2))
        check(telescope(8, ascending=True))
