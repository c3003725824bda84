"""Known spaces as small cubical complexes, and ways to make complexes from complexes.

Products, disjoint unions, subcomplexes and gluings of any cubes of one dimension, so that tests
reach cubes that are glued to themselves; and the state complex of a scene, cube by cube.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from hypothesis import strategies as st

from cubepath.coordinator.theory.complexes.cubical_complex import (
    CubicalComplex,
    Faces,
    complex_from_faces,
)
from cubepath.protocol.core.actions import Action, State, apply
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from oracles.complexes import actions_at, commuting_sets, states_of

Pair = tuple[int, int, int]

EMPTY = CubicalComplex(())
POINT = complex_from_faces([1])
LOOP = complex_from_faces([1, [[0, 0]]])
ONE_SQUARE_TORUS = complex_from_faces([1, [[0, 0]] * 2, [[[0, 0], [1, 1]]]])
ONE_SQUARE_KLEIN_BOTTLE = complex_from_faces([1, [[0, 0]] * 2, [[[0, 1], [1, 0]]]])
ONE_SQUARE_SPHERE = complex_from_faces([3, [[0, 1], [1, 2]], [[[0, 1], [0, 1]]]])
# A triangle whose three sides are one loop, twice forwards and once backwards: contractible, but
# without a free face.
DUNCE_HAT = complex_from_faces(
    [
        3,
        [[0, 1], [0, 1], [1, 2], [1, 2], [1, 2]],
        [[[0, 2], [0, 4]], [[0, 2], [1, 3]], [[1, 3], [1, 4]]],
    ]
)
# From its middle outwards, so that turning it round keeps which end of an edge is which.
OUTWARD = complex_from_faces([3, [[1, 0], [1, 2]]])
TURNED = [[2, 1, 0], [1, 0]]


def path(edges: int) -> CubicalComplex:
    """Return an interval of so many edges."""
    return complex_from_faces([edges + 1, [[i, i + 1] for i in range(edges)]])


def circle(edges: int) -> CubicalComplex:
    """Return a circle of so many edges; of 1 it is a loop."""
    return complex_from_faces([edges, [[i, (i + 1) % edges] for i in range(edges)]])


def product(*factors: CubicalComplex) -> CubicalComplex:
    """Return the product, the directions of the first factor first."""
    found = POINT
    for factor in factors:
        found = _product(found, factor)
    return found


def grid(*edges: int) -> CubicalComplex:
    """Return a box of so many unit cubes along each axis."""
    return product(*(path(count) for count in edges))


def torus(*edges: int) -> CubicalComplex:
    """Return a torus of so many unit cubes along each axis."""
    return product(*(circle(count) for count in edges))


def sphere(dimension: int) -> CubicalComplex:
    """Return the boundary of a cube of dimension + 1."""
    return CubicalComplex(grid(*[1] * (dimension + 1)).faces[:-1])


def disjoint(*parts: CubicalComplex) -> CubicalComplex:
    """Return the disjoint union."""
    found = EMPTY
    for part in parts:
        dimension = max(found.dimension, part.dimension)
        one, other = _padded(found, dimension), _padded(part, dimension)
        offsets = [0, *(len(faces) for faces in one)]
        found = CubicalComplex(
            tuple(
                np.concatenate([one[k], other[k] + offsets[k]]).astype(np.int32)
                for k in range(dimension + 1)
            )
        )
    return found


def glued(complex_: CubicalComplex, pairs: Iterable[Pair]) -> CubicalComplex:
    """Return the complex with the k-cubes i and j made one, and so their faces, for all (k, i, j).

    Directions and ends are kept, so any cubes of one dimension can be glued.
    """
    name = [list(range(count)) for count in complex_.f_vector]

    def root(k: int, i: int) -> int:
        while name[k][i] != i:
            i = name[k][i]
        return i

    todo = list(pairs)
    while todo:
        k, i, j = todo.pop()
        low, high = sorted((root(k, i), root(k, j)))
        name[k][high] = low
        ends = zip(complex_.faces[k][i].flat, complex_.faces[k][j].flat, strict=True)
        todo += [(k - 1, int(one), int(other)) for one, other in ends] if i != j else []
    return _kept(complex_, [[root(k, i) for i in range(len(of))] for k, of in enumerate(name)])


def generated(complex_: CubicalComplex, cubes: Iterable[tuple[int, int]]) -> CubicalComplex:
    """Return the subcomplex of the cubes (k, i) and their faces; its dimension may be less."""
    kept = [set[int]() for _ in complex_.faces]
    todo = list(cubes)
    while todo:
        k, i = todo.pop()
        kept[k].add(i)
        todo += [(k - 1, int(face)) for face in complex_.faces[k][i].flat]
    names = [
        [i if i in of else -1 for i in range(len(complex_.faces[k]))] for k, of in enumerate(kept)
    ]
    while names and not kept[len(names) - 1]:
        names.pop()
    return _kept(complex_, names)


def projective(dimension: int) -> CubicalComplex:
    """Return real projective space: a cube with opposite points of its boundary glued."""
    ball, opposite = POINT, [[0]]
    for _ in range(dimension):
        opposite = _product_map(opposite, TURNED)
        ball = _product(ball, OUTWARD)
    k = dimension - 1
    outside = np.flatnonzero(np.bincount(ball.faces[dimension].reshape(-1)) == 1)
    return glued(ball, [(k, int(i), opposite[k][i]) for i in outside])


def moebius() -> CubicalComplex:
    """Return the Moebius strip: two squares with opposite sides glued, one side turned round."""
    # The edges that go up are the first: two on the left, two on the right.
    return glued(product(path(1), OUTWARD), [(1, 0, 3), (1, 1, 2)])


def telescope(doublings: int, *, ascending: bool) -> CubicalComplex:
    """Return loops at one vertex with torsion Z/2^(doublings + 1) in H_1.

    Say x_i is the i-th loop less a last one: the squares say that x_i = 2 x_(i+1) and 2 x_0 = 0.
    """
    loops = range(doublings + 1) if ascending else range(doublings, -1, -1)
    number = {loop: place for place, loop in enumerate(loops)}
    base = doublings + 1
    # The boundary of [[a, b], [c, d]] is b - a - d + c.
    squares = [[[number[i], number[i + 1]], [number[i + 1], base]] for i in range(doublings)]
    squares.append([[base, number[0]], [number[0], base]])
    return complex_from_faces([1, [[0, 0]] * (doublings + 2), squares])


def state_complex(scene: Scene) -> CubicalComplex:
    """Return the state complex of a small scene, from the obvious enumeration of its cubes."""
    number: list[dict[object, int]] = []
    faces: list[dict[int, list[list[int]]]] = []
    order: dict[object, int] = {}
    cubes = [
        (state, tuple(sorted(chosen, key=lambda action: order.setdefault(action, len(order)))))
        for state in states_of(scene)
        for chosen in [(), *commuting_sets(actions_at(scene, state))]
    ]
    for state, chosen in sorted(cubes, key=lambda cube: len(cube[1])):
        k = len(chosen)
        if k == len(number):
            number.append({})
            faces.append({})
        key = _key(state, chosen)
        if key in number[k]:
            continue
        number[k][key] = len(number[k])
        rows = faces[k][number[k][key]] = []
        for j, action in enumerate(chosen):
            rest = chosen[:j] + chosen[j + 1 :]
            here, there = (number[k - 1][_key(at, rest)] for at in (state, apply(action, state)))
            first = action.ends[0] & action.trace <= state
            rows.append([here, there] if first else [there, here])
    return complex_from_faces([len(number[0]), *(list(of.values()) for of in faces[1:])])


def _key(state: State, chosen: Iterable[Action]) -> object:
    moved = frozenset[Site]().union(*(action.trace for action in chosen))
    return state - moved, frozenset(chosen)


def _padded(complex_: CubicalComplex, dimension: int) -> list[Faces]:
    none = range(complex_.dimension + 1, dimension + 1)
    return [*complex_.faces, *(np.empty((0, k, 2), np.int32) for k in none)]


def _product(one: CubicalComplex, other: CubicalComplex) -> CubicalComplex:
    """Return the product; its k-cubes by the dimension of the first factor, then by its number."""
    counts = [_counts(one, other, k) for k in range(one.dimension + other.dimension + 1)]
    faces: list[Faces] = []
    for k in range(len(counts)):
        rows = []
        for i, size in counts[k].items():
            many = other.f_vector[k - i]
            left, right = np.divmod(np.arange(size), many)
            row = np.empty((size, k, 2), np.int32)
            if i:
                first = sum(n for d, n in counts[k - 1].items() if d < i - 1)
                row[:, :i] = first + one.faces[i][left] * many + right[:, None, None]
            if k > i:
                first = sum(n for d, n in counts[k - 1].items() if d < i)
                fewer = other.f_vector[k - i - 1]
                row[:, i:] = first + left[:, None, None] * fewer + other.faces[k - i][right]
            rows.append(row)
        faces.append(np.concatenate(rows))
    return CubicalComplex(tuple(faces))


def _counts(one: CubicalComplex, other: CubicalComplex, k: int) -> dict[int, int]:
    """Return how many k-cubes the product has for each dimension in the first factor."""
    return {
        i: one.f_vector[i] * other.f_vector[k - i]
        for i in range(k + 1)
        if i <= one.dimension and k - i <= other.dimension
    }


def _product_map(one: list[list[int]], other: list[list[int]]) -> list[list[int]]:
    """Return the product of two maps, given by the images of cubes, as a map of products."""
    return [
        [
            _number(one, other, k, i) + x * len(other[k - i]) + y
            for i in range(k + 1)
            if i < len(one) and k - i < len(other)
            for x in one[i]
            for y in other[k - i]
        ]
        for k in range(len(one) + len(other) - 1)
    ]


def _number(one: list[list[int]], other: list[list[int]], k: int, i: int) -> int:
    return sum(
        len(one[d]) * len(other[k - d]) for d in range(i) if d < len(one) and k - d < len(other)
    )


def _kept(complex_: CubicalComplex, names: Sequence[Sequence[int]]) -> CubicalComplex:
    """Return the cubes that are their own names, each cube replaced by its name; -1 is for none."""
    chosen = [[i for i, name in enumerate(of) if name == i] for of in names]
    place = [{i: at for at, i in enumerate(of)} for of in chosen]
    faces: list[object] = [len(chosen[0])] if chosen else []
    for k in range(1, len(chosen)):
        below = [place[k - 1].get(name, -1) for name in names[k - 1]]
        faces.append([[below[face] for face in complex_.faces[k][i].flat] for i in chosen[k]])
    return complex_from_faces(faces)


GRIDS = [
    grid(*edges)
    for edges in [(4,), (3, 3), (2, 2, 2), (3, 2, 1), (1, 1, 1, 1), (2, 2, 1, 1), (2, 1, 1, 1)]
]
_pick = st.integers(0, 10**6)


@st.composite
def subcomplexes(draw: st.DrawFn, *, most: int = 4) -> CubicalComplex:
    """Draw a subcomplex of a grid of dimension at most `most`, generated by random cubes."""
    whole = draw(st.sampled_from([one for one in GRIDS if one.dimension <= most]))
    cubes = []
    for low, part in ((0, 20), (whole.dimension - 1, 20), (whole.dimension, 12)):
        for pick in draw(st.lists(_pick, max_size=part)):
            k = min(low + (pick % 2 if low == 0 else 0), whole.dimension)
            cubes.append((k, pick // 2 % whole.f_vector[k]))
    return generated(whole, cubes)


@st.composite
def presentations(draw: st.DrawFn) -> CubicalComplex:
    """Draw loops at one vertex and squares with any sides: any sums of incidences, much torsion."""
    loops = draw(st.integers(1, 5))
    side = st.integers(0, loops - 1)
    squares = draw(st.lists(st.lists(side, min_size=4, max_size=4), min_size=1, max_size=6))
    return complex_from_faces([1, [[0, 0]] * loops, squares])


@st.composite
def quotients(draw: st.DrawFn, *, most: int = 4) -> CubicalComplex:
    """Draw a quotient of such a subcomplex, or of squares, by gluings of random pairs of cubes."""
    found = draw(st.one_of(subcomplexes(most=most), presentations()))
    if most > 2 and found.f_vector[:1] == (1,):
        found = product(found, draw(st.sampled_from([POINT, LOOP, projective(2)])))
    if not found.faces:
        return found
    pairs = []
    for pick in draw(st.lists(st.tuples(_pick, _pick, _pick), max_size=8)):
        # Mostly cubes with many faces, which are the more seldom.
        k = max(found.dimension - pick[0] % 3, 0)
        count = found.f_vector[k]
        pairs.append((k, pick[1] % count, pick[2] % count))
    return glued(found, pairs)
