"""Landmarks on a mesh, as its vertices or points of its surface."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.apps.landmarks._record import Landmarks, checked, titled
from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import face_areas
from jfsf.mesh._values import check_values, mesh_arrays
from jfsf.types import ArrayLike, Mesh

# Distances from the surface within which a landmark is expected, and beyond which it is
# refused, in diagonals of the bounding box of the mesh. Landmarks by hand, or of a copy
# with other vertices, are within 0.01; those in other units or axes seldom within 0.05.
NEAR, FAR = 0.01, 0.05


class Placed(NamedTuple):
    """Landmarks as points of a mesh.

    corners: (l, 3) int64, the vertices of the triangle that each lies on; three times
        the same where it is a vertex.
    weights: (l, 3) barycentric coordinates, of sum 1; nan for a point that is.
    points: (l, 3) float64, in the coordinates of the mesh.
    distances: (l,) from the landmark to that point, in units of the mesh.
    """

    corners: ArrayLike
    weights: ArrayLike
    points: ArrayLike
    distances: ArrayLike

    def on(self, vertices: ArrayLike) -> np.ndarray:
        """The points, where the vertices of the mesh lie so."""
        corners = np.asarray(vertices, float)[self.corners]
        return np.einsum("lc,lci->li", self.weights, corners)


class AtVertices(NamedTuple):
    """Landmarks as vertices of a mesh.

    vertices: (l,) int64, from 0 on.
    distances: (l,) from the landmark to that vertex, in units of the mesh.
    said: what was noticed, a sentence each.
    """

    vertices: ArrayLike
    distances: ArrayLike
    said: list[str]


def to_vertices(landmarks: Landmarks, mesh: Mesh) -> AtVertices:
    """The vertex of a mesh for each landmark.

    It is the nearest corner of the triangle that is nearest to the landmark. On thin
    parts the nearest of all vertices may be on the other side; and a vertex without a
    face is none. Of a point cloud it is the nearest vertex.

    Args:
        landmarks: points in the coordinates of the mesh; or vertices, which are only
            checked.
        mesh: n vertices, m faces.

    Raises:
        ValueError: as `on_surface`.
    """
    placed = on_surface(landmarks, mesh)
    landmarks = checked(landmarks, "to_vertices")
    if landmarks.vertices is not None:
        return AtVertices(landmarks.vertices, placed.distances, [])
    corners = np.asarray(mesh.vertices, np.float64)[placed.corners]
    away = np.linalg.norm(corners - np.asarray(landmarks.points)[:, None], axis=2)
    best = away.argmin(1)[:, None]
    vertices = np.take_along_axis(placed.corners, best, 1)[:, 0]
    said = _shared(landmarks.names, vertices)
    return AtVertices(vertices, np.take_along_axis(away, best, 1)[:, 0], said)


def on_surface(landmarks: Landmarks, mesh: Mesh) -> Placed:
    """The point of the surface that is nearest to each landmark.

    Args:
        landmarks: points in the coordinates of the mesh; or vertices.
        mesh: n vertices, m faces; of a point cloud the nearest vertices are found.
            Vertices that are not finite are passed over, with their faces.

    Raises:
        ValueError: a landmark is farther from the mesh than `FAR` of the diagonal of
            its bounding box, or is a vertex that it does not have; three or more are
            nearer to each other than to the mesh; wrong shapes.
    """
    landmarks = checked(landmarks, "on_surface")
    vertices, faces = mesh_arrays(mesh, "on_surface")
    check_values(vertices, faces, "on_surface", finite=False)
    finite = np.asarray(np.isfinite(vertices).all(1))
    if not finite.any():
        check_values(vertices, faces, "on_surface")
    if not finite.all():
        faces = faces[finite[faces].all(1)]
        vertices = np.where(finite[:, None], vertices, vertices[finite][0])
        mesh = Mesh(vertices, faces)
    names = landmarks.names
    if landmarks.vertices is not None:
        wrong = (landmarks.vertices < 0) | (landmarks.vertices >= len(vertices))
        if len(lost := np.flatnonzero(wrong)):
            raise ValueError(
                f"{titled(names, lost[0])} is vertex {landmarks.vertices[lost[0]]}, "
                f"and the mesh has {len(vertices)} vertices, from 0 on; is the file of "
                "another mesh?"
            )
        if len(lost := np.flatnonzero(~finite[landmarks.vertices])):
            raise ValueError(
                f"{titled(names, lost[0])} is vertex {landmarks.vertices[lost[0]]}, "
                "which has no finite place; leave the landmark out"
            )
        return _at_vertices(mesh, landmarks.vertices)
    if not names:
        return _at_vertices(mesh, np.zeros(0, np.int64))
    diagonal = float(np.linalg.norm(np.ptp(vertices.astype(np.float64), axis=0)))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    with np.errstate(over="ignore"):
        outside = np.maximum(low - landmarks.points, landmarks.points - high).max(1)
    # First those outside of the box: squares of their distances may be infinite.
    _refuse_far(landmarks, outside, diagonal)
    placed = nearest(mesh, landmarks.points)
    _refuse_far(landmarks, placed.distances, diagonal)
    _refuse_small(landmarks, placed.distances, diagonal)
    return placed


def as_points(landmarks: Landmarks, mesh: Mesh) -> Landmarks:
    """Landmarks as points; those that are vertices, where these lie.

    Args:
        landmarks: points in the coordinates of the mesh; or vertices.
        mesh: n vertices, m faces.

    Raises:
        ValueError: as `on_surface`.
    """
    at = on_surface(landmarks, mesh)
    if landmarks.vertices is None:
        return landmarks
    return landmarks._replace(points=at.points, vertices=None)


def _refuse_far(landmarks: Landmarks, away: ArrayLike, diagonal: float) -> None:
    worst = int(away.argmax())
    if away[worst] > FAR * diagonal:
        system = ""
        if landmarks.system:
            system = (
                f" The file is in {landmarks.system}; if the mesh is not, reverse the "
                "signs of x and y."
            )
        raise ValueError(
            f"{titled(landmarks.names, worst)} is {away[worst]:.4g} from the mesh, "
            f"more than {FAR:.0%} of the diagonal of its bounding box "
            f"({diagonal:.4g}); are both in the same units and axes, and is the file "
            f"of another mesh, or of one that was moved?{system}"
        )


def _refuse_small(landmarks: Landmarks, away: ArrayLike, diagonal: float) -> None:
    # In metres they all are near the origin, and that may be near a mesh in mm.
    spread = float(np.linalg.norm(np.ptp(np.asarray(landmarks.points), axis=0)))
    if len(landmarks.names) > 2 and spread < np.max(away):
        raise ValueError(
            f"all landmarks lie within {spread:.4g} of each other, and up to "
            f"{np.max(away):.4g} from the mesh, whose bounding box has a diagonal of "
            f"{diagonal:.4g}; are both in the same units, and is it the right mesh?"
        )


def _shared(names: tuple[str, ...], vertices: ArrayLike) -> list[str]:
    """That two landmarks are at one vertex."""
    _, first, at = np.unique(vertices, return_index=True, return_inverse=True)
    first = first[at]
    return [
        f"{titled(names, first[i])} and {titled(names, i)} are both at vertex "
        f"{vertices[i]}: the mesh is coarse there"
        for i in map(int, np.flatnonzero(first != np.arange(len(names))))
    ]


def nearest(mesh: Mesh, points: ArrayLike) -> Placed:
    """The point of the mesh nearest to each point, exactly (`jfsf.mesh.closest`).

    Args:
        mesh: n vertices, m faces. Of a point cloud, and of a mesh without area, the
            nearest vertices are found.
        points: (l, 3); nan for one that is missing.
    """
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    points = np.asarray(points, np.float64)
    known = np.isfinite(points).all(1, keepdims=True)
    points = np.where(known, points, vertices[:1])
    faces = faces[face_areas(vertices, faces) > 0]
    if len(faces) == 0:
        distances, vertex = KDTree(vertices).query(points)
        found = _at_vertices(mesh, vertex)._replace(distances=distances)
    else:
        at = closest(surface_tree(Mesh(vertices, faces)), points)
        corners = faces[at.face].astype(np.int64)
        found = Placed(corners, at.barycentric, at.position, at.distance)
    there = lambda values: np.where(known, values, np.nan)
    return found._replace(weights=there(found.weights), points=there(found.points))


def _at_vertices(mesh: Mesh, vertices: ArrayLike) -> Placed:
    """Vertices of a mesh as its points, at distance 0."""
    vertices = np.asarray(vertices, np.int64)
    weights = np.zeros((len(vertices), 3))
    weights[:, 0] = 1
    points = np.asarray(mesh.vertices, np.float64)[vertices]
    corners = np.repeat(vertices[:, None], 3, axis=1)
    return Placed(corners, weights, points, np.zeros(len(vertices)))
