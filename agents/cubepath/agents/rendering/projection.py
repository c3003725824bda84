"""Cells in space: their faces, their projection onto the plane, and which of them lie in front.

Points are arrays of shape (..., 3), in lattice coordinates with z upwards. The projection is
parallel, so no length depends on the distance from the viewer. It imports nothing of the project.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from math import cos, pi, radians, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Points: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Viewpoint:
    """The direction of a picture, in radians: `azimuth` about the z axis, `tilt` above the floor.

    With azimuth 0 the viewer looks along the y axis and sees x to the right. A positive azimuth
    shows the side that faces x. The default azimuth is between those of the axes and of the
    diagonals, and stays so in steps of 45 degrees: no face is ever seen from its edge.
    """

    azimuth: float = radians(22.5)
    tilt: float = radians(30)

    @cached_property
    def axes(self) -> Points:
        """Return the unit vectors to the right, upwards and towards the viewer, shape (3, 3)."""
        x, y, up, level = sin(self.azimuth), cos(self.azimuth), sin(self.tilt), cos(self.tilt)
        return np.array([(y, x, 0), (-x * up, y * up, level), (x * level, -y * level, up)])


FRONT = Viewpoint()
"""The view of all pictures that do not turn."""


def project(points: Points, view: Viewpoint = FRONT) -> Points:
    """Return x, y and depth of points, shape (..., 3); depth grows towards the viewer.

    >>> project(np.array([0.0, 0.0, 1.0]), Viewpoint(azimuth=0.0, tilt=0.0)).tolist()
    [0.0, 1.0, 0.0]
    """
    return np.asarray(points, np.float64) @ view.axes.T


class Face(NamedTuple):
    """A face of a convex cell: corners, shape (n, 3), counter-clockwise as seen from outside.

    The `normal` has length 1 and points outwards, shape (3,).
    """

    corners: Points
    normal: Points


Faces: TypeAlias = tuple[Face, ...]
ROD = 0.24
"""The thickness of a lattice edge, and the size of the joint at its end."""


def _convex(corners: Points, normals: Sequence[tuple[int, ...]]) -> Faces:
    """Return the faces of the convex hull of corners, given the directions of its normals."""
    found = []
    for direction in normals:
        normal = np.array(direction) / sqrt(sum(part * part for part in direction))
        heights = corners @ normal
        face = corners[heights > heights.max() - 1e-9]
        middle = face.mean(axis=0)
        right = face[0] - middle
        turns = np.arctan2((face - middle) @ np.cross(normal, right), (face - middle) @ right)
        found.append(Face(face[np.argsort(turns)], normal))
    return tuple(found)


_ENDS = [end for end in product((-1, 0, 1), repeat=3) if any(end)]
_AXES = [end for end in _ENDS if sum(map(abs, end)) == 1]


@cache
def box_faces(wide: float, deep: float, tall: float) -> Faces:
    """Return the six faces of a box around the origin."""
    return _convex(np.array(list(product((-0.5, 0.5), repeat=3))) * (wide, deep, tall), _AXES)


def _dodecahedron() -> Faces:
    """Return the cell of the face-centred cubic lattice: the points nearest to the origin."""
    corners = [*product((-0.5, 0.5), repeat=3), *_AXES]
    return _convex(np.array(corners), [end for end in _ENDS if sum(map(abs, end)) == 2])


CELL_FACES: dict[str, tuple[Faces, ...]] = {
    "cubes": (box_faces(1, 1, 1),),
    "dodecahedra": (_dodecahedron(),),
    "cube-edges": tuple(
        box_faces(*(1 - ROD if along == axis else ROD for along in range(3))) for axis in range(3)
    ),
}
"""By the name of a drawing, the faces of its cells around their middles; of edges, by axis."""


def moved(faces: Faces, by: Points) -> Faces:
    """Return faces moved by a vector, shape (3,)."""
    return tuple(Face(face.corners + by, face.normal) for face in faces)


def tone(normal: Points) -> float:
    """Return how bright a face is, from 0.4 to 1: the light comes from the viewer's upper left."""
    light = np.array([-0.4, 0.7, 0.6]) / sqrt(1.01)
    return float(0.7 + 0.3 * (project(normal) @ light))


def outline_of(faces: Faces) -> Points:
    """Return the outline of a convex cell in the plane, shape (n, 2), counter-clockwise."""
    corners = np.unique(np.concatenate([face.corners for face in faces]), axis=0)
    flat = project(corners)[:, :2]
    turns = np.arange(720) * (pi / 360) + 0.001
    farthest = np.argmax(np.stack([np.cos(turns), np.sin(turns)], axis=1) @ flat.T, axis=1)
    return flat[list(dict.fromkeys(farthest.tolist()))]


def painting_order(
    bodies: Sequence[Faces], middles: Points, on_the_way: Sequence[int] = ()
) -> list[int]:
    """Return the order in which to paint bodies, so that what is in front hides what is behind.

    Those at rest go by the depth of their `middles`, shape (n, 3), which is right for the cells of
    one lattice where no face is seen from its edge. Let the cell at v hide a part of the one at 0:
    for two points p and q within that one, v = t d + p - q, where d leads to the viewer and t > 0.

    - Cubes: choose axes so that d_i > 0. Then v_i > -1, so v_i >= 0, and d . v > 0. Lattice edges
      and their joints are boxes of an uneven grid: the same holds for the numbers of its slots.
    - Dodecahedra: choose axes so that d_1 > d_2 > d_3 > 0. Opposite faces say v_i + v_j > -2 and
      v_i - v_j > -2 for i < j. So v_i >= |v_j| - 1, and the sum of v is even. Then v_1 < 0 is
      impossible, v_1 = 0 leaves (0, 1, 1) and (0, 1, -1), and for v_1 > 0 we have
      d . v >= d_1 + d_2 (|v_3| - 1) - d_3 |v_3| >= d_1 - d_2 > 0.

    A body `on_the_way` goes where the planes of faces between it and the others say.
    """
    depths = project(middles)
    loose = set(on_the_way)
    order = sorted(set(range(len(bodies))) - loose, key=lambda number: float(depths[number, 2]))
    for mover in on_the_way:
        order.insert(_place(mover, order, bodies, depths), mover)
    return order


def _place(mover: int, order: Sequence[int], bodies: Sequence[Faces], depths: Points) -> int:
    """Return the place with the fewest bodies on its wrong side, the nearest by depth."""
    cost = [0] * (len(order) + 1)
    for place, other in enumerate(order):
        if np.hypot(*(depths[other] - depths[mover])[:2]) < _APART:
            if hides(bodies[mover], bodies[other]):
                cost = [each + (at <= place) for at, each in enumerate(cost)]
            if hides(bodies[other], bodies[mover]):
                cost = [each + (at > place) for at, each in enumerate(cost)]
    deeper = sum(float(depths[other, 2]) <= float(depths[mover, 2]) for other in order)
    return min(range(len(cost)), key=lambda at: (cost[at], abs(at - deeper)))


_APART = 2.5
"""Cells whose middles are so far apart in a picture do not meet there."""


def hides(one: Faces, other: Faces) -> bool:
    """Return whether a convex body may hide a part of another.

    It does not if the plane of a face lies between them, and the viewer on the side of the other.
    """
    towards = FRONT.axes[2]
    return not (
        any(face.normal @ towards <= 0 and _beyond(face, one) for face in other)
        or any(face.normal @ towards >= 0 and _beyond(face, other) for face in one)
    )


def _beyond(face: Face, body: Faces) -> bool:
    """Return whether all of a body lies outside the plane of a face."""
    height = face.normal @ face.corners[0] - 1e-6
    return all((each.corners @ face.normal).min() >= height for each in body)
