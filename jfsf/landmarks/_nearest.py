"""The point of a surface that is nearest to a point, in space: exact, in float64."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from trimesh.triangles import closest_point, points_to_barycentric

from jfsf.mesh import face_areas
from jfsf.types import ArrayLike, Mesh


class Nearest(NamedTuple):
    """Points of a mesh.

    corners: (l, 3) the vertices of the triangle that each lies on; three times the same
        where it is a vertex.
    weights: (l, 3) barycentric coordinates.
    points: (l, 3) coordinates.
    distances: (l,) to the points that were asked for.
    """

    corners: ArrayLike
    weights: ArrayLike
    points: ArrayLike
    distances: ArrayLike


def nearest_points(mesh: Mesh, points: ArrayLike) -> Nearest:
    """The point of the mesh nearest to each point.

    The centre of the nearest triangle is no farther from a point than the nearest
    vertex, and the radius of that triangle more. All triangles for which that holds are
    measured.

    Args:
        mesh: n vertices, m faces. Of a point cloud, and of a mesh without area, the
            nearest vertices are found.
        points: (l, 3), finite.
    """
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    points = np.asarray(points, np.float64)
    faces = faces[face_areas(vertices, faces) > 0]
    if len(faces) == 0:
        distances, at = KDTree(vertices).query(points)
        return at_vertices(mesh, at)._replace(distances=distances)
    triangles = vertices[faces]
    centres = triangles.mean(1)
    radii = np.linalg.norm(triangles - centres[:, None], axis=2).max(1)
    bounds = KDTree(vertices[np.unique(faces)]).query(points)[0]
    # Rounding must not lose the nearest.
    slack = 1e-9 * (np.ptp(vertices, axis=0).max() + bounds)
    near = KDTree(centres).query_ball_point(points, bounds + radii.max() + slack)
    face, found = np.empty(len(points), np.int64), np.empty_like(points)
    for i, point in enumerate(points):
        some = np.array(near[i])
        away = np.linalg.norm(centres[some] - point, axis=1) - radii[some]
        some = some[away <= bounds[i] + slack[i]]
        on = closest_point(triangles[some], np.tile(point, (len(some), 1)))
        best = np.linalg.norm(on - point, axis=1).argmin()
        face[i], found[i] = some[best], on[best]
    weights = points_to_barycentric(triangles[face], found).clip(0, 1)
    weights /= weights.sum(1, keepdims=True)
    distances = np.linalg.norm(found - points, axis=1)
    return Nearest(faces[face].astype(np.int64), weights, found, distances)


def at_vertices(mesh: Mesh, vertices: ArrayLike) -> Nearest:
    """Vertices of a mesh as its points, at distance 0.

    Args:
        mesh: n vertices.
        vertices: (l,) vertices, from 0 on.
    """
    vertices = np.asarray(vertices, np.int64)
    weights = np.zeros((len(vertices), 3))
    weights[:, 0] = 1
    points = np.asarray(mesh.vertices, np.float64)[vertices]
    corners = np.repeat(vertices[:, None], 3, axis=1)
    return Nearest(corners, weights, points, np.zeros(len(vertices)))
