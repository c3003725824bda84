"""The paper's section on curvature: the link condition and its failures."""

from __future__ import annotations

from cubepath.coordinator.theory.complexes.collapses import collapse
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, complex_from_faces
from cubepath.coordinator.theory.complexes.links import check_links, unfilled
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.coordinator.theory.paper.euclidean_geodesics import chains, geodesics
from cubepath.coordinator.theory.paper.examples import small_systems
from cubepath.coordinator.theory.paper.registry import Outcome, PaperClaim, claim
from cubepath.protocol.scenes.specs import scene_from_spec

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
    return complex_of_squares(
        [
            (0, 1, 3, 5),
            (1, 3, 6, 4),
            (1, 4, 7, 2),
            (0, 5, 3, 8),
            (3, 6, 4, 8),
            (4, 7, 2, 8),
            (0, 9, 2, 8),
        ]
    )


def complex_of_squares(cycles: list[tuple[int, int, int, int]]) -> CubicalComplex:
    """Return squares, given by their corners in cyclic order, glued along common edges."""
    sides = sorted({tuple(sorted(pair)) for cycle in cycles for pair in _sides(cycle)})
    number = {side: place for place, side in enumerate(sides)}
    # Opposite sides of a square have the same orientation: orient the sides class by class.
    runs: dict[tuple[int, ...], bool] = {}
    for root in sides:
        stack = [root] if root not in runs else []
        runs.setdefault(root, True)
        while stack:
            side = stack.pop()
            for cycle in cycles:
                for a, b, c, d in (cycle, (*cycle[1:], cycle[0])):
                    for one, other in (((a, b), (d, c)), ((d, c), (a, b))):
                        here, there = tuple(sorted(one)), tuple(sorted(other))
                        if here == side and there not in runs:
                            runs[there] = runs[side] == ((one == here) == (other == there))
                            stack.append(there)
    edges = [[[low, high]] if runs[low, high] else [[high, low]] for low, high in sides]
    squares = []
    for a, b, c, d in cycles:
        across = number[tuple(sorted((a, b)))], number[tuple(sorted((d, c)))]
        along = number[tuple(sorted((a, d)))], number[tuple(sorted((b, c)))]
        # The sides ad and bc, at the ends of ab, fix direction 0, which runs along ab.
        first = list(along if edges[across[0]][0][0] == a else along[::-1])
        second = list(across if edges[along[0]][0][0] == a else across[::-1])
        squares.append([first, second])
    vertices = 1 + max(max(cycle) for cycle in cycles)
    return complex_from_faces([vertices, edges, squares])


def _sides(cycle: tuple[int, int, int, int]) -> list[tuple[int, int]]:
    return list(zip(cycle, (*cycle[1:], cycle[0]), strict=True))


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
