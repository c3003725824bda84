"""What is seen of bodies in space, found point by point: the face that is nearest to the viewer."""

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.projection import FRONT, Faces, Viewpoint


def nearest_faces(
    bodies: list[Faces], spots: NDArray[np.float64], view: Viewpoint = FRONT
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of body and face that are seen at spots, shape (..., 2); -1 for none."""
    right, up, towards = view.axes
    eyes = spots[..., :1] * right + spots[..., 1:] * up
    best = np.full(spots.shape[:-1], -np.inf)
    seen = np.full((2, *spots.shape[:-1]), -1)
    for number, faces in enumerate(bodies):
        for place, (corners, normal) in enumerate(faces):
            facing = normal @ towards
            if facing <= 1e-9:
                continue
            depth = ((corners[0] - eyes) @ normal) / facing
            hit = eyes + depth[..., None] * towards
            inside = np.ones(best.shape, bool)
            for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                inside &= (hit - one) @ np.cross(normal, other - one) >= 0
            nearer = inside & (depth > best)
            best[nearer] = depth[nearer]
            seen[:, nearer] = [[number], [place]]
    return seen[0], seen[1]
