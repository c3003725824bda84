"""State and shape complexes: exploration, links, homology, collapses, surfaces, pictures.

Room: coordinator. It takes a scene, or any cubical complex as arrays of faces; it knows no path, no
message and no recording. It imports the protocol, `agents.rendering` for pictures, and nothing from
the coordinator. Searches and the paper's claims are built on it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.complexes.bordered_surfaces import pulled_apart
    from cubepath.coordinator.complexes.closed_surfaces import Surface, surface
    from cubepath.coordinator.complexes.collapses import Collapsed, collapse, contractibility
    from cubepath.coordinator.complexes.cubical_complex import CubicalComplex, complex_from_faces
    from cubepath.coordinator.complexes.drawing import SUFFIXES, draw_complex
    from cubepath.coordinator.complexes.exploration import MAX_STATES, Explored, explore
    from cubepath.coordinator.complexes.export import to_networkx, write_complex
    from cubepath.coordinator.complexes.homology_groups import Homology, homology
    from cubepath.coordinator.complexes.links import Links, check_links
    from cubepath.coordinator.complexes.local_link import actions_at, unfilled
    from cubepath.coordinator.complexes.macros import Lift, Macro, lift, macro
    from cubepath.coordinator.complexes.report import ComplexReport, complex_report
    from cubepath.coordinator.complexes.shape_complexes import (
        ShapeComplex,
        lattice_of,
        normal_place,
        order_of,
        shape_complex,
        shifted,
        steps_at,
    )
    from cubepath.coordinator.complexes.state_complexes import StateComplex, f_vector, state_complex
    from cubepath.coordinator.complexes.vertex_layout import corners_of_squares, laid_out
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "bordered_surfaces": "pulled_apart",
            "closed_surfaces": "Surface surface",
            "collapses": "Collapsed collapse contractibility",
            "cubical_complex": "CubicalComplex complex_from_faces",
            "drawing": "SUFFIXES draw_complex",
            "vertex_layout": "corners_of_squares laid_out",
            "exploration": "Explored MAX_STATES explore",
            "export": "to_networkx write_complex",
            "homology_groups": "Homology homology",
            "links": "Links check_links",
            "local_link": "actions_at unfilled",
            "macros": "Lift Macro lift macro",
            "report": "ComplexReport complex_report",
            "shape_complexes": (
                "ShapeComplex lattice_of normal_place order_of shape_complex shifted steps_at"
            ),
            "state_complexes": "StateComplex f_vector state_complex",
        },
    )

__all__ = [
    "MAX_STATES",
    "SUFFIXES",
    "Collapsed",
    "ComplexReport",
    "CubicalComplex",
    "Explored",
    "Homology",
    "Lift",
    "Links",
    "Macro",
    "ShapeComplex",
    "StateComplex",
    "Surface",
    "actions_at",
    "check_links",
    "collapse",
    "complex_from_faces",
    "complex_report",
    "contractibility",
    "corners_of_squares",
    "draw_complex",
    "explore",
    "f_vector",
    "homology",
    "laid_out",
    "lattice_of",
    "lift",
    "macro",
    "normal_place",
    "order_of",
    "pulled_apart",
    "shape_complex",
    "shifted",
    "state_complex",
    "steps_at",
    "surface",
    "to_networkx",
    "unfilled",
    "write_complex",
]
