"""Lattices: which cells touch, and into how many pieces cells fall, as from where they lie."""

import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.catalogue import LATTICES, Catalogue, Cell, Generator, Lattice
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.touching import pieces, touching

DEGREES = {"hexagons": 6, "squares": 4, "edges": 6, "cubes": 6, "dodecahedra": 12, "cube-edges": 10}


@st.composite
def aggregates(draw: st.DrawFn) -> tuple[Lattice, set[Cell]]:
    """Draw a lattice, and some of its cells in a small box."""
    lattice = draw(st.sampled_from([*LATTICES.values()]))
    axes = [st.integers(-1, 2)] * lattice.dimension
    axes += [st.integers(0, lattice.dimension - 1)] * (lattice.arity - lattice.dimension)
    found = draw(st.sets(st.tuples(*axes), max_size=12))
    return lattice, {cell for cell in found if not (lattice.even and sum(cell) % 2)}


@given(aggregates())
def test_cells_touch_where_they_lie_as_near_as_cells_get(found: tuple[Lattice, set[Cell]]) -> None:
    """The contacts of every lattice, each neighbour once and mutual; and the pieces by them."""
    lattice, cells = found
    for cell in cells:
        near = lattice.beside(cell)
        assert len(near) == DEGREES[lattice.name]
        assert {*near} == touching(lattice, cell)
    assert lattice.pieces(cells) == pieces(lattice, cells)


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
def test_a_connected_system_allows_one_piece(lattice: Lattice) -> None:
    """The rule for the whole aggregate, on every lattice."""
    here: Cell = (0,) * lattice.arity
    there, beyond = lattice.beside(here)[0], lattice.shift(here, (4,) * lattice.dimension)
    cells = (here, beyond)
    jump = Generator("jump", cells, cells, (here,), (beyond,), (cells,))
    system = LatticeSystem(Catalogue(lattice, (jump,)), connected=True)
    assert system.legal({here, there})
    assert not system.legal({here, beyond})
