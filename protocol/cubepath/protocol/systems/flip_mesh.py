"""A triangulation in arrays, in which compiled code flips edges and walks along segments.

Edges have numbers that they keep when they flip. All arithmetic is on 64-bit integers, which the
span of the coordinates keeps exact (`PointSet.exact`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner

Numbers = NDArray[np.int64]
Floats = NDArray[np.float64]

NONE = -1
"""There is no triangle on this side of an edge, so no apex and no sides."""


class Mesh(NamedTuple):
    """A triangulation: for each edge its ends, the apexes of its triangles and their sides.

    Edge e goes from ``ends[e, 0]`` = a to ``ends[e, 1]`` = b; ``apex[e, 0]`` = c lies left of it
    and ``apex[e, 1]`` = d right. The row ``side[e]`` holds the numbers of the edges bc, ca, ad, db.
    """

    xy: Numbers
    """Coordinates, shape (points, 2)."""
    ends: Numbers
    """Shape (edges, 2)."""
    apex: Numbers
    """Shape (edges, 2), `NONE` outside the hull."""
    side: Numbers
    """Shape (edges, 4), `NONE` outside the hull."""
    spoke: Numbers
    """An edge that ends at each point, shape (points,); kept up to date where nothing flips."""


@inner
def turn(xy: Numbers, one: int, other: int, third: int) -> int:
    """Return twice the signed area of a triangle of points, positive where it turns left."""
    ax, ay = xy[one, 0], xy[one, 1]
    return int(
        (xy[other, 0] - ax) * (xy[third, 1] - ay) - (xy[other, 1] - ay) * (xy[third, 0] - ax)
    )


@inner
def _before(xy: Numbers, centre: int, one: int, other: int) -> bool:
    """Return whether the ray to `one` comes before that to `other`, counter-clockwise from east."""
    x, y = xy[one, 0] - xy[centre, 0], xy[one, 1] - xy[centre, 1]
    u, v = xy[other, 0] - xy[centre, 0], xy[other, 1] - xy[centre, 1]
    above, over = y > 0 or (y == 0 and x > 0), v > 0 or (v == 0 and u > 0)
    if above != over:
        return bool(above)
    return bool(x * v - y * u > 0)


class _Rays(NamedTuple):
    """The edges around each point, counter-clockwise: where they begin, other ends, numbers."""

    begins: Numbers
    ends: Numbers
    edges: Numbers


@inner
def _rays(mesh: Mesh) -> _Rays:
    points, edges = len(mesh.xy), len(mesh.ends)
    begins = np.zeros(points + 1, dtype=np.int64)
    for point in mesh.ends.ravel():
        begins[point + 1] += 1
    begins = np.cumsum(begins)
    filled = begins[:-1].copy()
    around = np.empty(2 * edges, dtype=np.int64)
    by = np.empty(2 * edges, dtype=np.int64)
    for edge in range(edges):
        for place in range(2):
            one, other = int(mesh.ends[edge, place]), int(mesh.ends[edge, 1 - place])
            at = filled[one]
            while at > begins[one] and _before(mesh.xy, one, int(other), int(around[at - 1])):
                around[at], by[at] = around[at - 1], by[at - 1]
                at -= 1
            around[at], by[at] = other, edge
            filled[one] += 1
    return _Rays(begins, around, by)


@inner
def _between(rays: _Rays, one: int, other: int) -> int:
    """Return the edge between two points, `NONE` if there is none."""
    begins = rays.begins
    if begins[one + 1] - begins[one] > begins[other + 1] - begins[other]:
        one, other = other, one
    for place in range(begins[one], begins[one + 1]):
        if rays.ends[place] == other:
            return int(rays.edges[place])
    return NONE


@compiled
def connect(mesh: Mesh) -> bool:
    """Fill in apexes, sides and spokes from the ends; return whether all is a triangulation.

    Every edge must have a triangle on one side at least, and every triangle three edges. That no
    two edges cross is for the caller to know.
    """
    rays = _rays(mesh)
    mesh.apex[:] = NONE
    mesh.side[:] = NONE
    for one in range(len(mesh.xy)):
        first, last = rays.begins[one], rays.begins[one + 1]
        if first == last:
            return False
        mesh.spoke[one] = rays.edges[first]
        for at in range(first, last):
            following = first if at + 1 == last else at + 1
            other, third = rays.ends[at], rays.ends[following]
            if turn(mesh.xy, one, other, third) <= 0:
                continue
            across = _between(rays, other, third)
            if across == NONE:
                return False
            _join(mesh, _from(mesh, rays.edges[at], one), third, across, rays.edges[following])
    for edge in range(len(mesh.ends)):
        if max(mesh.apex[edge, 0], mesh.apex[edge, 1]) == NONE:
            return False
    return True


@inner
def _join(mesh: Mesh, at: tuple[int, int], apex: int, ahead: int, back: int) -> None:
    """Put a triangle on one side of an edge: 0 on the left, 1 on the right.

    Seen from that side, `ahead` is the edge from the far end to the apex, and `back` the one from
    the apex to the near end.
    """
    edge, slot = at
    mesh.apex[edge, slot] = apex
    mesh.side[edge, 2 * slot] = ahead
    mesh.side[edge, 2 * slot + 1] = back


@inner
def _from(mesh: Mesh, edge: int, one: int) -> tuple[int, int]:
    """Return an edge and the side that lies left of it as seen from one of its ends."""
    return edge, 0 if mesh.ends[edge, 0] == one else 1


@inner
def convex(mesh: Mesh, edge: int) -> bool:
    """Return whether an edge can flip: its two triangles form a strictly convex quadrilateral."""
    c, d = mesh.apex[edge, 0], mesh.apex[edge, 1]
    if min(c, d) == NONE:
        return False
    a, b = mesh.ends[edge, 0], mesh.ends[edge, 1]
    return turn(mesh.xy, d, c, a) > 0 and turn(mesh.xy, c, d, b) > 0


@inner
def flip(mesh: Mesh, edge: int) -> None:
    """Flip an edge that can flip; spokes are left as they are. Twice gives the same edge again."""
    a, b = mesh.ends[edge, 0], mesh.ends[edge, 1]
    c, d = mesh.apex[edge, 0], mesh.apex[edge, 1]
    bc, ca, ad, db = mesh.side[edge, 0], mesh.side[edge, 1], mesh.side[edge, 2], mesh.side[edge, 3]
    mesh.ends[edge, 0], mesh.ends[edge, 1] = d, c
    mesh.apex[edge, 0], mesh.apex[edge, 1] = a, b
    mesh.side[edge, 0], mesh.side[edge, 1], mesh.side[edge, 2], mesh.side[edge, 3] = ca, ad, db, bc
    _join(mesh, _from(mesh, ca, c), d, ad, edge)
    _join(mesh, _from(mesh, ad, a), c, edge, ca)
    _join(mesh, _from(mesh, db, d), c, bc, edge)
    _join(mesh, _from(mesh, bc, b), d, edge, db)


@inner
def crossed(mesh: Mesh, weights: Floats, start: int, end: int, found: Numbers) -> tuple[float, int]:
    """Return the weight and the number of the edges that the segment between two points crosses.

    No point may lie on the segment. The edges are noted in `found`, as far as it reaches.
    """
    xy = mesh.xy
    edge, back = mesh.spoke[start], False
    # Turn left around the start until the segment lies in the triangle; at the hull, turn back.
    while True:
        place = 0 if mesh.ends[edge, 0] == start else 1
        other = mesh.ends[edge, 1 - place]
        slot = 1 - place if back else place
        apex = mesh.apex[edge, slot]
        if end in (other, apex):
            return 0.0, 0
        if apex == NONE:
            if back:
                return -1.0, NONE
            edge, back = mesh.spoke[start], True
            continue
        right, left = (apex, other) if back else (other, apex)
        ahead, behind = mesh.side[edge, 2 * slot], mesh.side[edge, 2 * slot + 1]
        if turn(xy, start, right, end) > 0 and turn(xy, start, left, end) < 0:
            gate = behind if back else ahead
            break
        edge = ahead if back else behind
    total, count = 0.0, 0
    while True:
        total += float(weights[gate])
        if count < len(found):
            found[count] = gate
        count += 1
        # Left of the edge as seen from its left end lies the triangle that follows.
        slot = 0 if mesh.ends[gate, 0] == left else 1
        apex = mesh.apex[gate, slot]
        if apex in (end, NONE):
            return (total, count) if apex == end else (-1.0, NONE)
        if turn(xy, start, end, apex) > 0:
            gate, left = mesh.side[gate, 2 * slot], apex
        else:
            gate, right = mesh.side[gate, 2 * slot + 1], apex


@compiled
def crossings(mesh: Mesh, edges: Numbers) -> Numbers:
    """Return how many edges of a mesh each of some edges crosses; `edges` has a row for each."""
    weights, nothing = np.ones(len(mesh.ends)), np.empty(0, dtype=np.int64)
    found = np.zeros(len(edges), dtype=np.int64)
    for place in range(len(edges)):
        _, found[place] = crossed(mesh, weights, edges[place, 0], edges[place, 1], nothing)
    return found
