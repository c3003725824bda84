"""Complexes written down: as pictures, as JSON, for networkx, and as data of a page.

A picture shows where vertices lie such that cubes look like cubes. Positions begin with classical
scaling of the distances in the transition graph (Torgerson, 1952), and are then moved until each
cube that is in no larger one is, as nearly as the complex allows it, a unit cube: by shape matching
(Müller et al., "Meshless deformations based on shape matching", 2005), held apart by stress
majorization (Gansner et al., "Graph drawing by stress majorization", 2004). Nothing is random, so
the same complex gives the same picture. What is near lies over what is far, which is paler.
matplotlib is imported when something is drawn; `page_document` has the fields of a page.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.style import DARK, INK, LIGHT, PAPER, WALL, Theme, arcs
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.shape_complexes import ShapeComplex
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex, state_complex
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, in_order, site_text, to_json
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    import networkx as nx
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

Points: TypeAlias = NDArray[np.float64]

_TILT = 0.3
_STEPS = 240
_APART = (4.0, 0.01)
"""The weight of the distances against that of a cube, in the first step and in the last."""
_POWER = 0.75
"""Of a distance in the graph: 1/2 is the diagonal of a cube, 1 the length of a path."""
_WORK = 2e8
"""Distances looked at in all: a complex with many vertices is drawn in fewer steps."""
_VIEWS, _VIEWS_LEAST, _NEAR = 160, 40, 0.5
"""The number of sides to look from, if the vertices are many, and the distance that is enough."""


def distances(complex_: CubicalComplex) -> NDArray[np.int32]:
    """Return the distance in edges between any two vertices, -1 if they are not connected.

    The result has shape (vertices, vertices).
    """
    count = complex_.f_vector[0]
    near: list[list[int]] = [[] for _ in range(count)]
    if complex_.dimension > 0:
        for low, high in complex_.faces[1][:, 0].tolist():
            near[low].append(high)
            near[high].append(low)
    found = np.full((count, count), -1, dtype=np.int32)
    for source in range(count):
        row = found[source]
        row[source] = 0
        layer = [source]
        while layer:
            layer = [
                other
                for vertex in layer
                for other in near[vertex]
                if row[other] < 0 and not row.__setitem__(other, row[vertex] + 1)
            ]
    return found


def laid_out(complex_: CubicalComplex, axes: int) -> Points:
    """Return the positions of the vertices, shape (vertices, axes): edges have length 1 or nearly.

    `axes` is 2 or 3; cubes of more dimensions are drawn as their projections.
    """
    apart = distances(complex_).astype(np.float64)
    apart[apart < 0] = apart.max() + 2  # components side by side
    places = _scaled(apart, axes)
    cubes = [
        (corners, _unit_cube(dimension, axes)) for dimension, corners in maximal_cubes(complex_)
    ]
    if not cubes:
        return places
    wanted = apart**_POWER
    weights = 1 / np.maximum(apart, 1) ** 2
    np.fill_diagonal(weights, 0)
    weights /= weights.sum(axis=1, keepdims=True)
    steps = max(20, min(_STEPS, int(_WORK / len(apart) ** 2)))
    first, last = _APART
    for step in range(steps):
        push = first * (last / first) ** (step / steps)
        places = _moved(places, cubes, wanted, weights, push)
    return places


def _moved(
    places: Points,
    cubes: list[tuple[NDArray[np.int64], Points]],
    wanted: Points,
    weights: Points,
    push: float,
) -> Points:
    """Return each vertex at the mean of where its cubes and the other vertices want it."""
    # |p - q| for all pairs, without an array of all differences.
    squares = (places**2).sum(axis=1)
    lengths = np.sqrt(np.maximum(squares[:, None] + squares - 2 * places @ places.T, 1e-12))
    pull = weights * wanted / lengths
    summed = push * (weights @ places + pull.sum(axis=1)[:, None] * places - pull @ places)
    total = np.full(len(places), push)
    for corners, shape in cubes:
        found = places[corners]
        middles = found.mean(axis=1, keepdims=True)
        left, _, right = np.linalg.svd(np.einsum("ncx,cy->nxy", found - middles, shape))
        fitted = middles + np.einsum("nxy,cy->ncx", left @ right, shape)
        np.add.at(summed, corners, fitted)
        np.add.at(total, corners, 1)
    moved: Points = summed / total[:, None]
    return moved


def _scaled(apart: Points, axes: int) -> Points:
    """Return positions by classical scaling of distances."""
    centre = np.eye(len(apart)) - 1 / len(apart)
    # A compromise: power 1 gives the squared distances of the corners of a cube, 2 of a flat sheet.
    values, vectors = np.linalg.eigh(-centre @ apart**1.5 @ centre / 2)
    order = np.argsort(values)[::-1][: 2 * axes]
    found = vectors[:, order] * np.sqrt(np.maximum(values[order], 0))
    # The sign of an eigenvector is arbitrary: make its largest entry positive.
    for axis in range(found.shape[1]):
        if found[np.argmax(np.abs(found[:, axis]).round(9)), axis] < 0:
            found[:, axis] *= -1
    found = np.pad(found, ((0, 0), (0, 2 * axes - found.shape[1])))
    # Vertices that differ only in further directions would coincide: tilt these in a little.
    return found[:, :axes] + _TILT * found[:, axes:]


def corners_of_cubes(complex_: CubicalComplex, dimension: int) -> NDArray[np.int64]:
    """Return the vertices of each cube of a dimension, shape (cubes, 2 ** dimension).

    Bit j of the place in a row is the end of direction j.
    """
    found = np.arange(complex_.f_vector[0], dtype=np.int64)[:, None]
    for k in range(1, dimension + 1):
        ends = complex_.faces[k][:, k - 1]
        found = np.concatenate([found[ends[:, 0]], found[ends[:, 1]]], axis=1)
    return found


def maximal_cubes(complex_: CubicalComplex) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield, by dimension from 1 on, the vertices of the cubes that are in no larger one."""
    for k in range(1, complex_.dimension + 1):
        own = np.ones(complex_.f_vector[k], dtype=np.bool_)
        if k < complex_.dimension:
            own[complex_.faces[k + 1].ravel()] = False
        if own.any():
            yield k, corners_of_cubes(complex_, k)[own]


def corners_of_squares(complex_: CubicalComplex) -> NDArray[np.int64]:
    """Return the four vertices of every square in cyclic order, shape (squares, 4)."""
    if complex_.dimension < 2:
        return np.empty((0, 4), dtype=np.int64)
    return corners_of_cubes(complex_, 2)[:, [0, 1, 3, 2]]


def _unit_cube(dimension: int, axes: int) -> Points:
    """Return the corners of a cube around the origin: of edges 1, projected if it must be."""
    edges = np.eye(axes)[:dimension]
    if dimension > axes:
        edges = _directions(dimension)[:, :axes]
        edges /= np.sqrt((edges**2).sum(axis=1, keepdims=True))
    ends = (np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1) - 0.5
    corners: Points = ends @ edges
    return corners


def _directions(count: int) -> Points:
    """Return directions that are spread over the upper half of the sphere, shape (count, 3).

    A spiral of the golden angle; no two of them are opposite, or nearly.
    """
    steps = np.arange(count) + 0.5
    height = 1 - steps / count
    across, turn = np.sqrt(1 - height**2), pi * (1 + sqrt(5)) * steps
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


@dataclass(frozen=True, slots=True)
class ProjectedView:
    """Positions as they are seen: in the plane, shape (vertices, 2), and how near each is."""

    places: Points
    nearness: Points
    """From 0, the farthest vertex, to 1, the nearest."""


def best_view(points: Points, edges: NDArray[np.int32]) -> ProjectedView:
    """Return points in space, shape (vertices, 3), from the viewpoint that separates them best.

    Looked at from many sides, the one is taken from which vertices are farthest from their nearest
    neighbours in the picture, and edges are longest; the wide side of the picture is across.
    """
    points = points - points.mean(axis=0)
    best, seen = -1.0, points
    views = max(_VIEWS_LEAST, min(_VIEWS, int(_WORK / 4 / len(points) ** 2)))
    for towards in _directions(views):
        turned = points @ _turned_to(towards).T
        apart = _told_apart(turned[:, :2], edges)
        if apart > best + 1e-9:
            best, seen = apart, turned
    flat = seen[:, :2]
    across = np.linalg.eigh(flat.T @ flat)[1][:, ::-1]
    across[:, 1] = -across[1, 0], across[0, 0]
    depth = seen[:, 2]
    spread = float(np.ptp(depth))
    near = (depth - depth.min()) / spread if spread > 1e-9 else np.ones(len(depth))
    return ProjectedView(flat @ across, near)


def _turned_to(towards: Points) -> Points:
    """Return the rotation that takes a direction to the third axis."""
    aside = np.cross((0.0, 1.0, 0.0) if abs(towards[1]) < 0.9 else (1.0, 0.0, 0.0), towards)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(towards, aside), towards])


def _told_apart(flat: Points, edges: NDArray[np.int32]) -> float:
    squares = (flat**2).sum(axis=1)
    apart = np.maximum(squares[:, None] + squares - 2 * flat @ flat.T, 0)
    np.fill_diagonal(apart, np.inf)
    nearest = np.sqrt(apart.min(axis=1))
    lengths = np.sqrt(((flat[edges[:, 0]] - flat[edges[:, 1]]) ** 2).sum(axis=1))
    long = np.minimum(lengths, _NEAR).mean() if len(lengths) else 0.0
    return float(np.minimum(nearest, _NEAR).mean() + 0.5 * long)


VERTICES_MAX = 1500
"""Complexes with more vertices are not drawn, since nothing could be recognised."""
SUFFIXES = (".png", ".svg", ".pdf")
_WIDE, _LEAST, _TITLE, _LEGEND = 7.0, 2.4, 0.5, 0.35
"""In inches: the width of a picture, the least height of the complex, of the title and legend."""
_RADIUS, _MARGIN = 0.05, 0.25
"""The radius of a vertex in inches, and the margin in edges of cubes."""
_ALPHA, _PALE = 0.55, 0.55
"""How opaque squares are, and how much paler the farthest are than the nearest."""
_SQUARES = ("#3b7dd8", "#1f9e89", "#d6246e", "#e08a1e", "#6a4fb3")
"""The colour of a square by the dimension, 2, 3, ..., of the largest cube that it is in."""


def largest_cubes(complex_: CubicalComplex) -> NDArray[np.int64]:
    """Return for each square the dimension of the largest cube that it is a face of."""
    above = np.full(complex_.f_vector[-1], complex_.dimension, dtype=np.int64)
    for k in range(complex_.dimension, 2, -1):
        below = np.full(complex_.f_vector[k - 1], k - 1, dtype=np.int64)
        np.maximum.at(below, complex_.faces[k].reshape(len(above), -1), above[:, None])
        above = below
    return above if complex_.dimension >= 2 else np.empty(0, dtype=np.int64)


def draw_complex(
    complex_: CubicalComplex, path: Path | str, title: str = "", *, dark: bool = False
) -> None:
    """Draw the complex to a file: in the plane up to dimension 1, else in space.

    Squares are coloured by the dimension of the largest cube that they are in; `dark` is for dark
    ground. InputError for more than `VERTICES_MAX` vertices, an unknown suffix, or a file that
    cannot be written.

    >>> found = state_complex(explore(scene_from_spec("agv:graph=K5,n=2"))).complex
    >>> draw_complex(found, "agv.png", title="two vehicles on K5")
    >>> from PIL import Image
    >>> with Image.open("agv.png") as picture:
    ...     picture.format
    'PNG'
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected a picture's suffix, one of {', '.join(SUFFIXES)}")
    if not 0 < complex_.f_vector[0] <= VERTICES_MAX:
        raise InputError(
            f"{complex_.f_vector[0]} vertices to draw, expected at most {VERTICES_MAX}"
        )
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    theme = DARK if dark else LIGHT
    edges = complex_.faces[1][:, 0] if complex_.dimension > 0 else np.empty((0, 2), np.int32)
    if complex_.dimension < 2:
        places = laid_out(complex_, 2)
        view = ProjectedView(places, np.ones(len(places)))
    else:
        view = best_view(laid_out(complex_, 3), edges)
    wide, tall = np.ptp(view.places, axis=0) + 2 * _MARGIN
    inner = min(max(_WIDE * float(tall / wide), _LEAST), _WIDE)
    high = inner + _TITLE + _LEGEND
    figure = Figure(figsize=(_WIDE, high), dpi=150, facecolor=theme.of(PAPER))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, _LEGEND / high, 1, inner / high))
    _draw(axes, complex_, view, edges, theme)
    axes.set_axis_off()
    axes.set_aspect("equal")
    if complex_.dimension >= 2:
        figure.legend(
            handles=_swatches(largest_cubes(complex_)),
            loc="lower center",
            ncols=5,
            frameon=False,
            fontsize=9,
            labelcolor=theme.of(INK),
        )
    counts = ", ".join(
        f"{count} {name if count > 1 else name.replace('vertices', 'vertex').removesuffix('s')}"
        for count, name in zip(complex_.f_vector, _names(complex_.dimension), strict=True)
    )
    heading = f"{title}\n{counts}" if title else counts
    figure.suptitle(heading, y=1 - 0.12 / high, va="top", fontsize=10, color=theme.of(INK))
    kind = path.suffix.lower()[1:]
    with written_whole(path) as stream:
        figure.savefig(stream, format=kind, metadata={"Software": None} if kind == "png" else None)


def _names(dimension: int) -> list[str]:
    return ["vertices", "edges", "squares", *(f"{k}-cubes" for k in range(3, dimension + 1))][
        : dimension + 1
    ]


def _colour_in(dimension: int) -> str:
    """Return the colour of a square whose largest cube has this dimension."""
    return _SQUARES[min(dimension - 2, len(_SQUARES) - 1)]


def _swatches(largest: NDArray[np.int64]) -> list[Artist]:
    """Return the entries of the legend: the colours of squares that occur."""
    from matplotlib.patches import Patch  # noqa: PLC0415

    by_colour: dict[str, list[int]] = {}
    for k in np.unique(largest).tolist():
        by_colour.setdefault(_colour_in(k), []).append(k)
    return [
        Patch(
            facecolor=colour,
            alpha=0.6,
            label="square in no 3-cube" if found == [2] else f"in a {_cubes(found)}",
        )
        for colour, found in by_colour.items()
    ]


def _cubes(dimensions: list[int]) -> str:
    first, last = dimensions[0], dimensions[-1]
    return f"{first}-cube" if first == last else f"{first}-cube to {last}-cube"


def _draw(
    axes: Axes,
    complex_: CubicalComplex,
    view: ProjectedView,
    edges: NDArray[np.int32],
    theme: Theme,
) -> None:
    """Draw squares, edges and vertices, the far ones first and paler."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    places, near = view.places, view.nearness
    paper = np.array(to_rgb(theme.of(PAPER)))
    line, dot = np.array(to_rgb(theme.of(WALL))), np.array(to_rgb(theme.of(INK)))
    corners = corners_of_squares(complex_)
    hues = np.array([to_rgb(_colour_in(k)) for k in largest_cubes(complex_).tolist()])
    (left, low), (right, high) = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    radius = _RADIUS * float(max(right - left, high - low)) / _WIDE
    ring = arcs([(0, 0)], radius / max(1, len(places) / 60) ** 0.25, corners=18)
    shapes = [*places[corners], *places[edges], *(ring + place for place in places)]
    far = 1 - np.concatenate(
        [near[corners].mean(axis=1), near[edges].mean(axis=1), near] if len(edges) else [near]
    )
    own = np.concatenate(
        [hues.reshape(-1, 3), np.tile(line, (len(edges), 1)), np.tile(dot, (len(places), 1))]
    )
    colours = own + (_PALE * far)[:, None] * (paper - own)
    opaque = np.repeat([_ALPHA, 1.0, 1.0], [len(corners), len(edges), len(places)])
    widths = np.repeat([0.0, 0.9, 0.0], [len(corners), len(edges), len(places)])
    # What is equally far is drawn in the order of the dimension, so vertices lie above edges.
    order = np.lexsort((np.arange(len(shapes)), -far.round(9)))
    drawn = np.column_stack([colours, opaque])[order]
    axes.add_collection(
        PolyCollection(
            [shapes[index] for index in order.tolist()],
            facecolors=drawn,
            edgecolors=drawn,
            linewidths=widths[order],
        )
    )
    axes.set(xlim=(left, right), ylim=(low, high))


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
    return f"{step.generator} at {to_json(step.at)}"


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
