"""Landmarks of one shape carried to another along a map between their vertices."""

import numpy as np

from jfsf.apps.landmarks._nearest import nearest_points
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.landmarks._record import Landmarks
from jfsf.mesh._values import check_values
from jfsf.types import ArrayLike, Mesh

# Images of two corners of a triangle that are farther apart than this share of the
# diagonal of X's bounding box, and than the corners are this many times over, are a
# tear of the map: their mean would be between two places.
TORN, STRETCHED = 0.1, 4


def carry_landmarks(
    landmarks: Landmarks, mesh_y: Mesh, mesh_x: Mesh, T_yx: ArrayLike
) -> Landmarks:
    """Landmarks of Y, carried to X.

    Each is a point of a triangle of Y (`on_surface`). The images of the three corners
    on X are averaged with its barycentric coordinates, and the nearest point of the
    surface of X is taken. Where the map tears a triangle apart, only the images near
    that of the nearest corner count. To carry landmarks of X to Y, exchange the meshes
    and give `T_xy`.

    Args:
        landmarks: on Y: points in its coordinates, or vertices of it.
        mesh_y: where they are; n_y vertices.
        mesh_x: where they go; n_x vertices. Of a point cloud the nearest vertex is
            taken.
        T_yx: (n_y,) the vertex of X for each vertex of Y, as `Match.T_yx`.

    Returns:
        Points on X, in its coordinates, with the names and the order of the landmarks.
        The system is that of Y: both meshes are taken to have the same axes.

    Raises:
        ValueError: as `on_surface`; or T_yx is no map from Y to X.
    """
    found = on_surface(landmarks, mesh_y)
    vertices, faces = np.asarray(mesh_x.vertices), np.asarray(mesh_x.faces)
    check_values(vertices, faces, "carry_landmarks: mesh_x")
    vertices = vertices.astype(np.float64)
    T_yx, n_y = np.asarray(T_yx), len(mesh_y.vertices)
    if T_yx.shape != (n_y,) or T_yx.dtype.kind not in "iu":
        raise ValueError(
            f"carry_landmarks: T_yx is {T_yx.dtype} {T_yx.shape}, expected whole "
            f"numbers ({n_y},): the vertex of X for each of Y"
        )
    if len(T_yx) and not 0 <= T_yx.min() <= T_yx.max() < len(vertices):
        raise ValueError(
            f"carry_landmarks: T_yx names vertices {T_yx.min()} to {T_yx.max()}, and X "
            f"has {len(vertices)}, from 0 on; does it run the other way?"
        )
    if not landmarks.names:
        return Landmarks((), np.zeros((0, 3)), None, found.system)
    images = vertices[T_yx[found.corners]]
    near = _together(images, found, vertices, np.asarray(mesh_y.vertices, np.float64))
    weights = np.where(near, found.weights, 0)
    weights /= weights.sum(1, keepdims=True)
    on_x = nearest_points(mesh_x, (weights[:, :, None] * images).sum(1)).points
    said = (*landmarks.said, *found.said)
    return Landmarks(tuple(landmarks.names), on_x, None, found.system, said)


def _together(images, found, vertices_x, vertices_y):
    """Whether the image of each corner (l, 3) is where that of the nearest one is."""
    heaviest = found.weights.argmax(1)[:, None, None]
    corners = vertices_y[found.corners]
    on_x, on_y = (
        np.linalg.norm(a - np.take_along_axis(a, heaviest, 1), axis=2)
        for a in (images, corners)
    )
    size_x, size_y = (
        np.linalg.norm(np.ptp(v, axis=0)) for v in (vertices_x, vertices_y)
    )
    return (on_x <= TORN * size_x) | (on_x * size_y <= STRETCHED * on_y * size_x)
