"""The state complex of a small system as data of a page, and where paths are in it.

It draws by `complexes`; `page_document` has the fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.drawing import corners_of_squares, laid_out
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.shape_complexes import ShapeComplex
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex, state_complex
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    import networkx as nx


STATES_MAX = 260
"""A state complex is shown if it has at most this many states."""


class StateSpace:
    """The states of a scene by number, and the complex that they span."""

    def __init__(
        self, scene: Scene, built: CubicalComplex, states: Iterable[frozenset[Site]]
    ) -> None:
        """Take the complex and its states in the order of its vertices."""
        self._scene = scene
        self._complex = built
        self._numbers = {state: number for number, state in enumerate(states)}

    def number(self, state: Iterable[Site]) -> int:
        """Return the number of a state."""
        return self._numbers[frozenset(state)]

    def along(self, steps: Iterable[Iterable[Action]]) -> list[int]:
        """Return the numbers of the start, and of the state after each step of a path."""
        state = set(self._scene.start_state)
        found = [self.number(state)]
        for actions in steps:
            for action in actions:
                apply_in_place(action, state)
            found.append(self.number(state))
        return found

    def document(self, paths: Sequence[Sequence[int]]) -> dict[str, Any]:
        """Return all of this as data, with the numbers of the states along each path."""
        built = self._complex
        points = np.zeros((len(self._numbers), 3))
        axes = 2 if built.dimension < 2 else 3
        points[:, :axes] = laid_out(built, axes)
        points /= np.abs(points).max()
        return {
            "counts": list(built.f_vector),
            "flat": axes == 2,
            "points": points.ravel(),
            "edges": built.faces[1][:, 0].ravel(),
            "squares": corners_of_squares(built).ravel(),
            "paths": [np.array(path, np.int64) for path in paths],
        }


def state_space(scene: Scene) -> StateSpace | None:
    """Return the state complex of a scene; None if it is too large to be shown, or a point."""
    explored = explore(scene, max_states=STATES_MAX)
    count = len(explored.states)
    if not explored.complete or not 2 <= count <= STATES_MAX:
        return None
    built = state_complex(explored).complex
    return StateSpace(scene, built, (explored.state(place) for place in range(count)))


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
