"""Landmarks of Y -> points on the surface of X."""

import numpy as np

from jfsf.apps.landmarks import Landmarks
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.transfer._laid import Laid
from jfsf.apps.transfer._points import Points, nearest, place, sides, target


def landmarks(laid: Laid, landmarks_y: Landmarks) -> Landmarks:
    """Landmarks carried from Y to X.

    Each is a point of the surface of Y. The nearest point of X, where it lies on Y, is
    taken there, and is a point of a triangle of X.

    Args:
        laid: X and Y laid on each other (`lay`).
        landmarks_y: points in Y's coordinates, or vertices of Y.

    Returns:
        Points on X, in its coordinates, with the names and the order of the landmarks.
        The system is that of the landmarks: both meshes are taken to have the same
        axes. `said` names those where Y has a surface and X has none.

    Raises:
        ValueError: as `jfsf.apps.landmarks.on_surface`; or a landmark on a piece of Y
            that was not matched, so that it has no place (`extended`).
    """
    at = on_surface(landmarks_y, laid.mesh_y)
    x, y = sides(laid)
    weights = np.asarray(at.weights)
    points = Points(np.full(len(weights), -1), np.asarray(at.corners), weights)
    at_y, normals = place(y, points)
    nowhere = np.flatnonzero(~np.isfinite(at_y).all(1))
    if len(nowhere):
        raise ValueError(
            f"landmarks: {_named(landmarks_y, nowhere)} lie on pieces of Y that were "
            "not matched; leave them out"
        )
    found = nearest(target(x), at_y, normals)
    vertices = np.asarray(laid.mesh_x.vertices, np.float64)
    on_x = np.einsum("lc,lcd->ld", found.weights, vertices[found.corners])
    said = [*landmarks_y.said]
    unknown = np.flatnonzero(~laid.known_x[found.corners].all(1))
    if len(unknown):
        names = _named(landmarks_y, unknown)
        said.append(f"{len(unknown)} lie where the map counts for nothing: {names}")
    return Landmarks(
        tuple(landmarks_y.names), on_x, None, landmarks_y.system, tuple(said)
    )


def _named(landmarks: Landmarks, rows: np.ndarray) -> list[str]:
    """Names of some of them; where they have none, their numbers from 1."""
    return [landmarks.names[i] or str(i + 1) for i in rows.tolist()]
