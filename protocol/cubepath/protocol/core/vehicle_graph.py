"""The graph that vehicles move on: vertices, edges and neighbours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cubepath.protocol.core.sites import Site


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class VehicleGraph:
    """A graph on which each move takes one vehicle along one edge, between two vertices.

    A system with such a graph promises that its places are the vertices, that the support of a move
    is both ends of its edge (with every label), and that the move is named ``edge`` and placed at
    the two ends in canonical order, followed by the label if vehicles have labels.

    `vertices` are in canonical order, `index` has the number of each, `near` its neighbours in
    canonical order, and `edges` each edge once, in canonical order.

    >>> graph = scene_from_spec("agv:graph=grid3x2,n=2").system.graph
    >>> graph.near[0, 0], len(graph.edges)
    (((0, 1), (1, 0)), 7)
    """

    vertices: tuple[Site, ...]
    index: Mapping[Site, int]
    near: Mapping[Site, tuple[Site, ...]]
    edges: tuple[tuple[Site, Site], ...]
