"""State and shape complexes for other programs: as a networkx graph, and as a JSON file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from cubepath.coordinator.theory.complexes.shape_complexes import ShapeComplex
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, in_order, site_text

if TYPE_CHECKING:
    import networkx as nx

FORMAT = "cubepath-complex-1"

Complex = StateComplex | ShapeComplex


def to_networkx(built: Complex) -> nx.MultiGraph[int]:
    """Return the 1-skeleton: the transition graph, whose nodes are the numbers of the states.

    Each node has `sites`, the sites that are on, in canonical order; each edge has `move`, the
    label of its action (in a shape complex, generator and translation), and `number`. Two states
    may be joined by several edges, and in a shape complex a node may be joined to itself.
    InputError if networkx is not installed, which nothing else here needs.
    """
    try:
        from networkx import MultiGraph  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise InputError(
            "to_networkx needs networkx, which is not installed: pip install 'cubepath[networkx]'"
        ) from None
    graph: nx.MultiGraph[int] = MultiGraph()
    for number, sites in enumerate(_states(built)):
        graph.add_node(number, sites=in_order(sites))
    if built.complex.dimension > 0:
        for number, (low, high) in enumerate(built.complex.faces[1][:, 0].tolist()):
            graph.add_edge(low, high, move=_move(built, number), number=number)
    return graph


def _states(built: Complex) -> list[frozenset[Site]]:
    if isinstance(built, ShapeComplex):
        return list(built.shapes)
    return [built.explored.state(number) for number in range(built.complex.f_vector[0])]


def _move(built: Complex, edge: int) -> str:
    if isinstance(built, StateComplex):
        return built.cube(1, edge)[1][0].label
    step, *_ = built.cubes[1][edge][1]
    return f"{step.generator} at {list(step.at)}"


def complex_document(built: Complex) -> dict[str, Any]:
    """Return the complex as JSON, format `cubepath-complex-1`; see docs/files.md."""
    document: dict[str, Any] = {"format": FORMAT}
    if isinstance(built, StateComplex):
        bits = built.explored.bits
        document |= {
            "system": built.explored.scene.spec,
            "complex": "state complex",
            "actions": [_action(action) for action in bits.actions],
            "cubes": [
                [
                    {"base": base, "actions": actions}
                    for base, actions in zip(bases.tolist(), rows.tolist(), strict=True)
                ]
                for bases, rows in zip(built.bases[1:], built.actions[1:], strict=True)
            ],
        }
    else:
        document |= {
            "system": built.scene.spec,
            "complex": "shape complex",
            "cubes": [
                [{"base": base, "moves": msgspec.to_builtins(steps)} for base, steps in cubes]
                for cubes in built.cubes[1:]
            ],
        }
    document["states"] = [in_order(sites) for sites in _states(built)]
    document["faces"] = [found.tolist() for found in built.complex.faces[1:]]
    return document


def _action(action: Action) -> dict[str, Any]:
    return {
        "label": action.label,
        "support": in_order(action.support),
        "trace": in_order(action.trace),
        "ends": [in_order(end) for end in action.ends],
        "free": in_order(action.free),
        "guards": sorted(action.guards, key=site_text),
    }


def write_complex(built: Complex, path: Path | str) -> None:
    """Write the complex as JSON; the file is either complete or unchanged.

    InputError if it cannot be written.

    >>> write_complex(state_complex(explore(scene_from_spec("agv:graph=C4,n=1"))), "ring.json")
    >>> msgspec.json.decode(Path("ring.json").read_bytes())["states"]
    [[0], [1], [3], [2]]
    """
    data = msgspec.json.encode(complex_document(built))
    with written_whole(path) as stream:
        stream.write(data + b"\n")
