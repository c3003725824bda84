"""Kinds of systems: on a lattice, on a graph, move by move, and flips of diagonals.

Room: protocol. Each class describes itself completely: its moves, what a module senses, how it is
written, drawn and bounded. Two of them are built on graphs and point sets. It imports only `core`.
Scenes are made of these classes, and plans of other planners are read as their moves; all other
code takes a `System` and asks for no class.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.systems.flips import FlipSystem, flip_of
    from cubepath.protocol.systems.graph import COMPASS, GraphSystem, along_edge
    from cubepath.protocol.systems.graphs import (
        Graph,
        Scenario,
        graph_from_map,
        graph_from_name,
        graph_round,
        is_named_graph,
        scenario_from_json,
    )
    from cubepath.protocol.systems.lattice import LatticeSystem
    from cubepath.protocol.systems.listed import TabledSystem
    from cubepath.protocol.systems.point_sets import (
        SWEEPS,
        Edge,
        Point,
        distinct_edges,
        edge_of,
        quadrilateral,
    )
    from cubepath.protocol.systems.triangles import Triangles
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "flips": "FlipSystem flip_of",
            "graph": "COMPASS GraphSystem along_edge",
            "graphs": (
                "Graph Scenario graph_from_map graph_from_name graph_round is_named_graph"
                " scenario_from_json"
            ),
            "lattice": "LatticeSystem",
            "listed": "TabledSystem",
            "point_sets": "Edge Point SWEEPS distinct_edges edge_of quadrilateral",
            "triangles": "Triangles",
        },
    )

__all__ = [
    "COMPASS",
    "SWEEPS",
    "Edge",
    "FlipSystem",
    "Graph",
    "GraphSystem",
    "LatticeSystem",
    "Point",
    "Scenario",
    "TabledSystem",
    "Triangles",
    "along_edge",
    "distinct_edges",
    "edge_of",
    "flip_of",
    "graph_from_map",
    "graph_from_name",
    "graph_round",
    "is_named_graph",
    "quadrilateral",
    "scenario_from_json",
]
