"""Points of a mesh: the nearest ones to points in space, or its vertices."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import face_areas
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
    """The point of the mesh nearest to each point, exactly (`jfsf.mesh.closest`).

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
    found = closest(surface_tree(Mesh(vertices, faces)), points)
    corners = faces[found.face].astype(np.int64)
    return Nearest(corners, found.barycentric, found.position, found.distance)


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
