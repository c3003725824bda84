"""Who can obstruct whom on a lattice, against the definition of commuting, for any catalogue."""

from itertools import product

import pytest
from hypothesis import given, reject, settings, strategies as st

from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import EDGES, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.systems.lattice import LatticeSystem

CELLS = list(product(range(-1, 2), range(-1, 2), range(2)))


@st.composite
def catalogues(draw: st.DrawFn) -> Catalogue:
    """Draw one or two generators on lattice edges, which may turn a module to another axis."""
    found = []
    for number in range(draw(st.integers(1, 2))):
        here, there, *reads = draw(
            st.lists(st.sampled_from(CELLS), min_size=2, max_size=4, unique=True)
        )
        support = (here, there, *reads)
        motion = ((here, there),)
        found.append(Generator(f"g{number}", support, (here, there), (here,), (there,), motion))
    try:
        return Catalogue(EDGES, tuple(found))
    except InputError:  # they are equal
        reject()


def competitors(catalogue: Catalogue, cell: Cell) -> set[Cell]:
    """Return where a module may stand that has a move that does not commute with one at `cell`."""
    mine = catalogue.proposals(cell)
    return {
        other
        for other in product(range(-5, 6), range(-5, 6), range(2))
        if other != cell
        and not all(
            commute(one.action, each.action) for one in mine for each in catalogue.proposals(other)
        )
    }


@pytest.mark.slow
@settings(max_examples=15)
@given(catalogues())
def test_reach_is_where_moves_do_not_commute(catalogue: Catalogue) -> None:
    """For each orbit exactly the places of which the definition says so."""
    system = LatticeSystem(catalogue)
    for orbit in catalogue.templates:
        assert set(system.reach(orbit)) == competitors(catalogue, orbit)
