"""Lattice cells, read back from sites, which may be anything hashable."""

from collections.abc import Iterable

from cubepath.protocol.core.sites import Site

Cell = tuple[int, int]


def cell_of(site: Site) -> Cell:
    """Return a site that is a pair of whole numbers; fail at any other."""
    match site:
        case (int(x), int(y)):
            return x, y
        case _:
            raise AssertionError(f"expected a cell (x, y), found {site!r}")


def cells_of(sites: Iterable[Site]) -> list[Cell]:
    """Return the sites as pairs of whole numbers, in their order."""
    return [cell_of(site) for site in sites]
