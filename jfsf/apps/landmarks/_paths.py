"""Geodesics between points of a surface, and points along them.

Shortest paths along edges, straightened by edge flips (Sharp and Crane 2020, "You can
find geodesic paths in triangle meshes by just flipping edges"; potpourri3d). They are
exact on the triangles, but for their ends, which may lie up to 2 % of an edge away.
"""

import numpy as np
import potpourri3d as pp3d
from trimesh.triangles import points_to_barycentric

from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import face_areas
from jfsf.types import Mesh

# A path ends in a vertex, so one is put at each point, but no nearer to an edge than
# this share of a triangle's height, and none nearer to a corner than twice this.
_CLEAR = 0.01


def length_of(line) -> float:
    """The length of a polygonal line."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def at_shares(line, shares) -> np.ndarray:
    """Points of a polygonal line at these shares of its length."""
    along = np.append(0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
    return np.stack(
        [np.interp(shares * along[-1], along, line[:, i]) for i in range(3)], 1
    )


class Paths:
    """Geodesics between points of a mesh.

    Each point becomes a vertex of the mesh.
    """

    def __init__(self, mesh: Mesh, points: np.ndarray):
        """Points lie on the mesh."""
        vertices, faces, self._at = _with_vertices(mesh, points)
        used, corners = np.unique(faces, return_inverse=True)
        self._at = np.searchsorted(used, self._at)
        self._points = points
        try:
            self._solver = pp3d.EdgeFlipGeodesicSolver(
                vertices[used], corners.reshape(-1, 3)
            )
        except RuntimeError:
            raise ValueError(
                "semilandmarks need a template that is a manifold, wound one way: "
                "add --repair"
            ) from None

    def between(self, a: int, b: int) -> np.ndarray:
        """The points of the path from one point to another."""
        ends = self._points[[a, b]]
        if self._at[a] == self._at[b]:
            return ends
        line = self._solver.find_geodesic_path(int(self._at[a]), int(self._at[b]))
        return np.concatenate([ends[:1], np.asarray(line)[1:-1], ends[1:]])


def _with_vertices(mesh: Mesh, points: np.ndarray):
    """Vertices and faces with a vertex near each point, and the number of it."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
    kept = np.flatnonzero(face_areas(vertices, faces) > 0)
    surface = surface_tree(Mesh(vertices, faces[kept]))
    places, corners = list(vertices), list(faces)
    parts: dict[int, list[int]] = {}  # of a face that was split
    at = []
    found = kept[closest(surface, points).face] if len(points) else []
    for face, point in zip(found, points, strict=True):
        own = parts.setdefault(int(face), [int(face)])
        triangles = np.array([[places[v] for v in corners[part]] for part in own])
        weights = points_to_barycentric(triangles, np.repeat(point[None], len(own), 0))
        best = int(weights.min(1).argmax())
        weight, (a, b, c) = weights[best], corners[own[best]]
        if weight.max() > 1 - 2 * _CLEAR:
            at.append(int((a, b, c)[weight.argmax()]))
            continue
        weight = np.maximum(weight, _CLEAR)
        new = len(places)
        places.append(weight / weight.sum() @ triangles[best])
        corners[own[best]] = np.array([a, b, new])
        own += [len(corners), len(corners) + 1]
        corners += [np.array([b, c, new]), np.array([c, a, new])]
        at.append(new)
    return np.array(places), np.array(corners), np.array(at, int)
