"""Homology of configuration spaces of vehicles on grids, against one pass over the face arrays.

    python tests/bench/bench_homology.py [--quick]

n unlabelled vehicles on a graph: the state complex of `agv`, whose cubes are the sets of n pairwise
disjoint closed cells of the graph, vertices and edges. It is built here from that definition alone,
by code of its own. The floor, measured in the same run, is one numpy sum over all face arrays. The
compiler's time, spent once after an installation, is not in it. Times are medians of three runs.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cubepath.coordinator.theory.complexes.collapses import collapse
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.protocol.compiled import allowance, compiled

Numbers = NDArray[np.int64]


def grid(width: int, height: int) -> Numbers:
    """Return the edges of a grid graph; shape (edges, 2)."""
    at = np.arange(width * height).reshape(height, width)
    across = np.stack([at[:, :-1].ravel(), at[:, 1:].ravel()], axis=1)
    up = np.stack([at[:-1].ravel(), at[1:].ravel()], axis=1)
    return np.concatenate([across, up])


@compiled
def _disjoint(places: int, edges: Numbers, moving: int, standing: int, found: Numbers) -> int:
    """List the cells with these many edges and vertices, in order; return how many there are.

    A cell is a row: the numbers of its edges, then those of its vertices, each ascending. Where
    `found` has no rows they are counted only.
    """
    depth, count = moving + standing, 0
    taken = np.zeros(places, np.bool_)
    chosen = np.zeros(depth + 1, np.int64)
    at = 0
    while at >= 0:
        if at == depth:
            if len(found):
                found[count] = chosen[:depth]
            count += 1
            at -= 1
            if at < 0:
                break
            _mark(edges, moving, at, chosen[at], taken)
            chosen[at] += 1
            continue
        last = len(edges) if at < moving else places
        while chosen[at] < last and not _free(edges, moving, at, chosen[at], taken):
            chosen[at] += 1
        if chosen[at] == last:
            at -= 1
            if at >= 0:
                _mark(edges, moving, at, chosen[at], taken)
                chosen[at] += 1
            continue
        _mark(edges, moving, at, chosen[at], taken)
        at += 1
        if at < depth:
            chosen[at] = 0 if at == moving else chosen[at - 1] + 1
    return count


@compiled
def _free(edges: Numbers, moving: int, at: int, cell: int, taken: NDArray[np.bool_]) -> bool:
    """Return whether no place of the cell is taken."""
    if at < moving:
        return not taken[edges[cell, 0]] and not taken[edges[cell, 1]]
    return not taken[cell]


@compiled
def _mark(edges: Numbers, moving: int, at: int, cell: int, taken: NDArray[np.bool_]) -> None:
    """Take the places of the cell, or leave them if they are taken."""
    if at < moving:
        taken[edges[cell, 0]] ^= True
        taken[edges[cell, 1]] ^= True
    else:
        taken[cell] ^= True


def configurations(width: int, height: int, vehicles: int) -> CubicalComplex:
    """Return the state complex of vehicles on a grid."""
    places, edges = width * height, grid(width, height)
    base = max(places, len(edges))
    faces: list[NDArray[np.int32]] = []
    below = np.empty(0, np.int64)
    for moving in range(vehicles + 1):
        standing = vehicles - moving
        none = np.empty((0, vehicles), np.int64)
        count = _disjoint(places, edges, moving, standing, none)
        if not count:
            break
        cells = np.empty((count, vehicles), np.int64)
        _disjoint(places, edges, moving, standing, cells)
        found = np.empty((count, moving, 2), np.int32)
        for j in range(moving):
            for e in (0, 1):
                end = edges[cells[:, j], e][:, None]
                stood = np.sort(np.concatenate([cells[:, moving:], end], axis=1), axis=1)
                rows = np.concatenate([cells[:, :j], cells[:, j + 1 : moving], stood], axis=1)
                found[:, j, e] = np.searchsorted(below, _keys(rows, base))
        faces.append(found)
        below = _keys(cells, base)
    return CubicalComplex(tuple(faces))


def _keys(rows: Numbers, base: int) -> Numbers:
    """Return a number for each row that grows with the rows' lexicographic order."""
    keys = np.zeros(len(rows), np.int64)
    for column in rows.T:
        keys = keys * base + column
    return keys


def read_faces(space: CubicalComplex) -> int:
    """Read every number of the complex once."""
    return sum(int(faces.sum()) for faces in space.faces)


def seconds_of(work: Callable[[], object]) -> float:
    """Return the median time of three runs."""
    times = []
    for _ in range(3):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def main() -> None:
    """Print the table."""
    allowance.left = 0  # what is measured is compiled code, for small sizes too
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="smaller grids only")
    cases = [(3, 3, 2), (3, 3, 3), (4, 3, 4), (4, 4, 3), (4, 4, 4), (6, 6, 3)]
    if not options.parse_args().quick:
        cases += [(5, 4, 4), (8, 8, 3), (5, 5, 4), (5, 5, 5)]
    homology(configurations(2, 2, 2))
    collapse(configurations(2, 2, 2))
    print(
        f"{'grid':>5}{'vehicles':>9}{'cells':>11}{'seconds':>9}{'us/cell':>9}{'floor ms':>10}"
        f"{'ratio':>8}{'critical':>9}{'betti':>8}{'collapse s':>11}"
    )
    for width, height, vehicles in tqdm(cases, disable=None, leave=False, file=sys.stderr):
        space = configurations(width, height, vehicles)
        cells = sum(space.f_vector)
        floor = seconds_of(partial(read_faces, space))
        ours = seconds_of(partial(homology, space))
        other = seconds_of(partial(collapse, space))
        found = homology(space)
        print(
            f"{width}x{height}".rjust(5) + f"{vehicles:>9}{cells:>11,}{ours:>9.4f}"
            f"{1e6 * ours / cells:>9.2f}{1e3 * floor:>10.3f}{ours / floor:>8.0f}"
            f"{sum(found.critical):>9,}{sum(found.betti):>8,}{other:>11.4f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
