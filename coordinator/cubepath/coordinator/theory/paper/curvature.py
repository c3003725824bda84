"""What the paper says about curvature, and geodesics in small complexes by their definitions.

Nothing here is fast, and nothing knows about actions.
"""

from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from math import isclose, sqrt

from cubepath.coordinator.theory.complexes.collapses import collapse
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, complex_from_faces
from cubepath.coordinator.theory.complexes.links import check_links, unfilled
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.coordinator.theory.paper.examples import Outcome, PaperClaim, claim, small_systems
from cubepath.protocol.scenes.specs import scene_from_spec

Cell = tuple[int, int]
"""A cube: its dimension and its number."""
CellPath = tuple[Cell, ...]


def closure(complex_: CubicalComplex, cell: Cell) -> frozenset[Cell]:
    """Return a cube with all of its faces."""
    found = {cell}
    layer = {cell}
    while layer:
        layer = {
            (k - 1, int(face))
            for k, number in layer
            if k
            for face in complex_.faces[k][number].ravel()
        }
        found |= layer
    return frozenset(found)


def diagonals(complex_: CubicalComplex) -> dict[int, list[tuple[int, Cell]]]:
    """Return for each vertex the cubes of which it is a corner, each with the opposite corner."""
    found: dict[int, list[tuple[int, Cell]]] = defaultdict(list)
    for k in range(1, complex_.dimension + 1):
        for number in range(complex_.f_vector[k]):
            for corner in range(1 << k):
                ends = [corner >> j & 1 for j in range(k)]
                here = _corner(complex_, (k, number), ends)
                there = _corner(complex_, (k, number), [1 - end for end in ends])
                found[here].append((there, (k, number)))
    return found


def _corner(complex_: CubicalComplex, cell: Cell, ends: list[int]) -> int:
    k, number = cell
    for j in reversed(range(k)):
        number = int(complex_.faces[j + 1][number, j, ends[j]])
    return number


def normal_cube_paths(
    complex_: CubicalComplex, start: int, end: int, *, most: int
) -> list[CellPath]:
    """Return all normal cube paths of at most `most` cubes from one vertex to another.

    By the paper's definition, read on the complex itself: consecutive cubes meet in one vertex, and
    the star of a cube, which is the union of the closed cubes of which it is a face, meets the next
    cube only there. So this is only for complexes in which two cubes meet in at most one cube.
    """
    across = diagonals(complex_)
    closed = {
        (k, number): closure(complex_, (k, number))
        for k in range(complex_.dimension + 1)
        for number in range(complex_.f_vector[k])
    }
    star: dict[Cell, set[Cell]] = defaultdict(set)
    for faces in closed.values():
        for face in faces:
            star[face] |= faces

    def onward(at: int, path: CellPath) -> Iterator[CellPath]:
        if at == end:
            yield path
        if len(path) == most:
            return
        for there, cell in across[at]:
            if not path or star[path[-1]] & closed[cell] == {(0, at)}:
                yield from onward(there, (*path, cell))

    return list(onward(start, ()))


def chains(
    complex_: CubicalComplex, start: int, end: int, *, most: int, through: int | None = None
) -> list[CellPath]:
    """Return all chains of at most `most` cubes from corner to corner, from `start` to `end`.

    With `through`, only cubes in the star of that vertex count: the faces of the cubes at it.
    """
    across = diagonals(complex_)
    near: set[Cell] | None = None
    if through is not None:
        near = set()
        for _, cell in across[through]:
            near |= closure(complex_, cell)

    def onward(at: int, path: CellPath) -> Iterator[CellPath]:
        if at == end:
            yield path
        if len(path) < most:
            for there, cell in across[at]:
                if near is None or cell in near:
                    yield from onward(there, (*path, cell))

    return list(onward(start, ()))


def geodesics(complex_: CubicalComplex, start: int, end: int) -> tuple[float, int]:
    """Return the length of the shortest paths between two vertices, and their number.

    Every square is Euclidean, with sides of length 1. Paths consist of edges, diagonals of squares,
    and diagonals of two squares that share an edge. So this is only for complexes of dimension 2 in
    which no shortest path runs through three squares between two vertices.
    """
    steps: dict[int, list[tuple[int, float]]] = defaultdict(list)
    for there, (k, _), here in (
        (there, cell, here) for here, found in diagonals(complex_).items() for there, cell in found
    ):
        steps[here].append((there, sqrt(k)))
    for here, there in _dominoes(complex_):
        steps[here].append((there, sqrt(5)))
    best: dict[int, float] = {start: 0.0}
    number: dict[int, int] = {start: 1}
    done: set[int] = set()
    while end not in done:
        here = min((vertex for vertex in best if vertex not in done), key=lambda v: best[v])
        done.add(here)
        for there, length in steps[here]:
            total = best[here] + length
            if there in best and isclose(total, best[there]):
                number[there] += number[here]
            elif there not in best or total < best[there]:
                best[there], number[there] = total, number[here]
    return best[end], number[end]


def _dominoes(complex_: CubicalComplex) -> Iterator[tuple[int, int]]:
    """Yield opposite corners of the rectangles that consist of two squares with a common edge."""
    beside: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for square in range(complex_.f_vector[2]):
        for j in (0, 1):
            for e in (0, 1):
                edge = int(complex_.faces[2][square, j, e])
                beside[edge].append((square, int(complex_.faces[2][square, j, 1 - e])))
    for found in beside.values():
        for place, (one, far) in zip(count(1), found, strict=False):
            for other, beyond in found[place:]:
                if one == other:
                    continue
                for end in (0, 1):
                    # Opposite sides of a square have the same orientation, also in both squares.
                    here = int(complex_.faces[1][far, 0, end])
                    there = int(complex_.faces[1][beyond, 0, 1 - end])
                    yield here, there
                    yield there, here


CLAIMS: list[PaperClaim] = []


@claim(CLAIMS, "6, theorem on curvature", "the state complex of any local system is NPC")
def _local_is_npc() -> Outcome:
    checked = 0
    for spec, explored in small_systems().items():
        links = check_links(state_complex(explored).complex)
        if not links.npc:
            return f"{spec}: {links.failing[0]}", False
        checked += links.checked
    return (
        f"the link condition holds at all {checked} states of {len(small_systems())} systems",
        True,
    )


@claim(
    CLAIMS,
    "6, the non-local example",
    "with connectivity as a global rule, three moves that commute pairwise may span no cube",
)
def _not_local() -> Outcome:
    scene = scene_from_spec("hex-connected:scene=ring")
    missing = unfilled(scene, scene.start_state)
    if not missing:
        return "no such three moves were found", False
    moves = "; ".join(action.label for action in missing[0])
    return f"an aggregate of {len(scene.start)} modules: {moves}", len(missing[0]) == 3


def corner_of_a_cube() -> CubicalComplex:
    """Return three squares around a vertex, number 0: positive curvature.

    Its neighbours are 1, 2, 3; vertex 4 is opposite to it in the square of 1 and 2, vertex 5 in the
    square of 2 and 3, vertex 6 in the square of 1 and 3.
    """
    edges = [[0, 1], [0, 2], [0, 3], [1, 4], [2, 4], [2, 5], [3, 5], [1, 6], [3, 6]]
    squares = [[[1, 3], [0, 4]], [[2, 5], [1, 6]], [[2, 7], [0, 8]]]
    return complex_from_faces([7, [[edge] for edge in edges], squares])


def dented_disc() -> CubicalComplex:
    """Return a disc of seven squares with a path of two edges on its rim, vertices 0, 1, 2.

    Three squares at vertex 1 lie along the path, and three behind them close up such that 0 and 2
    are opposite corners of a seventh square.
    """
    edges = [[0, 1], [0, 5], [0, 8], [0, 9], [1, 2], [1, 3], [1, 4], [2, 7], [8, 2], [9, 2]]
    edges += [[5, 3], [3, 6], [8, 3], [4, 6], [4, 7], [8, 4]]
    # Round vertex 1, behind these three, and the seventh.
    squares = [[[1, 5], [0, 10]], [[6, 11], [5, 13]], [[4, 14], [6, 7]]]
    squares += [[[2, 10], [1, 12]], [[12, 13], [15, 11]], [[15, 7], [8, 14]], [[2, 9], [3, 8]]]
    return complex_from_faces([10, [[edge] for edge in edges], squares])


@claim(
    CLAIMS,
    "7, figure of positive curvature [left]",
    "with positive curvature there may be several shortest paths in one homotopy class",
)
def _several_geodesics() -> Outcome:
    complex_ = corner_of_a_cube()
    complex_.check()
    length, count = geodesics(complex_, 4, 3)
    npc = check_links(complex_).npc
    return (
        (
            f"three squares round a corner (NPC: {'yes' if npc else 'no'}): {count} shortest paths"
            f" of length {length:.4f} between two vertices, in a complex that is simply connected"
        ),
        not npc and count > 1,
    )


@claim(
    CLAIMS,
    "7, figure of positive curvature [right]",
    "with positive curvature a path may be shorter than any near it, and not shortest in its class",
)
def _local_minimum() -> Outcome:
    complex_ = dented_disc()
    complex_.check()
    npc = check_links(complex_).npc
    near = chains(complex_, 0, 2, most=2, through=1)
    shortest = min(map(len, chains(complex_, 0, 2, most=2)))
    disc = complex_.euler == 1 and collapse(complex_).contractible
    return (
        (
            f"a disc of seven squares (NPC: {'yes' if npc else 'no'}): of the cube paths in the"
            f" star of its middle vertex {len(near)} is as short as a path of"
            f" {len(near[0]) if near else 0} edges, that path itself; across the disc there is one"
            f" of {shortest} cube"
        ),
        not npc and disc and len(near) == 1 and len(near[0]) > shortest,
    )
