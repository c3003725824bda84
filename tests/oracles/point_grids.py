"""The obvious triangulations of a point set, by code that shares nothing with the project's."""

from fractions import Fraction
from itertools import combinations

from hypothesis import strategies as st

from cubepath.protocol.systems.point_sets import Edge, Point


def turn(a: Point, b: Point, c: Point) -> int:
    value = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (value > 0) - (value < 0)


def between(a: Point, b: Point, c: Point) -> bool:
    return turn(a, b, c) == 0 and min(a, b) < c < max(a, b)


def meet(points: list[Point], one: Edge, other: Edge) -> bool:
    """Tell whether two edges have more in common than a corner, from where their lines meet."""
    (p, q), (r, s) = ((points[a], points[b]) for a, b in (one, other))
    d, e = (q[0] - p[0], q[1] - p[1]), (s[0] - r[0], s[1] - r[1])
    cross = d[0] * e[1] - d[1] * e[0]
    if cross == 0:
        return any(between(p, q, c) for c in (r, s)) or any(between(r, s, c) for c in (p, q))
    w = (r[0] - p[0], r[1] - p[1])
    t, u = Fraction(w[0] * e[1] - w[1] * e[0], cross), Fraction(w[0] * d[1] - w[1] * d[0], cross)
    return 0 <= t <= 1 and 0 <= u <= 1 and not (t in (0, 1) and u in (0, 1))


def all_triangulations(points: list[Point]) -> set[frozenset[Edge]]:
    """Return the largest sets of edges that do not meet, by trying all."""
    edges = [
        (a, b)
        for a, b in combinations(range(len(points)), 2)
        if not any(between(points[a], points[b], c) for c in points)
    ]
    clash = {
        edge: {other for other in edges if other != edge and meet(points, edge, other)}
        for edge in edges
    }
    found: list[frozenset[Edge]] = []

    def extend(chosen: list[Edge], left: list[Edge]) -> None:
        if not left:
            found.append(frozenset(chosen))
            return
        edge = left[0]
        extend([*chosen, edge], [other for other in left[1:] if other not in clash[edge]])
        if clash[edge] & set(left):
            extend(chosen, left[1:])

    extend([], edges)
    most = max(map(len, found))
    return {edges for edges in found if len(edges) == most}


def on_grid(most: int) -> st.SearchStrategy[list[Point]]:
    """Draw points on a small grid, of which many are collinear, but not all."""
    cells = [(x, y) for x in range(4) for y in range(4)]
    return st.lists(st.sampled_from(cells), min_size=3, max_size=most, unique=True).filter(
        lambda points: any(turn(a, b, c) for a, b, c in combinations(points, 3))
    )
