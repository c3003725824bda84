"""The paper's examples of state complexes, its section on topology, and the shape complex."""

from __future__ import annotations

from collections import Counter

import networkx as nx
import numpy as np

from cubepath.coordinator.claims import Claim, Outcome, claim
from cubepath.coordinator.collapse import collapse, contractibility
from cubepath.coordinator.cubical import CubicalComplex
from cubepath.coordinator.explore import explore
from cubepath.coordinator.homology import homology
from cubepath.coordinator.links import check_links
from cubepath.coordinator.pinches import without_pinches
from cubepath.coordinator.shapes import commuting_steps, shape_complex, steps_at
from cubepath.coordinator.state_complex import state_complex
from cubepath.coordinator.surfaces import surface
from cubepath.protocol.families.hexagons import hex_catalogue
from cubepath.protocol.graph_system import GraphSystem
from cubepath.protocol.lattice_system import LatticeSystem
from cubepath.protocol.scenes import scene_from_spec
from cubepath.protocol.sites import Site
from cubepath.protocol.systems import Scene

CLAIMS: list[Claim] = []


def complex_of(scene: str | Scene) -> CubicalComplex:
    """Return the state complex of a scene."""
    found = scene_from_spec(scene) if isinstance(scene, str) else scene
    return state_complex(explore(found)).complex


@claim(
    CLAIMS,
    "4, sliding round a p-by-q rectangle",
    "4(pq+1)+2(p+q) vertices and 8(pq+1)-2(p+q) edges; topologically a circle, for all p and q",
)
def _sliding() -> Outcome:
    sizes = [(p, q) for p in range(1, 6) for q in range(1, p + 1)]
    for p, q in sizes:
        found = complex_of(f"sliding:p={p},q={q}")
        states = 4 * (p * q + 1) + 2 * (p + q)
        edges = 8 * (p * q + 1) - 2 * (p + q)
        groups = homology(found)
        left = collapse(found).left
        # What is left is a connected graph with as many edges as vertices and no free end.
        circle = groups.betti[:2] == (1, 1) and not any(left[2:])
        if found.f_vector != (states, edges, 4 * (p - 1) * (q - 1))[: len(left)] or not circle:
            return f"p={p}, q={q}: {found.f_vector}, Betti numbers {groups.betti}", False
    return f"so for {len(sizes)} pairs up to 5 by 5; each collapses to a circle", True


@claim(
    CLAIMS,
    "4, the tunnel of hexagons",
    "a line of cells climbs across one by one; contractible at any length, of growing dimension",
    expected=None,
)
def _tunnel() -> Outcome:
    strict = complex_of("hex-tunnel:n=4,catalogue=1").f_vector
    found = []
    for count in (3, 4, 6, 8, 10, 12):
        complex_ = complex_of(f"hex-tunnel:n={count}")
        kind = contractibility(complex_, homology(complex_))
        if kind != "collapses to a point":
            return f"n={count}: {kind}", False
        found.append(f"{complex_.dimension} at n={count}")
    return (
        (
            f"with catalogue 1 to the letter not reproduced: nothing moves (f-vector {strict}). If"
            " a filled obstacle behind a module does not forbid it to pivot across, it collapses"
            f" to a point, with dimension {', '.join(found)}"
        ),
        None,
    )


@claim(
    CLAIMS, "4, arm with 5 segments", "the complex has one cube of dimension three, and no higher"
)
def _arm_of_five() -> Outcome:
    found = complex_of("arm:n=5").f_vector
    return f"f-vector {found}", found == (32, 48, 18, 1)


@claim(
    CLAIMS, "5, proposition on the arm", "the complex of the positive arm is contractible for all N"
)
def _arms_contract() -> Outcome:
    most = 13
    for count in range(1, most + 1):
        found = complex_of(f"arm:n={count}")
        kind = contractibility(found, homology(found))
        if kind != "collapses to a point":
            return f"N={count}: {kind}", False
    return f"collapses to a point for every N from 1 to {most}", True


@claim(
    CLAIMS,
    "5, refinement of the arm",
    "with a joint in the middle of each edge the dimension doubles, and it stays contractible",
)
def _arm_refined() -> Outcome:
    rows = []
    agrees = True
    for count in range(2, 8):
        coarse, fine = complex_of(f"arm:n={count}"), complex_of(f"arm:n={2 * count}")
        kind = contractibility(fine, homology(fine))
        agrees &= kind == "collapses to a point"
        # A staircase of N segments has a corner for every other segment, and its end.
        agrees &= coarse.dimension == (count + 1) // 2 and fine.dimension == count
        rows.append(f"{coarse.dimension} to {fine.dimension}")
    return (
        (
            f"dimensions for N = 2 to 7 and 2N: {', '.join(rows)} (twice that of N for even N, one"
            " less for odd); all contractible"
        ),
        agrees,
    )


@claim(
    CLAIMS,
    "4, K5 with two vehicles",
    "a closed surface of Euler characteristic -5, so non-orientable; labelled: orientable, genus 6",
)
def _complete_graph() -> Outcome:
    names = [
        surface(complex_of(f"{family}:graph=K5,n=2")).name for family in ("agv", "agv-labelled")
    ]
    return (
        "; labelled: ".join(names),
        names
        == [
            "closed non-orientable surface, Euler characteristic -5",
            "closed orientable surface of genus 6",
        ],
    )


def _subdivided(name: str, more: int) -> nx.Graph[int]:
    graphs = {
        "K4": nx.complete_graph(4),
        "K5": nx.complete_graph(5),
        "the star with three legs": nx.star_graph(3),
        "the triangle with a tail": nx.Graph([(0, 1), (1, 2), (2, 0), (0, 3)]),
    }
    found: nx.Graph[int] = nx.Graph()
    following = 100
    for one, other in graphs[name].edges:
        way = [one, *range(following, following + more), other]
        following += more
        nx.add_path(found, way)
    return found


def vehicles(graph: nx.Graph[int], count: int) -> Scene:
    """Return a scene of unlabelled vehicles on a graph, from its first vertices."""
    system = GraphSystem(graph.nodes, graph.edges)
    return Scene("vehicles", "agv", system, system.vertices[:count])


@claim(
    CLAIMS,
    "5, refinement of graphs",
    "the homotopy type stays the same from N additional vertices an edge on",
)
def _refined_graphs() -> Outcome:
    rows = []
    cases = [("K4", 2), ("K5", 2), ("the star with three legs", 3), ("the triangle with a tail", 3)]
    for name, count in cases:
        found: list[object] = []
        for more in range(count + 2):
            graph = _subdivided(name, more)
            if len(graph) < count:
                found.append(None)
                continue
            groups = homology(complex_of(vehicles(graph, count)))
            found.append((*groups.betti[:3], groups.torsion[1:2]))
        if found[count] != found[count + 1]:
            return f"{name}, N={count}: {found[count]} with N, {found[count + 1]} with N+1", False
        stable = next(more for more in range(count + 2) if found[more] == found[count])
        rows.append(f"{name}, N={count}: from {stable} on")
    return f"the same homology with N and N+1, and already: {'; '.join(rows)}", True


@claim(
    CLAIMS,
    "A, shape complex of three hexagons",
    "nine squares: a Moebius strip, with two triples of vertices identified",
)
def _moebius() -> Outcome:
    found = shape_complex(scene_from_spec("hex:n=3")).complex
    euler, orientable, rims = without_pinches(found)
    strip = (euler, orientable, rims) == (0, False, 1)
    # Before they are identified there are as many vertices more as the characteristic is larger.
    before = found.f_vector[0] + euler - found.euler
    return (
        (
            f"f-vector {found.f_vector}; squares glued along edges alone: {before} vertices, Euler"
            f" characteristic {euler}, {'orientable' if orientable else 'non-orientable'}, bounded"
            f" by {rims} circle"
        ),
        strip and found.f_vector == (11, 24, 9) and before == 15,
    )


@claim(
    CLAIMS,
    "A, covering",
    "the state complex covers the shape complex, so the latter is non-positively curved too",
)
def _covering() -> Outcome:
    system = LatticeSystem(hex_catalogue(keeps_topology=True))
    checked = 0
    for count in (2, 3, 4, 5):
        shapes = shape_complex(scene_from_spec(f"hex:n={count}"))
        if not check_links(shapes.complex).npc:
            return f"n={count}: the link condition fails", False
        below = _cubes_at(shapes.complex)
        for number, shape in enumerate(shapes.shapes):
            # A state over the shape, somewhere else: the cubes at it are those of its link.
            state: frozenset[Site] = frozenset(
                (cell[0] + 7, cell[1] - 4) for cell in shape if isinstance(cell, tuple)
            )
            sets = commuting_steps(steps_at(system, state))
            above = Counter(len(steps) for steps in sets)
            if above != below[number]:
                return f"n={count}, shape {number}: {above} above, {below[number]} below", False
            checked += 1
    return f"as many cubes at a state as at its shape, for {checked} shapes, and NPC", True


def _cubes_at(complex_: CubicalComplex) -> list[Counter[int]]:
    """Return for each vertex how many corners of cubes of each dimension lie there."""
    counts: list[Counter[int]] = [Counter() for _ in range(complex_.f_vector[0])]
    corners = np.arange(complex_.f_vector[0])[:, None]
    for k in range(1, complex_.dimension + 1):
        faces = complex_.faces[k]
        corners = np.concatenate([corners[faces[:, k - 1, 0]], corners[faces[:, k - 1, 1]]], axis=1)
        for vertex, count in enumerate(np.bincount(corners.ravel(), minlength=len(counts))):
            if count:
                counts[vertex][k] = int(count)
    return counts
