"""The paper's section on curvature: the link condition, and where it fails."""

from __future__ import annotations

from cubepath.coordinator.claims import Claim, Outcome, claim
from cubepath.coordinator.claims_examples import small_systems
from cubepath.coordinator.cubical import CubicalComplex, cubical_complex
from cubepath.coordinator.links import check_links
from cubepath.coordinator.state_complex import state_complex
from cubepath.coordinator.state_link import unfilled
from cubepath.coordinator.walks import geodesics, normal_cube_paths
from cubepath.protocol.scenes import scene_from_spec

CLAIMS: list[Claim] = []


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
    """Return three squares round a vertex, number 0: positive curvature.

    Its neighbours are 1, 2, 3; vertex 4 lies across from it in the square of 1 and 2, vertex 5 in
    that of 2 and 3, vertex 6 in that of 1 and 3.
    """
    edges = [[0, 1], [0, 2], [0, 3], [1, 4], [2, 4], [2, 5], [3, 5], [1, 6], [3, 6]]
    squares = [[[1, 3], [0, 4]], [[2, 5], [1, 6]], [[2, 7], [0, 8]]]
    return cubical_complex([7, [[edge] for edge in edges], squares])


def open_box() -> CubicalComplex:
    """Return the surface of a cube without its floor: the floor's corners are 0 to 3 in order."""
    edges = [
        *([0, 1], [1, 2], [3, 2], [0, 3]),  # the rim below
        *([4, 5], [5, 6], [7, 6], [4, 7]),  # the rim above
        *([0, 4], [1, 5], [2, 6], [3, 7]),
    ]
    squares = [
        [[8, 9], [0, 4]],
        [[9, 10], [1, 5]],
        [[11, 10], [2, 6]],
        [[8, 11], [3, 7]],
        [[7, 5], [4, 6]],
    ]
    return cubical_complex([8, [[edge] for edge in edges], squares])


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
    "with positive curvature a cube path may be shortest among its neighbours but not in its class",
)
def _local_minimum() -> Outcome:
    complex_ = open_box()
    complex_.check()
    paths = normal_cube_paths(complex_, 0, 3, most=3)
    lengths = sorted(len(path) for path in paths)
    npc = check_links(complex_).npc
    return (
        (
            f"a box without its floor (NPC: {'yes' if npc else 'no'}): normal cube paths of lengths"
            f" {lengths} between neighbours, all homotopic"
        ),
        not npc and lengths[0] == 1 and lengths[-1] == 3,
    )
